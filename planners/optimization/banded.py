"""Banded Cholesky factorization, four rows at a time.

The band is stored row by row, A[r, c] at flat index r * (S - 1) + c where S is the length of a stored row: a
matrix with that stride, of which tiles of rows and columns can be taken.
"""

from __future__ import annotations

import math

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.row_sums import add_rows
from pepper_kin.kernels.signatures import Floats1, Floats2
from pepper_kin.kernels.tile_products import TILE_COLUMNS, TILE_ROWS, add_tile

PADDING = 2 * TILE_COLUMNS
"""Number of entries after the band in each row: as many zeros as a tile has columns, since tiles reach beyond
the band, and space for the entries left of the diagonal that tiles write and nothing reads."""


@compiled(lean=True, inline=True)
def add_row(target: Floats1, share: float, row: Floats1) -> None:
    """Add a multiple `share` of a row of the target's length."""
    add_rows(target.ctypes.data, (row.ctypes.data,), (share,), target.size)


@compiled(lean=True, inline=True)
def add_four_rows(
    target: Floats1, rows: tuple[Floats1, Floats1, Floats1, Floats1], p: float, q: float, r: float, s: float
) -> None:
    """Add multiples p, q, r and s of four rows of the target's length."""
    a, b, c, d = rows
    places = a.ctypes.data, b.ctypes.data, c.ctypes.data, d.ctypes.data
    add_rows(target.ctypes.data, places, (p, q, r, s), target.size)


@compiled(lean=True, vector=True)
def dot(first: Floats1, second: Floats1) -> float:
    """Return the dot product of two rows, summed in four partial sums."""
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
        band: A[r, r + d] at band[r, d] for 0 <= d < w, shape (N, w + PADDING); see `PADDING`.
    """
    size, width, stride = band.shape[0], band.shape[1] - PADDING, band.shape[1] - 1
    first = band.ctypes.data
    for r in range(0, size, TILE_ROWS):
        if r + TILE_ROWS <= size:
            for c in range(r, min(r + TILE_ROWS - 1 + width, size), TILE_COLUMNS):
                k = max(0, c - width + 1)  # the first row whose band reaches column c
                target, left, right = r * stride + c, k * stride + r, k * stride + c
                add_tile(first + 8 * target, stride, first + 8 * left, first + 8 * right, stride, r - k, -1.0)
        else:
            for k in range(max(0, r - width + 1), r):
                for row in range(r, min(size, k + width)):
                    d = row - k
                    add_row(band[row, : width - d], -band[k, d], band[k, d:width])
        for row in range(r, min(r + TILE_ROWS, size)):
            own = band[row]
            for k in range(max(r, row - width + 1), row):
                d = row - k
                add_row(own[: width - d], -band[k, d], band[k, d:width])
            if not own[0] > 0.0:
                return False
            scale = 1.0 / math.sqrt(own[0])
            for d in range(width):
                own[d] *= scale
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
