"""Banded positive definite block systems, for nodes along a path that are coupled with their neighbors."""

from __future__ import annotations

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1


@compiled(lean=True)
def _places(count: int, closed: bool, place: Ints1) -> None:
    """Write the order of all nodes but the first, shape (K,); a closed path from both ends in turn."""
    place[0] = -1
    for k in range(1, count):
        place[k] = k - 1
        if closed:
            place[k] = 2 * k - 2 if 2 * k <= count else 2 * (count - k) - 1


@compiled(lean=True)
def _write_block(
    null: Floats3, own: Floats1, more: Floats2, ends: tuple[int, int], band: Floats2, at: Ints1
) -> None:
    """Add N_a diag(own) N_b^T, and the squares of additional rows of one node, to the lower band.

    Args:
        null: Bases N, shape (K, d, k).
        own: Diagonal, shape (k,).
        more: Rows in the basis of a, shape (w, d); none for two different nodes.
        ends: Nodes a and b, a not before b in the order.
        band: Lower band; row i has columns i - w to i, shape (M, w + 1).
        at: Indices of a and b in the order, shape (2,).
    """
    a, b = ends
    d, width = null.shape[1], band.shape[1] - 1
    for i in range(d):
        row = at[0] * d + i
        for j in range(d if at[0] != at[1] else i + 1):
            total = 0.0
            for k in range(own.size):
                total += null[a, i, k] * own[k] * null[b, j, k]
            for w in range(more.shape[0]):
                total += more[w, i] * more[w, j]
            band[row, width - row + at[1] * d + j] += total


@compiled(lean=True)
def factorize_band(band: Floats2) -> bool:
    """Replace a band by its Cholesky factor's; row i has columns i - w to i, shape (M, w + 1).

    Returns:
        Whether the matrix is positive definite.
    """
    width = band.shape[1] - 1
    for i in range(band.shape[0]):
        first = max(0, i - width)
        for j in range(first, i + 1):
            begin = max(first, j - width)
            total, here, there = band[i, width - i + j], width - i, width - j
            for k in range(begin, j):
                total -= band[i, here + k] * band[j, there + k]
            if j < i:
                band[i, here + j] = total / band[j, width]
            elif total <= 0.0:
                return False
            else:
                band[i, width] = np.sqrt(total)
    return True


@compiled(lean=True)
def solve_band(band: Floats2, x: Floats1) -> None:
    """Replace b by A^-1 b, given the factor of `factorize_band`; b has shape (N,)."""
    width = band.shape[1] - 1
    for i in range(x.size):
        for j in range(max(0, i - width), i):
            x[i] -= band[i, width - i + j] * x[j]
        x[i] /= band[i, width]
    for i in range(x.size - 1, -1, -1):
        x[i] /= band[i, width]
        for j in range(max(0, i - width), i):
            x[j] -= band[i, width - i + j] * x[i]


@compiled(
    "boolean(float64[:, :, ::1], float64[:, ::1], float64[:, ::1], float64[:, :, ::1], boolean,"
    " float64[:, ::1])"
)
def solve_path_blocks(
    null: Floats3, bend: Floats2, weight: Floats2, more: Floats3, closed: bool, values: Floats2
) -> bool:
    """Solve for the coordinates of all nodes but the first in their bases.

    The diagonal block of node k is N_k (bend_0k 1 + diag(weight_k)) N_k^T + more_k^T more_k; the block of
    nodes k and l = k + d, d = 1, 2, is bend_dk N_k N_l^T, with l modulo their number if the path is closed.

    Args:
        null: Bases N, shape (K, d, k).
        bend: Couplings, shape (3, K).
        weight: Weights, nonnegative, shape (K, k).
        more: Additional rows, shape (K, w, d), w may be 0.
        closed: Whether the path is closed.
        values: Right-hand side, of which the first row is not used; output: the solution, shape (K, d).

    Returns:
        Whether the matrix is positive definite to rounding.
    """
    count, d, size = null.shape
    place, at = np.empty(count, np.int64), np.empty(2, np.int64)
    _places(count, closed, place)
    reach = min(4 if closed else 2, count - 2)
    width, own = (reach + 1) * d - 1, np.empty(size)
    band, nothing = np.zeros(((count - 1) * d, width + 1)), np.empty((0, d))
    for k in range(count):
        for step in range(3):
            other = (k + step) % count
            if k == 0 or other == 0 or (k + step >= count and not closed) or (step > 0 and other == k):
                continue
            high, low = (other, k) if place[other] >= place[k] else (k, other)
            at[0], at[1] = place[high], place[low]
            for i in range(size):
                own[i] = bend[step, k] + (weight[k, i] if step == 0 else 0.0)
            _write_block(null, own, more[k] if step == 0 else nothing, (high, low), band, at)
    if not factorize_band(band):
        return False
    x = np.empty((count - 1) * d)
    for k in range(1, count):
        for i in range(d):
            x[place[k] * d + i] = values[k, i]
    solve_band(band, x)
    for k in range(1, count):
        for i in range(d):
            values[k, i] = x[place[k] * d + i]
    return True
