from __future__ import annotations

import ctypes
import time

import numpy as np
import pytest

from pepper_kin.planners import (
    CompiledValidity,
    Problem,
    Roadmap,
    Status,
    certify,
    rrt_connect,
    shortcut,
    smooth,
)

LEFT, RIGHT = [0.1, 0.1], [0.9, 0.15]


def padded(world, start, goals, code, resolution=0.014, **options) -> Problem:  # type: ignore[no-untyped-def]
    """With obstacles grown by half the resolution, a checked edge is valid at every point."""
    n = len(start)
    oracle = code(world, resolution / 2.0)
    return Problem(np.zeros(n), np.ones(n), start, goals, oracle, resolution=resolution, **options)


@pytest.mark.parametrize("name", ["wall", "maze", "discs"])
def test_plane_worlds(name: str, request: pytest.FixtureRequest, machine_code) -> None:  # type: ignore[no-untyped-def]
    world = request.getfixturevalue(name)
    problem = padded(world, [0.05, 0.05], [0.95, 0.95], machine_code)
    for seed in range(20):
        result = rrt_connect(problem, seed=seed, timeout=60.0)
        assert result.status is Status.SOLVED
        assert world.path_free(result.path.points)
        assert np.all(np.diff(result.path.arc_lengths) > 0.0)  # no way-point twice, not even where trees meet
        assert certify(problem, result.path).valid
        assert result.cost == result.path.length
        assert result.goal_index == 0


@pytest.mark.parametrize("n", [3, 5, 10, 15])
def test_balls_in_many_dimensions(n: int, balls, machine_code) -> None:  # type: ignore[no-untyped-def]
    world = balls(n)
    resolution = 0.01 * np.sqrt(n)
    problem = padded(world, np.full(n, 0.1), np.full(n, 0.9), machine_code, resolution)
    for seed in range(10):
        result = rrt_connect(problem, seed=seed, timeout=60.0)
        assert result.success
        assert result.iterations > 0
        assert world.path_free(result.path.points)


def test_weights_scale_the_metric(boxes_6d, machine_code) -> None:  # type: ignore[no-untyped-def]
    weights, resolution = np.array([1.0, 2.0, 1.0, 0.5, 1.0, 1.5]), 0.02
    oracle = machine_code(boxes_6d, resolution / 2.0 / weights)
    problem = Problem(
        np.zeros(6), np.ones(6), np.full(6, 0.05), np.full(6, 0.95), oracle, weights, resolution
    )
    for seed in range(5):
        result = rrt_connect(problem, seed=seed, timeout=60.0)
        assert result.success
        assert boxes_6d.path_free(result.path.points)
        assert result.cost == pytest.approx(
            np.linalg.norm(np.diff(result.path.points, axis=0) * weights, axis=1).sum()
        )


def test_python_and_machine_code_agree_on_effort(balls, machine_code) -> None:  # type: ignore[no-untyped-def]
    """The same algorithm on other random numbers: medians over seeds of samples and costs are alike."""
    code = machine_code(balls(4))
    ends = np.full(4, 0.1), np.full(4, 0.9)
    problems = [Problem(np.zeros(4), np.ones(4), *ends, f) for f in (code, lambda x: code(x))]
    runs = [[rrt_connect(p, seed=seed, timeout=60.0) for seed in range(40)] for p in problems]
    iterations = [np.median([r.iterations for r in some]) for some in runs]
    costs = [np.median([r.cost for r in some]) for some in runs]
    assert iterations[0] == pytest.approx(iterations[1], rel=0.4)
    assert costs[0] == pytest.approx(costs[1], rel=0.15)


def test_same_seed_same_path(maze, machine_code) -> None:  # type: ignore[no-untyped-def]
    problem = padded(maze, LEFT, RIGHT, machine_code)
    first, again, other = (rrt_connect(problem, seed=s, timeout=60.0) for s in (5, 5, 6))
    assert np.array_equal(first.path.points, again.path.points)
    assert (first.iterations, first.states_checked) == (again.iterations, again.states_checked)
    assert not np.array_equal(first.path.points, other.path.points)


def test_trees_outgrow_their_first_arrays(closed_wall, maze, machine_code) -> None:  # type: ignore[no-untyped-def]
    problem = padded(closed_wall, LEFT, RIGHT, machine_code)
    result = rrt_connect(problem, timeout=60.0, max_iterations=20_000, step=0.02)
    assert result.status is Status.OUT_OF_ITERATIONS
    assert result.iterations == 20_000
    fine = padded(maze, [0.05, 0.05], [0.95, 0.95], machine_code, 0.002)
    dense = rrt_connect(fine, timeout=60.0, step=0.002)  # a node at every step
    assert dense.success
    assert len(dense.path) > 500
    assert maze.path_free(dense.path.points)
    assert np.max(np.diff(dense.path.arc_lengths)) <= 0.002 * (1 + 1e-9)


def test_free_straight_line_needs_no_sample(wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    result = rrt_connect(padded(wall, LEFT, [[0.9, 0.1], [0.2, 0.9], [0.3, 0.3]], machine_code))
    assert result.iterations == 0
    assert result.goal_index == 2  # the nearest of those in sight
    assert np.array_equal(result.path.points, [LEFT, [0.3, 0.3]])


def test_goal_that_can_be_reached_is_found_among_others(maze, machine_code) -> None:  # type: ignore[no-untyped-def]
    """One goal is inside a wall, one is walled in; the third decides, and is named by its index."""
    cell = [([0.85, 0.45], [0.87, 0.65]), ([0.93, 0.45], [0.95, 0.65])]
    cell += [([0.85, 0.45], [0.95, 0.47]), ([0.85, 0.63], [0.95, 0.65])]
    lower = np.vstack((maze.box_lower, [low for low, _ in cell]))
    upper = np.vstack((maze.box_upper, [high for _, high in cell]))
    world = type(maze)(lower, upper)
    problem = padded(world, [0.05, 0.05], [[0.4, 0.5], [0.9, 0.55], [0.7, 0.1]], machine_code)
    for seed in range(5):
        result = rrt_connect(problem, seed=seed, timeout=60.0)
        assert result.goal_index == 2
        assert np.array_equal(result.path.points[-1], problem.goals[2])
        assert world.path_free(result.path.points)


def test_many_goals(wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    goals = np.column_stack((np.full(3000, 0.9), np.linspace(0, 1, 3000)))
    result = rrt_connect(padded(wall, LEFT, goals, machine_code), timeout=60.0)
    assert result.success
    assert np.array_equal(result.path.points[-1], goals[result.goal_index])


def test_start_equal_to_goal_is_solved_at_once(wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    result = rrt_connect(padded(wall, LEFT, LEFT, machine_code))
    assert result.success
    assert result.cost == 0.0


def test_invalid_ends_have_their_own_status(wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    inside = [0.5, 0.2]
    start = rrt_connect(padded(wall, inside, RIGHT, machine_code))
    goal = rrt_connect(padded(wall, LEFT, [inside, [0.5, 0.1]], machine_code))
    assert start.status is Status.START_INVALID
    assert goal.status is Status.GOAL_INVALID
    assert start.path is goal.path is None
    assert str(goal).startswith("goal_invalid: cost inf, 0 iterations, 3 states checked")


@pytest.mark.parametrize("timeout", [0.05, 0.3])
def test_no_path_ends_in_time(timeout: float, closed_wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    problem = padded(closed_wall, LEFT, RIGHT, machine_code)
    rrt_connect(problem, max_iterations=1)
    begun, spent = time.perf_counter(), time.thread_time()
    result = rrt_connect(problem, timeout=timeout)
    passed, spent = time.perf_counter() - begun, time.thread_time() - spent
    assert result.status is Status.NO_PATH_IN_TIME
    assert timeout <= result.time <= passed
    assert spent < 2.0 * timeout + 1.0  # of its own; by the clock others may keep it waiting for longer
    assert result.iterations > 100


@pytest.mark.parametrize("name", ["wall", "maze", "discs"])
def test_short_cuts_are_valid_and_never_longer(name: str, request, machine_code) -> None:  # type: ignore[no-untyped-def]
    world = request.getfixturevalue(name)
    problem = padded(world, LEFT, RIGHT, machine_code)
    for seed in range(6):
        path = rrt_connect(problem, seed=seed, timeout=60.0).path
        lengths = [path.length]
        for iterations in (1, 10, 100, 1000):
            short = shortcut(problem, path, seed=seed, iterations=iterations, timeout=60.0)
            assert world.path_free(short.points)
            assert np.array_equal(short.points[[0, -1]], path.points[[0, -1]])
            lengths.append(short.length)
        # The choices of a shorter run are a prefix of a longer one's.
        assert np.all(np.diff(lengths) <= 1e-12)
        assert lengths[-1] < lengths[0]


def test_wall_path_comes_near_the_shortest(wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    problem = padded(wall, LEFT, RIGHT, machine_code)
    corners = np.array([LEFT, [0.473, 0.457], [0.527, 0.457], RIGHT])
    shortest = np.linalg.norm(np.diff(corners, axis=0), axis=1).sum()
    short = shortcut(problem, rrt_connect(problem).path, iterations=600, timeout=60.0)
    assert 0.99 * shortest < short.length < 1.02 * shortest


@pytest.mark.parametrize("n", [3, 6])
def test_short_cuts_are_as_good_as_those_in_python(n: int, balls, machine_code) -> None:  # type: ignore[no-untyped-def]
    code = machine_code(balls(n))
    ends = np.full(n, 0.1), np.full(n, 0.9)
    compiled, plain = (Problem(np.zeros(n), np.ones(n), *ends, f) for f in (code, lambda x: code(x)))
    lengths = []
    for seed in range(16):
        path = rrt_connect(compiled, seed=seed, timeout=60.0).path
        lengths.append(
            [shortcut(p, path, seed=seed, iterations=100, timeout=60.0).length for p in (compiled, plain)]
        )
        assert lengths[-1][0] <= path.length
    mean = np.mean(lengths, axis=0)
    assert mean[0] <= 1.02 * mean[1]


def test_short_cuts_of_a_seed_are_the_same(maze, machine_code) -> None:  # type: ignore[no-untyped-def]
    problem = padded(maze, LEFT, RIGHT, machine_code)
    path = rrt_connect(problem, seed=1, timeout=60.0).path
    first, again, other = (shortcut(problem, path, seed=s, timeout=60.0) for s in (3, 3, 4))
    assert np.array_equal(first.points, again.points)
    assert not np.array_equal(first.points, other.points)


def test_edges_that_are_not_checked_would_be_caught(wall) -> None:  # type: ignore[no-untyped-def]
    """Plant the bug: machine code that answers for single states only, and lets every edge pass."""
    free = wall.padded(0.007)

    @ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p)
    def careless(a: int, b: int, steps: int, memory: int) -> int:
        state = np.array((ctypes.c_double * 2).from_address(b))
        return steps if steps > 1 else int(free(state[None])[0])

    code = CompiledValidity(ctypes.cast(careless, ctypes.c_void_p).value, 2, keep_alive=careless)
    problem = Problem([0, 0], [1, 1], LEFT, RIGHT, code, resolution=0.014)
    for result in (rrt_connect(problem), Roadmap(problem).solve()):
        assert result.success
        assert not wall.path_free(result.path.points)
        assert not certify(problem, result.path).valid


@pytest.mark.parametrize("seed", range(6))
def test_whole_chain_to_a_smooth_curve(seed: int, maze, machine_code) -> None:  # type: ignore[no-untyped-def]
    """Search, short-cuts and rounding with half the margin; the curve is free at every point."""
    resolution = 0.014
    wide, half = (
        Problem([0, 0], [1, 1], [0.05, 0.05], [0.95, 0.95], machine_code(maze, margin), resolution=resolution)
        for margin in (resolution, resolution / 2)
    )
    short = shortcut(wide, rrt_connect(wide, seed=seed, timeout=60.0).path, seed=seed, timeout=60.0)
    curve = smooth(half, short)
    assert np.all(maze.free(curve.sample(resolution / 50)))
    assert certify(half, curve).valid
