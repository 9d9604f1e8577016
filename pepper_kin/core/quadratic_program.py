"""Small dense quadratic programs, solved exactly."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.linear_algebra import cholesky, dot, solve_lower, solve_lower_transposed
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Ints1

# Violation up to which a constraint counts as satisfied [rad/s or m/s], and relative size of a zero normal.
KEPT = 1e-10
PARALLEL = 1e-12


def solve_program(
    hessian: Floats2, gradient: Floats1, low: Floats1, high: Floats1, rows: Floats2, least: Floats1
) -> Floats1 | None:
    """Return x = argmin x^T H x / 2 + g^T x  subject to  low <= x <= high,  C x >= least.

    The dual method of Goldfarb and Idnani (A numerically stable dual method for solving strictly convex
    quadratic programs, 1983): from the unconstrained minimum, the constraint violated most is added next, and
    constraints whose multiplier vanishes are dropped.  Its cost grows with the number of constraints that are
    active at the end, not with the total number, and it ends after finitely many steps, also with parallel or
    degenerate rows: interior and augmented Lagrangian methods may take longer there than a control cycle.

    Args:
        hessian: H, symmetric and positive definite, shape (n, n).
        gradient: g, shape (n,).
        low: Lower bounds, shape (n,).
        high: Upper bounds, shape (n,).
        rows: C, shape (k, n).
        least: Lower bounds of C x, shape (k,).

    Returns:
        x, exactly within the box, shape (n,); None if rows and box contradict one another.
    """
    x = np.empty(gradient.size)
    program = QuadraticProgram(
        np.ascontiguousarray(hessian), gradient, low, high, np.ascontiguousarray(rows), least
    )
    return np.clip(x, low, high) if solve(program, x) and np.isfinite(x).all() else None


class QuadraticProgram(NamedTuple):
    """min x^T H x / 2 + g^T x  subject to  low <= x <= high,  C x >= least; shapes as in `solve_program`."""

    hessian: Floats2
    gradient: Floats1
    low: Floats1
    high: Floats1
    rows: Floats2
    least: Floats1


@compiled("boolean(QuadraticProgram, float64[::1])")
def solve(program: QuadraticProgram, x: Floats1) -> bool:
    """Write x of `solve_program`, shape (n,); return whether a solution exists.

    The program is solved in y = L^T x with H = L L^T, where the objective is the distance to the
    unconstrained minimum.
    """
    hessian, gradient, low, high = program.hessian, program.gradient, program.low, program.high
    rows, least = program.rows, program.least
    n, k = gradient.size, least.size
    factor = np.zeros((n, n))
    if not cholesky(hessian, factor):
        return False
    y = -gradient
    solve_lower(factor, y)
    norms = np.empty(k)
    for i in range(k):
        norms[i] = math.sqrt(dot(rows[i], rows[i]))
    basis, triangle = np.zeros((n, n)), np.zeros((n, n))
    multipliers, active = np.zeros(n + 1), np.full(n + 1, -1)
    held = np.zeros(2 * n + k, dtype=np.bool_)
    normal, along, ahead, back = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    count = 0
    for _ in range(20 * (2 * n + k)):
        x[:] = y
        solve_lower_transposed(factor, x)
        chosen, broken = _most_broken(x, low, high, rows, least, norms, held)
        if chosen < 0:
            return True
        _normal(chosen, rows, factor, normal)
        own = 0.0
        while True:
            _split(basis, triangle, normal, count, ahead, along, back)
            square = dot(ahead, ahead)
            full: float = (
                broken / square if square > PARALLEL * dot(normal, normal) and count < n else math.inf
            )
            part, leaving = math.inf, -1
            for j in range(count):
                if back[j] > 0.0 and multipliers[j] / back[j] < part:
                    part, leaving = float(multipliers[j] / back[j]), j
            step = min(full, part)
            if step == math.inf:
                return False
            for j in range(count):
                multipliers[j] = max(multipliers[j] - step * back[j], 0.0)
            own += step
            if full < math.inf:
                y += step * ahead
                broken -= step * square
            if full <= part:
                length = math.sqrt(square)
                basis[count] = ahead / length
                triangle[:count, count] = along[:count]
                triangle[count, count] = length
                multipliers[count], active[count] = own, chosen
                held[chosen] = True
                count += 1
                break
            held[active[leaving]] = False
            _drop(basis, triangle, multipliers, active, leaving, count)
            count -= 1
    return False


@compiled
def _split(
    basis: Floats2,
    triangle: Floats2,
    normal: Floats1,
    count: int,
    ahead: Floats1,
    along: Floats1,
    back: Floats1,
) -> None:
    """Split a normal into its part in the span of the active normals and the rest.

    Args:
        basis: Orthonormal basis of the active normals in its first `count` rows, shape (n, n).
        triangle: The active normals in that basis, one in each column, upper triangular, shape (n, n).
        normal: The normal, shape (n,).
        count: Number of active constraints.
        ahead: Output: the rest, shape (n,).
        along: Output: coordinates in the basis, in the first `count` of shape (n,).
        back: Output: multiples of the active normals, in the first `count` of shape (n,).
    """
    ahead[:] = normal
    along[:count] = 0.0
    for _ in range(2):  # twice, to remove rounding errors
        for j in range(count):
            part = dot(basis[j], ahead)
            along[j] += part
            ahead -= part * basis[j]
    for j in range(count - 1, -1, -1):
        value = along[j]
        for c in range(j + 1, count):
            value -= triangle[j, c] * back[c]
        back[j] = value / triangle[j, j]


@compiled
def _most_broken(
    x: Floats1, low: Floats1, high: Floats1, rows: Floats2, least: Floats1, norms: Floats1, held: Flags1
) -> tuple[int, float]:
    """Return the constraint violated most, relative to its norm, and its violation; -1 if none is violated.

    Lower bounds come first, then upper bounds, then rows.

    Args:
        x: Present solution, shape (n,).
        low: Lower bounds, shape (n,).
        high: Upper bounds, shape (n,).
        rows: C, shape (k, n).
        least: Lower bounds of C x, shape (k,).
        norms: Norms of the rows of C, shape (k,).
        held: Which constraints are active, shape (2 n + k,).
    """
    n, worst, chosen, broken = x.size, KEPT, -1, 0.0
    for i in range(n):
        if low[i] - x[i] > worst and not held[i]:
            worst, chosen, broken = low[i] - x[i], i, low[i] - x[i]
        if x[i] - high[i] > worst and not held[n + i]:
            worst, chosen, broken = x[i] - high[i], n + i, x[i] - high[i]
    for i in range(least.size):
        short = least[i] - dot(rows[i], x)
        if short > worst * norms[i] and norms[i] > 1e-12 and not held[2 * n + i]:
            worst, chosen, broken = short / norms[i], 2 * n + i, short
    return chosen, broken


@compiled
def _normal(chosen: int, rows: Floats2, factor: Floats2, normal: Floats1) -> None:
    """Write a constraint's normal in the coordinates y, L^-1 c.

    Args:
        chosen: Index of the constraint, see `_most_broken`.
        rows: C, shape (k, n).
        factor: L, shape (n, n).
        normal: Output, shape (n,).
    """
    n = normal.size
    if chosen >= 2 * n:
        normal[:] = rows[chosen - 2 * n]
    else:
        normal[:] = 0.0
        normal[chosen % n] = 1.0 if chosen < n else -1.0
    solve_lower(factor, normal)


@compiled
def _drop(
    basis: Floats2, triangle: Floats2, multipliers: Floats1, active: Ints1, leaving: int, count: int
) -> None:
    """Remove one active constraint and make the rest triangular again by rotations.

    Args:
        basis: Orthonormal basis, see `_split`, changed, shape (n, n).
        triangle: Triangular factor, see `_split`, changed, shape (n, n).
        multipliers: Multipliers of the active constraints, changed, shape (n + 1,).
        active: Indices of the active constraints, changed, shape (n + 1,).
        leaving: Index, among the active constraints, of the one to remove.
        count: Number of active constraints before.
    """
    for j in range(leaving, count - 1):
        triangle[: j + 2, j] = triangle[: j + 2, j + 1]
        multipliers[j], active[j] = multipliers[j + 1], active[j + 1]
    for j in range(leaving, count - 1):
        length = math.hypot(triangle[j, j], triangle[j + 1, j])
        c, s = triangle[j, j] / length, triangle[j + 1, j] / length
        for col in range(j, count - 1):
            upper, lower = triangle[j, col], triangle[j + 1, col]
            triangle[j, col], triangle[j + 1, col] = c * upper + s * lower, c * lower - s * upper
        for i in range(basis.shape[1]):
            upper, lower = basis[j, i], basis[j + 1, i]
            basis[j, i], basis[j + 1, i] = c * upper + s * lower, c * lower - s * upper
