"""Time-optimal parameterization: alternates passes with checks between grid points that tighten constraints.

On a grid the path's acceleration u = d2s/dt2 is constant between grid points, so that s(t) is quadratic and
q(s(t)), for a piecewise cubic path, a polynomial of degree 6 on each interval.
"""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.timing.constraints import (
    fill_middle,
    fill_rows,
    tighten_frames,
    tighten_joints,
    tighten_middle,
)
from pepper_kin.core.timing.reachability import repeat_passes, reset_profile
from pepper_kin.core.timing.tables import Instants, PathEffects, PathGrid, PathLimits, PathRows, ProfileSpace
from pepper_kin.kernels.compiled_function import compiled

FOUND, NO_PROFILE, NO_REST = 0, 1, 2
"""Statuses of `optimal_profile`: found; none exists; the robot cannot rest at a node, so slower is no
help."""

_ROUNDS = 3  # maximum number of solutions with tightened limits; then the motion is slowed down
_SMALL_STRETCH = 2e-4  # slowing down by less than this is cheaper than solving again
_LEAST = 1e-4  # relative to a limit: smaller violations are left to slowing down
_NEAR = 0.99  # relative to a limit: intervals that may exceed this are examined at each sample time


@compiled(
    "Tuple(int64, int64, float64)(PathGrid, PathEffects, PathLimits, PathRows, ProfileSpace)", lean=True
)
def optimal_profile(
    grid: PathGrid, effects: PathEffects, limits: PathLimits, rows: PathRows, space: ProfileSpace
) -> tuple[int, int, float]:
    """Find the maximum squared speed, and the factor by which the motion has to be slower.

    After each solution, extrema of velocity and acceleration are computed in every interval, torques and
    edge moments in its middle, where their coefficients are interpolated by cubics, and a bound on the speed
    of frames everywhere; violated limits are tightened by the violation before the next passes.

    Args:
        grid: The path.
        effects: Torques, edge moments and frame speeds along it.
        limits: The limits.
        rows: Output: the constraints, tightened.
        space: Workspace; its `best` is the resulting profile.

    Returns:
        FOUND, NO_PROFILE or NO_REST; the grid point at which a search for a profile ended, or -1; and the
        stretch factor that velocity, acceleration and frames need.
    """
    fill_rows(grid, effects, limits, rows)
    n, size = grid.at.shape[2], grid.step.size
    for k in range(rows.c.shape[0]):
        for r in range(n, rows.c.shape[1]):
            if not rows.low[0, r] <= rows.c[k, r] <= rows.high[0, r]:
                return NO_REST, -1, 1.0
    fill_middle(grid, rows)
    reset_profile(space)
    x, changed, failed = space.x, space.changed, -1
    shortest, stretch = np.inf, 1.0
    for _ in range(_ROUNDS):
        failed = repeat_passes(grid, rows, space)
        if failed >= 0:
            break
        for i in range(size):
            changed[i] = False
        slower = tighten_joints(grid, limits, rows, x, _LEAST, changed)
        slower = max(slower, tighten_frames(grid, effects, rows, x, _LEAST, changed))
        needed = max(slower, tighten_middle(grid, limits, rows, x, _LEAST, changed))
        duration = profile_duration(grid, x) * needed
        if duration < shortest:
            shortest, stretch = duration, slower
            for i in range(size + 1):
                space.best[i] = x[i]
        if needed <= 1.0 + _SMALL_STRETCH:
            break
    return (FOUND if shortest < np.inf else NO_PROFILE), failed, stretch


@compiled("float64(PathGrid, float64[::1])", lean=True)
def profile_duration(grid: PathGrid, x: Array) -> float:
    """Return the duration of a motion [s].

    Args:
        grid: The path.
        x: Squared speed at the grid points, shape (N + 1,).
    """
    total = 0.0
    for i in range(grid.step.size):
        total += _interval_time(grid, x, i)
    return total


@compiled(lean=True)
def _interval_time(grid: PathGrid, x: Array, i: int) -> float:
    """Return the time on interval i [s], from the squared speed at the grid points, shape (N + 1,)."""
    return 2 * grid.step[i] / (np.sqrt(x[i]) + np.sqrt(x[i + 1]))


@compiled("int64(float64, float64, float64)", lean=True)
def instant_count(duration: float, stretch: float, dt: float) -> int:
    """Return the number of multiples of dt up to the end of a stretched motion, plus one."""
    return int(np.ceil(duration * stretch / dt)) + 1


@compiled("int64(PathGrid, float64[::1], float64, float64, Instants)", lean=True)
def all_instants(grid: PathGrid, x: Array, stretch: float, dt: float, sample_times: Instants) -> int:
    """Find interval and local time of every multiple of dt, and of the end, of a stretched motion.

    Args:
        grid: The path.
        x: Squared speed at the grid points, shape (N + 1,).
        stretch: Factor of the duration.
        dt: Sampling interval [s].
        sample_times: Output, at least `instant_count` times.

    Returns:
        The number of sample times.
    """
    size, end = grid.step.size, profile_duration(grid, x)
    count = instant_count(end, stretch, dt)
    i, begin, after = 0, 0.0, _interval_time(grid, x, 0)
    for k in range(count):
        time = min(k * dt / stretch, end)
        while i < size - 1 and time >= after:
            i += 1
            begin, after = after, after + _interval_time(grid, x, i)
        sample_times.interval[k], sample_times.local[k] = i, time - begin
    return count


@compiled(
    "int64(PathGrid, PathRows, float64[::1], int64, float64[::1], float64, float64, Instants)", lean=True
)
def instants_near_limits(
    grid: PathGrid, rows: PathRows, limit: Array, begin: int, x: Array, stretch: float, dt: float,
    sample_times: Instants,
) -> int:  # fmt: skip
    """Find the multiples of dt at which torques or edge moments may violate their limits.

    They lie in intervals where the parabola through a quantity's values at both ends and in the middle, plus
    four times its bulge, comes nearer to its limit than 1 %.

    Args:
        grid: The path.
        rows: The constraints.
        limit: Limit of the absolute value of each row, 0 for rows that must not be negative, shape (k,).
        begin: Number of rows in `rows.middle` before the rows to examine.
        x: Squared speed at the grid points, shape (N + 1,).
        stretch: Factor of the duration.
        dt: Sampling interval [s].
        sample_times: Output, at least `instant_count` times.

    Returns:
        The number of sample times.
    """
    size, n = grid.step.size, grid.at.shape[2]
    duration = profile_duration(grid, x)
    count = instant_count(duration, stretch, dt)
    kept, k, square, scale, start = 0, 0, stretch * stretch, 0.0, 0.0
    for node in range(rows.c.shape[0]):
        for j in range(n + begin, n + begin + limit.size):
            scale = max(scale, abs(rows.c[node, j]))
    for i in range(size):
        near = _is_near(i, grid, rows, limit, begin, x, square, scale)
        after = start + _interval_time(grid, x, i)
        end = after if i < size - 1 else np.inf
        while k < count:
            time = min(k * dt / stretch, duration)
            if time >= end:
                break
            if near:
                sample_times.interval[kept], sample_times.local[kept] = i, time - start
                kept += 1
            k += 1
        start = after
    return kept


@compiled(lean=True)
def _is_near(
    i: int, grid: PathGrid, rows: PathRows, limit: Array, begin: int, x: Array, square: float, scale: float
) -> bool:
    """Return whether an examined row comes near its limit on interval i.

    Args:
        i: Index of the interval.
        grid: The path.
        rows: The constraints.
        limit: Limits of the rows, see `instants_near_limits`, shape (k,).
        begin: Number of rows in `rows.middle` before the rows to examine.
        x: Squared speed at the grid points, shape (N + 1,).
        square: Squared stretch factor.
        scale: Maximum absolute value at rest of the rows, for rows without a limit.
    """
    a, b, c, middle, node = rows.a, rows.b, rows.c, rows.middle, grid.first[i]
    u, x0, x1 = (x[i + 1] - x[i]) / (2 * grid.step[i] * square), x[i] / square, x[i + 1] / square
    half, n = (x0 + x1) / 2, grid.at.shape[2]
    for k in range(limit.size):
        r, j = begin + k, n + begin + k
        start = a[node, j] * u + b[node, j] * x0 + c[node, j]
        end = a[node + 1, j] * u + b[node + 1, j] * x1 + c[node + 1, j]
        inside = middle[0, i, r] * u + middle[1, i, r] * half + middle[2, i, r]
        bulge = abs(start - 2 * inside + end) / 2
        if limit[k] == 0.0:
            if min(start, inside, end) - bulge < (1 - _NEAR) * scale:
                return True
        elif max(abs(start), abs(inside), abs(end)) + bulge > _NEAR * limit[k]:
            return True
    return False


@compiled("void(PathGrid, float64[::1], Instants, float64, float64[:, :, ::1])", lean=True)
def evaluate_motion(grid: PathGrid, x: Array, sample_times: Instants, stretch: float, state: Array) -> None:
    """Write position, velocity and acceleration of a stretched motion.

    Args:
        grid: The path.
        x: Squared speed at the grid points, shape (N + 1,).
        sample_times: Sample times; the first T are used.
        stretch: Factor of the duration.
        state: Output: q [rad or m], v and a, shape (3, T, n).
    """
    taylor, n = grid.taylor, grid.taylor.shape[2]
    for k in range(state.shape[1]):
        i, time = sample_times.interval[k], sample_times.local[k]
        u = (x[i + 1] - x[i]) / (2 * grid.step[i])
        w = np.sqrt(x[i])
        d = time * (w + u * time / 2)
        speed = (w + u * time) / stretch
        square, u = speed * speed, u / (stretch * stretch)
        for j in range(n):
            c0, c1, c2, c3 = taylor[i, 0, j], taylor[i, 1, j], taylor[i, 2, j], taylor[i, 3, j]
            slope = c1 + d * (2 * c2 + 3 * d * c3)
            state[0, k, j] = c0 + d * (c1 + d * (c2 + d * c3))
            state[1, k, j] = slope * speed
            state[2, k, j] = slope * u + (2 * c2 + 6 * d * c3) * square


@compiled("void(PathGrid, float64[::1], float64, float64[::1], float64[:, :, ::1])", lean=True)
def motion_polynomials(grid: PathGrid, x: Array, stretch: float, breaks: Array, coefficients: Array) -> None:
    """Write q(s(t)) exactly, for constant d2s/dt2 between grid points.

    On an interval s(t) = s_i + w t + h t^2, with w its initial speed and h half its acceleration, so that
    with d = s - s_i
        d = w t + h t^2,   d^2 = w^2 t^2 + 2 w h t^3 + h^2 t^4,
        d^3 = w^3 t^3 + 3 w^2 h t^4 + 3 w h^2 t^5 + h^3 t^6,
    and q is a polynomial of degree 6.

    Args:
        grid: The path.
        x: Squared speed at the grid points, no two successive ones zero, shape (N + 1,).
        stretch: Factor of the duration.
        breaks: Output: times at the grid points, shape (N + 1,) [s].
        coefficients: Output: segments, constant term first, shape (N, 7, n).
    """
    size, _, n = grid.taylor.shape
    time = breaks[0] = 0.0
    for i in range(size):
        time += _interval_time(grid, x, i)
        breaks[i + 1] = time * stretch
        w = np.sqrt(x[i]) / stretch
        h = (x[i + 1] - x[i]) / (4 * grid.step[i] * stretch * stretch)
        w2, wh, h2 = w * w, w * h, h * h
        for j in range(n):
            c1, c2, c3 = grid.taylor[i, 1, j], grid.taylor[i, 2, j], grid.taylor[i, 3, j]
            coefficients[i, 0, j] = grid.taylor[i, 0, j]
            coefficients[i, 1, j] = c1 * w
            coefficients[i, 2, j] = c1 * h + c2 * w2
            coefficients[i, 3, j] = 2 * c2 * wh + c3 * w2 * w
            coefficients[i, 4, j] = c2 * h2 + 3 * c3 * w2 * h
            coefficients[i, 5, j] = 3 * c3 * w * h2
            coefficients[i, 6, j] = c3 * h2 * h
