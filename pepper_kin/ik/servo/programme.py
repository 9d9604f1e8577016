"""The quadratic programme of one tick, solved exactly in machine code."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pepper_kin.ik.tasks.task import Array
from pepper_kin.kernels.compilation import Compilation

# A constraint broken by less than this counts as kept [rad/s or m/s]; so much of a normal counts as nothing.
KEPT = 1e-10
PARALLEL = 1e-12


class Programme:
    """min x^T H x / 2 + g^T x  subject to  low <= x <= high,  C x >= least.

    The dual method of Goldfarb and Idnani (A numerically stable dual method for solving strictly convex
    quadratic programs, 1983): from the free minimum, the constraint broken most is met next, and those that
    lose their force are dropped.  Its cost grows with the constraints that hold at the end and not with the
    number given, and it ends after finitely many steps, also where rows are parallel or hold at one point:
    interior and augmented Lagrangian methods may take very long there, which a tick cannot wait for.

    Args:
        n: Number of unknowns.
    """

    def __init__(self, n: int) -> None:
        # Compiled, or read from disk, here and not in the first tick.
        first, one = None if _solve.signatures else Compilation("the servo"), np.ones(n)
        self.solve(np.eye(n), one, -one, one, np.ones((1, n)), -one[:1])
        if first is not None:
            first.end(compiled=bool(_solve.stats.cache_misses))

    def solve(
        self, hessian: Array, gradient: Array, low: Array, high: Array, rows: Array, least: Array
    ) -> Array | None:
        """Return x, exactly within the box, shape (n,); None where rows and box contradict one another.

        Args:
            hessian: H, symmetric and positive definite, shape (n, n).
            gradient: g, shape (n,).
            low: Lower bounds, shape (n,).
            high: Upper bounds, shape (n,).
            rows: C, shape (k, n).
            least: Shape (k,).
        """
        x = np.empty(gradient.size)
        found = _solve(
            np.ascontiguousarray(hessian), gradient, low, high, np.ascontiguousarray(rows), least, x
        )
        return np.clip(x, low, high) if found and np.isfinite(x).all() else None


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(
    hessian: Array, gradient: Array, low: Array, high: Array, rows: Array, least: Array, x: Array
) -> bool:
    """Solve in y = L^T x with H = L L^T, where the objective is the distance to the free minimum."""
    n, k = gradient.size, least.size
    factor = np.zeros((n, n))
    if not _cholesky(hessian, factor):
        return False
    y = -gradient.copy()
    _forward(factor, y)
    norms = np.empty(k)
    for i in range(k):
        norms[i] = math.sqrt(rows[i] @ rows[i])
    basis, triangle = np.zeros((n, n)), np.zeros((n, n))
    multipliers, active = np.zeros(n + 1), np.full(n + 1, -1)
    held = np.zeros(2 * n + k, dtype=np.bool_)
    normal, along, ahead, back = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    count = 0
    for _ in range(20 * (2 * n + k)):
        x[:] = y
        _backward(factor, x)
        chosen, broken = _most_broken(x, low, high, rows, least, norms, held)
        if chosen < 0:
            return True
        _normal(chosen, rows, factor, normal)
        own = 0.0
        while True:
            _split(basis, triangle, normal, count, ahead, along, back)
            square = float(ahead @ ahead)
            full: float = broken / square if square > PARALLEL * (normal @ normal) and count < n else math.inf
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


@njit(cache=True, nogil=True, error_model="numpy")
def _split(
    basis: Array, triangle: Array, normal: Array, count: int, ahead: Array, along: Array, back: Array
) -> None:
    """Split a normal into what the active ones span (`along`, in multiples of them: `back`) and the rest."""
    ahead[:] = normal
    along[:count] = 0.0
    for _ in range(2):  # once more, for what rounding left
        for j in range(count):
            part = basis[j] @ ahead
            along[j] += part
            ahead -= part * basis[j]
    for j in range(count - 1, -1, -1):
        value = along[j]
        for c in range(j + 1, count):
            value -= triangle[j, c] * back[c]
        back[j] = value / triangle[j, j]


@njit(cache=True, nogil=True, error_model="numpy")
def _most_broken(
    x: Array, low: Array, high: Array, rows: Array, least: Array, norms: Array, held: np.ndarray
) -> tuple[int, float]:
    """Return the constraint broken most, for its length, and by how much; -1 where none is.

    Lower bounds come first, then upper bounds, then rows.
    """
    n, worst, chosen, broken = x.size, KEPT, -1, 0.0
    for i in range(n):
        if low[i] - x[i] > worst and not held[i]:
            worst, chosen, broken = low[i] - x[i], i, low[i] - x[i]
        if x[i] - high[i] > worst and not held[n + i]:
            worst, chosen, broken = x[i] - high[i], n + i, x[i] - high[i]
    for i in range(least.size):
        short = least[i] - rows[i] @ x
        if short > worst * norms[i] and norms[i] > 1e-12 and not held[2 * n + i]:
            worst, chosen, broken = short / norms[i], 2 * n + i, short
    return chosen, broken


@njit(cache=True, nogil=True, error_model="numpy")
def _normal(chosen: int, rows: Array, factor: Array, normal: Array) -> None:
    """Write a constraint's normal in the coordinates y, L^-1 c."""
    n = normal.size
    if chosen >= 2 * n:
        normal[:] = rows[chosen - 2 * n]
    else:
        normal[:] = 0.0
        normal[chosen % n] = 1.0 if chosen < n else -1.0
    _forward(factor, normal)


@njit(cache=True, nogil=True, error_model="numpy")
def _drop(
    basis: Array, triangle: Array, multipliers: Array, active: np.ndarray, leaving: int, count: int
) -> None:
    """Take one constraint out of the active ones and make the rest triangular again by rotations."""
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


@njit(cache=True, nogil=True, error_model="numpy")
def _cholesky(matrix: Array, factor: Array) -> bool:
    """Write L of H = L L^T; return whether H is positive definite."""
    for j in range(matrix.shape[0]):
        pivot = matrix[j, j]
        for c in range(j):
            pivot -= factor[j, c] * factor[j, c]
        if not pivot > 0.0:
            return False
        factor[j, j] = math.sqrt(pivot)
        for i in range(j + 1, matrix.shape[0]):
            value = matrix[i, j]
            for c in range(j):
                value -= factor[i, c] * factor[j, c]
            factor[i, j] = value / factor[j, j]
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _forward(factor: Array, vector: Array) -> None:
    """Replace b by L^-1 b."""
    for i in range(vector.size):
        value = vector[i]
        for c in range(i):
            value -= factor[i, c] * vector[c]
        vector[i] = value / factor[i, i]


@njit(cache=True, nogil=True, error_model="numpy")
def _backward(factor: Array, vector: Array) -> None:
    """Replace b by L^-T b."""
    for i in range(vector.size - 1, -1, -1):
        value = vector[i]
        for c in range(i + 1, vector.size):
            value -= factor[c, i] * vector[c]
        vector[i] = value / factor[i, i]
