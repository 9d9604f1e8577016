"""Constraints of a path's timing at the nodes of its grid, and checks between nodes that tighten them.

Slowed down by a factor k, a motion has velocity v / k and acceleration a / k^2; torques and edge moments
become c + (value - c) / k^2, with c their value at rest.
"""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.timing.tables import PathEffects, PathGrid, PathLimits, PathRows, StateEffects
from pepper_kin.kernels.compiled_function import compiled


@compiled("void(PathGrid, PathEffects, PathLimits, PathRows)", lean=True)
def fill_rows(grid: PathGrid, effects: PathEffects, limits: PathLimits, rows: PathRows) -> None:
    """Write the constraints of acceleration, torque, balance and speed.

    Args:
        grid: The path.
        effects: Torques, edge moments and frame speeds along it.
        limits: The limits.
        rows: Output: the constraints, all but `middle`.
    """
    a, b, c, low, high = rows.a, rows.b, rows.c, rows.low, rows.high
    n, n_tau, n_edge = grid.at.shape[2], effects.torque.shape[2], effects.moments.shape[2]
    for k in range(grid.at.shape[1]):
        for j in range(n):
            a[k, j], b[k, j], c[k, j] = grid.at[1, k, j], grid.at[2, k, j], 0.0
        for j in range(n_tau):
            rest, r = effects.torque[0, k, j], n + j
            a[k, r], b[k, r] = effects.torque[1, k, j] - rest, effects.torque[2, k, j] - rest
            c[k, r] = rest
        for j in range(n_edge):
            rest, r = effects.moments[0, k, j], n + n_tau + j
            a[k, r], b[k, r] = effects.moments[1, k, j] - rest, effects.moments[2, k, j] - rest
            c[k, r] = rest
    for i in range(grid.step.size):
        for j in range(n):
            low[i, j], high[i, j] = -limits.acceleration[j], limits.acceleration[j]
        for j in range(n_tau):
            low[i, n + j], high[i, n + j] = -limits.torque[j], limits.torque[j]
        for j in range(n_edge):
            low[i, n + n_tau + j], high[i, n + n_tau + j] = 0.0, np.inf
    _fill_speed_bound(grid, effects.frame_speed, limits, rows.x_most)


@compiled(lean=True)
def _fill_speed_bound(grid: PathGrid, frame_speed: Array, limits: PathLimits, x_most: Array) -> None:
    """Write the maximum squared path speed that velocities of joints and frames allow at the grid points.

    Args:
        grid: The path.
        frame_speed: |dp/ds| of each frame over its limit, see `PathEffects`, shape (M, f).
        limits: The limits.
        x_most: Output, shape (N + 1,).
    """
    size, n = grid.step.size, grid.at.shape[2]
    for i in range(size + 1):
        x_most[i] = limits.x
    for i in range(size):
        for end in range(2):
            node, share = grid.first[i] + end, 0.0
            for j in range(n):
                share = max(share, abs(grid.at[1, node, j]) / limits.velocity[j])
            for f in range(frame_speed.shape[1]):
                share = max(share, frame_speed[node, f])
            if share > 0:
                x_most[i + end] = min(x_most[i + end], 1 / (share * share))


@compiled(lean=True)
def fill_middle(grid: PathGrid, rows: PathRows) -> None:
    """Write coefficients of the rows except accelerations in the middle of every interval.

    They are interpolated by the cubic through four nodes, next to the ends of the path's segments by a
    parabola through three.

    Args:
        grid: The path.
        rows: The constraints; `middle` is output.
    """
    a, b, c, found, first = rows.a, rows.b, rows.c, rows.middle, grid.first
    size, n = first.size, grid.at.shape[2]
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
        for r in range(a.shape[1] - n):
            j = n + r
            found[0, i, r] = w0 * a[p, j] + w1 * a[k, j] + w2 * a[k + 1, j] + w3 * a[s, j]
            found[1, i, r] = w0 * b[p, j] + w1 * b[k, j] + w2 * b[k + 1, j] + w3 * b[s, j]
            found[2, i, r] = w0 * c[p, j] + w1 * c[k, j] + w2 * c[k + 1, j] + w3 * c[s, j]


@compiled("float64(PathGrid, PathLimits, PathRows, float64[::1], float64, boolean[::1])", lean=True)
def tighten_joints(
    grid: PathGrid, limits: PathLimits, rows: PathRows, x: Array, least: float, changed: np.ndarray
) -> float:
    """Return the factor by which velocity and acceleration require to slow down; tighten constraints.

    On an interval, with d = s - s_i and x = x_i + 2 u d, a joint's acceleration
        q'' x + q' u = A + B d + C d^2,   A = 2 c_2 x_i + c_1 u,  B = 6 c_3 x_i + 6 c_2 u,  C = 15 c_3 u,
    has extrema at the ends or at d = -B / 2 C, and its velocity at the ends or where the acceleration is
    zero: both are compared with their limits at all times.

    Args:
        grid: The path.
        limits: The limits.
        rows: The constraints, tightened by their violation.
        x: Squared speed at the grid points, shape (N + 1,).
        least: Violation, relative to the limit, up to which nothing is tightened.
        changed: Set to True where constraints are changed, shape (N,).
    """
    square = 1.0
    velocity, acceleration, taylor, step = limits.velocity, limits.acceleration, grid.taylor, grid.step
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
                    rows.high[i, j] -= most - acceleration[j]
                    rows.low[i, j] += most - acceleration[j]
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
            _lower_speed(i, slow, rows.x_most, changed)
    return np.sqrt(square)


@compiled(lean=True)
def _lower_speed(i: int, factor: float, x_most: Array, changed: np.ndarray) -> None:
    """Divide the bounds on x, shape (N + 1,), at both ends of an interval; set `changed`, shape (N,)."""
    x_most[i], x_most[i + 1] = x_most[i] / factor, x_most[i + 1] / factor
    changed[i], changed[min(i + 1, changed.size - 1)] = True, True


@compiled(lean=True)
def tighten_middle(
    grid: PathGrid, limits: PathLimits, rows: PathRows, x: Array, least: float, changed: np.ndarray
) -> float:
    """Return the factor by which torques and edge moments mid-interval require to slow down; tighten rows.

    Args:
        grid: The path.
        limits: The limits.
        rows: The constraints with `middle`; violated rows are tightened.
        x: Squared speed at the grid points, shape (N + 1,).
        least: Violation, relative to the limit's distance from rest, up to which nothing is tightened.
        changed: Set to True where constraints are changed, shape (N,).
    """
    n, n_tau, middle = grid.at.shape[2], limits.torque.size, rows.middle
    square = 1.0
    for i in range(grid.step.size):
        u, half = (x[i + 1] - x[i]) / (2 * grid.step[i]), (x[i] + x[i + 1]) / 2
        for r in range(middle.shape[2]):
            rest = middle[2, i, r]
            value = middle[0, i, r] * u + middle[1, i, r] * half + rest
            limit = limits.torque[r] if r < n_tau else 0.0
            if r >= n_tau or value < 0.0:
                value, rest = -value, -rest
            if value > limit:
                square = max(square, (value - rest) / (limit - rest)) if limit > rest else np.inf
                if value - limit > least * (limit - rest):
                    rows.low[i, n + r] += value - limit
                    rows.high[i, n + r] -= value - limit
                    changed[i] = True
    return np.sqrt(square)


@compiled(lean=True)
def tighten_frames(
    grid: PathGrid, effects: PathEffects, rows: PathRows, x: Array, least: float, changed: np.ndarray
) -> float:
    """Return the factor by which speeds of frames require to slow down; tighten bounds on x.

    On an interval a frame's squared speed g = |dp/ds|^2 x is computed at both ends and in the middle.  The
    error of the parabola through these values is at most 0.0642 of the maximum third difference over half an
    interval, which is sampled with the adjacent intervals; four times the maximum sample is used.

    Args:
        grid: The path.
        effects: Speeds of frames along the path.
        rows: The constraints.
        x: Squared speed at the grid points, shape (N + 1,).
        least: Violation, relative to the limit, up to which nothing is tightened.
        changed: Set to True where constraints are changed, shape (N,).
    """
    size, first, square = grid.step.size, grid.first, 1.0
    ends, middle = effects.frame_speed, effects.frame_middle
    for i in range(size):
        k, u = first[i], (x[i + 1] - x[i]) / (2 * grid.step[i])
        before = i > 0 and first[i - 1] == k - 1
        after = i + 1 < size and first[i + 1] == k + 1
        slow = 1.0
        for f in range(ends.shape[1]):
            g0, g2 = ends[k, f] ** 2 * x[i], ends[k + 1, f] ** 2 * x[i + 1]
            g1 = middle[i, f] ** 2 * (x[i] + x[i + 1]) / 2
            third = 0.0 if before or after else 4 * abs(g0 - 2 * g1 + g2)
            if before:
                g = middle[i - 1, f] ** 2 * (x[i] - u * grid.step[i])
                third = abs(g2 - 3 * g1 + 3 * g0 - g)
            if after:
                g = middle[i + 1, f] ** 2 * (x[i + 1] + u * grid.step[i])
                third = max(third, abs(g - 3 * g2 + 3 * g1 - g0))
            most, tilt, bend = max(g0, g1, g2), (g2 - g0) / 2, (g0 + g2) / 2 - g1
            if abs(tilt) < -2 * bend:
                most = g1 - tilt * tilt / (4 * bend)
            slow = max(slow, most + 4 * 0.0642 * third)
        square = max(square, slow)
        if slow > 1.0 + least:
            _lower_speed(i, slow, rows.x_most, changed)
    return np.sqrt(square)


@compiled("float64(PathGrid, float64[::1], PathRows, int64, int64[::1], StateEffects, boolean)")
def tighten_states(
    grid: PathGrid, torque_limit: Array, rows: PathRows, first_row: int, interval: np.ndarray,
    effects: StateEffects, tighten: bool,
) -> float:  # fmt: skip
    """Return the factor by which torques, edge moments and frame speeds require to slow down a motion.

    Args:
        grid: The path.
        torque_limit: Limits of the torques of `effects`, shape (n or 0,) [N m or N].
        rows: The constraints.
        first_row: Index of the row of the first torque or, without torques, edge moment.
        interval: Interval of each state, shape (T,).
        effects: Torques, edge moments and frame speeds of the states.
        tighten: Whether to tighten constraints by their violation.

    Returns:
        At least 1; inf if not even rest keeps the limits.
    """
    first, torque, moments, frame_speed = grid.first, effects.torque, effects.moments, effects.frame_speed
    n_tau, n_edge = torque_limit.size, moments.shape[1]
    square = 1.0
    cut, slow = np.zeros((first.size, n_tau + n_edge)), np.ones(first.size)
    for k in range(interval.size):
        i = interval[k]
        for f in range(frame_speed.shape[1]):
            slow[i] = max(slow[i], frame_speed[k, f] * frame_speed[k, f])
        for r in range(n_tau + n_edge):
            value = abs(torque[k, r]) if r < n_tau else -moments[k, r - n_tau]
            limit = torque_limit[r] if r < n_tau else 0.0
            if value > limit:
                rest = (rows.c[first[i], first_row + r] + rows.c[first[i] + 1, first_row + r]) / 2
                if r >= n_tau or torque[k, r] < 0:
                    rest = -rest
                cut[i, r] = max(cut[i, r], value - limit)
                square = max(square, (value - rest) / (limit - rest)) if limit > rest else np.inf
    for i in range(first.size):
        square = max(square, slow[i])
        if tighten:
            for r in range(n_tau + n_edge):
                rows.low[i, first_row + r] += cut[i, r]
                rows.high[i, first_row + r] -= cut[i, r]
            rows.x_most[i], rows.x_most[i + 1] = rows.x_most[i] / slow[i], rows.x_most[i + 1] / slow[i]
    return np.sqrt(square)
