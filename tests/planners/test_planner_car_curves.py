"""Shortest curves of a car, against OMPL's state spaces and against integration."""

import math

import numpy as np
import pytest
from ompl import base

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners.car_curves import CarCurve, car_curve


def theirs(start, end, radius, backward):
    space = base.ReedsSheppStateSpace(radius) if backward else base.DubinsStateSpace(radius)
    bounds = base.RealVectorBounds(2)
    bounds.setLow(-100.0)
    bounds.setHigh(100.0)
    space.setBounds(bounds)
    states = []
    for x, y, yaw in (start, end):
        state = space.allocState()
        state.setX(x)
        state.setY(y)
        state.setYaw(math.remainder(yaw, 2 * math.pi))
        states.append(state)
    return space.distance(*states)


def poses(seed, count, size):
    rng = np.random.default_rng(seed)
    return rng.uniform([-size, -size, -math.pi], [size, size, math.pi], (count, 2, 3))


@pytest.mark.parametrize("backward", [True, False])
@pytest.mark.parametrize("size", [0.3, 1.5, 8.0])
def test_lengths_are_those_of_ompl(backward, size):
    for start, end in poses(0, 1500, size):
        ours = car_curve(start, end, 0.7, backward=backward)
        assert ours.length == pytest.approx(theirs(start, end, 0.7, backward), abs=1e-8)


@pytest.mark.parametrize("backward", [True, False])
def test_curves_lead_to_the_end(backward):
    for start, end in poses(1, 1500, 2.0):
        curve = car_curve(start, end, 0.5, backward=backward)
        reached = curve(curve.length)
        np.testing.assert_allclose(reached[:2], end[:2], atol=1e-8)
        assert abs(math.remainder(reached[2] - end[2], 2 * math.pi)) < 1e-8
        np.testing.assert_array_equal(curve(0.0), start)
        assert backward or (curve.lengths > 0).all()


def test_the_car_goes_where_it_points():
    """Finite differences along the curve: no sideways motion, no curvature beyond the radius."""
    for start, end in poses(2, 40, 2.0):
        curve = car_curve(start, end, 0.5)
        s = np.linspace(0.0, curve.length, 4001)
        states = curve(s)
        step, moved = s[1], np.diff(states, axis=0)
        yaw = 0.5 * (states[1:, 2] + states[:-1, 2])
        sideways = moved[:, 1] * np.cos(yaw) - moved[:, 0] * np.sin(yaw)
        forward = moved[:, 0] * np.cos(yaw) + moved[:, 1] * np.sin(yaw)
        inner = np.abs(np.abs(forward) - step) < 1e-6 * step  # not across a cusp
        assert inner.mean() > 0.99
        assert np.abs(sideways[inner]).max() < 1e-3 * step
        assert np.abs(moved[:, 2]).max() <= step / 0.5 * (1 + 1e-9)


def test_known_curves():
    for end, backward, length in [
        ((3.0, 0.0, 0.0), False, 3.0),
        ((-3.0, 0.0, 0.0), True, 3.0),
        ((0.0, 2.0, math.pi), False, math.pi),
        ((0.0, 0.0, 0.0), True, 0.0),
        ((0.0, 0.0, 0.0), False, 0.0),
        ((1.0, 1.0, math.pi / 2), True, math.pi / 2),
        ((0.0, 0.0, math.pi), True, math.pi),  # three arcs of sixty degrees
    ]:
        assert car_curve((0.0, 0.0, 0.0), end, 1.0, backward=backward).length == pytest.approx(
            length, abs=1e-9
        )


def test_going_backward_the_same_way_is_as_long():
    for start, end in poses(3, 300, 2.0):
        there, back = car_curve(start, end, 0.4), car_curve(end, start, 0.4)
        assert there.length == pytest.approx(back.length, abs=1e-9)


def test_misuse_is_named():
    with pytest.raises(InvalidValueError, match="radius: got 0"):
        car_curve((0, 0, 0), (1, 0, 0), 0.0)
    with pytest.raises(InvalidValueError, match="start"):
        car_curve((0, 0), (1, 0, 0), 1.0)
    curve = car_curve((0, 0, 0), (1, 0, 0), 1.0)
    assert isinstance(curve, CarCurve)
    assert not curve.lengths.flags.writeable


def test_arrays_that_machine_code_cannot_read_are_refused():
    for field, value in [
        ("start", [0.0, 0.0]),
        ("turns", [1.0]),
        ("lengths", [1.0, np.nan]),
        ("radius", 0.0),
    ]:
        fields = {"start": np.zeros(3), "turns": np.array([1.0, -1.0]), "lengths": np.ones(2), "radius": 0.5}
        assert CarCurve(**fields).length == 2.0
        with pytest.raises(InvalidValueError, match="lengths" if field == "turns" else field):
            CarCurve(**{**fields, field: np.asarray(value)})
