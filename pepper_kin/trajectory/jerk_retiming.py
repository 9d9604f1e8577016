"""Timing along a path with velocity, acceleration, jerk and torque limited at once.

The time-optimal motion without jerk limits is smoothed by a moving average over time and made slower until
it keeps all limits.  Its time tau then becomes a new path parameter, Q(tau) = q(s(tau)), along which the
robot sets out with zero speed, and the rate y = (d tau / dt)^2 > 0 is improved:

    dq/dt = sqrt(y) Q',   d2q/dt2 = y Q'' + y' Q' / 2,
    d3q/dt3 = sqrt(y) (y Q''' + 3 y' Q'' / 2 + y'' Q' / 2).

Limits on velocity, acceleration, torque and balance are linear in y and y'.  Those on jerk, divided by
sqrt(y), have the convex function J / sqrt(y) on their right; its tangent lies below it, so that a linear
program with tangents at the last y leaves only motions that keep the limit, and its solution is at least as
fast.  (Sequential convex programming of convex-concave constraints: F. Debrouwere et al., IEEE Trans.
Robotics 29, 2013.)  y is a quadratic spline in tau, so that jerk is smooth between its knots.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.extremes import extremes_of
from pepper_kin.trajectory.jerk_rows import Rows, make_rows
from pepper_kin.trajectory.limit_use import measure_use, stretch_at_extremes
from pepper_kin.trajectory.limits import Limits
from pepper_kin.trajectory.path import LIMIT_TOLERANCE, CubicPath
from pepper_kin.trajectory.samples import Samples
from pepper_kin.trajectory.sampling import sample_times
from pepper_kin.trajectory.smooth_time import SmoothTime, smooth_time
from pepper_kin.trajectory.time_optimal import refuse_long
from pepper_kin.trajectory.trajectory import Trajectory

_ITERATIONS = 12  # linear programs
_ENOUGH = 1e-3  # gain of duration below which to stop
_TRUST = 2.0  # factor by which y may change in one step
_PARTS = (3, 6, 12, 24)  # polynomials for each piece of y, more where positions leave their limits
_WINDOWS = (0.6, 1.0, 1.6)  # of the time in which acceleration may build up, and
_SHARES = (0.05, 0.2, 0.6)  # of the duration without jerk limits: widths of the moving average to try
_TOLERANCE = 1e-9
_MORE = 1.0 + 1e-6
_SHARE_OF_MARGIN = 0.999  # of limits, for what is between the points that the programs look at


@dataclass(frozen=True, eq=False)
class _Rate:
    """y and its derivatives in tau, shape (K,) each, at the starts of pieces between knots [s], (K + 1,)."""

    knots: Array
    value: Array
    slope: Array
    bend: Array

    def at(self, segment: NDArray[np.intp], local: Array) -> tuple[Array, Array, Array]:
        """Return y, y' [1/s] and y'' [1/s^2], shape (...), at local times [s] on pieces, which broadcast."""
        bend = self.bend[segment]
        slope = self.slope[segment] + local * bend
        return self.value[segment] + local * (self.slope[segment] + local * bend / 2), slope, bend


def limit_jerk(
    pepper: PepperModel, curve: CubicPath, fastest: Trajectory, s: Array, limits: Limits
) -> Trajectory:
    """Return a fast trajectory along a path that keeps jerk limits too, from rest to rest.

    Accelerations are continuous and zero at both ends.  Positions lie on the path at the knots, and between
    them, some milliseconds apart, to the accuracy of quintic interpolation.

    Args:
        pepper: The robot.
        curve: The path.
        fastest: The time-optimal trajectory without jerk limits.
        s: Path parameter at its knots, shape (N + 1,).
        limits: The limits, those of jerk among them, inf for none.

    Returns:
        The trajectory; see `_within` for where limits hold.
    """
    assert limits.jerk is not None
    jerk, velocity, acceleration = (
        _SHARE_OF_MARGIN * most for most in (limits.jerk, limits.velocity, limits.acceleration)
    )
    inner = replace(limits, velocity=velocity, acceleration=acceleration)
    best: tuple[float, SmoothTime, Rows, Array] | None = None
    for window in _windows(limits.acceleration, limits.jerk, fastest.duration):
        base = smooth_time(curve, fastest.breaks, s, window)
        rows = make_rows(pepper, curve, base, inner, jerk)
        if not rows.can_rest():
            raise _cannot_rest()
        y = np.full(base.knots.size + 1, rows.greatest_even_rate())
        if best is None or rows.duration(y) < best[0]:
            best = rows.duration(y), base, rows, y
    assert best is not None  # there is at least one window
    _, base, rows, y = best
    duration = rows.duration(y)
    for _ in range(_ITERATIONS):
        better = rows.improved(y, _TRUST)
        if better is None:
            break
        gain = 1.0 - rows.duration(better) / duration
        if gain > 0:
            y, duration = better, rows.duration(better)
        if gain < _ENOUGH:
            break
    rate = _Rate(base.knots, *rows.polynomials(y))
    for parts in _PARTS:
        trajectory = _trajectory(pepper, curve, base, rate, parts)
        if _keeps_positions(pepper, trajectory):
            break
    return _within(pepper, trajectory, limits)


def _windows(acceleration: Array, jerk: Array, duration: float) -> list[float]:
    """Return widths of the moving average to try [s].

    Args:
        acceleration: Limits [rad/s^2 or m/s^2], shape (n,).
        jerk: Limits [rad/s^3 or m/s^3], shape (n,).
        duration: Of the motion without jerk limits [s].
    """
    both = np.isfinite(acceleration) & np.isfinite(jerk)
    build_up = float(np.max(acceleration[both] / jerk[both])) if both.any() else 0.1 * duration
    widths = [share * build_up for share in _WINDOWS] + [share * duration for share in _SHARES]
    return [width for width in widths if 0.02 * duration < width < duration]  # never empty: the last two


def _keeps_positions(pepper: PepperModel, trajectory: Trajectory) -> bool:
    """Whether quintics, which lie on the path at their ends, keep the position limits between these too."""
    found = extremes_of(trajectory.breaks, trajectory.coefficients)
    outside = np.maximum(found.high - pepper.upper_limits, pepper.lower_limits - found.low)
    return bool(outside.max() <= LIMIT_TOLERANCE)


def _trajectory(
    pepper: PepperModel, curve: CubicPath, base: SmoothTime, rate: _Rate, parts: int
) -> Trajectory:
    """Return quintics in time through states at the knots of y and instants that cut each piece in parts."""
    step = np.diff(base.knots)
    segment = np.repeat(np.arange(step.size), parts)
    width = step[segment] / parts
    start = np.tile(np.arange(parts), step.size) * width
    node, weight = np.polynomial.legendre.leggauss(4)
    inside = start[:, None] + width[:, None] * (node + 1) / 2
    y = rate.at(segment[:, None], inside)[0]
    times = np.sum(weight / np.sqrt(y), axis=1) * width / 2
    segments, local = np.append(segment, segment[-1]), np.append(start, step[-1])
    q, first, second, _ = base.derivatives(curve, segments, local)
    y, slope, _ = rate.at(segments, local)
    velocity = np.sqrt(y)[:, None] * first
    acceleration = y[:, None] * second + slope[:, None] * first / 2
    time = np.concatenate([[0.0], np.cumsum(times)])
    return Samples(pepper.joint_names, time, q, velocity, acceleration, pepper.joint_units).to_trajectory()


def _within(pepper: PepperModel, trajectory: Trajectory, limits: Limits) -> Trajectory:
    """Slow down, where need be, until all limits hold.

    Those of velocity, acceleration and jerk at every instant, the others at the knots and at every multiple
    of 1 ms.
    """
    trajectory = trajectory.scaled(stretch_at_extremes(trajectory, limits))
    for _ in range(50):
        refuse_long(trajectory.duration)
        state = trajectory(np.concatenate([sample_times(trajectory.duration, 0.001), trajectory.breaks]))
        stretch = measure_use(pepper, state, limits).stretch
        if stretch <= 1.0 + _TOLERANCE:
            return trajectory
        if not np.isfinite(stretch):
            break
        trajectory = trajectory.scaled(stretch * _MORE)
    raise _cannot_rest()


def _cannot_rest() -> InfeasibleError:
    return InfeasibleError(
        "trajectory",
        "the path passes a posture that the robot can move through but cannot hold at rest",
        "leave jerk limits out, or choose a path with less load",
    )
