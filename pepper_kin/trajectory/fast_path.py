"""Compiled: the spline through way-points, and a path's derivatives at the points of a grid."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def spline(points: Array) -> tuple[Array, Array]:
    """Return the C2 cubic through way-points over the chord length, with unit speed along the end chords.

    The slopes at the way-points solve a tridiagonal system (de Boor, A Practical Guide to Splines, chapter
    4), here by elimination without pivoting, for its diagonal dominates.

    Args:
        points: Way-points, successive ones differ, shape (k, n).

    Returns:
        Breaks, shape (k,), and coefficients, constant term first, shape (k - 1, 4, n).
    """
    k, n = points.shape
    breaks, slope = np.zeros(k), np.empty((k, n))
    for i in range(k - 1):
        square = 0.0
        for j in range(n):
            square += (points[i + 1, j] - points[i, j]) ** 2
        breaks[i + 1] = breaks[i] + np.sqrt(square)
    upper = np.zeros(k)
    for i in range(k):
        left = breaks[i] - breaks[i - 1] if i > 0 else 0.0
        right = breaks[i + 1] - breaks[i] if i < k - 1 else 0.0
        inside = 0 < i < k - 1
        pivot = 2 * (left + right) - right * upper[i - 1] if inside else 1.0
        upper[i] = left / pivot if inside else 0.0
        for j in range(n):
            before = (points[i, j] - points[i - 1, j]) / left if i > 0 else 0.0
            after = (points[i + 1, j] - points[i, j]) / right if i < k - 1 else 0.0
            if inside:
                slope[i, j] = (3 * (right * before + left * after) - right * slope[i - 1, j]) / pivot
            else:
                slope[i, j] = before + after
    for i in range(k - 2, 0, -1):
        for j in range(n):
            slope[i, j] -= upper[i] * slope[i + 1, j]
    coefficients = np.empty((k - 1, 4, n))
    for i in range(k - 1):
        h = breaks[i + 1] - breaks[i]
        for j in range(n):
            chord = (points[i + 1, j] - points[i, j]) / h
            coefficients[i, 0, j] = points[i, j]
            coefficients[i, 1, j] = slope[i, j]
            coefficients[i, 2, j] = (3 * chord - 2 * slope[i, j] - slope[i + 1, j]) / h
            coefficients[i, 3, j] = (slope[i, j] + slope[i + 1, j] - 2 * chord) / (h * h)
    return breaks, coefficients


@njit(cache=True, nogil=True, error_model="numpy")
def greatest_excess(breaks: Array, coefficients: Array, lower: Array, upper: Array) -> float:
    """Return how far a piecewise cubic leaves its bounds at most, negative where it stays inside."""
    worst = -np.inf
    pieces, _, n = coefficients.shape
    for i in range(pieces):
        h = breaks[i + 1] - breaks[i]
        for j in range(n):
            q, a, b, c = (
                coefficients[i, 0, j],
                coefficients[i, 3, j],
                coefficients[i, 2, j],
                coefficients[i, 1, j],
            )
            # Between its ends a cubic is extreme where 3 a x^2 + 2 b x + c = 0.
            disc = b * b - 3 * a * c
            root = np.sqrt(disc) if disc > 0 else 0.0
            w = -(b + root if b >= 0 else b - root)
            for x in (0.0, h, w / (3 * a) if a != 0 else 0.0, c / w if w != 0 else 0.0):
                if 0 <= x <= h:
                    value = q + x * (c + x * (b + x * a))
                    worst = max(worst, lower[j] - value, value - upper[j])
    return worst


@njit(cache=True, nogil=True, error_model="numpy")
def spline_within(
    points: Array, lower: Array, upper: Array, same: float, tolerance: float
) -> tuple[bool, Array, Array]:
    """Return whether way-points are finite, differ, and give a spline within bounds; and the spline."""
    for i in range(points.shape[0]):
        for j in range(points.shape[1]):
            if not np.isfinite(points[i, j]):
                return False, np.empty(0), np.empty((0, 0, 0))
    breaks, coefficients = spline(points)
    for i in range(breaks.size - 1):
        if breaks[i + 1] - breaks[i] <= same:
            return False, breaks, coefficients
    return greatest_excess(breaks, coefficients, lower, upper) <= tolerance, breaks, coefficients


@njit(cache=True, nogil=True, error_model="numpy")
def nodes(
    breaks: Array, coefficients: Array, intervals: int
) -> tuple[Array, np.ndarray, Array, Array, Array]:
    """Cut every piece into equal intervals, as `make_grid` does, and evaluate the path at their ends.

    Args:
        breaks: Ends of the pieces, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n).
        intervals: Least number of intervals in all.

    Returns:
        Length of each interval, shape (N,); node at its start, whose end is the next one, shape (N,);
        q, q' and q'' at the nodes, shape (3, N + m, n), where pieces meet once for each; and the Taylor
        coefficients at the start of each interval, shape (N, 4, n); the length of the path's parameter at
        the grid points, shape (N + 1,), comes last.
    """
    pieces, _, n = coefficients.shape
    counts = np.empty(pieces, np.int64)
    for i in range(pieces):
        share = (breaks[i + 1] - breaks[i]) / (breaks[pieces] - breaks[0])
        counts[i] = max(1, int(np.ceil(intervals * share - 1e-9)))
    total = counts.sum()
    step, first = np.empty(total), np.empty(total, np.int64)
    at = np.empty((3, total + pieces, n))
    taylor = np.empty((total, 4, n))
    s = np.empty(total + 1)
    interval, node = 0, 0
    for i in range(pieces):
        h = (breaks[i + 1] - breaks[i]) / counts[i]
        for part in range(counts[i] + 1):
            x = part * h if part < counts[i] else breaks[i + 1] - breaks[i]
            for j in range(n):
                q, v, a, c = (
                    coefficients[i, 0, j], coefficients[i, 1, j], coefficients[i, 2, j], coefficients[i, 3, j]
                )  # fmt: skip
                at[0, node, j] = q + x * (v + x * (a + x * c))
                at[1, node, j] = v + x * (2 * a + 3 * x * c)
                at[2, node, j] = 2 * a + 6 * x * c
                if part < counts[i]:
                    taylor[interval, 0, j], taylor[interval, 1, j] = at[0, node, j], at[1, node, j]
                    taylor[interval, 2, j], taylor[interval, 3, j] = a + 3 * x * c, c
            if part < counts[i]:
                step[interval], first[interval], s[interval] = h, node, breaks[i] + x
                interval += 1
            node += 1
    s[total] = breaks[pieces]
    return step, first, at, taylor, s
