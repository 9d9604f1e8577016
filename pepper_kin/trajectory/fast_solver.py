"""Time-optimal speed along a path, in compiled code from the way-points to the polynomials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.trajectory.fast_effects import Effects
from pepper_kin.trajectory.fast_motion import (
    inspect,
    inspect_joints,
    instants,
    motion,
    polynomials,
    rows_at_nodes,
    speed_bound,
    times,
)
from pepper_kin.trajectory.fast_passes import passes
from pepper_kin.trajectory.fast_path import greatest_excess, nodes, spline
from pepper_kin.trajectory.limit_use import Limits
from pepper_kin.trajectory.path import LIMIT_TOLERANCE, SAME, PathLike

Array = NDArray[np.float64]

CHECK_STEP = 0.001  # [s]
_ROUNDS = 3  # solutions with tightened limits before settling for a slower one
_SMALL_STRETCH = 2e-4  # slowing down by less than this is cheaper than solving again
_MORE, _LEAST = 1.1, 2e-6  # stretch a little further than needed
_SHRINK = 1e-3  # share of limits left unused where time cannot be stretched
_TOLERANCE = 1e-9  # of a limit, for rounding
_GREATEST = 1e12  # squared speed where no velocity limit acts, in path lengths squared a second squared


@dataclass(frozen=True, eq=False)
class FastResult:
    """A time law and its polynomials, or where the search for one ended.

    Attributes:
        breaks: Times at the grid points [s], shape (N + 1,); None where there is no time law.
        coefficients: Constant term first, shape (N, 7, n).
        failed_at: Share of the path's length from which the end cannot be reached; None on success.
    """

    breaks: Array | None
    coefficients: Array | None
    failed_at: float | None = None


def interval_counts(breaks: Array, intervals: int) -> NDArray[np.int64]:
    """Return how many intervals each piece of a path has, at least `intervals` in all."""
    h = breaks[1:] - breaks[:-1]
    return np.maximum(1, np.ceil(intervals * h / (breaks[-1] - breaks[0]) - 1e-9)).astype(np.int64)


def quick_spline(pepper: PepperModel, path: PathLike) -> tuple[Array, Array] | None:
    """Return what `as_cubic_path` makes of way-points; None where it has something to say about them."""
    points = path if isinstance(path, np.ndarray) else None
    if points is None:
        try:
            points = np.asarray(path, dtype=float)
        except (TypeError, ValueError):
            return None
    if points.ndim != 2 or points.shape[1] != pepper.n or len(points) < 2 or points.dtype.kind not in "fiu":
        return None
    points = np.ascontiguousarray(points, dtype=float)
    if not points.flags.writeable:
        points = points.copy()
    if not np.isfinite(points).all():
        return None
    breaks, coefficients = spline(points)
    lower, upper = np.array(pepper.lower_limits), np.array(pepper.upper_limits)
    if (breaks[1:] - breaks[:-1]).min() <= SAME:
        return None
    if greatest_excess(breaks, coefficients, lower, upper) > LIMIT_TOLERANCE:
        return None
    return breaks, coefficients


def fast_time_law(
    pepper: PepperModel, breaks: Array, coefficients: Array, intervals: int, limits: Limits
) -> FastResult:
    """Return the fastest motion along a path from rest to rest that keeps limits.

    Velocity and acceleration keep their limits at every instant, the others at both ends of every interval
    and at every multiple of 1 ms.  Extremes of velocity and acceleration are looked for in each interval, and
    its middle for the others; where a limit is exceeded, that interval's is tightened by the excess before
    the passes are run again.  What is left is removed by stretching time.

    Args:
        pepper: The robot.
        breaks: Ends of the path's pieces, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n).
        intervals: Least number of intervals.
        limits: The limits.
    """
    search = _Search(pepper, breaks, coefficients, intervals, limits)
    found = search.stretched() if search.can_rest() else search.unstretched()
    if found is None:
        return FastResult(None, None, search.failed_at)
    x, stretch = found
    time = times(search.step, x) * stretch
    return FastResult(time, polynomials(search.taylor, search.step, x, stretch))


class _Search:
    """Passes and inspections along one path, with limits that are tightened on the way."""

    def __init__(
        self, pepper: PepperModel, breaks: Array, coefficients: Array, intervals: int, limits: Limits
    ) -> None:
        self.effects = Effects(pepper, limits)
        counts = interval_counts(breaks, intervals)
        self.step, self.first, at, self.taylor, self.s = nodes(breaks, coefficients, counts)
        self.velocity, self.acceleration = np.array(limits.velocity), np.array(limits.acceleration)
        self.n = pepper.n
        self.a, self.b, self.c, self.low, self.high = rows_at_nodes(
            at, self.first, self.step.size, self.acceleration, *_coefficients(self.effects, at)
        )
        greatest = _GREATEST * (self.s[-1] - self.s[0]) ** 2
        share = self.effects.speed(at[0], at[1])
        self.x_most = speed_bound(at, self.first, self.velocity, share, greatest)
        self.failed_at = 0.0

    def can_rest(self) -> bool:
        """Whether the robot could stand still at every grid point: then slower is always possible."""
        rest, low, high = self.c[:, self.n :], self.low[0, self.n :], self.high[0, self.n :]
        return bool(np.all((rest >= low) & (rest <= high)))

    def stretched(self) -> tuple[Array, float] | None:
        """Return x and how much slower the motion has to be than x says; None where there is no x."""
        best: tuple[float, float, Array] | None = None
        for _ in range(_ROUNDS):
            x = self._pass()
            if x is None:
                break
            stretch = self._joints(x)
            needed = max(stretch, self._rest(x, 1.0, 0.0, True))
            duration = times(self.step, x)[-1] * needed
            if np.isfinite(needed) and (best is None or duration < best[0]):
                best = duration, stretch, x
            if needed <= 1.0 + _SMALL_STRETCH:
                break
        if best is None:
            return None
        _, stretch, x = best
        while True:
            more = self._rest(x, stretch, CHECK_STEP, False)
            if more <= 1.0 + _TOLERANCE:
                return x, stretch
            if not np.isfinite(more):
                return None
            stretch *= 1.0 + _MORE * (more - 1.0) + _LEAST  # the instants looked at next are others

    def unstretched(self) -> tuple[Array, float] | None:
        """Return x that keeps all limits as it is: slower, the robot could not hold itself on the way."""
        self.low += _SHRINK * np.where(np.isfinite(self.low), np.abs(self.low), 0.0)
        self.high -= _SHRINK * np.where(np.isfinite(self.high), np.abs(self.high), 0.0)
        self.low[:, self.n + self.effects.torque_limit.size :] += _SHRINK
        self.x_most *= 1.0 - 2 * _SHRINK
        for _ in range(3 * _ROUNDS):
            x = self._pass()
            if x is None:
                return None
            if max(self._joints(x), self._rest(x, 1.0, CHECK_STEP, True)) <= 1.0 + _TOLERANCE:
                return x, 1.0
        return None

    def _pass(self) -> Array | None:
        x, failed = passes(self.step, self.first, self.a, self.b, self.c, self.low, self.high, self.x_most)
        if failed < 0:
            return x
        self.failed_at = float((self.s[failed] - self.s[0]) / (self.s[-1] - self.s[0]))
        return None

    def _joints(self, x: Array) -> float:
        """Return how much slower velocity and acceleration ask to be; tighten them where exceeded."""
        limits = self.velocity, self.acceleration, self.low, self.high, self.x_most
        return float(inspect_joints(self.taylor, self.step, x, *limits))

    def _rest(self, x: Array, stretch: float, dt: float, tighten: bool) -> float:
        """Return how much slower the other limits ask to be, at every dt or in the middle of intervals."""
        if not self.effects.any:
            return 1.0
        interval, local = instants(times(self.step, x), stretch, dt)
        q, v, a = motion(self.taylor, self.step, x, interval, local, stretch)
        effects = self.effects
        asked = effects.torque(q, v, a), effects.torque_limit, effects.moments(q, v, a), effects.speed(q, v)
        bounds = self.c, self.first, self.low, self.high, self.x_most
        return float(inspect(interval, self.n, *asked, *bounds, tighten))


def _coefficients(effects: Effects, at: Array) -> tuple[Array, Array, Array]:
    """Return torques and edge moments of rest, of unit path acceleration and of unit path speed."""
    q, first, second = at
    if not effects.torque_limit.size and effects.polygon is None:
        empty = np.zeros((3, len(q), 0))
        return empty, effects.torque_limit, empty
    states = np.empty((3, 3, *q.shape))
    states[0] = q
    states[1, :2], states[1, 2] = 0.0, first
    states[2, 0], states[2, 1], states[2, 2] = 0.0, first, second
    flat = states.reshape(3, -1, q.shape[1])
    torque = effects.torque(*flat).reshape(3, len(q), -1 if effects.torque_limit.size else 0)
    return (
        torque,
        effects.torque_limit,
        effects.moments(*flat).reshape(3, len(q), -1 if effects.polygon is not None else 0),
    )
