"""Compiled: the two passes of TOPP-RA over limits that were evaluated beforehand."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

_PARALLEL = 1e-12  # of a row's greatest coefficient: less does not bound the path's acceleration
_ROUNDING = 1e-12


@njit(cache=True, nogil=True, error_model="numpy")
def passes(
    step: Array, first: np.ndarray, a: Array, b: Array, c: Array, low: Array, high: Array, x_most: Array
) -> tuple[Array, int]:
    """Return the fastest squared speed from rest to rest (TOPP-RA, Pham and Pham 2018).

    With u = d2s/dt2 constant on each interval and x = (ds/dt)^2, the rows low <= a u + b x + c <= high hold
    at both ends of every interval, at the second with x + 2 D u in place of x.  Backward: the greatest and
    the least x from which the end can be reached.  Forward: the greatest u.

    Each linear programme has two variables.  For a given x the rows leave an interval of u, whose ends are a
    concave and a convex function of x; the greatest x is where they meet, and Newton's method finds it from
    the right in finitely many steps, for both are piecewise linear.

    Args:
        step: Length D of each interval, shape (N,).
        first: Node at the start of each interval; its end is the next node, shape (N,).
        a: shape (M, r), by node.
        b: shape (M, r), by node.
        c: shape (M, r), by node.
        low: shape (N, r), by interval.
        high: shape (N, r), by interval.
        x_most: Greatest x at the grid points, finite, shape (N + 1,).

    Returns:
        x at the grid points, shape (N + 1,), and -1; or, where there is none, the grid point at which the
        search ended.
    """
    size, rows = low.shape
    lines, span = np.empty((size, 3, 2 * rows + 1)), np.empty((size, 3))
    reach, x = np.zeros((size + 1, 2)), np.zeros(size + 1)
    changed = np.ones(size, np.bool_)
    failed = repeat_passes(step, first, a, b, c, low, high, x_most, changed, lines, span, reach, x)
    return x, failed


@njit(cache=True, nogil=True, error_model="numpy")
def repeat_passes(
    step: Array, first: np.ndarray, a: Array, b: Array, c: Array, low: Array, high: Array, x_most: Array,
    changed: np.ndarray, lines: Array, span: Array, reach: Array, x: Array,
) -> int:  # fmt: skip
    """Run the passes where limits have changed since the last time, and where that has consequences.

    Args:
        step: See `passes`, as for the other limits.
        first: Node at the start of each interval.
        a: Gains on u.
        b: Gains on x.
        c: Values at rest.
        low: Lower bounds.
        high: Upper bounds.
        x_most: Greatest x.
        changed: Intervals with bounds that are new, or whose greatest x is, shape (N,); at first all.
        lines: Kept between calls: rows as bounds on u, shape (N, 3, 2 r + 1).
        span: Kept: bounds on x of rows without u, and whether it can stand still (1 or 0), shape (N, 3).
        reach: Kept: least and greatest x from which the end can be reached, shape (N + 1, 2); at first 0.
        x: Kept: the result, shape (N + 1,); at first 0.

    Returns:
        -1, or the grid point at which the search ended.
    """
    size, last = step.size, 2 * low.shape[1]
    fresh = True  # whether what can be reached from the end of the interval is new
    anew = np.zeros(size, np.bool_)
    for i in range(size - 1, -1, -1):
        if not (changed[i] or fresh):
            continue
        if changed[i]:
            _write_lines(i, step[i], a, b, c, first[i], low, high, lines, span)
        slope = 1 / (2 * step[i])
        lines[i, 0, last], lines[i, 1, last] = reach[i + 1, 1] * slope, reach[i + 1, 0] * slope
        lines[i, 2, last] = slope
        from_x, to_x = span[i, 0], min(span[i, 1], x_most[i])
        greatest = _extreme(lines, i, to_x, True)
        if not (greatest >= from_x - _ROUNDING * abs(from_x)):
            return i
        smallest = 0.0
        if from_x > 0.0 or reach[i + 1, 0] > 0.0 or not span[i, 2]:
            smallest = min(_extreme(lines, i, from_x, False), greatest)
        fresh = smallest != reach[i, 0] or greatest != reach[i, 1]
        reach[i, 0], reach[i, 1] = smallest, greatest
        anew[i] = True
    if reach[0, 0] > 0.0:
        return 0
    fresh = False
    for i in range(size):
        if not (anew[i] or fresh):
            continue
        u = _greatest_u(lines, i, x[i])
        ahead = min(max(x[i] + 2 * step[i] * u, reach[i + 1, 0]), reach[i + 1, 1])
        if not x[i] + ahead > 0.0:
            return i
        fresh = ahead != x[i + 1]
        x[i + 1] = ahead
    return -1


@njit(cache=True, nogil=True, error_model="numpy")
def _write_lines(
    i: int, step: float, a: Array, b: Array, c: Array, node: int, low: Array, high: Array, lines: Array,
    span: Array,
) -> None:  # fmt: skip
    """Write every row as bottom - slope x <= u <= top - slope x; and what `repeat_passes` calls a span."""
    rows, flat, moves = low.shape[1], 0, 0
    for end in range(2):
        at, twice, k = node + end, 2 * step * end, end * rows
        for r in range(rows):
            beta, offset = b[at, r], c[at, r]
            alpha = a[at, r] + twice * beta
            flat += abs(alpha) <= _PARALLEL * step * abs(beta)
            inverse, up, down = 1 / alpha, high[i, r] - offset, low[i, r] - offset
            moves += (up < 0.0) | (down > 0.0)
            up, down = up * inverse, down * inverse
            lines[i, 0, k + r] = up if up > down else down
            lines[i, 1, k + r] = down if up > down else up
            lines[i, 2, k + r] = beta * inverse
    span[i, 0], span[i, 1], span[i, 2] = 0.0, np.inf, moves == 0
    if flat:
        _rows_without_u(i, step, a, b, c, node, low, high, lines, span)


@njit(cache=True, nogil=True, error_model="numpy")
def _rows_without_u(
    i: int, step: float, a: Array, b: Array, c: Array, node: int, low: Array, high: Array, lines: Array,
    span: Array,
) -> None:  # fmt: skip
    """Take rows that do not bound u out of the lines; they bound x."""
    rows = low.shape[1]
    from_x, to_x = 0.0, np.inf
    for end in range(2):
        for r in range(rows):
            beta, offset = b[node + end, r], c[node + end, r]
            alpha = a[node + end, r] + 2 * step * end * beta
            if not abs(alpha) <= _PARALLEL * step * abs(beta):
                continue
            k = end * rows + r
            lines[i, 0, k], lines[i, 1, k], lines[i, 2, k] = np.inf, -np.inf, 0.0
            up, down = high[i, r] - offset, low[i, r] - offset
            if beta > 0:
                to_x, from_x = min(to_x, up / beta), max(from_x, down / beta)
            elif beta < 0:
                to_x, from_x = min(to_x, down / beta), max(from_x, up / beta)
            elif up < 0 or down > 0:
                to_x = -np.inf
    span[i, 0], span[i, 1] = from_x, to_x


@njit(cache=True, nogil=True, error_model="numpy")
def _extreme(lines: Array, i: int, x: float, greatest: bool) -> float:
    """Return the greatest x below a given one (or the least above it) that leaves some u; NaN for none."""
    last = lines.shape[2] - 1
    for _ in range(200):
        upper, lower = _greatest_u(lines, i, x), _least_u(lines, i, x)
        gap = lower - upper
        if gap <= _ROUNDING * (abs(lower) + abs(upper)):
            return x
        k = j = 0
        while k < last and lines[i, 0, k] - lines[i, 2, k] * x > upper:
            k += 1
        while j < last and lines[i, 1, j] - lines[i, 2, j] * x < lower:
            j += 1
        turn = lines[i, 2, k] - lines[i, 2, j]  # d gap / dx
        if (turn <= 0) if greatest else (turn >= 0):
            return np.nan
        meet = (lines[i, 0, k] - lines[i, 1, j]) / turn
        if (meet >= x) if greatest else (meet <= x):
            return x
        x = meet
    return x


@njit(cache=True, nogil=True, error_model="numpy")
def _greatest_u(lines: Array, i: int, x: float) -> float:
    """Return the least of all upper bounds; four at a time, so that they share vector instructions."""
    p = q = r = s = np.inf
    count = lines.shape[2]
    whole = count // 4 * 4
    for k in range(0, whole, 4):
        value = lines[i, 0, k] - lines[i, 2, k] * x
        p = value if value < p else p
        value = lines[i, 0, k + 1] - lines[i, 2, k + 1] * x
        q = value if value < q else q
        value = lines[i, 0, k + 2] - lines[i, 2, k + 2] * x
        r = value if value < r else r
        value = lines[i, 0, k + 3] - lines[i, 2, k + 3] * x
        s = value if value < s else s
    for k in range(whole, count):
        value = lines[i, 0, k] - lines[i, 2, k] * x
        p = value if value < p else p
    p, r = q if q < p else p, s if s < r else r
    return r if r < p else p


@njit(cache=True, nogil=True, error_model="numpy")
def _least_u(lines: Array, i: int, x: float) -> float:
    """Return the greatest of all lower bounds; see `_greatest_u`."""
    p = q = r = s = -np.inf
    count = lines.shape[2]
    whole = count // 4 * 4
    for k in range(0, whole, 4):
        value = lines[i, 1, k] - lines[i, 2, k] * x
        p = value if value > p else p
        value = lines[i, 1, k + 1] - lines[i, 2, k + 1] * x
        q = value if value > q else q
        value = lines[i, 1, k + 2] - lines[i, 2, k + 2] * x
        r = value if value > r else r
        value = lines[i, 1, k + 3] - lines[i, 2, k + 3] * x
        s = value if value > s else s
    for k in range(whole, count):
        value = lines[i, 1, k] - lines[i, 2, k] * x
        p = value if value > p else p
    p, r = q if q > p else p, s if s > r else r
    return r if r > p else p
