"""Quadratic programs with bounds, solved exactly by an active-set method."""

from __future__ import annotations

import math

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

CHANCES = 3
"""Number of rounds without fewer wrong bounds in which all wrong bounds change at once; after them one bound
changes at a time."""
MOST_ROUNDS = 300

FREE, LOW, HIGH = 0, 1, 2
"""States of a joint: within its bounds, or at the lower or upper bound."""


@compiled(lean=True, inline=True)
def solve_box(
    matrix: Floats2,
    gradient: Floats1,
    low: Floats1,
    high: Floats1,
    step: Floats1,
    state: Ints1,
    factor: Floats2,
    once: bool,
) -> bool:
    """Find the minimum of g^T x + x^T H x / 2 within low <= x <= high.

    The method starts with the bounds that `state` marks; joints beyond a bound are put on it, joints whose
    multiplier has the wrong sign leave it, until none is wrong (block principal pivoting: Judice and Pires,
    1994; one at a time after some rounds: Murty, 1974).

    Args:
        matrix: H, symmetric and positive definite, shape (k, k); its upper triangle is read.
        gradient: g, shape (k,).
        low: Lower bounds, shape (k,).
        high: Upper bounds, shape (k,).
        step: x, output, shape (k,) [rad or m].
        state: FREE, LOW or HIGH for each joint, read and written, shape (k,).
        factor: Workspace, shape (k, k + 1).
        once: Whether to solve once with the given states: joints beyond a bound are left there.

    Returns:
        Whether the matrix was positive definite and a solution was found.
    """
    k = gradient.size
    fewest, chances = k + 1, CHANCES
    for _ in range(MOST_ROUNDS):
        if not solve_free(matrix, gradient, low, high, step, state, factor):
            return False
        if once:
            return True
        wrong, last = 0, -1
        for i in range(k):
            if _change(matrix, gradient, low, high, step, state, i) != state[i]:
                wrong, last = wrong + 1, i
        if wrong == 0:
            break
        if wrong < fewest:
            fewest, chances = wrong, CHANCES
        else:
            chances -= 1
        # Changing all at once is quick but may cycle; changing only the last one cannot.  The new states
        # depend on the step, not on the state of other joints, so they may change one after the other.
        for i in range(k if chances >= 0 else 0):
            state[i] = _change(matrix, gradient, low, high, step, state, i)
        if chances < 0:
            state[last] = _change(matrix, gradient, low, high, step, state, last)
    for i in range(k):
        step[i] = min(max(step[i], low[i]), high[i])
    return True


@compiled(lean=True, inline=True)
def _change(
    matrix: Floats2, gradient: Floats1, low: Floats1, high: Floats1, step: Floats1, state: Ints1, i: int
) -> int:
    """Return the state that joint i should have after the step; arguments and shapes as in `solve_box`."""
    if state[i] == FREE:
        return LOW if step[i] < low[i] - 1e-12 else HIGH if step[i] > high[i] + 1e-12 else FREE
    if high[i] - low[i] <= 1e-14:
        return state[i]
    slope = gradient[i]
    for j in range(i):
        slope += matrix[j, i] * step[j]
    for j in range(i, step.size):
        slope += matrix[i, j] * step[j]
    pulled = (state[i] == LOW and slope < -1e-13) or (state[i] == HIGH and slope > 1e-13)
    return FREE if pulled else state[i]


@compiled(lean=True, inline=True)
def solve_free(
    matrix: Floats2,
    gradient: Floats1,
    low: Floats1,
    high: Floats1,
    step: Floats1,
    state: Ints1,
    factor: Floats2,
) -> bool:
    """Solve for the free joints by Cholesky factorization, with the others at their bounds.

    The free joints' rows are contiguous in `factor`, the right-hand side in its last column.  The factor is
    computed column by column, whose entries are independent.  Arguments, shapes and result are those of
    `solve_box`.
    """
    k, count = gradient.size, 0
    for i in range(k):
        if state[i] != FREE:
            step[i] = low[i] if state[i] == LOW else high[i]
    for i in range(k):
        if state[i] != FREE:
            continue
        right, b = -gradient[i], 0
        for j in range(k):
            if state[j] != FREE:
                right -= (matrix[i, j] if j >= i else matrix[j, i]) * step[j]
            elif j <= i:
                factor[count, b] = matrix[j, i]
                b += 1
        factor[count, k] = right
        count += 1
    for b in range(count):
        pivot, right = factor[b, b], factor[b, k]
        for c in range(b):
            pivot -= factor[b, c] * factor[b, c]
            right -= factor[b, c] * factor[c, k]
        if not pivot > 1e-300:
            return False
        inverse = 1.0 / math.sqrt(pivot)
        factor[b, b], factor[b, k] = inverse, right * inverse
        for a in range(b + 1, count):
            total = factor[a, b]
            for c in range(b):
                total -= factor[a, c] * factor[b, c]
            factor[a, b] = total * inverse
    for i in range(k - 1, -1, -1):
        if state[i] == FREE:
            count -= 1
            step[i] = factor[count, k] * factor[count, count]
            for c in range(count):
                factor[c, k] -= factor[count, c] * step[i]
    return True
