"""Banded Cholesky factorization, row by row.

Sums along rows are taken element by element, since a sum over one row would wait for each addition in turn.
"""

from __future__ import annotations

import math

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.row_sums import add_rows
from pepper_kin.kernels.signatures import Floats1, Floats2

PADDING = 4
"""Zeros after the band in each row: four rows at a time are read as far as the last of them reaches."""


@compiled(lean=True, inline=True)
def add_row(target: Floats1, share: float, row: Floats1) -> None:
    """Add a multiple of a row as long as the target."""
    add_rows(target.ctypes.data, (row.ctypes.data,), (share,), target.size)


@compiled(lean=True, inline=True)
def add_four_rows(
    target: Floats1, rows: tuple[Floats1, Floats1, Floats1, Floats1], p: float, q: float, r: float, s: float
) -> None:
    """Add multiples of four rows that are as long as the target."""
    a, b, c, d = rows
    places = a.ctypes.data, b.ctypes.data, c.ctypes.data, d.ctypes.data
    add_rows(target.ctypes.data, places, (p, q, r, s), target.size)


@compiled(lean=True, vector=True)
def dot(first: Floats1, second: Floats1) -> float:
    """Return the product of two rows; four sums are taken side by side."""
    s, t, u, v = 0.0, 0.0, 0.0, 0.0
    whole = first.size - first.size % 4
    for k in range(0, whole, 4):
        s += first[k] * second[k]
        t += first[k + 1] * second[k + 1]
        u += first[k + 2] * second[k + 2]
        v += first[k + 3] * second[k + 3]
    for k in range(whole, first.size):
        s += first[k] * second[k]
    return (s + t) + (u + v)


@compiled(lean=True)
def factorize(band: Floats2) -> bool:
    """Replace a symmetric matrix A by U of A = U^T U; return whether A is positive definite.

    Args:
        band: A[r, r + d] at band[r, d] for 0 <= d < w, shape (N, w + PADDING); the padding is zero.
    """
    size, width = band.shape[0], band.shape[1] - PADDING
    for r in range(size):
        row = band[r]
        k = max(0, r - width + 1)
        while k + 3 < r:
            # Row k reaches r + length - 1 after those three before, whose padding is zero there.
            length, d = width + k + 3 - r, r - k
            rows = (
                band[k, d : d + length], band[k + 1, d - 1 : d - 1 + length],
                band[k + 2, d - 2 : d - 2 + length], band[k + 3, d - 3 : d - 3 + length],
            )  # fmt: skip
            add_four_rows(
                row[:length], rows, -band[k, d], -band[k + 1, d - 1], -band[k + 2, d - 2], -band[k + 3, d - 3]
            )
            k += 4
        while k < r:
            d = r - k
            add_row(row[: width - d], -band[k, d], band[k, d:width])
            k += 1
        if not row[0] > 0.0:
            return False
        scale = 1.0 / math.sqrt(row[0])
        for d in range(width):
            row[d] *= scale
    return True


@compiled(lean=True)
def solve_factorized(band: Floats2, right: Floats1) -> None:
    """Replace b by A^-1 b, given the factor of `factorize`; b has shape (N,)."""
    size, width = band.shape[0], band.shape[1] - PADDING
    for r in range(size):
        count = min(width, size - r)
        right[r] /= band[r, 0]
        add_row(right[r + 1 : r + count], -right[r], band[r, 1:count])
    for r in range(size - 1, -1, -1):
        count = min(width, size - r)
        right[r] = (right[r] - dot(band[r, 1:count], right[r + 1 : r + count])) / band[r, 0]
