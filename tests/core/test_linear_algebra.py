"""Small dense linear algebra, against NumPy."""

import numpy as np
import pytest

from pepper_kin.core.linear_algebra import cholesky, solve_cholesky, solve_cholesky_columns


@pytest.mark.parametrize("size", [0, 1, 2, 4, 5, 6, 7, 8, 13])
def test_factors_and_solutions_are_those_of_numpy(size):
    rng = np.random.default_rng(size)
    root = rng.normal(size=(size, size))
    matrix, right = root @ root.T + np.eye(size), rng.normal(size=(size, 5))
    factor, in_place = np.zeros((size, size)), matrix.copy()
    assert cholesky(matrix, factor)
    assert cholesky(in_place, in_place)
    np.testing.assert_allclose(factor, np.linalg.cholesky(matrix) if size else factor, atol=1e-12)
    np.testing.assert_array_equal(np.tril(in_place), factor)
    columns, one = right.copy(), right[:, 2].copy()
    solve_cholesky_columns(factor, columns)
    solve_cholesky(factor, one)
    np.testing.assert_allclose(matrix @ columns, right, atol=1e-10)
    np.testing.assert_array_equal(one, columns[:, 2])


def test_a_matrix_that_is_not_positive_definite_is_refused():
    matrix = np.eye(6)
    matrix[4, 4] = -1e-3
    assert not cholesky(matrix, np.zeros((6, 6)))
