import re
import time

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import Problem, Status, aorrtc, certify, rrt_connect

LEFT = [0.1, 0.1]


@pytest.fixture(params=["machine code", "callable"])
def checker_of(request: pytest.FixtureRequest, machine_code):  # type: ignore[no-untyped-def]
    return machine_code if request.param == "machine code" else lambda world, margin: world.padded(margin)


def problem_of(checker, sampler) -> Problem:  # type: ignore[no-untyped-def]
    return Problem([0, 0], [1, 1], LEFT, sampler, checker, resolution=0.014)


def test_goals_are_drawn_until_one_is_reached(wall, checker_of) -> None:  # type: ignore[no-untyped-def]
    """The first draws fail, lie in the wall, or are cut off by the box; a later one can be reached."""
    drawn: list[np.ndarray] = []

    def sampler(rng: np.random.Generator) -> np.ndarray | None:
        if rng.random() < 0.3:
            return None
        drawn.append(np.array([0.5, 0.2]) if len(drawn) < 3 else rng.uniform([0.8, 0.0], [1.0, 0.3]))
        return drawn[-1]

    problem = problem_of(checker_of(wall, 0.007), sampler)
    assert problem.goals.shape == (0, 2)
    assert problem.goal_sampler is sampler
    for seed in range(5):
        drawn.clear()
        result = rrt_connect(problem, seed=seed, timeout=60.0)
        assert result.success
        assert result.goal_index >= 3
        assert np.array_equal(result.path.points[-1], drawn[result.goal_index])
        assert wall.path_free(result.path.points)
        assert certify(problem, result.path).success


def test_later_goals_count_too(closed_wall, checker_of) -> None:  # type: ignore[no-untyped-def]
    """The first goal is behind a closed wall; only a goal drawn later can be reached."""
    calls = []

    def sampler(rng: np.random.Generator) -> list[float]:
        calls.append(1)
        return [0.9, 0.5] if len(calls) < 4 else [0.2, 0.9]

    result = rrt_connect(problem_of(checker_of(closed_wall, 0.007), sampler), timeout=60.0)
    assert result.success
    assert result.goal_index == 3
    assert result.iterations == 32 + 64 + 128
    assert len(calls) == 4


def test_same_seed_same_draws(discs, checker_of) -> None:  # type: ignore[no-untyped-def]
    problem = problem_of(checker_of(discs, 0.007), lambda rng: rng.uniform(0.8, 1.0, 2))
    first, again, other = (rrt_connect(problem, seed=s, timeout=60.0) for s in (1, 1, 2))
    assert np.array_equal(first.path.points, again.path.points)
    assert not np.array_equal(first.path.points[-1], other.path.points[-1])


@pytest.mark.parametrize("goal", [None, [0.5, 0.5]])
def test_without_a_valid_goal(goal, closed_wall, checker_of) -> None:  # type: ignore[no-untyped-def]
    problem = problem_of(checker_of(closed_wall, 0.007), lambda rng: goal)
    rrt_connect(problem, max_iterations=1)
    begun = time.perf_counter()
    result = rrt_connect(problem, timeout=0.1)
    assert result.status is Status.NO_GOAL
    assert 0.1 <= result.time <= time.perf_counter() - begun
    assert result.path is None
    assert "sampler" in result.status.advice
    tired = rrt_connect(problem, timeout=60.0, max_iterations=20)
    assert tired.status is Status.NO_GOAL


def test_start_is_judged_first(wall, checker_of) -> None:  # type: ignore[no-untyped-def]
    problem = Problem([0, 0], [1, 1], [0.5, 0.2], lambda rng: LEFT, checker_of(wall, 0.0))
    assert rrt_connect(problem).status is Status.START_INVALID


def test_no_path_to_drawn_goals_ends_in_time_or_by_iterations(closed_wall, checker_of) -> None:  # type: ignore[no-untyped-def]
    problem = problem_of(checker_of(closed_wall, 0.007), lambda rng: rng.uniform([0.8, 0], [1, 1]))
    result = rrt_connect(problem, timeout=60.0, max_iterations=300)  # its code is loaded here
    assert result.status is Status.OUT_OF_ITERATIONS
    assert result.iterations == 300
    assert rrt_connect(problem, timeout=1.0).status is Status.NO_PATH_IN_TIME


def test_a_path_to_a_drawn_goal_is_improved(discs, machine_code) -> None:  # type: ignore[no-untyped-def]
    """It may end at another goal that was drawn for the first path; a path given is one of them."""
    problem = problem_of(machine_code(discs, 0.007), lambda rng: rng.uniform(0.9, 1.0, 2))
    first = rrt_connect(problem, seed=4, timeout=60.0)
    searched = aorrtc(problem, seed=4, max_iterations=500, timeout=60.0)
    assert np.all(searched.path.points[-1] >= 0.9)
    improved = aorrtc(problem, first.path, max_iterations=500, timeout=60.0)
    assert np.array_equal(improved.path.points[-1], first.path.points[-1])
    for result in (searched, improved):
        assert discs.path_free(result.path.points)
        assert result.cost <= first.cost


def test_misuse_is_named(wall, checker_of) -> None:
    for drawn, message in [
        ([0.5, 1.5], "goal drawn[1] (y): got 1.5, expected a value within the bounds [0, 1]"),
        ([np.nan, 0.5], "goal drawn[0] (x): got nan, expected a finite number"),
        ([0.5], "goal drawn: got shape (1,), expected a vector of shape (2,)"),
        ("goal", "goal drawn: got goal"),
    ]:
        problem = Problem(
            [0, 0], [1, 1], LEFT, lambda rng, x=drawn: x, checker_of(wall, 0.0), labels=("x", "y")
        )
        with pytest.raises(InvalidValueError, match=re.escape(message)):
            rrt_connect(problem)
