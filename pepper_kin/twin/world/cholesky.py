"""Small symmetric systems, factored in place and in one order, so that every run gives the same bits."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS

Array = NDArray[np.float64]


@njit("boolean(float64[:, ::1])", **OPTIONS)
def factor(matrix: Array) -> bool:
    """Write L of matrix = L L^T over its lower triangle; False where it is not positive definite."""
    size = len(matrix)
    for i in range(size):
        for k in range(i + 1):
            total = matrix[i, k]
            for m in range(k):
                total -= matrix[i, m] * matrix[k, m]
            if i == k:
                if not total > 0.0:
                    return False
                matrix[i, i] = math.sqrt(total)
            else:
                matrix[i, k] = total / matrix[k, k]
    return True


@njit("void(float64[:, ::1], float64[::1])", **OPTIONS)
def solve(lower: Array, vector: Array) -> None:
    """Write x of L L^T x = vector over the vector."""
    size = len(lower)
    for i in range(size):
        total = vector[i]
        for m in range(i):
            total -= lower[i, m] * vector[m]
        vector[i] = total / lower[i, i]
    for i in range(size - 1, -1, -1):
        vector[i] /= lower[i, i]
        total = vector[i]
        for m in range(i):
            vector[m] -= lower[i, m] * total
