"""Piecewise polynomials: values by Horner's scheme, bounds and extrema in the Bernstein basis.

On a segment of length h, with u = t / h in [0, 1], a polynomial sum_p c_p t^p has the Bernstein coefficients

    b_i = sum_{p <= i} C(i, p) / C(k, p) c_p h^p,   i = 0 ... k:

the first and the last are its values at the ends, and no value is above the maximum coefficient (the convex
hull property; G. Farin, Curves and Surfaces for CAGD, 2002).
"""

from __future__ import annotations

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1

ROUNDING = 1e-13
"""Tolerance of an extremum, relative to the maximum absolute coefficient."""
_DEEPEST = 64  # depth of the stack of halves: doubles cannot be halved more often


@compiled("void(float64[:, :, ::1], int64[::1], float64[::1], float64[:, :, ::1])")
def evaluate(coefficients: Floats3, segment: Ints1, local: Floats1, state: Floats3) -> None:
    """Write value and first derivatives of polynomials.

    Horner's scheme for all of them at once: the sums of its steps are p(x), p'(x), p''(x) / 2, ...

    Args:
        coefficients: Constant term first, shape (m, k, n).
        segment: Indices of segments, shape (T,).
        local: Times from the segments' starts [s], shape (T,).
        state: Output, derivative by derivative, shape (d, T, n), 1 <= d <= 4.
    """
    orders = state.shape[0]
    for t in range(segment.size):
        x, own = local[t], coefficients[segment[t]]
        for j in range(own.shape[1]):
            value = first = second = third = 0.0
            for power in range(own.shape[0] - 1, -1, -1):
                third = third * x + second
                second = second * x + first
                first = first * x + value
                value = value * x + own[power, j]
            state[0, t, j] = value
            if orders > 1:
                state[1, t, j] = first
            if orders > 2:
                state[2, t, j] = 2.0 * second
            if orders > 3:
                state[3, t, j] = 6.0 * third


@compiled(lean=True)
def _scale(count: int, order: int, step: float, scale: Floats1) -> int:
    """Write the factors from a segment's coefficients to a derivative's scaled ones; return their number.

    With k the derivative's degree, its coefficient p is (p + order)! / p! c_{p + order}; the factor includes
    h^p / C(k, p).
    """
    size = max(count - order, 1)
    power, choices = 1.0, 1.0
    for p in range(size):
        if p:
            power *= step
            choices *= (size - p) / p
        scale[p] = power / choices if order < count else 0.0
        for i in range(order):
            scale[p] *= p + order - i
    return size


@compiled(lean=True, inline=True)
def _bernstein(own: Floats2, j: int, order: int, scale: Floats1, row: Floats1, size: int) -> None:
    """Write the Bernstein coefficients of a derivative of a segment by repeated sums of adjacent entries.

    With a_p the scaled coefficients, b_i = sum_p C(i, p) a_p: k rounds of adding to each its predecessor.
    """
    for p in range(size):
        row[p] = own[min(order + p, own.shape[0] - 1), j] * scale[p]
    for i in range(1, size):
        for p in range(size - 1, i - 1, -1):
            row[p] += row[p - 1]


@compiled("void(float64[:, :, ::1], int64[::1], float64[:, ::1], float64[:, :, ::1])")
def derivative_bounds(coefficients: Floats3, segment: Ints1, parts: Floats2, bounds: Floats3) -> None:
    """Write bounds on the derivatives of parts of segments: the maximum absolute Bernstein coefficients.

    Args:
        coefficients: Constant term first, shape (m, k, n), k <= 32.
        segment: Index of the segment of each part, shape (c,).
        parts: Start of each part after its segment's start, and its length [s], shape (c, 2).
        bounds: Output, bounds on |d^o p / dt^o|, o = 0 ... , shape (orders, c, n).
    """
    count = coefficients.shape[1]
    moved, row, scale = np.empty((count, coefficients.shape[2])), np.empty(count), np.empty(count)
    for c in range(segment.size):
        start, own = parts[c, 0], coefficients[segment[c]]
        if start > 0.0:
            for p in range(count):
                for j in range(own.shape[1]):
                    moved[p, j] = own[p, j]
            for k in range(count - 1):  # Taylor's shift
                for p in range(count - 2, k - 1, -1):
                    for j in range(own.shape[1]):
                        moved[p, j] += start * moved[p + 1, j]
            own = moved
        for order in range(bounds.shape[0]):
            size = _scale(count, order, parts[c, 1], scale)
            for j in range(own.shape[1]):
                _bernstein(own, j, order, scale, row, size)
                most = 0.0
                for i in range(size):
                    most = max(most, abs(row[i]))
                bounds[order, c, j] = most


@compiled(lean=True)
def _halve(rows: Floats2, depth: int, count: int) -> None:
    """Split a row of coefficients, shape (k,): its right half stays, the left half goes to the next row."""
    right, left = rows[depth], rows[depth + 1]
    for i in range(count):
        left[i] = right[0]
        for p in range(count - 1 - i):
            right[p] = (right[p] + right[p + 1]) / 2.0
    # The last coefficient of each round stays: the row is the right half, in order.


@compiled(lean=True)
def _search(rows: Floats2, ends: Floats2, count: int, tolerance: float, best: Floats1) -> None:
    """Update the maximum value and its time, shape (2,), by a polynomial's greater values.

    Args:
        rows: Bernstein coefficients in the first row; the other rows are workspace.
        ends: Start and end times in the first row; the other rows are workspace.
        count: Number of coefficients.
        tolerance: Absolute tolerance of the maximum.
        best: Maximum value and its time, changed.
    """
    depth = 0
    while depth >= 0:
        top, start, end = -np.inf, ends[depth, 0], ends[depth, 1]
        for i in range(count):
            top = max(top, rows[depth, i])
        middle = (start + end) / 2.0
        if top <= best[0] + tolerance or not start < middle < end:
            depth -= 1
            continue
        _halve(rows, depth, count)
        if rows[depth, 0] > best[0]:
            best[0], best[1] = rows[depth, 0], middle
        ends[depth, 0], ends[depth + 1, 0], ends[depth + 1, 1] = middle, start, middle
        depth += 1


@compiled("void(float64[::1], float64[:, :, ::1], int64, float64[:, :, ::1])")
def extremes(breaks: Floats1, coefficients: Floats3, order: int, found: Floats3) -> None:
    """Write the extrema of a derivative of a piecewise polynomial, to a tolerance of `ROUNDING`.

    Segments whose maximum Bernstein coefficient is above the maximum value found so far are halved (de
    Casteljau) until none is above it by more than the tolerance.

    Args:
        breaks: Ends of the segments [s], shape (m + 1,).
        coefficients: Constant term first, shape (m, k, n).
        order: Order of the derivative.
        found: Output: for each joint the maximum and its time, then those of the negative, shape (n, 2, 2).
    """
    m, count, n = coefficients.shape
    rows, ends, scale = np.empty((_DEEPEST + 2, count)), np.empty((_DEEPEST + 2, 2)), np.empty(count)
    hull, most, row = np.empty((m, n, 2)), np.zeros(n), rows[0]
    for j in range(n):
        for side in range(2):
            found[j, side, 0], found[j, side, 1] = -np.inf, 0.0
    for s in range(m):
        size = _scale(count, order, breaks[s + 1] - breaks[s], scale)
        for j in range(n):
            _bernstein(coefficients[s], j, order, scale, row, size)
            high = low = row[0]
            for i in range(1, size):
                high, low = max(high, row[i]), min(low, row[i])
            hull[s, j, 0], hull[s, j, 1] = high, -low
            most[j] = max(most[j], max(high, -low))
            for end in range(2):
                value, place = row[end * (size - 1)], breaks[s + end]
                if value > found[j, 0, 0]:
                    found[j, 0, 0], found[j, 0, 1] = value, place
                if -value > found[j, 1, 0]:
                    found[j, 1, 0], found[j, 1, 1] = -value, place
    for s in range(m):
        size = _scale(count, order, breaks[s + 1] - breaks[s], scale)
        for j in range(n):
            for side in range(2):
                tolerance = ROUNDING * most[j]
                if hull[s, j, side] > found[j, side, 0] + tolerance:
                    _bernstein(coefficients[s], j, order, scale, row, size)
                    for i in range(size):
                        row[i] *= 1.0 - 2.0 * side
                    ends[0, 0], ends[0, 1] = breaks[s], breaks[s + 1]
                    _search(rows, ends, size, tolerance, found[j, side])
