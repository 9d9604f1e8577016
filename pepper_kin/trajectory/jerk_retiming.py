"""Timing along a path with velocity, acceleration, jerk and torque limited at once.

The time-optimal motion without jerk limits is smoothed by a moving average over time.  Its time tau then
becomes a new path parameter, Q(tau) = q(s(tau)), along which the robot starts at rest, and the rate y = (d
tau / dt)^2 > 0 is optimized:

    dq/dt = sqrt(y) Q',   d2q/dt2 = y Q'' + y' Q' / 2,
    d3q/dt3 = sqrt(y) (y Q''' + 3 y' Q'' / 2 + y'' Q' / 2).

Limits on velocity, acceleration, torque and balance are linear in y and y'.  Jerk limits, divided by sqrt(y),
have the convex function J / sqrt(y) on their right-hand side; its tangent lies below it, so that steps within
the tangents at the previous y keep the limit (convex-concave constraints: F. Debrouwere et al., IEEE Trans.
Robotics 29, 2013).  y is a quadratic spline in tau, so that jerk is smooth between its knots, and the search
for it an interior-point method, `pepper_kin.core.timing.rate_program`.

A motion that begins with given ds/dt and d2s/dt2 joins the motion from rest: a polynomial of degree 5 leads
from the start to the state of that motion at some instant.  Of all instants, durations and slower motions
from rest that are tried, the combination that ends soonest and keeps all limits is taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.splines import derivatives_on_segments
from pepper_kin.core.timing.joining import next_way
from pepper_kin.core.timing.rate_program import fastest_rate
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.active_limits import measure_use, stretch_at_extremes
from pepper_kin.trajectory.examined_states import extremes_of
from pepper_kin.trajectory.limits import Limits
from pepper_kin.trajectory.path import LIMIT_TOLERANCE, CubicPath
from pepper_kin.trajectory.samples import Samples, sample_times
from pepper_kin.trajectory.smooth_time import SmoothTime, rate_program, smooth_time, to_powers
from pepper_kin.trajectory.time_optimal import refuse_long
from pepper_kin.trajectory.trajectory import Trajectory

_GAP = 5e-3  # relative gap of the duration at which the interior-point method stops
_STEPS = 60  # maximum number of interior-point steps
_PARTS = (3, 6, 12, 24)  # polynomials for each piece of y; more if positions leave their limits
_WINDOW = 2.5  # width of the moving average, relative to the time in which acceleration builds up
_SHARES = (0.1, 0.8)  # minimum and maximum of that width, relative to the duration without jerk limits
_JOINS = 64  # number of instants at which a motion may join the motion from rest
_DURATIONS = (0.4, 2.5, 24)  # of the joining motion over the even one's: minimum, maximum, number tried
_SLOWER = (1.0, 1.02, 1.06, 1.15, 1.3)  # slow-downs of the motion from rest, which may then be joined sooner
_PIECE = 0.005  # length of the polynomials of the joining motion [s]
_TOLERANCE = 1e-9
_MORE = 1.0 + 1e-6
_SHARE_OF_MARGIN = 0.999  # fraction of the limits used by the program, for excess between its points


@dataclass(frozen=True, eq=False)
class _Rate:
    """Rate y and its derivatives in tau at the starts of pieces, shape (K,) each; knots [s], (K + 1,)."""

    knots: Array
    value: Array
    slope: Array
    bend: Array

    def at(self, segment: NDArray[np.intp], local: Array) -> tuple[Array, Array, Array]:
        """Return y, y' [1/s] and y'' [1/s^2], shape (...), at local times [s] on pieces, broadcast."""
        bend = self.bend[segment]
        slope = self.slope[segment] + local * bend
        return self.value[segment] + local * (self.slope[segment] + local * bend / 2), slope, bend


def limit_jerk(
    pepper: PepperModel,
    curve: CubicPath,
    fastest: Trajectory,
    s: Array,
    limits: Limits,
    start: tuple[float, float] = (0.0, 0.0),
) -> Trajectory:
    """Return a fast trajectory along a path to rest that keeps jerk limits in addition to all others.

    Accelerations are continuous and zero at the end, and at a start at rest.  Positions lie on the path at
    the knots, which are some milliseconds apart, and between the knots to the accuracy of quintic
    interpolation.

    Args:
        pepper: The robot.
        curve: The path.
        fastest: The time-optimal trajectory without jerk limits.
        s: Path parameter at its knots, shape (N + 1,).
        limits: The limits, including jerk; inf for none.
        start: Initial ds/dt and d2s/dt2 of the motion.

    Returns:
        The trajectory.  Velocity, acceleration and jerk keep their limits at every instant, the other
        quantities at knots and multiples of 1 ms.

    Raises:
        InfeasibleError: if no motion from the start was found.
    """
    assert limits.jerk is not None
    jerk, velocity, acceleration = (
        _SHARE_OF_MARGIN * most for most in (limits.jerk, limits.velocity, limits.acceleration)
    )
    base = smooth_time(curve, fastest.breaks, s, _window(limits.acceleration, limits.jerk, fastest.duration))
    inner = replace(limits, velocity=velocity, acceleration=acceleration, jerk=jerk)
    program, y = rate_program(pepper, curve, base, inner), np.empty(base.knots.size + 1)
    if fastest_rate(program, y, _GAP, _STEPS) == np.inf:
        raise _cannot_rest()
    coefficients = y[np.arange(base.knots.size - 1)[:, None] + np.arange(3)]
    rate = _Rate(base.knots, *np.einsum("kdc,kc->dk", to_powers(base.knots), coefficients))
    for parts in _PARTS:
        trajectory, law = _trajectory(pepper, curve, base, rate, parts)
        if _keeps_positions(pepper, trajectory):
            break
    slow = _within(pepper, trajectory, limits)
    if start == (0.0, 0.0):
        return slow
    stretch = slow.duration / trajectory.duration
    return _from_motion(pepper, curve, slow, law / stretch ** np.arange(3.0)[:, None], limits, start)


def _window(acceleration: Array, jerk: Array, duration: float) -> float:
    """Return the width of the moving average [s].

    Args:
        acceleration: Acceleration limits [rad/s^2 or m/s^2], shape (n,).
        jerk: Jerk limits [rad/s^3 or m/s^3], shape (n,).
        duration: Duration of the motion without jerk limits [s].
    """
    both = np.isfinite(acceleration) & np.isfinite(jerk)
    build_up = float(np.max(acceleration[both] / jerk[both])) if both.any() else 0.0
    return float(np.clip(_WINDOW * build_up, _SHARES[0] * duration, _SHARES[1] * duration))


def _keeps_positions(pepper: PepperModel, trajectory: Trajectory) -> bool:
    """Whether quintics, whose ends lie on the path, keep the position limits between their ends too."""
    found = extremes_of(trajectory.breaks, trajectory.coefficients)
    outside = np.maximum(found.high - pepper.upper_limits, pepper.lower_limits - found.low)
    return bool(outside.max() <= LIMIT_TOLERANCE)


def _trajectory(
    pepper: PepperModel, curve: CubicPath, base: SmoothTime, rate: _Rate, parts: int
) -> tuple[Trajectory, Array]:
    """Return quintics in time through states on the path, and the time law at these states.

    The states are at the knots of y and at instants that cut each piece into `parts`.  The time law is s and
    its first two derivatives in time, shape (3, K).
    """
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
    s, s1, s2, _ = base.at(segments, local)
    law = np.stack([s, np.sqrt(y) * s1, y * s2 + slope * s1 / 2])
    return _through(pepper, time, q, velocity, acceleration), law


def _through(pepper: PepperModel, time: Array, q: Array, velocity: Array, acceleration: Array) -> Trajectory:
    return Samples(pepper.joint_names, time, q, velocity, acceleration, pepper.joint_units).to_trajectory()


def _from_motion(
    pepper: PepperModel, curve: CubicPath, slow: Trajectory, law: Array, limits: Limits,
    start: tuple[float, float],
) -> Trajectory:  # fmt: skip
    """Return the soonest motion within limits from a moving start that joins a motion from rest.

    Args:
        pepper: The robot.
        curve: The path.
        slow: The motion from rest.
        law: s, ds/dt and d2s/dt2 at the breaks of the motion from rest, shape (3, K).
        limits: The limits.
        start: Initial ds/dt and d2s/dt2.

    Raises:
        InfeasibleError: if none was found.
    """
    assert limits.jerk is not None
    joins = np.unique(np.linspace(1, slow.breaks.size - 1, _JOINS).astype(int))
    slower, joins, longer = (
        grid.ravel() for grid in np.meshgrid(_SLOWER, joins, np.geomspace(*_DURATIONS), indexing="ij")
    )
    ends = law[:, joins] / slower ** np.arange(3.0)[:, None]
    times = longer * 2.0 * (ends[0] - law[0, 0]) / (start[0] + ends[1] + _TOLERANCE)
    order = np.argsort(times + slower * (slow.duration - slow.breaks[joins]), kind="stable")
    slower, joins, times = slower[order], joins[order], times[order]
    first = np.array([law[0, 0], *start])[:, None]
    ways = _quintics(times, np.broadcast_to(first, (3, times.size)), ends[:, order])
    bounds = (1.0 + _TOLERANCE) * np.stack([limits.velocity, limits.acceleration, limits.jerk])
    way = -1
    while (way := next_way(curve.breaks, curve.coefficients, ways, times, bounds, way + 1)) >= 0:
        local = np.linspace(0.0, times[way], math.ceil(times[way] / _PIECE) + 2)
        begun = _through(pepper, local, *_along(curve, ways[way], local))
        state = begun(sample_times(begun.duration, 0.001))
        stretch = max(stretch_at_extremes(begun, limits), measure_use(pepper, state, limits).stretch)
        if stretch <= 1.0 + _TOLERANCE and _keeps_positions(pepper, begun):
            if joins[way] == slow.breaks.size - 1:
                return begun
            late = slow.scaled(slower[way])
            return begun.then(late.between(late.breaks[joins[way]], late.duration))
    raise InfeasibleError(
        "start_velocity", "no way from it into the motion from rest keeps all limits",
        "a slower one, a longer path, or `Trajectory.replaced`",
    )  # fmt: skip


def _quintics(times: Array, start: Array, end: Array) -> Array:
    """Return polynomials of degree 5 between states, shape (3, m) each, in times [s], (m,): shape (m, 6)."""
    h = times
    (p, v, a), (p1, v1, a1) = start, end
    d, e, f = p1 - p - h * (v + h * a / 2), h * (v1 - v - h * a), h * h * (a1 - a)
    third, fourth, fifth = 10 * d - 4 * e + f / 2, -15 * d + 7 * e - f, 6 * d - 3 * e + f / 2
    return np.stack([p, v, a / 2, third / h**3, fourth / h**4, fifth / h**5], axis=1)


def _along(curve: CubicPath, way: Array, local: Array) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration at local times [s], (T,), of a quintic s(t), shape (6,)."""
    s, s1, s2 = derivatives_on_segments(way[None, :, None], 0, local, 3)
    inside = np.clip(s[:, 0], curve.breaks[0], curve.breaks[-1])
    piece = np.clip(np.searchsorted(curve.breaks, inside, side="right") - 1, 0, curve.breaks.size - 2)
    q, q1, q2 = derivatives_on_segments(curve.coefficients, piece, inside - curve.breaks[piece], 3)
    return q, q1 * s1, q2 * s1**2 + q1 * s2


def _within(pepper: PepperModel, trajectory: Trajectory, limits: Limits) -> Trajectory:
    """Slow a motion down, if necessary, until all limits hold.

    Velocity, acceleration and jerk keep their limits at every instant, the other quantities at the knots and
    at every multiple of 1 ms.
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
