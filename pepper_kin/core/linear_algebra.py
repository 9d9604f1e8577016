"""Small dense linear algebra."""

from __future__ import annotations

import math

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2


@compiled(lean=True, inline=True)
def dot(a: Floats1, b: Floats1) -> float:
    """Return the dot product sum(a_i b_i) of two vectors, shape (n,)."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@compiled(lean=True)
def cholesky(matrix: Floats2, factor: Floats2) -> bool:
    """Write the lower triangle L of A = L L^T; return whether A is positive definite.

    Args:
        matrix: A, symmetric, shape (n, n); its lower triangle is read.
        factor: L, output, shape (n, n); entries above the diagonal are not written.
    """
    for j in range(matrix.shape[0]):
        pivot = matrix[j, j]
        for c in range(j):
            pivot -= factor[j, c] * factor[j, c]
        if not pivot > 0.0:
            return False
        factor[j, j] = math.sqrt(pivot)
        i = j + 1
        while i + 3 < matrix.shape[0]:  # four independent sums, since each term of a sum waits for the last
            first, second, third, fourth = matrix[i, j], matrix[i + 1, j], matrix[i + 2, j], matrix[i + 3, j]
            for c in range(j):
                above = factor[j, c]
                first -= factor[i, c] * above
                second -= factor[i + 1, c] * above
                third -= factor[i + 2, c] * above
                fourth -= factor[i + 3, c] * above
            factor[i, j], factor[i + 1, j] = first / factor[j, j], second / factor[j, j]
            factor[i + 2, j], factor[i + 3, j] = third / factor[j, j], fourth / factor[j, j]
            i += 4
        while i < matrix.shape[0]:
            value = matrix[i, j]
            for c in range(j):
                value -= factor[i, c] * factor[j, c]
            factor[i, j] = value / factor[j, j]
            i += 1
    return True


@compiled(lean=True)
def solve_lower(factor: Floats2, vector: Floats1) -> None:
    """Replace b, shape (n,), by L^-1 b, with L lower triangular, shape (n, n)."""
    for i in range(vector.size):
        value = vector[i]
        for c in range(i):
            value -= factor[i, c] * vector[c]
        vector[i] = value / factor[i, i]


@compiled(lean=True)
def solve_lower_transposed(factor: Floats2, vector: Floats1) -> None:
    """Replace b, shape (n,), by L^-T b, with L lower triangular, shape (n, n)."""
    for i in range(vector.size - 1, -1, -1):
        value = vector[i]
        for c in range(i + 1, vector.size):
            value -= factor[c, i] * vector[c]
        vector[i] = value / factor[i, i]


@compiled(lean=True)
def symmetric_eigen(matrix: Floats2, values: Floats1, vectors: Floats2) -> None:
    """Write the eigenvalues, ascending, and eigenvectors of a symmetric matrix by cyclic Jacobi rotations.

    Source: G. H. Golub and C. F. Van Loan, Matrix Computations, section 8.5.

    Args:
        matrix: Symmetric matrix, shape (n, n); overwritten.
        values: Output, shape (n,).
        vectors: Output, one in each column, shape (n, n).
    """
    n = values.size
    for i in range(n):
        for j in range(n):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(50):
        off, size = 0.0, 0.0
        for i in range(n):
            size += matrix[i, i] * matrix[i, i]
            for j in range(i + 1, n):
                off += matrix[i, j] * matrix[i, j]
        if off <= 1e-32 * size:
            break
        for p in range(n - 1):
            for q in range(p + 1, n):
                _rotate(matrix, vectors, p, q)
    for i in range(n):
        values[i] = matrix[i, i]
    for i in range(n - 1):  # sort ascending
        least = i
        for j in range(i + 1, n):
            if values[j] < values[least]:
                least = j
        if least != i:
            values[i], values[least] = values[least], values[i]
            for k in range(n):
                vectors[k, i], vectors[k, least] = vectors[k, least], vectors[k, i]


@compiled(lean=True)
def _rotate(matrix: Floats2, vectors: Floats2, p: int, q: int) -> None:
    """Zero entries (p, q) and (q, p) of a symmetric matrix, and rotate `vectors`; both have shape (n, n)."""
    if matrix[p, q] == 0.0:
        return
    theta = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
    t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    if abs(theta) > 1e150:
        t = 0.5 / theta
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    for k in range(matrix.shape[0]):
        first, second = matrix[k, p], matrix[k, q]
        matrix[k, p], matrix[k, q] = c * first - s * second, s * first + c * second
    for k in range(matrix.shape[0]):
        first, second = matrix[p, k], matrix[q, k]
        matrix[p, k], matrix[q, k] = c * first - s * second, s * first + c * second
        first, second = vectors[k, p], vectors[k, q]
        vectors[k, p], vectors[k, q] = c * first - s * second, s * first + c * second


@compiled(lean=True)
def solve_cholesky(factor: Floats2, vector: Floats1) -> None:
    """Replace b, shape (n,), by A^-1 b, given L of A = L L^T, shape (n, n); rows of L are read in order."""
    solve_lower(factor, vector)
    for i in range(vector.size - 1, -1, -1):
        vector[i] /= factor[i, i]
        for c in range(i):
            vector[c] -= factor[i, c] * vector[i]


@compiled(lean=True)
def solve_cholesky_columns(factor: Floats2, columns: Floats2) -> None:
    """Replace B by A^-1 B, given L of A = L L^T, for all columns at once.

    Args:
        factor: L, shape (n, n).
        columns: B, overwritten, shape (n, k).
    """
    for i in range(factor.shape[0]):
        for c in range(i):
            _take_row(columns[i], factor[i, c], columns[c])
        _divide(columns[i], factor[i, i])
    for i in range(factor.shape[0] - 1, -1, -1):
        _divide(columns[i], factor[i, i])
        for c in range(i):
            _take_row(columns[c], factor[i, c], columns[i])


@compiled(lean=True, inline=True)
def _take_row(row: Floats1, share: float, other: Floats1) -> None:
    """Subtract a multiple of a row from another, shape (k,) each."""
    for r in range(row.size):
        row[r] -= share * other[r]


@compiled(lean=True, inline=True)
def _divide(row: Floats1, divisor: float) -> None:
    """Divide a row, shape (k,), by a number."""
    for r in range(row.size):
        row[r] /= divisor
