"""Compiled: values and derivatives of piecewise polynomials at many times."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def states_at_times(breaks: Array, coefficients: Array, time: Array) -> Array:
    """Return value, first and second derivative at given times, shape (3, T, n).

    At a break the later piece gives the values, at the end the last.  Times that rise are found fastest.

    Args:
        breaks: Ends of the pieces, rising, shape (m + 1,).
        coefficients: Constant term first, shape (m, k, n).
        time: Within the breaks, shape (T,).
    """
    piece, local = np.empty(time.size, np.int64), np.empty(time.size)
    last, i = breaks.size - 2, 0
    for k in range(time.size):
        t = time[k]
        if t < breaks[i] or (i < last and t >= breaks[min(i + 8, last)]):
            i = min(max(np.searchsorted(breaks, t, side="right") - 1, 0), last)
        while i < last and t >= breaks[i + 1]:
            i += 1
        piece[k], local[k] = i, t - breaks[i]
    return states_on_pieces(coefficients, piece, local)


@njit(cache=True, nogil=True, error_model="numpy")
def states_on_pieces(coefficients: Array, piece: np.ndarray, local: Array) -> Array:
    """Return value, first and second derivative of polynomials, shape (3, T, n); Horner's scheme.

    Args:
        coefficients: Constant term first, shape (m, k, n).
        piece: Indices of pieces, shape (T,).
        local: Arguments, shape (T,).
    """
    state = np.empty((3, piece.size, coefficients.shape[2]))
    if coefficients.shape[1] == 7:
        _of_degree_six(coefficients, piece, local, state)
    else:
        _of_any_degree(coefficients, piece, local, state)
    return state


@njit(cache=True, nogil=True, error_model="numpy")
def _of_degree_six(coefficients: Array, piece: np.ndarray, local: Array, state: Array) -> None:
    """Written out for what timing along cubic paths gives, so that joints share vector instructions."""
    for k in range(piece.size):
        i, x = piece[k], local[k]
        for j in range(coefficients.shape[2]):
            p = coefficients[i, 6, j]
            d = p
            p = p * x + coefficients[i, 5, j]
            e = d
            d = d * x + p
            p = p * x + coefficients[i, 4, j]
            e = e * x + d
            d = d * x + p
            p = p * x + coefficients[i, 3, j]
            e = e * x + d
            d = d * x + p
            p = p * x + coefficients[i, 2, j]
            e = e * x + d
            d = d * x + p
            p = p * x + coefficients[i, 1, j]
            state[2, k, j] = 2 * (e * x + d)
            state[1, k, j] = d * x + p
            state[0, k, j] = p * x + coefficients[i, 0, j]


@njit(cache=True, nogil=True, error_model="numpy")
def _of_any_degree(coefficients: Array, piece: np.ndarray, local: Array, state: Array) -> None:
    state[:] = 0.0
    order, n = coefficients.shape[1], coefficients.shape[2]
    for k in range(piece.size):
        i, x = piece[k], local[k]
        for power in range(order - 1, -1, -1):
            for j in range(n):
                state[2, k, j] = state[2, k, j] * x + state[1, k, j]
                state[1, k, j] = state[1, k, j] * x + state[0, k, j]
                state[0, k, j] = state[0, k, j] * x + coefficients[i, power, j]
        for j in range(n):
            state[2, k, j] *= 2
