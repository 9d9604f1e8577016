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
    effects = Effects(pepper, limits)
    counts = interval_counts(breaks, intervals)
    step, first, at, taylor, s = nodes(breaks, coefficients, counts)
    velocity, acceleration = np.array(limits.velocity), np.array(limits.acceleration)
    a, b, c, low, high = rows_at_nodes(at, first, step.size, acceleration, *_coefficients(effects, at))
    length = s[-1] - s[0]
    x_most = speed_bound(at, first, velocity, effects.speed(at[0], at[1]), _GREATEST * length**2)
    best: tuple[float, float, Array] | None = None
    failed = 0

    def look(x: Array, stretch: float, dt: float, tighten: bool) -> float:
        if not effects.any:
            return 1.0
        interval, local = instants(t, stretch, dt)
        q, v, acc = motion(taylor, step, x, interval, local, stretch)
        torque, moments, speed = effects.torque(q, v, acc), effects.moments(q, v, acc), effects.speed(q, v)
        asked = torque, effects.torque_limit, moments, speed
        return float(inspect(interval, pepper.n, *asked, c, first, low, high, x_most, tighten))

    for _ in range(_ROUNDS):
        x, failed = passes(step, first, a, b, c, low, high, x_most)
        if failed >= 0:
            break
        t = times(step, x)
        stretch = inspect_joints(taylor, step, x, velocity, acceleration, low, high, x_most, True)
        needed = max(stretch, look(x, 1.0, 0.0, True))
        if np.isfinite(needed) and (best is None or t[-1] * needed < best[0]):
            best = t[-1] * needed, stretch, x
        if needed <= 1.0 + _SMALL_STRETCH:
            break
    if best is None:
        return FastResult(None, None, float((s[max(failed, 0)] - s[0]) / length))
    _, stretch, x = best
    t = times(step, x)
    while True:
        more = look(x, stretch, CHECK_STEP, False)
        if more <= 1.0 + _TOLERANCE:
            break
        if not np.isfinite(more):
            return FastResult(None, None, 0.0)
        stretch *= 1.0 + _MORE * (more - 1.0) + _LEAST  # the instants looked at next are others
    return FastResult(t * stretch, polynomials(taylor, step, x, stretch))


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
