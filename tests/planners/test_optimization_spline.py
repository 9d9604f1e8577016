import numpy as np
import pytest
from scipy.interpolate import BSpline

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners.optimization import RestSpline


def made(degree, intervals=9, seed=0):
    rng = np.random.default_rng(seed)
    spline = RestSpline(rng.normal(size=3), rng.normal(size=3), intervals, degree)
    return spline, rng.normal(size=(spline.size, 3))


@pytest.mark.parametrize("degree", [3, 5])
def test_every_derivative_agrees_with_scipy(degree):
    spline, unknowns = made(degree)
    control, s = spline.control_points(unknowns), np.linspace(0, 1, 57)
    reference = BSpline(spline.knots, control, degree)
    for order in range(degree + 1):
        expected = (reference.derivative(order) if order else reference)(s)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(spline.basis(s, order) @ control, expected, atol=1e-12 * scale)


@pytest.mark.parametrize("degree", [3, 5])
def test_starts_and_ends_at_rest(degree):
    spline, unknowns = made(degree)
    control = spline.control_points(unknowns)
    ends = [spline.basis([0.0, 1.0], order) @ control for order in range(3)]
    np.testing.assert_allclose(ends[0], [spline.start, spline.goal], atol=1e-12)
    np.testing.assert_allclose(ends[1:], 0.0, atol=1e-9)


@pytest.mark.parametrize("degree", [3, 5])
def test_derivatives_stay_in_the_hull_of_their_control_points(degree):
    spline, unknowns = made(degree, seed=1)
    control, s = spline.control_points(unknowns), np.linspace(0, 1, 2001)
    for order in range(3):
        values, hull = spline.basis(s, order) @ control, spline.difference(order) @ control
        assert np.all(values <= hull.max(axis=0) + 1e-9)
        assert np.all(values >= hull.min(axis=0) - 1e-9)


def test_accelerations_of_cubics_are_extreme_at_knots():
    spline, unknowns = made(3)
    control = spline.control_points(unknowns)
    knots = np.linspace(0, 1, spline.intervals + 1)
    at_knots = spline.basis(knots, 2) @ control
    np.testing.assert_allclose(at_knots, spline.difference(2) @ control, atol=1e-8)


def test_pieces_are_the_spline_over_time():
    spline, unknowns = made(5)
    breaks, coefficients = spline.segments(unknowns, 2.5)
    reference = BSpline(spline.knots, spline.control_points(unknowns), 5)
    for t in (0.0, 0.4, 1.3, 2.4999):
        segment = np.searchsorted(breaks, t, side="right") - 1
        local = t - breaks[segment]
        value = sum(coefficients[segment, p] * local**p for p in range(6))
        np.testing.assert_allclose(value, reference(t / 2.5), atol=1e-9)


def test_fit_finds_a_spline_again():
    spline, unknowns = made(3)
    states = spline.basis(np.linspace(0, 1, 100)) @ spline.control_points(unknowns)
    np.testing.assert_allclose(spline.fit(states), unknowns, atol=1e-9)


def test_misuse_is_named():
    with pytest.raises(InvalidValueError, match="degree: got 4, expected 3 or 5"):
        RestSpline([0.0], [1.0], 10, 4)
    with pytest.raises(InvalidValueError, match="intervals: got 3, expected a whole number of at least 4"):
        RestSpline([0.0], [1.0], 3)
    with pytest.raises(InvalidValueError, match=r"goal: got shape \(2,\)"):
        RestSpline([0.0], [1.0, 2.0])
    with pytest.raises(InvalidValueError, match="states: got 5 of them, expected at least 20"):
        RestSpline([0.0], [1.0], 10).fit(np.zeros((5, 1)))


def test_a_smooth_fit_is_the_least_of_distance_and_third_derivative():
    spline = RestSpline([0.0, 1.0], [2.0, -1.0], 12)
    states = np.random.default_rng(4).normal(size=(60, 2)).cumsum(axis=0)

    def objective(unknowns, smoothness):
        control = spline.control_points(unknowns)
        apart = spline.basis(np.linspace(0.0, 1.0, 60)) @ control - states
        rough = spline.difference(3) @ control / 12**3
        return (apart**2).sum() / 60 + smoothness * (rough**2).sum()

    for smoothness in (0.0, 0.3):
        best = spline.fit(states, smoothness)
        least = objective(best, smoothness)
        for move in np.random.default_rng(5).normal(0.0, 1e-3, (20, *best.shape)):
            assert objective(best + move, smoothness) > least
