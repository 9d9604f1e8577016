"""Tiles of products against NumPy's, and the banded factorization that is made of them."""

import numpy as np
import pytest

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats2
from pepper_kin.kernels.tile_products import TILE_COLUMNS, TILE_ROWS, add_tile
from pepper_kin.planners.optimization.banded import PADDING, factorize


@compiled("void(float64[:, ::1], float64[:, ::1], int64, int64, float64)")
def add(target: Floats2, rows: Floats2, column: int, count: int, share: float) -> None:
    """Add the products of the first four and of eight later columns to the second tile of a matrix."""
    place = target.ctypes.data + 8 * TILE_COLUMNS
    here = rows.ctypes.data
    add_tile(place, target.shape[1], here, here + 8 * column, rows.shape[1], count, share)


@compiled("boolean(float64[:, ::1])")
def factor(band: Floats2) -> bool:
    """Factorize a band."""
    return factorize(band)


@pytest.mark.parametrize("count", [0, 1, 2, 7, 60])
def test_a_tile_gets_the_product_and_nothing_else_changes(count):
    rng = np.random.default_rng(count)
    target, rows = rng.normal(size=(TILE_ROWS, 3 * TILE_COLUMNS)), rng.normal(size=(60, 21))
    expected, wide = target.copy(), slice(TILE_COLUMNS, 2 * TILE_COLUMNS)
    expected[:, wide] += -1.5 * rows[:count, :TILE_ROWS].T @ rows[:count, 13 : 13 + TILE_COLUMNS]
    add(target, rows, 13, count, -1.5)
    np.testing.assert_allclose(target, expected, rtol=1e-13, atol=1e-13)
    outside = [*range(TILE_COLUMNS), *range(2 * TILE_COLUMNS, 3 * TILE_COLUMNS)]
    np.testing.assert_array_equal(target[:, outside], expected[:, outside])


@pytest.mark.parametrize("width", [1, 2, 7, 8, 9, 28, 60])
@pytest.mark.parametrize("size", [1, 3, 4, 5, 30, 103])
def test_the_factor_is_that_of_cholesky(size, width):
    rng = np.random.default_rng(size + 1000 * width)
    lower = np.tril(np.triu(rng.normal(size=(size, size)), 1 - width))
    lower[np.diag_indices(size)] = rng.uniform(1.0, 2.0, size) * np.sqrt(width)
    matrix = lower @ lower.T
    band = np.zeros((size, width + PADDING))
    for d in range(min(width, size)):
        band[: size - d, d] = np.diagonal(matrix, d)
    # What tiles on the diagonal leave at the end of rows is never read.
    band[:, width + TILE_COLUMNS + 1 :] = rng.normal(size=(size, PADDING - TILE_COLUMNS - 1))
    assert factor(band)
    upper = np.linalg.cholesky(matrix).T
    for d in range(min(width, size)):
        np.testing.assert_allclose(band[: size - d, d], np.diagonal(upper, d), rtol=1e-9, atol=1e-10)


def test_a_matrix_that_is_not_positive_definite_is_refused():
    for place in (0, 5, 10):
        band = np.zeros((11, 3 + PADDING))
        band[:, 0] = 1.0
        band[place, 0] = -1.0
        assert not factor(band)
