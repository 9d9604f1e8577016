"""A path's derivatives at the points of a grid, and the states that determine its dynamics."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.timing.tables import PathGrid
from pepper_kin.kernels.compiled_function import compiled


@compiled("int64(float64[::1], int64)", lean=True)
def interval_count(breaks: Array, intervals: int) -> int:
    """Return the number of intervals into which `fill_grid` divides a path.

    Args:
        breaks: Ends of the path's segments, shape (m + 1,).
        intervals: Minimum number of intervals.
    """
    total = 0
    for i in range(breaks.size - 1):
        total += _count(breaks, i, intervals)
    return total


@compiled(lean=True)
def _count(breaks: Array, i: int, intervals: int) -> int:
    """Return the number of intervals of segment i; breaks have shape (m + 1,)."""
    share = (breaks[i + 1] - breaks[i]) / (breaks[breaks.size - 1] - breaks[0])
    return max(1, int(np.ceil(intervals * share - 1e-9)))


@compiled("void(float64[::1], float64[:, :, ::1], int64, PathGrid)", lean=True)
def fill_grid(breaks: Array, coefficients: Array, intervals: int, grid: PathGrid) -> None:
    """Divide every segment of a path into equal intervals and evaluate the path at their ends.

    Args:
        breaks: Ends of the segments, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n).
        intervals: Minimum number of intervals in all.
        grid: Output; N = `interval_count`, M = N + m.
    """
    segments, _, n = coefficients.shape
    at, taylor = grid.at, grid.taylor
    interval, node = 0, 0
    for i in range(segments):
        count = _count(breaks, i, intervals)
        h = (breaks[i + 1] - breaks[i]) / count
        for part in range(count + 1):
            x = part * h if part < count else breaks[i + 1] - breaks[i]
            for j in range(n):
                q, v = coefficients[i, 0, j], coefficients[i, 1, j]
                a, c = coefficients[i, 2, j], coefficients[i, 3, j]
                at[0, node, j] = q + x * (v + x * (a + x * c))
                at[1, node, j] = v + x * (2 * a + 3 * x * c)
                at[2, node, j] = 2 * a + 6 * x * c
                if part < count:
                    taylor[interval, 0, j], taylor[interval, 1, j] = at[0, node, j], at[1, node, j]
                    taylor[interval, 2, j], taylor[interval, 3, j] = a + 3 * x * c, c
            if part < count:
                grid.step[interval], grid.first[interval], grid.s[interval] = h, node, breaks[i] + x
                interval += 1
            node += 1
    grid.s[interval] = breaks[segments]


@compiled("void(float64[:, :, ::1], float64[:, :, ::1])", lean=True)
def coefficient_states(at: Array, states: Array) -> None:
    """Write q, v and a at rest, at unit path acceleration and at unit path speed.

    Args:
        at: q [rad or m], q' and q'' at the nodes, shape (3, M, n).
        states: Output: q, v and a, shape (3, 3 M, n).
    """
    count, n = at.shape[1], at.shape[2]
    for k in range(count):
        for j in range(n):
            for part in range(3):
                states[0, part * count + k, j] = at[0, k, j]
            states[1, k, j] = states[1, count + k, j] = states[2, k, j] = 0.0
            states[2, count + k, j] = at[1, k, j]
            states[1, 2 * count + k, j] = at[1, k, j]
            states[2, 2 * count + k, j] = at[2, k, j]


@compiled("void(PathGrid, float64[:, :, ::1])", lean=True)
def frame_states(grid: PathGrid, states: Array) -> None:
    """Write q and q' at the nodes, then in the middle of the intervals.

    Args:
        grid: The path.
        states: Output, shape (2, M + N, n).
    """
    count, n = grid.at.shape[1], grid.at.shape[2]
    for k in range(count):
        for j in range(n):
            states[0, k, j], states[1, k, j] = grid.at[0, k, j], grid.at[1, k, j]
    for i in range(grid.step.size):
        d = grid.step[i] / 2
        for j in range(n):
            c1, c2, c3 = grid.taylor[i, 1, j], grid.taylor[i, 2, j], grid.taylor[i, 3, j]
            states[0, count + i, j] = grid.taylor[i, 0, j] + d * (c1 + d * (c2 + d * c3))
            states[1, count + i, j] = c1 + d * (2 * c2 + 3 * d * c3)
