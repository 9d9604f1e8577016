import ctypes
import signal
import threading
import time

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import (
    CompiledMotionValidator,
    MotionValidator,
    Problem,
    Roadmap,
    Status,
    certify,
    first_invalid_states,
    rrt_connect,
    shortcut,
    smooth,
)
from pepper_kin.planners.motion_validator import MAX_BATCH

LEFT, RIGHT = [0.1, 0.1], [0.9, 0.15]


def padded(world, start, goals, code, resolution=0.014, **options) -> Problem:  # type: ignore[no-untyped-def]
    """With obstacles grown by half the resolution, a checked edge is valid at every point."""
    n = len(start)
    checker = code(world, resolution / 2.0)
    return Problem(np.zeros(n), np.ones(n), start, goals, checker, resolution=resolution, **options)


def callable_of(world, margin):  # type: ignore[no-untyped-def]
    return world.padded(margin)


@pytest.mark.parametrize("name", ["wall", "maze", "discs"])
def test_plane_worlds(name: str, request: pytest.FixtureRequest, machine_code) -> None:  # type: ignore[no-untyped-def]
    world = request.getfixturevalue(name)
    problem = padded(world, [0.05, 0.05], [0.95, 0.95], machine_code)
    for seed in range(20):
        result = rrt_connect(problem, seed=seed, timeout=60.0)
        assert result.status is Status.SOLVED
        assert world.path_free(result.path.points)
        assert np.all(np.diff(result.path.arc_lengths) > 0.0)  # no waypoint twice, not even where trees meet
        assert certify(problem, result.path).success
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
    checker = machine_code(boxes_6d, resolution / 2.0 / weights)
    problem = Problem(
        np.zeros(6), np.ones(6), np.full(6, 0.05), np.full(6, 0.95), checker, weights, resolution
    )
    for seed in range(5):
        result = rrt_connect(problem, seed=seed, timeout=60.0)
        assert result.success
        assert boxes_6d.path_free(result.path.points)
        assert result.cost == pytest.approx(
            np.linalg.norm(np.diff(result.path.points, axis=0) * weights, axis=1).sum()
        )


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
    dense = rrt_connect(fine, timeout=60.0, step=0.02)
    assert dense.success
    assert len(dense.path) > 50
    assert maze.path_free(dense.path.points)
    assert np.max(np.diff(dense.path.arc_lengths)) <= 0.02 * (1 + 1e-9)


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


def test_edges_that_are_not_checked_would_be_caught(wall) -> None:  # type: ignore[no-untyped-def]
    """Plant the bug: machine code that answers for single states only, and lets every edge pass."""
    free = wall.padded(0.007)

    @ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p)
    def careless(a: int, b: int, steps: int, memory: int) -> int:
        state = np.array((ctypes.c_double * 2).from_address(b))
        return steps if steps > 1 else int(free(state[None])[0])

    code = CompiledMotionValidator(ctypes.cast(careless, ctypes.c_void_p).value, 2, keep_alive=careless)
    problem = Problem([0, 0], [1, 1], LEFT, RIGHT, code, resolution=0.014)
    for result in (rrt_connect(problem), Roadmap(problem).solve()):
        assert result.success
        assert not wall.path_free(result.path.points)
        assert not certify(problem, result.path).success


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


@pytest.mark.parametrize("seed", range(6))
def test_whole_chain_to_a_smooth_curve(seed: int, maze, machine_code) -> None:  # type: ignore[no-untyped-def]
    """Search, shortcuts and rounding with half the margin; the curve is free at every point."""
    resolution = 0.014
    wide, half = (
        Problem([0, 0], [1, 1], [0.05, 0.05], [0.95, 0.95], machine_code(maze, margin), resolution=resolution)
        for margin in (resolution, resolution / 2)
    )
    short = shortcut(wide, rrt_connect(wide, seed=seed, timeout=60.0).path, seed=seed, timeout=60.0)
    curve = smooth(half, short)
    assert np.all(maze.free(curve.sample(resolution / 50)))
    assert certify(half, curve).success


def test_global_random_state_plays_no_part(wall) -> None:  # type: ignore[no-untyped-def]
    problem = padded(wall, LEFT, RIGHT, callable_of)
    before = np.random.get_state()[1].copy()
    rrt_connect(problem, seed=1, timeout=60.0)
    assert np.array_equal(before, np.random.get_state()[1])


def test_invalid_start_and_goals_have_their_own_status(wall) -> None:  # type: ignore[no-untyped-def]
    inside = [0.5, 0.2]
    start = rrt_connect(padded(wall, inside, RIGHT, callable_of))
    goal = rrt_connect(padded(wall, LEFT, [inside, [0.5, 0.1]], callable_of))
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


def test_budget_is_overrun_by_one_batch_at_most(closed_wall, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    now, cost, timeout = [0.0], 1e-3, 3.0
    monkeypatch.setattr("pepper_kin.kernels.working_time.perf_counter", lambda: now[0])
    free = closed_wall.padded(0.0)

    def slow(states: np.ndarray) -> np.ndarray:
        now[0] += cost * len(states)
        return free(states)

    goals = np.column_stack((np.full(700, 0.9), np.linspace(0, 1, 700)))
    result = rrt_connect(Problem([0, 0], [1, 1], LEFT, goals, slow, resolution=0.001), timeout=timeout)
    assert result.status is Status.NO_PATH_IN_TIME
    assert timeout <= result.time <= timeout + cost * MAX_BATCH


def test_path_without_edge_checks_would_be_caught(wall, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """Plant the bug: edges count as valid unseen.  Both the certificate and the exact test must object."""
    checked = MotionValidator.last_valid_step
    monkeypatch.setattr(
        MotionValidator, "last_valid_step", lambda self, a, b, n: n if n > 1 else checked(self, a, b, n)
    )
    problem = padded(wall, LEFT, RIGHT, callable_of)
    result = rrt_connect(problem)
    assert result.success
    assert not wall.path_free(result.path.points)
    certificate = certify(problem, result.path)
    assert not certificate.success
    assert not wall.padded(0.007)(certificate.first_invalid[None, :])[0]


def test_misuse_is_named(wall) -> None:  # type: ignore[no-untyped-def]
    problem = padded(wall, LEFT, RIGHT, callable_of)
    for options, message in (
        (dict(seed=None), "seed: got None, expected an integer >= 0"),
        (dict(seed=-1), "seed: got -1, expected an integer >= 0"),
        (dict(timeout=0.0), "timeout: got 0.0, expected a number of seconds above 0"),
        (dict(max_iterations=1.5), "max_iterations: got 1.5, expected an integer >= 0"),
        (dict(step=np.nan), "step: got nan, expected a finite number above 0"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            rrt_connect(problem, **options)


def test_a_callable_leads_to_the_same_path_as_machine_code(balls, machine_code) -> None:  # type: ignore[no-untyped-def]
    world = balls(4)
    ends = np.full(4, 0.1), np.full(4, 0.9)
    for seed in range(10):
        code, plain = (
            rrt_connect(Problem(np.zeros(4), np.ones(4), *ends, of(world, 0.01)), seed=seed, timeout=60.0)
            for of in (machine_code, callable_of)
        )
        assert np.array_equal(code.path.points, plain.path.points)
        assert code.iterations == plain.iterations
        assert plain.states_checked >= code.states_checked  # in batches


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
def test_what_a_callable_raises_ends_the_search(error: type[BaseException], maze) -> None:  # type: ignore[no-untyped-def]
    asked = []

    def broken(states: np.ndarray) -> np.ndarray:
        asked.append(len(states))
        if len(asked) > 20:
            raise error("in the checker")
        return maze.free(states)

    problem = Problem([0, 0], [1, 1], [0.05, 0.05], [0.95, 0.95], broken, resolution=0.014)
    with pytest.raises(error, match="in the checker"):
        rrt_connect(problem, timeout=60.0)
    assert len(asked) == 21


def test_an_interrupt_from_the_keyboard_ends_machine_code(closed_wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    problem = padded(closed_wall, LEFT, RIGHT, machine_code)
    rrt_connect(problem, max_iterations=1)
    main = threading.main_thread().ident
    timer = threading.Timer(0.2, lambda: signal.pthread_kill(main, signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell began it with &
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            rrt_connect(problem, timeout=60.0, max_iterations=10**9)
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(("shut", "side"), [("start", Status.START_SHUT_IN), ("goal", Status.GOAL_SHUT_IN)])
def test_an_enclosed_end_is_named(shut: str, side: Status, toy) -> None:  # type: ignore[no-untyped-def]
    """A small room around one end: its tree is small, and its walls are what is met."""
    space = np.array([0.2, 0.3])
    low = [[0.13, 0.23], [0.25, 0.23], [0.13, 0.23], [0.13, 0.35]]
    high = [[0.15, 0.37], [0.27, 0.37], [0.27, 0.25], [0.27, 0.37]]
    world = toy.world(low, high)
    ends = (space, [0.9, 0.9]) if shut == "start" else ([0.9, 0.9], space)
    problem = Problem([0, 0], [1, 1], *ends, toy.code(world, 0.004), resolution=0.008)
    result = rrt_connect(problem, max_iterations=20_000, timeout=60.0)
    assert result.status is side
    small, large = result.tree_sizes if shut == "start" else result.tree_sizes[::-1]
    assert 1 <= small < large
    assert "surrounds it" in result.status.advice
    assert np.all(np.abs(result.frontier - space) < 0.05)
    met = first_invalid_states(problem, result.frontier, 40)
    assert len(met) > 30
    assert np.all((np.abs(met - space) < 0.08) & ~problem.validity(met)[:, None])


def test_a_wall_between_two_halves_shuts_nobody_in(closed_wall, machine_code) -> None:  # type: ignore[no-untyped-def]
    result = rrt_connect(padded(closed_wall, LEFT, RIGHT, machine_code), max_iterations=20_000, timeout=60.0)
    assert result.status is Status.OUT_OF_ITERATIONS
    assert min(result.tree_sizes) > 100


@pytest.mark.parametrize("step", [0.3, 0.0025])
def test_paths_of_any_number_of_way_points_are_whole(step: float) -> None:
    """Few waypoints are traced in the call that finds them, more than it has room for afterwards.

    A dot is in the way of the straight edge, so that the trees meet soon even where steps are short.
    """
    dot = np.array([0.5, 0.5])
    start, goal = np.array([0.1, 0.5]), np.array([0.9, 0.5])
    problem = Problem(
        np.zeros(2),
        np.ones(2),
        start,
        goal,
        lambda q: np.linalg.norm(q - dot, axis=1) > 0.002,
        resolution=0.001,
    )
    for seed in range(3):
        found = rrt_connect(problem, seed=seed, timeout=60.0, step=step)
        other = rrt_connect(problem, seed=seed + 10, timeout=60.0, step=step)
        points = found.path.points
        assert (len(points) > 300) == (step < 0.01)
        assert np.array_equal(points[[0, -1]], [start, goal])
        edges = np.diff(points, axis=0)
        lengths = np.linalg.norm(edges, axis=1)
        assert 0.0 < lengths.max() <= step * (1 + 1e-12)
        nearest = np.clip(((dot - points[:-1]) * edges).sum(axis=1) / lengths**2, 0.0, 1.0)
        assert np.linalg.norm(points[:-1] + nearest[:, None] * edges - dot, axis=1).min() > 0.0015
        assert np.allclose(found.path.arc_lengths, np.concatenate([[0.0], lengths.cumsum()]))
        assert found.goal_index == 0
        assert not np.array_equal(other.path.points, points)
