"""T-RRT: passes are crossed where they are low, which a search without regard to the price does not."""

import math
import time

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import Problem, StateCost, Status, descend_cost, rrt_connect, transition_rrt

START, GOAL = [-1.0, 0.0], [1.0, 0.0]


def problem(valid=lambda x: np.ones(len(x), dtype=bool), goals=(GOAL,)):
    return Problem([-1.5, -1.5], [1.5, 1.5], START, goals, valid, resolution=0.02)


def ridge(x):
    """A ridge across the way, 30 high in the middle, with a pass of 0.5 at y = 1."""
    across = np.exp(-(x[:, 0] ** 2) / (2 * 0.15**2))
    dip = np.exp(-((x[:, 1] - 1.0) ** 2) / (2 * 0.2**2))
    height = 30 - 29.5 * dip
    slope_x = -x[:, 0] / 0.15**2 * across * height
    slope_y = across * 29.5 * (x[:, 1] - 1.0) / 0.2**2 * dip
    return (across * height)[:, None], np.stack([slope_x, slope_y], axis=1)[:, None]


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(6))
def test_a_ridge_is_crossed_at_its_pass(seed):
    cost = StateCost(ridge, 2)
    found = transition_rrt(problem(), cost, seed=seed, timeout=60)
    assert found.success
    np.testing.assert_array_equal(found.path.points[[0, -1]], [START, GOAL])
    assert cost.at(found.path.resample(0.005).points).max() < 12  # of 30
    straight = rrt_connect(problem(), seed=seed).path
    assert cost.at(straight.resample(0.005).points).max() > 29
    assert found.cost == pytest.approx(cost.along(found.path.resample(0.01)), rel=0.05)
    lowered = descend_cost(problem(), cost, found.path, seed=seed, timeout=60)
    assert cost.at(lowered.resample(0.005).points).max() < 2
    assert cost.along(lowered) < found.cost


@pytest.mark.thorough
def test_obstacles_are_kept_clear_of():
    free = lambda x: np.abs(x[:, 0]) + np.abs(x[:, 1] - 0.6) > 0.5  # noqa: E731
    found = transition_rrt(problem(free), StateCost(ridge, 2), seed=1, timeout=60)
    assert found.success
    assert free(found.path.resample(0.02).points).all()


def test_without_a_price_there_is_a_path_too():
    flat = StateCost(lambda x: (np.zeros((len(x), 1)), np.zeros((len(x), 1, 2))), 2)
    wall = lambda x: ~((np.abs(x[:, 0]) < 0.1) & (x[:, 1] < 1.0))  # noqa: E731
    found = transition_rrt(problem(wall), flat, seed=2, timeout=60)
    assert found.success
    assert found.cost == pytest.approx(found.path.length)


def test_one_of_several_goals_is_reached():
    goals = [[0.0, 0.0], [1.0, 0.1], [-0.9, 0.9]]
    found = transition_rrt(
        problem(lambda x: np.linalg.norm(x, axis=1) > 0.05, goals), StateCost(ridge, 2), timeout=60
    )
    assert found.success
    assert found.goal_index in (1, 2)
    np.testing.assert_array_equal(found.path.points[-1], goals[found.goal_index])


def test_ends_that_are_not_valid_and_limits_are_said():
    cost = StateCost(ridge, 2)
    left, right = (lambda x: x[:, 0] < 0.5), (lambda x: x[:, 0] > -0.5)
    assert transition_rrt(problem(left), cost).status is Status.GOAL_INVALID
    assert transition_rrt(problem(right), cost).status is Status.START_INVALID
    short = transition_rrt(problem(), cost, max_iterations=3)
    assert short.status is Status.OUT_OF_ITERATIONS
    assert math.isinf(short.cost)
    closed = problem(lambda x: np.abs(x[:, 0]) > 0.1)
    assert transition_rrt(closed, cost, timeout=0.3).status is Status.NO_PATH_IN_TIME
    with pytest.raises(InvalidValueError, match="3 coordinates"):
        transition_rrt(problem(), StateCost(ridge, 3))


@pytest.mark.thorough
def test_the_same_seed_gives_the_same_path():
    runs = [transition_rrt(problem(), StateCost(ridge, 2), seed=s, timeout=60).path.points for s in (3, 3, 4)]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_what_a_price_raises_comes_out_at_once():
    def broken(x):
        if len(calls) > 50:
            raise ZeroDivisionError("in the price")
        calls.append(x)
        return np.zeros((len(x), 1)), np.zeros((len(x), 1, 2))

    calls, begin = [], time.process_time()
    closed = problem(lambda x: np.abs(x[:, 0]) > 0.1)
    with pytest.raises(ZeroDivisionError, match="in the price"):
        transition_rrt(closed, StateCost(broken, 2), timeout=60)
    assert time.process_time() - begin < 10
