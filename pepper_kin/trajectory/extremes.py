"""Extremes of piecewise polynomials over their whole length, not of samples.

On a piece of length h, with u = t / h in [0, 1], a polynomial sum_p c_p t^p has the Bernstein coefficients

    b_i = sum_{p <= i} C(i, p) / C(k, p) c_p h^p,   i = 0 ... k:

the first and the last are its values at the ends, and none of its values is above the greatest of them (the
convex hull property; G. Farin, Curves and Surfaces for CAGD, 2002).  Pieces whose greatest coefficient is
above the greatest value found so far are halved (de Casteljau) until none is above it by more than rounding.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array

ROUNDING = 1e-13
"""Of the greatest coefficient: what an extreme is known to."""

_HALVINGS = 60
_AT_ONCE = 2048  # pieces


class Maxima(NamedTuple):
    """Greatest values of the columns of a piecewise polynomial.

    Attributes:
        value: The greatest values, shape (n,).
        time: Where they are attained, shape (n,).
    """

    value: Array
    time: Array


def derivative(coefficients: Array, order: int) -> Array:
    """Return the pieces of a derivative with respect to time.

    Args:
        coefficients: Constant term first, shape (m, k, n).
        order: Of the derivative, 0 or more.

    Returns:
        Shape (m, max(k - order, 1), n).
    """
    found = coefficients
    for _ in range(order):
        powers = np.arange(1.0, found.shape[1])[:, None]
        found = found[:, 1:] * powers if len(powers) else np.zeros_like(found)
    return found


def bernstein(step: Array, coefficients: Array) -> Array:
    """Return the Bernstein coefficients of pieces.

    Args:
        step: Lengths of the pieces, shape (m,).
        coefficients: Constant term first, shape (m, k, n).

    Returns:
        Shape (m, k, n).
    """
    count = coefficients.shape[1]
    gain = np.array(
        [[comb(i, p) / comb(count - 1, p) if p <= i else 0.0 for p in range(count)] for i in range(count)]
    )
    scaled = coefficients * (step[:, None] ** np.arange(count))[:, :, None]
    return np.asarray(np.matmul(gain, scaled))


def greatest_size(step: Array, coefficients: Array) -> Array:
    """Return a bound on |p(t)| on each piece, the greatest of its Bernstein coefficients, shape (m, n)."""
    return np.asarray(np.abs(bernstein(step, coefficients)).max(axis=1))


def maxima(breaks: Array, coefficients: Array) -> Maxima:
    """Return the greatest values of a piecewise polynomial, to `ROUNDING`.

    Args:
        breaks: Ends of the pieces, shape (m + 1,).
        coefficients: Constant term first, shape (m, k, n).
    """
    m, _, n = coefficients.shape
    best, time = np.full(n, -np.inf), np.zeros(n)
    for first in range(0, m, _AT_ONCE):
        part = slice(first, min(first + _AT_ONCE, m))
        _improve(breaks[first : part.stop + 1], coefficients[part], best, time)
    return Maxima(best, time)


def _improve(breaks: Array, coefficients: Array, best: Array, time: Array) -> None:
    """Replace the greatest values, and where they are, by greater ones of some pieces.

    Args:
        breaks: Ends of the pieces, shape (m + 1,).
        coefficients: Constant term first, shape (m, k, n).
        best: The greatest values so far, shape (n,), changed in place.
        time: Where they are attained, shape (n,), changed in place.
    """
    step, columns = np.diff(breaks), np.arange(best.size)
    hull = bernstein(step, coefficients)
    for end, places in ((0, breaks[:-1]), (-1, breaks[1:])):
        at = hull[:, end].argmax(axis=0)
        value = hull[at, end, columns]
        better = value > best
        best[better], time[better] = value[better], places[at[better]]
    tolerance = ROUNDING * np.abs(hull).max(axis=(0, 1))
    segment, column = np.nonzero(hull.max(axis=1) > best + tolerance)
    rows, start, width = hull[segment, :, column], breaks[segment], step[segment]
    for _ in range(_HALVINGS):
        if not column.size:
            return
        left, right = _halves(rows)
        width = width / 2
        rows = np.concatenate([left, right])
        start, width, column = np.concatenate([start, start + width]), np.tile(width, 2), np.tile(column, 2)
        order = np.argsort(rows[:, 0])  # the last of several values for one column is kept: the greatest
        better = order[rows[order, 0] > best[column[order]]]
        best[column[better]], time[column[better]] = rows[better, 0], start[better]
        still = rows.max(axis=1) > best[column] + tolerance[column]
        rows, start, width, column = rows[still], start[still], width[still], column[still]


def _halves(rows: Array) -> tuple[Array, Array]:
    """Return the Bernstein coefficients of both halves of polynomials, shape (r, k) each."""
    left, right, count = np.empty_like(rows), np.empty_like(rows), rows.shape[1]
    for i in range(count):
        left[:, i], right[:, count - 1 - i] = rows[:, 0], rows[:, -1]
        rows = (rows[:, :-1] + rows[:, 1:]) / 2
    return left, right
