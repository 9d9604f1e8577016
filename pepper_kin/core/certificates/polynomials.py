"""Piecewise polynomials: values by Horner's scheme, bounds and extremes by Bernstein's basis.

On a piece of length h, with u = t / h in [0, 1], a polynomial sum_p c_p t^p has the Bernstein coefficients

    b_i = sum_{p <= i} C(i, p) / C(k, p) c_p h^p,   i = 0 ... k:

the first and the last are its values at the ends, and none of its values is above the greatest of them (the
convex hull property; G. Farin, Curves and Surfaces for CAGD, 2002).
"""

from __future__ import annotations

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1

ROUNDING = 1e-13
"""Of the greatest coefficient: what an extreme is known to."""
_DEEPEST = 64  # halves of a piece that wait: each is half as long as the one before, which ends with doubles


@compiled("void(float64[:, :, ::1], int64[::1], float64[::1], float64[:, :, ::1])")
def evaluate(coefficients: Floats3, segment: Ints1, local: Floats1, state: Floats3) -> None:
    """Write value and first derivatives of polynomials.

    Horner's scheme for all of them at once: the sums of its steps are p(x), p'(x), p''(x) / 2, ...

    Args:
        coefficients: Constant term first, shape (m, k, n).
        segment: Indices of pieces, shape (T,).
        local: Times from their starts [s], shape (T,).
        state: Written, shape (d, T, n), 1 <= d <= 4.
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
    """Write what coefficients of a derivative of a piece are multiplied with; return how many there are.

    With k its degree, its coefficient p is (p + order)! / p! c_{p + order}, of which h^p / C(k, p) is wanted.
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
    """Write the Bernstein coefficients of a derivative of a piece, by sums of neighbors.

    With a_p the scaled coefficients, b_i = sum_p C(i, p) a_p: k rounds of adding to each its predecessor.
    """
    for p in range(size):
        row[p] = own[min(order + p, own.shape[0] - 1), j] * scale[p]
    for i in range(1, size):
        for p in range(size - 1, i - 1, -1):
            row[p] += row[p - 1]


@compiled("void(float64[:, :, ::1], int64[::1], float64[:, ::1], float64[:, :, ::1])")
def derivative_bounds(coefficients: Floats3, segment: Ints1, parts: Floats2, bounds: Floats3) -> None:
    """Write bounds on the derivatives of parts of pieces, the greatest of their Bernstein coefficients.

    Args:
        coefficients: Constant term first, shape (m, k, n), k <= 32.
        segment: The piece of each part, shape (c,).
        parts: Time from the start of the piece to that of the part, and its length [s], shape (c, 2).
        bounds: Written, bounds on |d^o p / dt^o|, o = 0 ... , shape (orders, c, n).
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
    """Replace a row, shape (k,), by the right half of its polynomial, and write the left one behind it."""
    right, left = rows[depth], rows[depth + 1]
    for i in range(count):
        left[i] = right[0]
        for p in range(count - 1 - i):
            right[p] = (right[p] + right[p + 1]) / 2.0
    # The last coefficient of each round stays: they are the right half, in order.


@compiled(lean=True)
def _search(rows: Floats2, ends: Floats2, count: int, tolerance: float, best: Floats1) -> None:
    """Replace the greatest value and its time, shape (2,), where a polynomial has greater ones.

    Args:
        rows: Its Bernstein coefficients in the first row; the others are workspace.
        ends: Where it begins and ends in the first row; the others are workspace.
        count: Number of coefficients.
        tolerance: What the greatest value may be off.
        best: Changed.
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
    """Write the greatest values of a derivative of a piecewise polynomial and of its negative, to `ROUNDING`.

    Pieces whose greatest Bernstein coefficient is above the greatest value found so far are halved (de
    Casteljau) until none is above it by more than rounding.

    Args:
        breaks: Ends of the pieces [s], shape (m + 1,).
        coefficients: Constant term first, shape (m, k, n).
        order: Of the derivative.
        found: Written: for each joint the greatest value and its time, then those of the negative, (n, 2, 2).
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
