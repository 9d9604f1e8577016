from __future__ import annotations

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import Metric, Oracle, Problem, Status, certify, rrt_connect
from pepper_kin.planners.oracle import MAX_BATCH
from pepper_kin.planners.tree import Tree

UNIT = (np.zeros(2), np.ones(2))
LEFT, RIGHT = [0.1, 0.1], [0.9, 0.15]


def padded_problem(world, start, goals, resolution=0.014, **options) -> Problem:  # type: ignore[no-untyped-def]
    """With obstacles grown by half the resolution, a checked edge is valid at every point."""
    n = len(start)
    oracle = world.padded(resolution / 2.0)
    return Problem(np.zeros(n), np.ones(n), start, goals, oracle, resolution=resolution, **options)


@pytest.mark.parametrize("seed", range(8))
def test_wall_is_passed_through_its_gap(wall, seed: int) -> None:  # type: ignore[no-untyped-def]
    problem = padded_problem(wall, LEFT, RIGHT)
    result = rrt_connect(problem, seed=seed, timeout=60.0)
    assert result.success
    assert result.status is Status.SOLVED
    assert wall.path_free(result.path.points)
    assert np.all(np.diff(result.path.arc_lengths) > 0.0)  # no way-point twice, not even where the trees meet
    assert certify(problem, result.path).valid
    assert result.cost == result.path.length > np.hypot(0.8, 0.05)
    assert result.iterations > 0
    assert result.seed == seed


@pytest.mark.parametrize("name", ["maze", "discs"])
def test_other_plane_worlds(name: str, request: pytest.FixtureRequest) -> None:
    world = request.getfixturevalue(name)
    for seed in range(3):
        problem = padded_problem(world, [0.05, 0.05], [0.95, 0.95])
        result = rrt_connect(problem, seed=seed, timeout=60.0)
        assert result.success
        assert world.path_free(result.path.points)


def test_six_dimensions_with_weights(boxes_6d) -> None:  # type: ignore[no-untyped-def]
    weights = np.array([1.0, 2.0, 1.0, 0.5, 1.0, 1.5])
    resolution = 0.02
    oracle = boxes_6d.padded(resolution / 2.0 / weights)
    problem = Problem(
        np.zeros(6),
        np.ones(6),
        np.full(6, 0.05),
        np.full(6, 0.95),
        oracle,
        weights=weights,
        resolution=resolution,
    )
    for seed in range(3):
        result = rrt_connect(problem, seed=seed, timeout=60.0)
        assert result.success
        assert result.iterations > 0
        assert boxes_6d.path_free(result.path.points)
        assert result.cost == pytest.approx(Metric(weights).arc_lengths(result.path.points)[-1])


def test_same_seed_same_path(wall) -> None:  # type: ignore[no-untyped-def]
    problem = padded_problem(wall, LEFT, RIGHT)
    first, again, other = (rrt_connect(problem, seed=s, timeout=60.0) for s in (5, 5, 6))
    assert np.array_equal(first.path.points, again.path.points)
    assert (first.iterations, first.states_checked) == (again.iterations, again.states_checked)
    assert not np.array_equal(first.path.points, other.path.points)


def test_global_random_state_plays_no_part(wall) -> None:  # type: ignore[no-untyped-def]
    problem = padded_problem(wall, LEFT, RIGHT)
    before = np.random.get_state()[1].copy()
    rrt_connect(problem, seed=1, timeout=60.0)
    assert np.array_equal(before, np.random.get_state()[1])


def test_free_straight_line_needs_no_sample(wall) -> None:  # type: ignore[no-untyped-def]
    problem = padded_problem(wall, LEFT, [[0.9, 0.1], [0.2, 0.9], [0.3, 0.3]])
    result = rrt_connect(problem)
    assert result.iterations == 0
    assert result.goal_index == 2  # the nearest of those in sight
    assert np.array_equal(result.path.points, [LEFT, [0.3, 0.3]])


def test_goal_that_can_be_reached_is_found_among_others(maze) -> None:  # type: ignore[no-untyped-def]
    """One goal is inside a wall, one is walled in; the third decides, and is named by its index."""
    cell = [([0.85, 0.45], [0.87, 0.65]), ([0.93, 0.45], [0.95, 0.65])]
    cell += [([0.85, 0.45], [0.95, 0.47]), ([0.85, 0.63], [0.95, 0.65])]
    lower = np.vstack((maze.box_lower, [low for low, _ in cell]))
    upper = np.vstack((maze.box_upper, [high for _, high in cell]))
    world = type(maze)(lower, upper)
    problem = padded_problem(world, [0.05, 0.05], [[0.4, 0.5], [0.9, 0.55], [0.7, 0.1]])
    result = rrt_connect(problem, seed=2, timeout=60.0)
    assert result.success
    assert result.goal_index == 2
    assert np.array_equal(result.path.points[-1], problem.goals[2])
    assert world.path_free(result.path.points)


def test_start_equal_to_goal_is_solved_at_once(wall) -> None:  # type: ignore[no-untyped-def]
    result = rrt_connect(padded_problem(wall, LEFT, LEFT))
    assert result.success
    assert result.cost == 0.0


def test_invalid_start_and_goals_have_their_own_status(wall) -> None:  # type: ignore[no-untyped-def]
    inside = [0.5, 0.2]
    start = rrt_connect(padded_problem(wall, inside, RIGHT))
    goal = rrt_connect(padded_problem(wall, LEFT, [inside, [0.5, 0.1]]))
    assert start.status is Status.START_INVALID
    assert goal.status is Status.GOAL_INVALID
    for result in (start, goal):
        assert not result.success
        assert result.path is None
        assert result.goal_index is None
        assert result.cost == np.inf
    assert "start state" in start.status.advice
    assert "goal state" in goal.status.advice
    assert str(goal).startswith("goal_invalid: cost inf, 0 iterations, 3 states checked")


def test_no_path_ends_by_time_or_by_iterations(closed_wall) -> None:  # type: ignore[no-untyped-def]
    problem = padded_problem(closed_wall, LEFT, RIGHT)
    late = rrt_connect(problem, timeout=0.2)
    assert late.status is Status.NO_PATH_IN_TIME
    assert late.time >= 0.2
    assert "raise the timeout" in late.status.advice
    tired = rrt_connect(problem, timeout=60.0, max_iterations=300)
    assert tired.status is Status.OUT_OF_ITERATIONS
    assert tired.iterations == 300
    assert "max_iterations" in tired.status.advice
    assert tired.path is None


def test_every_status_has_its_own_advice() -> None:
    advice = [status.advice for status in Status]
    assert len(set(advice)) == len(advice)
    assert all(sentence.endswith(".") for sentence in advice)


def test_budget_is_overrun_by_one_batch_at_most(closed_wall, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    now, cost, timeout = [0.0], 1e-3, 3.0
    monkeypatch.setattr("pepper_kin.planners.deadline.perf_counter", lambda: now[0])
    free = closed_wall.padded(0.0)

    def slow(states: np.ndarray) -> np.ndarray:
        now[0] += cost * len(states)
        return free(states)

    goals = np.column_stack((np.full(700, 0.9), np.linspace(0, 1, 700)))
    result = rrt_connect(Problem(*UNIT, LEFT, goals, slow, resolution=0.001), timeout=timeout)
    assert result.status is Status.NO_PATH_IN_TIME
    assert timeout <= result.time <= timeout + cost * MAX_BATCH


def test_path_without_edge_checks_would_be_caught(wall, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """Plant the bug: edges count as valid unseen.  Both the certificate and the exact test must object."""
    monkeypatch.setattr(Oracle, "edge_valid", lambda self, a, b: True)
    problem = padded_problem(wall, LEFT, RIGHT)
    result = rrt_connect(problem)
    assert result.success
    assert not wall.path_free(result.path.points)
    certificate = certify(problem, result.path)
    assert not certificate.valid
    assert not wall.padded(0.007)(certificate.first_invalid[None, :])[0]


def test_misuse_is_named(wall) -> None:  # type: ignore[no-untyped-def]
    problem = padded_problem(wall, LEFT, RIGHT)
    for options, message in (
        (dict(seed=None), "seed: got None, expected an integer >= 0"),
        (dict(seed=-1), "seed: got -1, expected an integer >= 0"),
        (dict(timeout=0.0), "timeout: got 0.0, expected a number of seconds above 0"),
        (dict(max_iterations=1.5), "max_iterations: got 1.5, expected an integer >= 0"),
        (dict(step=np.nan), "step: got nan, expected a finite number above 0"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            rrt_connect(problem, **options)


def test_tree_finds_the_nearest_node_and_the_way_back() -> None:
    """Against brute force, across several growths of its arrays."""
    rng = np.random.default_rng(0)
    metric = Metric(np.array([1.0, 3.0, 0.2]))
    states = rng.normal(size=(1500, 3)) + 50.0
    tree = Tree(states[:2], metric)
    for first in range(2, 1500, 7):
        last = tree.add_chain(first // 3, states[first : first + 7])
        assert last == tree.size - 1
    assert tree.size == 1500
    for query in rng.normal(size=(50, 3)) + 50.0:
        assert tree.nearest(query) == np.argmin(metric.distance(states, query))
    branch = tree.branch(1499)
    assert branch[-1] == 1499
    assert branch[0] in (0, 1)
    assert np.all(np.diff(branch) > 0)
    assert np.array_equal(tree.states(branch), states[branch])
