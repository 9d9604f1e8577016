"""Paths of a car among disks: free, drivable, and no shorter than can be."""

import math

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import Problem, Status
from pepper_kin.planners.car_connect import car_connect
from pepper_kin.planners.car_curves import car_curve

RADIUS = 0.5
LOWER, UPPER = (-3.0, -3.0, -math.pi), (3.0, 3.0, math.pi)


def problem(start, goal, disks=(), resolution=0.02):
    """Of a point car among disks (x, y, radius)."""
    disks = np.array(disks, dtype=float).reshape(-1, 3)

    def valid(states):
        apart = np.linalg.norm(states[:, None, :2] - disks[None, :, :2], axis=2)
        return (apart > disks[:, 2]).all(axis=1)

    return Problem(LOWER, UPPER, start, goal, valid, weights=(1.0, 1.0, 0.2), resolution=resolution)


def states_along(result, spacing=0.002):
    return result.curve(np.append(np.arange(0.0, result.length, spacing), result.length))


def assert_joined(result, start, goals):
    np.testing.assert_array_equal(result.curve.start, start)
    end = result.curve(result.length)
    goal = np.atleast_2d(goals)[result.goal_index]
    np.testing.assert_allclose(end[:2], goal[:2], atol=1e-6)
    assert abs(math.remainder(end[2] - goal[2], 2 * math.pi)) < 1e-6


@pytest.mark.parametrize("backward", [True, False])
def test_without_obstacles_the_shortest_curve_is_the_path(backward):
    start, goal = (0.0, 0.0, 0.0), (1.0, 1.5, 2.0)
    result = car_connect(problem(start, goal), RADIUS, backward=backward)
    assert result.status is Status.SOLVED
    assert result.length == pytest.approx(car_curve(start, goal, RADIUS, backward=backward).length, abs=1e-9)


@pytest.mark.parametrize("backward", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_paths_among_disks_are_free_and_drivable(backward, seed):
    rng = np.random.default_rng(seed)
    start, goal = np.array([-2.5, -2.5, 0.3]), np.array([2.5, 2.5, -2.0 if backward else 0.9])
    disks = np.column_stack([rng.uniform(-2, 2, (9, 2)), rng.uniform(0.3, 0.6, 9)])
    asked = problem(start, goal, disks)
    result = car_connect(asked, RADIUS, backward=backward, seed=seed, timeout=20.0)
    assert result.status is Status.SOLVED
    assert_joined(result, start, goal)
    states = states_along(result)
    apart = np.linalg.norm(states[:, None, :2] - disks[None, :, :2], axis=2) - disks[:, 2]
    assert apart.min() > -0.25 * 0.02**2 / RADIUS - 0.02**2  # between states that were looked at
    assert (np.abs(states[:, :2]) <= 3.0 + 1e-9).all()
    assert result.curve.radius == RADIUS
    assert backward or (result.curve.lengths > 0).all()
    assert result.length >= car_curve(start, goal, RADIUS, backward=backward).length - 1e-9
    again = car_connect(asked, RADIUS, backward=backward, seed=seed, timeout=20.0)
    assert again.length == result.length


def test_parking_needs_going_backward():
    """Out of a bay between disks, whose mouth is behind the car."""
    bay = [(0.8 * math.cos(a), 0.8 * math.sin(a), 0.4) for a in np.linspace(-2.2, 2.2, 13)]
    start, goal = (0.0, 0.0, 0.0), (2.0, 0.0, 0.0)
    result = car_connect(problem(start, goal, bay), RADIUS, timeout=20.0)
    assert result.status is Status.SOLVED
    assert_joined(result, start, goal)
    assert (result.curve.lengths < 0).any()
    forward = car_connect(problem(start, goal, bay), RADIUS, backward=False, timeout=0.3)
    assert forward.status is Status.NO_PATH_IN_TIME


def test_the_nearest_of_several_goals_will_do():
    goals = [(2.0, 0.0, 0.0), (0.0, 2.5, 0.0)]
    result = car_connect(problem((0.0, 0.0, 0.0), goals), RADIUS)
    assert result.goal_index == 0
    assert result.length == pytest.approx(2.0)


def test_what_cannot_be_is_said():
    ring = [(math.cos(a), math.sin(a), 0.4) for a in np.linspace(0, 2 * math.pi, 13)]
    shut = problem((0.0, 0.0, 0.0), (2.5, 0.0, 0.0), ring)
    result = car_connect(shut, RADIUS, timeout=0.3)
    assert result.status is Status.NO_PATH_IN_TIME
    assert result.curve is None
    assert result.time < 2.0
    assert car_connect(problem((1.0, 0, 0), (0, 0, 0), ring), RADIUS).status is Status.START_INVALID
    assert car_connect(problem((0, 0, 0), (1.0, 0, 0), ring), RADIUS).status is Status.GOAL_INVALID
    with pytest.raises(InvalidValueError, match="radius: got -1"):
        car_connect(shut, -1)
    flat = Problem((0, 0), (1, 1), (0, 0), (1, 1), lambda states: np.ones(len(states), bool))
    with pytest.raises(InvalidValueError, match="problem: got 2 coordinates, expected three"):
        car_connect(flat, 1.0)
