"""Compiled: motion along a path at given instants, its polynomials, and where it exceeds its limits."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def times(step: Array, x: Array) -> Array:
    """Return the times at the grid points, shape (N + 1,)."""
    t = np.zeros(x.size)
    for i in range(step.size):
        t[i + 1] = t[i] + 2 * step[i] / (np.sqrt(x[i]) + np.sqrt(x[i + 1]))
    return t


@njit(cache=True, nogil=True, error_model="numpy")
def instants(t: Array, stretch: float, dt: float) -> tuple[np.ndarray, Array]:
    """Return interval and local time of every multiple of dt, and of the end, of a motion made slower.

    With dt = 0: of the middle of every interval.
    """
    size = t.size - 1
    if dt == 0.0:
        return np.arange(size), (t[1:] - t[:-1]) / 2
    count = int(np.ceil(t[size] * stretch / dt)) + 1
    interval, local = np.empty(count, np.int64), np.empty(count)
    i = 0
    for k in range(count):
        time = min(k * dt / stretch, t[size])
        while i < size - 1 and time >= t[i + 1]:
            i += 1
        interval[k], local[k] = i, time - t[i]
    return interval, local


@njit(cache=True, nogil=True, error_model="numpy")
def motion(taylor: Array, step: Array, x: Array, interval: np.ndarray, local: Array, stretch: float) -> Array:
    """Return position, velocity and acceleration of a motion made slower, shape (3, T, n)."""
    n = taylor.shape[2]
    state = np.empty((3, interval.size, n))
    for k in range(interval.size):
        i = interval[k]
        u = (x[i + 1] - x[i]) / (2 * step[i])
        w = np.sqrt(x[i])
        d = local[k] * (w + u * local[k] / 2)
        speed = (w + u * local[k]) / stretch
        square, u = speed * speed, u / (stretch * stretch)
        for j in range(n):
            c0, c1, c2, c3 = taylor[i, 0, j], taylor[i, 1, j], taylor[i, 2, j], taylor[i, 3, j]
            slope = c1 + d * (2 * c2 + 3 * d * c3)
            state[0, k, j] = c0 + d * (c1 + d * (c2 + d * c3))
            state[1, k, j] = slope * speed
            state[2, k, j] = slope * u + (2 * c2 + 6 * d * c3) * square
    return state


@njit(cache=True, nogil=True, error_model="numpy")
def polynomials(taylor: Array, step: Array, x: Array, stretch: float) -> tuple[Array, Array]:
    """Return times at the grid points, and q(s(t)) on every interval; see `time_law.compose`.

    Returns:
        Times of the motion made slower, shape (N + 1,), and coefficients, constant term first, (N, 7, n).
    """
    size, _, n = taylor.shape
    coefficients = np.empty((size, 7, n))
    for i in range(size):
        w = np.sqrt(x[i]) / stretch
        h = (x[i + 1] - x[i]) / (4 * step[i] * stretch * stretch)
        w2, wh, h2 = w * w, w * h, h * h
        for j in range(n):
            c1, c2, c3 = taylor[i, 1, j], taylor[i, 2, j], taylor[i, 3, j]
            coefficients[i, 0, j] = taylor[i, 0, j]
            coefficients[i, 1, j] = c1 * w
            coefficients[i, 2, j] = c1 * h + c2 * w2
            coefficients[i, 3, j] = 2 * c2 * wh + c3 * w2 * w
            coefficients[i, 4, j] = c2 * h2 + 3 * c3 * w2 * h
            coefficients[i, 5, j] = 3 * c3 * w * h2
            coefficients[i, 6, j] = c3 * h2 * h
    return times(step, x) * stretch, coefficients


@njit(cache=True, nogil=True, error_model="numpy")
def rows_at_nodes(
    at: Array, first: np.ndarray, size: int, acceleration: Array, torque: Array, torque_limit: Array,
    moments: Array,
) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
    """Join acceleration, torque and balance to rows low <= a u + b x + c <= high.

    Args:
        at: q, q' and q'' at the nodes, shape (3, M, n).
        first: Node at the start of each interval, shape (N,).
        size: Number of intervals N.
        acceleration: Limits, shape (n,).
        torque: Torque at rest, with q' and with q'' in place of the acceleration, shape (3, M, n or 0).
        torque_limit: shape (n or 0,).
        moments: Edge moments alike, shape (3, M, k).

    Returns:
        a, b and c, shape (M, r), and low and high, shape (N, r).
    """
    count, n = at.shape[1], at.shape[2]
    n_tau, n_edge = torque.shape[2], moments.shape[2]
    rows = n + n_tau + n_edge
    a, b, c = np.empty((count, rows)), np.empty((count, rows)), np.empty((count, rows))
    for k in range(count):
        for j in range(n):
            a[k, j], b[k, j], c[k, j] = at[1, k, j], at[2, k, j], 0.0
        for j in range(n_tau):
            rest, r = torque[0, k, j], n + j
            a[k, r], b[k, r], c[k, r] = torque[1, k, j] - rest, torque[2, k, j] - rest, rest
        for j in range(n_edge):
            rest, r = moments[0, k, j], n + n_tau + j
            a[k, r], b[k, r], c[k, r] = moments[1, k, j] - rest, moments[2, k, j] - rest, rest
    low, high = np.empty((size, rows)), np.empty((size, rows))
    for i in range(size):
        for j in range(n):
            low[i, j], high[i, j] = -acceleration[j], acceleration[j]
        for j in range(n_tau):
            low[i, n + j], high[i, n + j] = -torque_limit[j], torque_limit[j]
        for j in range(n_edge):
            low[i, n + n_tau + j], high[i, n + n_tau + j] = 0.0, np.inf
    return a, b, c, low, high


@njit(cache=True, nogil=True, error_model="numpy")
def speed_bound(at: Array, first: np.ndarray, velocity: Array, frame_speed: Array, greatest: float) -> Array:
    """Return the greatest squared path speed at the grid points, shape (N + 1,).

    Args:
        at: q, q' and q'' at the nodes, shape (3, M, n).
        first: Node at the start of each interval, shape (N,).
        velocity: Joint limits, shape (n,).
        frame_speed: |dp/ds| of each limited frame over its limit, shape (M, f).
        greatest: Bound where there is no other.
    """
    size, n = first.size, at.shape[2]
    bound = np.full(size + 1, greatest)
    for i in range(size):
        for end in range(2):
            node, share = first[i] + end, 0.0
            for j in range(n):
                share = max(share, abs(at[1, node, j]) / velocity[j])
            for f in range(frame_speed.shape[1]):
                share = max(share, frame_speed[node, f])
            if share > 0:
                bound[i + end] = min(bound[i + end], 1 / (share * share))
    return bound


@njit(cache=True, nogil=True, error_model="numpy")
def inspect_joints(
    taylor: Array, step: Array, x: Array, velocity: Array, acceleration: Array, low: Array, high: Array,
    x_most: Array, least: float, changed: np.ndarray,
) -> float:  # fmt: skip
    """Return how many times as slow the motion has to be for velocity and acceleration; tighten limits.

    On an interval, with d = s - s_i and x = x_i + 2 u d, a joint's acceleration
        q'' x + q' u = A + B d + C d^2,   A = 2 c_2 x_i + c_1 u,  B = 6 c_3 x_i + 6 c_2 u,  C = 15 c_3 u,
    is extreme at the ends or at d = -B / 2 C, and its velocity at the ends or where the acceleration is zero:
    both are compared with their limits at every instant.

    Args:
        taylor: Coefficients c of the path at the start of each interval, shape (N, 4, n).
        step: Length of each interval, shape (N,).
        x: Squared speed at the grid points, shape (N + 1,).
        velocity: Limits, shape (n,).
        acceleration: Limits, shape (n,).
        low: Lower bounds of the rows, raised by what they are exceeded by, shape (N, r).
        high: Upper bounds of the rows, likewise.
        x_most: Bounds on the squared speed, likewise, shape (N + 1,).
        least: Share of a limit up to which an excess tightens nothing.
        changed: Is set where bounds are changed, shape (N,).
    """
    square = 1.0
    for i in range(step.size):
        u, slow, length = (x[i + 1] - x[i]) / (2 * step[i]), 1.0, step[i]
        fastest = np.sqrt(max(x[i], x[i + 1]))
        for j in range(velocity.size):
            c1, c2, c3 = taylor[i, 1, j], taylor[i, 2, j], taylor[i, 3, j]
            a0, a1, a2 = 2 * c2 * x[i] + c1 * u, 6 * (c3 * x[i] + c2 * u), 15 * c3 * u
            most = max(abs(a0), abs(a0 + length * (a1 + length * a2)))
            if 0.0 < -a1 * a2 < 2 * length * a2 * a2:
                most = max(most, abs(a0 - a1 * a1 / (4 * a2)))
            if most > acceleration[j]:
                square = max(square, most / acceleration[j])
                if most > acceleration[j] * (1 + least):
                    high[i, j] -= most - acceleration[j]
                    low[i, j] += most - acceleration[j]
                    changed[i] = True
            if (abs(c1) + length * (2 * abs(c2) + 3 * length * abs(c3))) * fastest <= velocity[j]:
                continue
            end = abs(c1 + length * (2 * c2 + 3 * length * c3)) * np.sqrt(x[i + 1])
            most = max(abs(c1) * np.sqrt(x[i]), end)
            inner = a1 * a1 - 4 * a2 * a0
            root = np.sqrt(inner) if inner > 0 else 0.0
            w = -(a1 + root if a1 >= 0 else a1 - root) / 2
            for d in (w / a2 if a2 != 0 else -1.0, a0 / w if w != 0 else -1.0):
                if 0 < d < length:
                    speed = np.sqrt(max(x[i] + 2 * u * d, 0.0))
                    most = max(most, abs(c1 + d * (2 * c2 + 3 * d * c3)) * speed)
            slow = max(slow, (most / velocity[j]) ** 2)
        square = max(square, slow)
        if slow > 1.0 + least:
            x_most[i], x_most[i + 1] = x_most[i] / slow, x_most[i + 1] / slow
            changed[i], changed[min(i + 1, step.size - 1)] = True, True
    return np.sqrt(square)


@njit(cache=True, nogil=True, error_model="numpy")
def inspect(
    interval: np.ndarray, first_row: int, torque: Array, torque_limit: Array, moments: Array,
    frame_speed: Array, c: Array, first: np.ndarray, low: Array, high: Array, x_most: Array, tighten: bool,
) -> float:  # fmt: skip
    """Return how many times as slow the motion has to be for the rest; tighten limits where it exceeds them.

    Made k times as slow, a motion has v / k, and torques and edge moments c + (value - c) / k^2, with c their
    value at rest, here that of the nearest nodes.

    Args:
        interval: Interval of each state, shape (T,).
        first_row: Number of rows before those of torque.
        torque: shape (T, n or 0).
        torque_limit: shape (n or 0,).
        moments: Edge moments, to be positive, shape (T, k).
        frame_speed: Speed over its limit, shape (T, f).
        c: Values at rest by node, shape (M, r).
        first: Node at the start of each interval, shape (N,).
        low: Lower bounds of the rows, changed where `tighten`, shape (N, r).
        high: Upper bounds of the rows, likewise.
        x_most: Bounds on the squared speed, likewise, shape (N + 1,).
        tighten: Whether to change the bounds by what they are exceeded by.
    """
    n_tau, n_edge = torque_limit.size, moments.shape[1]
    square = 1.0
    cut = np.zeros((first.size, n_tau + n_edge))
    slow = np.ones(first.size)
    for k in range(interval.size):
        i = interval[k]
        for f in range(frame_speed.shape[1]):
            slow[i] = max(slow[i], frame_speed[k, f] * frame_speed[k, f])
        for r in range(n_tau + n_edge):
            value = abs(torque[k, r]) if r < n_tau else -moments[k, r - n_tau]
            limit = torque_limit[r] if r < n_tau else 0.0
            if value > limit:
                rest = (c[first[i], first_row + r] + c[first[i] + 1, first_row + r]) / 2
                if r >= n_tau or torque[k, r] < 0:
                    rest = -rest
                cut[i, r] = max(cut[i, r], value - limit)
                square = max(square, (value - rest) / (limit - rest)) if limit > rest else np.inf
    square = max(square, slow.max())
    if tighten:
        for i in range(first.size):
            for r in range(n_tau + n_edge):
                low[i, first_row + r] += cut[i, r]
                high[i, first_row + r] -= cut[i, r]
            x_most[i], x_most[i + 1] = x_most[i] / slow[i], x_most[i + 1] / slow[i]
    return np.sqrt(square)
