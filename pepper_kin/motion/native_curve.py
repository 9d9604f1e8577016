"""Compiled: way-points on a rounded polyline, and states along a piecewise cubic curve.

Numba keeps the machine code beside this file and renews it when this file changes.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Places = NDArray[np.int64]

_DEGREE = 3


@njit("void(float64[:, ::1], float64[::1], float64, float64[::1])", cache=True, nogil=True)
def _on_polyline(points: Array, lengths: Array, s: float, state: Array) -> None:
    """Write the state of a polyline at an arc length; `lengths` are those of its points."""
    k = 0
    while k < lengths.size - 2 and lengths[k + 1] < s:
        k += 1
    span = lengths[k + 1] - lengths[k]
    share = min(max((s - lengths[k]) / span, 0.0), 1.0) if span > 0.0 else 1.0
    for i in range(state.size):
        state[i] = points[k, i] + share * (points[k + 1, i] - points[k, i])


@njit("float64[:, ::1](float64[:, ::1], float64[::1], int64)", cache=True, nogil=True, error_model="numpy")
def rounded_waypoints(points: Array, lengths: Array, pieces: int) -> Array:
    """Return the values at its breaks of the Schoenberg spline of a polyline, with breaks equally spaced.

    See `planners.smooth` for the curve, and `planners.smooth._power_basis` for the values: a break t_j's is
    interpolated between those of the three control points whose B-splines are not zero there.

    Args:
        points: The polyline, two points or more, shape (k, n).
        lengths: Arc length at each, shape (k,), rising.
        pieces: Number of pieces.

    Returns:
        Shape (pieces + 1, n); the first and the last row are the polyline's ends.
    """
    n, total = points.shape[1], lengths[-1]
    knots = np.empty(pieces + 1 + 2 * _DEGREE)
    for j in range(knots.size):
        knots[j] = total * min(max(j - _DEGREE, 0), pieces) / pieces
    control = np.empty((pieces + _DEGREE, n))
    for i in range(control.shape[0]):
        s = (knots[i + 1] + knots[i + 2] + knots[i + 3]) / 3.0
        _on_polyline(points, lengths, min(s, total), control[i])
    found = np.empty((pieces + 1, n))
    for j in range(1, pieces):
        t = knots[j : j + 7]  # t[3] is the break
        for i in range(n):
            a, b, c = control[j, i], control[j + 1, i], control[j + 2, i]
            first = a + (t[3] - t[1]) / (t[4] - t[1]) * (b - a)
            second = b + (t[3] - t[2]) / (t[5] - t[2]) * (c - b)
            found[j, i] = first + (t[3] - t[2]) / (t[4] - t[2]) * (second - first)
    found[0], found[pieces] = points[0], points[-1]
    return found


@njit(
    "Tuple((int64[::1], float64[::1], float64[::1]))"
    "(float64[::1], float64[:, :, ::1], float64[::1], float64)",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def stations(breaks: Array, coefficients: Array, reach: Array, step: float) -> tuple[Places, Array, Array]:
    """Cut a curve into intervals on none of which any point of the body moves farther than a step.

    A point moves at most sum_j reach_j |dq_j|, and |dq_j/ds| on a piece is at most the greatest of the
    control values of that quadratic, since it is a Bezier curve.

    Args:
        breaks: Ends of the pieces, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n).
        reach: How far a joint moves a point of the body, shape (n,) [m/rad, or 1].
        step: [m].

    Returns:
        Of each of the N intervals the piece, the parameter at its start, counted from the piece's first
        break, and its width, each of shape (N,).
    """
    pieces, n = coefficients.shape[0], reach.size
    counts = np.empty(pieces, np.int64)
    for i in range(pieces):
        h, speed = breaks[i + 1] - breaks[i], 0.0
        for j in range(n):
            first, second, third = coefficients[i, 1, j], coefficients[i, 2, j], coefficients[i, 3, j]
            middle = first + second * h
            last = middle + (second + 3.0 * third * h) * h
            speed += reach[j] * max(abs(first), abs(middle), abs(last))
        counts[i] = max(1, np.ceil(h * speed / step))
    total = counts.sum()
    piece, local, width = np.empty(total, np.int64), np.empty(total), np.empty(total)
    place = 0
    for i in range(pieces):
        h = (breaks[i + 1] - breaks[i]) / counts[i]
        for k in range(counts[i]):
            piece[place], local[place], width[place] = i, k * h, h
            place += 1
    return piece, local, width


@njit(
    "float64[:, ::1](float64[:, :, ::1], int64[::1], float64[::1], float64[::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def middles(coefficients: Array, piece: Places, begin: Array, width: Array) -> Array:
    """Return the states in the middle of intervals of a curve.

    Args:
        coefficients: Constant term first, shape (m, 4, n).
        piece: The piece of each of N intervals, shape (N,).
        begin: Where they begin, from the piece's first break, shape (N,).
        width: Their widths, shape (N,).

    Returns:
        Shape (N, n).
    """
    n = coefficients.shape[2]
    states = np.empty((piece.size, n))
    for k in range(piece.size):
        x, one = begin[k] + 0.5 * width[k], coefficients[piece[k]]
        for j in range(n):
            states[k, j] = one[0, j] + x * (one[1, j] + x * (one[2, j] + x * one[3, j]))
    return states
