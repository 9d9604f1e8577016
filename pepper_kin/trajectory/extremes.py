"""Extremes of piecewise polynomials over their whole length, not of samples.

The greatest Bernstein coefficient of a piece bounds it, and pieces are halved until none is above the
greatest value found by more than rounding (`pepper_kin.core.certificates.polynomials`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.certificates.polynomials import extremes


class Extremes(NamedTuple):
    """Greatest and least values of the columns of a piecewise polynomial, shape (n,) each.

    Attributes:
        high: The greatest values.
        high_time: Where they are attained [s].
        low: The least values.
        low_time: Where these are attained [s].
    """

    high: Array
    high_time: Array
    low: Array
    low_time: Array


def extremes_of(breaks: Array, coefficients: Array, order: int = 0) -> Extremes:
    """Return the extremes of a derivative of a piecewise polynomial, to 1e-13 of the greatest bound.

    Args:
        breaks: Ends of the pieces [s], shape (m + 1,).
        coefficients: Constant term first, shape (m, k, n).
        order: Of the derivative, 0 or more.
    """
    found = np.empty((coefficients.shape[2], 2, 2))
    extremes(np.ascontiguousarray(breaks), np.ascontiguousarray(coefficients), order, found)
    (high, high_time), (less, low_time) = np.moveaxis(found, 0, -1)
    return Extremes(high, high_time, -less, low_time)
