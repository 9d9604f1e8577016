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
    count = 2 * rows + 1
    top, bottom, slope = np.empty((size, count)), np.empty((size, count)), np.empty((size, count))
    least, most = np.zeros(size + 1), np.zeros(size + 1)
    x = np.zeros(size + 1)
    for i in range(size - 1, -1, -1):
        from_x, to_x = _lines(
            step[i],
            a,
            b,
            c,
            first[i],
            low[i],
            high[i],
            least[i + 1],
            most[i + 1],
            top[i],
            bottom[i],
            slope[i],
        )
        to_x = min(to_x, x_most[i])
        greatest = _extreme(top[i], bottom[i], slope[i], to_x, True)
        if not (greatest >= from_x - _ROUNDING * abs(from_x)):
            return x, i
        smallest = _extreme(top[i], bottom[i], slope[i], from_x, False)
        most[i] = greatest
        least[i] = min(smallest, greatest)
    if least[0] > 0.0:
        return x, 0
    for i in range(size):
        u = np.inf
        for k in range(count):
            u = min(u, top[i, k] - slope[i, k] * x[i])
        x[i + 1] = min(max(x[i] + 2 * step[i] * u, least[i + 1]), most[i + 1])
        if not x[i] + x[i + 1] > 0.0:
            return x, i
    return x, -1


@njit(cache=True, nogil=True, error_model="numpy")
def _lines(
    step: float, a: Array, b: Array, c: Array, node: int, low: Array, high: Array, least: float, most: float,
    top: Array, bottom: Array, slope: Array,
) -> tuple[float, float]:  # fmt: skip
    """Write every row as bottom - slope x <= u <= top - slope x; return the bounds on x of rows without u."""
    from_x, to_x = 0.0, np.inf
    rows = low.size
    for end in range(2):
        for r in range(rows):
            k = end * rows + r
            beta, offset = b[node + end, r], c[node + end, r]
            alpha = a[node + end, r] + 2 * step * end * beta
            up, down = high[r] - offset, low[r] - offset
            if abs(alpha) <= _PARALLEL * abs(beta) * step or alpha == 0.0:
                top[k], bottom[k], slope[k] = np.inf, -np.inf, 0.0
                if beta > 0:
                    to_x, from_x = min(to_x, up / beta), max(from_x, down / beta)
                elif beta < 0:
                    to_x, from_x = min(to_x, down / beta), max(from_x, up / beta)
                elif up < 0 or down > 0:
                    to_x = -np.inf
                continue
            inverse = 1 / alpha
            top[k] = (up if alpha > 0 else down) * inverse
            bottom[k] = (down if alpha > 0 else up) * inverse
            slope[k] = beta * inverse
    k = 2 * rows
    top[k], bottom[k], slope[k] = most / (2 * step), least / (2 * step), 1 / (2 * step)
    return from_x, to_x


@njit(cache=True, nogil=True, error_model="numpy")
def _extreme(top: Array, bottom: Array, slope: Array, x: float, greatest: bool) -> float:
    """Return the greatest x below a given one (or the least above it) that leaves some u; NaN for none."""
    for _ in range(200):
        upper, lower, i, j = np.inf, -np.inf, 0, 0
        for k in range(top.size):
            bend = slope[k] * x
            if top[k] - bend < upper:
                upper, i = top[k] - bend, k
            if bottom[k] - bend > lower:
                lower, j = bottom[k] - bend, k
        gap = lower - upper
        if gap <= _ROUNDING * (abs(lower) + abs(upper)):
            return x
        turn = slope[i] - slope[j]  # d gap / dx
        if (turn <= 0) if greatest else (turn >= 0):
            return np.nan
        meet = (top[i] - bottom[j]) / turn
        if (meet >= x) if greatest else (meet <= x):
            return x
        x = meet
    return x
