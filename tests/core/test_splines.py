"""Piecewise polynomials against NumPy and SciPy, compiled and interpreted."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicSpline

from pepper_kin.core import splines


@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize("order", [1, 3, 6, 7, 8])
def test_derivatives_are_those_of_numpy_in_any_order_of_times(order, count):
    rng = np.random.default_rng(order)
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 1.0, 40))])
    coefficients = rng.normal(size=(40, order, 3))
    times = np.concatenate([rng.uniform(0, breaks[-1], 300), breaks, np.linspace(0, breaks[-1], 300)])
    segment = np.minimum(np.searchsorted(breaks, times, side="right") - 1, 39)
    local = times - breaks[segment]
    expected = np.array(
        [
            [
                [
                    Polynomial(coefficients[i, :, j]).deriv(d)(x)
                    if d
                    else Polynomial(coefficients[i, :, j])(x)
                    for j in range(3)
                ]
                for i, x in zip(segment, local, strict=True)
            ]
            for d in range(count)
        ]
    )
    found = np.empty((count, times.size, 3))
    splines.evaluate_at_times(breaks, coefficients, times, found)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-11)
    splines.evaluate_on_segments(coefficients, segment, local, found)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-11)


def test_pieces_of_any_shape_count_from_the_end_too():
    coefficients = np.arange(24.0).reshape(2, 4, 3)
    found = splines.derivatives_on_segments(coefficients, [[0], [-1]], [0.0, 1.0, 2.0], 2)
    assert found.shape == (2, 2, 3, 3)
    np.testing.assert_array_equal(found[0, :, 0], coefficients[:, 0])
    np.testing.assert_array_equal(found[0, 1, 1], coefficients[1].sum(axis=0))
    for outside in (2, -3):
        with pytest.raises(IndexError):
            splines.derivatives_on_segments(coefficients, outside, 0.0, 1)


@pytest.mark.parametrize("count", [2, 3, 5, 12])
def test_the_spline_is_that_of_scipy(count):
    points = np.random.default_rng(count).normal(size=(count, 4))
    breaks, coefficients = np.empty(count), np.empty((count - 1, 4, 4))
    splines.cubic_spline(points, breaks, coefficients)
    chords = np.diff(points, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    slopes = chords / lengths[:, None]
    np.testing.assert_allclose(breaks, np.concatenate([[0.0], np.cumsum(lengths)]), rtol=1e-14)
    theirs = CubicSpline(breaks, points, bc_type=((1, slopes[0]), (1, slopes[-1])))
    np.testing.assert_allclose(coefficients, theirs.c[::-1].transpose(1, 0, 2), atol=1e-11)
    dense = theirs(np.linspace(0, breaks[-1], 20001))
    violation = splines.greatest_violation(breaks, coefficients, np.full(4, -0.5), np.full(4, 0.5))
    assert violation == pytest.approx(np.abs(dense).max() - 0.5, abs=1e-6)
    bounds = np.full(4, -0.5), np.full(4, 0.5)
    again = splines.bounded_cubic_spline(points, *bounds, 1e-9, breaks, coefficients)
    assert again == violation


def test_points_that_make_no_spline_are_reported():
    bounds, scratch = (np.full(2, -1.0), np.full(2, 1.0)), (np.empty(3), np.empty((2, 4, 2)))
    for points in ([[0, 0], [0, 0], [1, 1]], [[0, 0], [np.nan, 0], [1, 1]], [[0, 0], [np.inf, 0], [1, 1]]):
        assert splines.bounded_cubic_spline(np.array(points, float), *bounds, 1e-9, *scratch) == np.inf
