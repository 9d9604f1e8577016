"""The step: a quadratic programme within a box, solved exactly by changing the set of active bounds."""

from __future__ import annotations

import math

from numba import njit

from pepper_kin.ik.tasks.task import Array

# Rounds in which all wrong bounds change at once; after them one at a time, which cannot go in circles.
BLOCK_ROUNDS = 8
MOST_ROUNDS = 60

FREE, LOW, HIGH = 0, 1, 2


@njit(cache=True, nogil=True, error_model="numpy")
def solve_box(
    matrix: Array, gradient: Array, low: Array, high: Array, step: Array, state: Array, factor: Array
) -> bool:
    """Find the minimum of g^T x + x^T H x / 2 within low <= x <= high.

    Starts with the bounds that `state` marks; joints beyond a bound are put on it, joints whose multiplier has
    the wrong sign leave it, until none is wrong (block principal pivoting: Judice and Pires, 1994; one at a
    time after some rounds: Murty, 1974).

    Args:
        matrix: H, symmetric and positive definite, shape (k, k); its upper triangle is read.
        gradient: g, shape (k,).
        low: Lower bounds, shape (k,).
        high: Upper bounds, shape (k,).
        step: x, written, shape (k,).
        state: FREE, LOW or HIGH for each joint, read and written, shape (k,).
        factor: Room of shape (k, k + 1).

    Returns:
        Whether the matrix was positive definite and a solution was found.
    """
    k = gradient.size
    for round_ in range(MOST_ROUNDS):
        if not solve_free(matrix, gradient, low, high, step, state, factor):
            return False
        wrong = -1
        for i in range(k):
            change = -1
            if state[i] == FREE:
                if step[i] < low[i] - 1e-12:
                    change = LOW
                elif step[i] > high[i] + 1e-12:
                    change = HIGH
            else:
                slope = gradient[i]
                for j in range(k):
                    slope += (matrix[i, j] if j >= i else matrix[j, i]) * step[j]
                if (state[i] == LOW and slope < -1e-13) or (state[i] == HIGH and slope > 1e-13):
                    if high[i] - low[i] > 1e-14:
                        change = FREE
            if change >= 0:
                wrong = i
                if round_ < BLOCK_ROUNDS:
                    state[i] = change
                else:
                    last = change
        if wrong < 0:
            for i in range(k):
                step[i] = min(max(step[i], low[i]), high[i])
            return True
        if round_ >= BLOCK_ROUNDS:
            state[wrong] = last
    for i in range(k):
        step[i] = min(max(step[i], low[i]), high[i])
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def solve_free(
    matrix: Array, gradient: Array, low: Array, high: Array, step: Array, state: Array, factor: Array
) -> bool:
    """Solve for the free joints by Cholesky's factorisation, with the others at their bounds."""
    k = gradient.size
    for i in range(k):
        if state[i] == LOW:
            step[i] = low[i]
        elif state[i] == HIGH:
            step[i] = high[i]
    for i in range(k):
        if state[i] != FREE:
            continue
        right = -gradient[i]
        for j in range(k):
            if state[j] != FREE:
                right -= (matrix[i, j] if j >= i else matrix[j, i]) * step[j]
        for j in range(i):
            if state[j] != FREE:
                continue
            total = matrix[j, i]
            for c in range(j):
                if state[c] == FREE:
                    total -= factor[i, c] * factor[j, c]
            factor[i, j] = total * factor[j, j]
        pivot = matrix[i, i]
        for c in range(i):
            if state[c] == FREE:
                pivot -= factor[i, c] * factor[i, c]
                right -= factor[i, c] * factor[c, k]
        if not pivot > 1e-300:
            return False
        factor[i, i] = 1.0 / math.sqrt(pivot)
        factor[i, k] = right * factor[i, i]
    for i in range(k - 1, -1, -1):
        if state[i] != FREE:
            continue
        value = factor[i, k]
        for j in range(i + 1, k):
            if state[j] == FREE:
                value -= factor[j, i] * step[j]
        step[i] = value * factor[i, i]
    return True
