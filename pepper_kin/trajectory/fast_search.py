"""Compiled: passes, looks between the grid points and tightened limits, until limits hold or nearly so."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.trajectory.fast_motion import (
    inspect_joints,
    motion,
    rows_at_nodes,
    speed_bound,
    times,
)
from pepper_kin.trajectory.fast_passes import repeat_passes

Array = NDArray[np.float64]

FOUND, NO_SPEED, CANNOT_REST = 0, 1, 2

_ROUNDS = 3  # solutions with tightened limits before settling for a slower one
_SMALL_STRETCH = 2e-4  # slowing down by less than this is cheaper than solving again
_LEAST = 1e-4  # of a limit: lesser excesses are left to stretching
_NEAR = 0.99  # of a limit: nearer than this by a cautious estimate, instants are looked at one by one


@njit(cache=True, nogil=True, error_model="numpy")
def coefficient_states(at: Array, room: Array) -> Array:
    """Return q, v and a of rest, of unit path acceleration and of unit path speed, shape (3, 3 M, n).

    Args:
        at: q, q' and q'' at the nodes, shape (3, M, n).
        room: Memory to write to, of 9 M n numbers and more.
    """
    count, n = at.shape[1], at.shape[2]
    states = room[: 9 * count * n].reshape((3, 3 * count, n))
    for k in range(count):
        for j in range(n):
            for part in range(3):
                states[0, part * count + k, j] = at[0, k, j]
            states[1, k, j] = states[1, count + k, j] = states[2, k, j] = 0.0
            states[2, count + k, j] = at[1, k, j]
            states[1, 2 * count + k, j] = at[1, k, j]
            states[2, 2 * count + k, j] = at[2, k, j]
    return states


@njit(cache=True, nogil=True, error_model="numpy")
def frame_states(at: Array, taylor: Array, step: Array) -> Array:
    """Return q and q' at the nodes, then in the middle of the intervals, shape (2, M + N, n)."""
    count, n = at.shape[1], at.shape[2]
    states = np.empty((2, count + step.size, n))
    for k in range(count):
        for j in range(n):
            states[0, k, j], states[1, k, j] = at[0, k, j], at[1, k, j]
    for i in range(step.size):
        d = step[i] / 2
        for j in range(n):
            c1, c2, c3 = taylor[i, 1, j], taylor[i, 2, j], taylor[i, 3, j]
            states[0, count + i, j] = taylor[i, 0, j] + d * (c1 + d * (c2 + d * c3))
            states[1, count + i, j] = c1 + d * (2 * c2 + 3 * d * c3)
    return states


@njit(cache=True, nogil=True, error_model="numpy")
def lines_size(intervals: int, rows: int) -> int:
    """Return how many numbers `search` needs as room."""
    return intervals * 3 * (2 * rows + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def search(
    step: Array, first: np.ndarray, at: Array, taylor: Array, torque: Array, torque_limit: Array,
    moments: Array, frame_speed: Array, frame_middle: Array, velocity: Array, acceleration: Array,
    greatest: float, room: Array,
) -> tuple[int, Array, float, Array, Array, Array, Array]:  # fmt: skip
    """Return the fastest squared speed and how much slower the motion has to be than it says.

    After each solution, extremes of velocity and acceleration are looked for in every interval, torques and
    edge moments in its middle, where their coefficients are interpolated by cubics, and a bound on the speed
    of frames anywhere; limits that are exceeded are tightened by the excess before the passes are run again.

    Args:
        step: Length of each interval, shape (N,).
        first: Node at the start of each interval, shape (N,).
        at: q, q' and q'' at the nodes, shape (3, M, n).
        taylor: Coefficients of the path at the start of each interval, shape (N, 4, n).
        torque: At `coefficient_states`, shape (3, M, n or 0).
        torque_limit: shape (n or 0,).
        moments: Edge moments alike, shape (3, M, k).
        frame_speed: |dp/ds| of each limited frame over its limit at the nodes, shape (M, f).
        frame_middle: Likewise in the middle of the intervals, shape (N, f).
        velocity: Limits, shape (n,).
        acceleration: Limits, shape (n,).
        greatest: Bound on the squared speed where there is no other.
        room: Memory for `lines_size` numbers and more, of no content.

    Returns:
        Status; x at the grid points, shape (N + 1,); the stretch that velocity, acceleration and
        frames need; a, b and c of all rows at the nodes, shape (M, r); and what `_middles` returns.
    """
    n, size = at.shape[2], step.size
    a, b, c, low, high = rows_at_nodes(at, first, size, acceleration, torque, torque_limit, moments)
    x_most = speed_bound(at, first, velocity, frame_speed, greatest)
    rows = a.shape[1]
    x, best = np.zeros(size + 1), np.zeros(size + 1)
    for k in range(c.shape[0]):
        for r in range(n, rows):
            if not low[0, r] <= c[k, r] <= high[0, r]:
                return CANNOT_REST, x, 1.0, a, b, c, np.zeros((3, 0, 0))
    lines = room[: lines_size(size, rows)].reshape((size, 3, 2 * rows + 1))
    span = np.empty((size, 3))
    reach, changed = np.zeros((size + 1, 2)), np.ones(size, np.bool_)
    middle = _middles(first, a, b, c, n)
    shortest, stretch = np.inf, 1.0
    for _ in range(_ROUNDS):
        if repeat_passes(step, first, a, b, c, low, high, x_most, changed, lines, span, reach, x) >= 0:
            break
        for i in range(size):
            changed[i] = False
        slower = inspect_joints(taylor, step, x, velocity, acceleration, low, high, x_most, _LEAST, changed)
        slower = max(slower, _inspect_frames(step, first, x, frame_speed, frame_middle, x_most, changed))
        needed = max(slower, _inspect_middles(step, x, middle, torque_limit, n, low, high, changed))
        duration = times(step, x)[size] * needed
        if duration < shortest:
            shortest, stretch = duration, slower
            for i in range(size + 1):
                best[i] = x[i]
        if needed <= 1.0 + _SMALL_STRETCH:
            break
    return (FOUND if shortest < np.inf else NO_SPEED), best, stretch, a, b, c, middle


@njit(cache=True, nogil=True, error_model="numpy")
def _middles(first: np.ndarray, a: Array, b: Array, c: Array, n: int) -> Array:
    """Return coefficients of the rows but those of acceleration in the middle of every interval.

    By the cubic through four nodes, at the ends of the path's pieces by a parabola through three.

    Returns:
        a, b and c, shape (3, N, r - n).
    """
    size, rows = first.size, a.shape[1] - n
    found = np.zeros((3, size, rows))
    for i in range(size):
        k = first[i]
        before = i > 0 and first[i - 1] == k - 1
        after = i + 1 < size and first[i + 1] == k + 1
        w0, w1, w2, w3 = 0.0, 0.5, 0.5, 0.0
        if before and after:
            w0, w1, w2, w3 = -1 / 16, 9 / 16, 9 / 16, -1 / 16
        elif before:
            w0, w1, w2 = -1 / 8, 6 / 8, 3 / 8
        elif after:
            w1, w2, w3 = 3 / 8, 6 / 8, -1 / 8
        p, s = (k - 1 if before else k), (k + 2 if after else k + 1)
        for r in range(rows):
            j = n + r
            found[0, i, r] = w0 * a[p, j] + w1 * a[k, j] + w2 * a[k + 1, j] + w3 * a[s, j]
            found[1, i, r] = w0 * b[p, j] + w1 * b[k, j] + w2 * b[k + 1, j] + w3 * b[s, j]
            found[2, i, r] = w0 * c[p, j] + w1 * c[k, j] + w2 * c[k + 1, j] + w3 * c[s, j]
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _inspect_middles(
    step: Array, x: Array, middle: Array, torque_limit: Array, n: int, low: Array, high: Array,
    changed: np.ndarray,
) -> float:  # fmt: skip
    """Return how many times as slow torques and edge moments ask to be; tighten them, as `inspect` does."""
    n_tau, rows = torque_limit.size, low.shape[1] - n
    square = 1.0
    for i in range(step.size):
        u, half = (x[i + 1] - x[i]) / (2 * step[i]), (x[i] + x[i + 1]) / 2
        for r in range(rows):
            rest = middle[2, i, r]
            value = middle[0, i, r] * u + middle[1, i, r] * half + rest
            limit = torque_limit[r] if r < n_tau else 0.0
            if r >= n_tau or value < 0.0:
                value, rest = -value, -rest
            if value > limit:
                square = max(square, (value - rest) / (limit - rest)) if limit > rest else np.inf
                if value - limit > _LEAST * (limit - rest):
                    low[i, n + r] += value - limit
                    high[i, n + r] -= value - limit
                    changed[i] = True
    return np.sqrt(square)


@njit(cache=True, nogil=True, error_model="numpy")
def _inspect_frames(
    step: Array, first: np.ndarray, x: Array, frame_speed: Array, frame_middle: Array, x_most: Array,
    changed: np.ndarray,
) -> float:  # fmt: skip
    """Return how many times as slow speeds of frames ask to be; tighten their limits.

    On an interval a frame's squared speed g = |dp/ds|^2 x is known at both ends and in the middle.  The
    parabola through these is wrong by at most 0.0642 of the greatest third difference over half an interval,
    of which those with the neighbours are examples; four times their greatest stands for it.
    """
    size, square = step.size, 1.0
    for i in range(size):
        k, u = first[i], (x[i + 1] - x[i]) / (2 * step[i])
        before = i > 0 and first[i - 1] == k - 1
        after = i + 1 < size and first[i + 1] == k + 1
        slow = 1.0
        for f in range(frame_speed.shape[1]):
            g0, g2 = frame_speed[k, f] ** 2 * x[i], frame_speed[k + 1, f] ** 2 * x[i + 1]
            g1 = frame_middle[i, f] ** 2 * (x[i] + x[i + 1]) / 2
            third = 0.0 if before or after else 4 * abs(g0 - 2 * g1 + g2)
            if before:
                g = frame_middle[i - 1, f] ** 2 * (x[i] - u * step[i])
                third = abs(g2 - 3 * g1 + 3 * g0 - g)
            if after:
                g = frame_middle[i + 1, f] ** 2 * (x[i + 1] + u * step[i])
                third = max(third, abs(g - 3 * g2 + 3 * g1 - g0))
            most, tilt, bend = max(g0, g1, g2), (g2 - g0) / 2, (g0 + g2) / 2 - g1
            if abs(tilt) < -2 * bend:
                most = g1 - tilt * tilt / (4 * bend)
            slow = max(slow, most + 4 * 0.0642 * third)
        square = max(square, slow)
        if slow > 1.0 + _LEAST:
            x_most[i], x_most[i + 1] = x_most[i] / slow, x_most[i + 1] / slow
            changed[i], changed[min(i + 1, size - 1)] = True, True
    return np.sqrt(square)


@njit(cache=True, nogil=True, error_model="numpy")
def near_limits(
    step: Array, first: np.ndarray, taylor: Array, a: Array, b: Array, c: Array, middle: Array,
    limit: Array, x: Array, stretch: float, dt: float, begin: int,
) -> tuple[np.ndarray, Array]:  # fmt: skip
    """Return interval and state at those multiples of dt where some rows may leave their limits.

    Those are the instants on intervals where the parabola through a quantity's values at both ends and in
    the middle comes nearer to its limit than 1 %, with four times its bulge on top.

    Args:
        step: See `search`, as for the others.
        first: Node at the start of each interval.
        taylor: Coefficients of the path.
        a: Gains on u at the nodes, shape (M, r).
        b: Gains on x.
        c: Values at rest.
        middle: All three in the middle of every interval, shape (3, N, r - n).
        limit: Of the size of the rows to look at; or 0 for those that must not be negative, shape (k,).
        x: Squared speed at the grid points.
        stretch: How much slower the motion is.
        dt: [s].
        begin: Number of rows in `middle` before those to look at.

    Returns:
        Interval of each instant, shape (T,), and q, v and a of the motion made slower, shape (3, T, n).
    """
    size, n = step.size, taylor.shape[2]
    t = times(step, x)
    count = int(np.ceil(t[size] * stretch / dt)) + 1
    interval, local = np.empty(count, np.int64), np.empty(count)
    kept, k, square = 0, 0, stretch * stretch
    scale = 0.0
    for node in range(c.shape[0]):
        for j in range(n + begin, n + begin + limit.size):
            scale = max(scale, abs(c[node, j]))
    for i in range(size):
        near = _is_near(i, step[i], first[i], a, b, c, middle, limit, x, square, begin, scale)
        end = t[i + 1] if i < size - 1 else np.inf
        while k < count:
            time = min(k * dt / stretch, t[size])
            if time >= end:
                break
            if near:
                interval[kept], local[kept] = i, time - t[i]
                kept += 1
            k += 1
    return interval[:kept], motion(taylor, step, x, interval[:kept], local[:kept], stretch)


@njit(cache=True, nogil=True, error_model="numpy")
def _is_near(
    i: int, step: float, node: int, a: Array, b: Array, c: Array, middle: Array, limit: Array, x: Array,
    square: float, begin: int, scale: float,
) -> bool:  # fmt: skip
    u, x0, x1 = (x[i + 1] - x[i]) / (2 * step * square), x[i] / square, x[i + 1] / square
    half, n = (x0 + x1) / 2, a.shape[1] - middle.shape[2]
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
