import re
import time

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import (
    Deadline,
    Path,
    Problem,
    Roadmap,
    Status,
    StopReason,
    aorrtc,
    rrt_connect,
    shortcut,
)
from pepper_kin.planners.motion_validator import machine_code_of
from pepper_kin.planners.rrt_connect import Search
from pepper_kin.planners.sampling import stream_key, within_ellipsoid
from pepper_kin.planners.search_space import SearchSpace
from pepper_kin.planners.tree import take_trees


def box(lower, extent, weights) -> SearchSpace:  # type: ignore[no-untyped-def]
    return SearchSpace(0, np.zeros(1), 0, 1.0, 1.0, lower, extent, weights)


def box_problem(toy, resolution: float = 0.004, **options) -> tuple[Problem, float]:  # type: ignore[no-untyped-def]
    """A wide wall from below: the shortest path touches its two upper corners, so its length is known."""
    world = toy.world([[0.3, -1.0]], [[0.7, 0.8]])
    code = toy.code(world, resolution / 2.0)
    problem = Problem([0, 0], [1, 1], [0.1, 0.2], [0.9, 0.3], code, resolution=resolution, **options)
    corners = np.array([[0.1, 0.2], [0.3, 0.8], [0.7, 0.8], [0.9, 0.3]])
    corners[1:3] += np.array([[-1, 1], [1, 1]]) * resolution / 2.0
    return problem, float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())


def ball_problem(toy, n: int, resolution: float = 0.01) -> tuple[Problem, float]:  # type: ignore[no-untyped-def]
    """A ball in the way: the shortest path is two tangents and an arc of a great circle."""
    radius, far = 0.3, 0.4
    world = toy.world(centers=np.full((1, n), 0.5), radii=np.array([radius]))
    start, goal = np.full((2, n), 0.5)
    start[0], goal[0] = 0.5 - far, 0.5 + far
    problem = Problem(
        np.zeros(n), np.ones(n), start, goal, toy.code(world, resolution / 2.0), resolution=resolution
    )
    grown = radius + resolution / 2.0
    arc = grown * (np.pi - 2.0 * np.arccos(grown / far))
    return problem, float(2.0 * np.sqrt(far**2 - grown**2) + arc)


@pytest.mark.thorough
def test_shortest_path_around_a_box_is_found(toy) -> None:  # type: ignore[no-untyped-def]
    problem, shortest = box_problem(toy)
    for seed in range(3):
        result = aorrtc(problem, seed=seed, max_iterations=6000, timeout=60.0)
        assert result.success
        without_margin = np.hypot(0.2, 0.6) + 0.4 + np.hypot(0.2, 0.5)
        assert without_margin < result.cost < shortest * (1 + 2e-3)
        assert np.all(toy.world([[0.3, -1.0]], [[0.7, 0.8]]).free(result.path.resample(1e-4).points))


def test_gap_to_the_shortest_path_closes_with_iterations(toy) -> None:  # type: ignore[no-untyped-def]
    """The median over seeds falls with each fourfold number of samples, and by far overall."""
    problem, shortest = ball_problem(toy, 2, 0.002)
    gaps = []
    for iterations in (1, 100, 1600, 16000):
        costs = [aorrtc(problem, seed=s, max_iterations=iterations, timeout=60.0).cost for s in range(7)]
        gaps.append(np.median(costs) / shortest - 1.0)
    assert np.all(np.diff(gaps) < 0.0)
    assert gaps[-1] < 0.001
    assert gaps[-1] < 0.25 * gaps[0]


@pytest.mark.parametrize(("n", "gap"), [(2, 0.001), (3, 0.005), (5, 0.012), (9, 0.02)])
def test_shortest_path_around_a_ball(n: int, gap: float, toy) -> None:  # type: ignore[no-untyped-def]
    problem, shortest = ball_problem(toy, n)
    results = [aorrtc(problem, seed=s, max_iterations=4000, timeout=60.0) for s in range(7)]
    costs = [result.cost for result in results]
    assert min(costs) > shortest * (1 - 2e-3)
    assert np.median(costs) < shortest * (1 + gap)
    for result in results:
        assert np.linalg.norm(result.path.resample(1e-3).points - 0.5, axis=1).min() > 0.3


@pytest.mark.parametrize("inside", [np.inf, 1.1])
def test_searches_stay_where_paths_can_be_short(inside: float, toy) -> None:  # type: ignore[no-untyped-def]
    """The states of a path lie in the ellipsoid of a length; without one they lie outside, too."""
    problem, shortest = ball_problem(toy, 3)
    assert shortest < 1.1
    deadline, trees, found, farthest = Deadline(60.0), take_trees(problem.n), 0, 0.0
    with machine_code_of(problem, deadline, counters=trees.counters) as code:
        search = Search(problem, code, trees, 1, None)
        assert search.begin(deadline)
        for _ in range(20):
            if search.below(np.inf, 2000, deadline, inside):
                points, found = search.path()[0].points, found + 1
                ends = problem.start, problem.goals[0]
                length = sum(np.linalg.norm(points - end, axis=1) for end in ends).max()
                farthest = max(farthest, length)
    assert found > 5
    assert farthest <= inside * (1 + 1e-12)
    assert (farthest > 1.1) == (inside == np.inf)


def test_other_way_around_is_found(toy) -> None:  # type: ignore[no-untyped-def]
    """The path given goes the long way; shortcuts cannot leave it, the improvement can."""
    world = toy.world([[0.2, 0.15]], [[0.8, 0.9]])
    problem = Problem([0, 0], [1, 1], [0.1, 0.5], [0.9, 0.5], toy.code(world, 0.002), resolution=0.004)
    over = Path([[0.1, 0.5], [0.1, 0.95], [0.9, 0.95], [0.9, 0.5]])
    upper = 2 * np.hypot(0.1, 0.4) + 0.6
    lower = 2 * np.hypot(0.1, 0.35) + 0.6
    short = shortcut(problem, over, iterations=400, timeout=60.0)
    assert short.length > 0.995 * upper
    result = aorrtc(problem, short, max_iterations=6000, timeout=60.0)
    assert result.cost < 1.01 * lower
    assert world.path_free(result.path.points)


def test_narrow_way_near_the_straight_line_is_found(toy) -> None:  # type: ignore[no-untyped-def]
    """Four boxes leave a hole beside the straight line; past their side is a far longer way, easy to find."""
    n, hole = 4, 0.02
    low, high = np.full((4, n), -1.0), np.full((4, n), 2.0)
    low[:, 0], high[:, 0] = 0.4, 0.6
    high[0, 1] = 0.5
    low[1, 1], high[1, 1] = 0.5 + hole, 0.85
    low[2:, 1], high[2:, 1] = 0.5, 0.5 + hole
    high[2, 2], low[3, 2] = 0.5, 0.5 + hole
    world, ends = toy.world(low, high), np.full((2, n), 0.5)
    ends[:, 0] = 0.2, 0.8
    problem = Problem(np.zeros(n), np.ones(n), *ends, toy.code(world, 0.005), resolution=0.01)
    past_the_side = 2.0 * np.hypot(0.2, 0.35) + 0.2
    through_its_middle = 2.0 * np.hypot(0.2, np.hypot(hole, hole) / 2.0) + 0.2
    for seed in range(3):
        result = aorrtc(problem, seed=seed, max_iterations=30_000, timeout=60.0)
        assert result.cost < through_its_middle < 0.7 * past_the_side
        assert world.path_free(result.path.points)


def test_never_longer_and_history_tells_how(toy) -> None:  # type: ignore[no-untyped-def]
    problem, _ = box_problem(toy)
    first = rrt_connect(problem, seed=1)
    costs = [first.cost]
    for iterations in (0, 10, 100, 1000):
        result = aorrtc(problem, first.path, seed=2, max_iterations=iterations, timeout=60.0)
        costs.append(result.cost)
        assert result.iterations == iterations
        assert result.history[0].cost == pytest.approx(first.cost)
        assert result.history[-1].cost == pytest.approx(result.cost)
        for entries in (
            np.diff([h.time for h in result.history]),
            -np.diff([h.cost for h in result.history]),
        ):
            assert np.all(entries >= 0.0)
        assert np.array_equal(result.path.points[[0, -1]], first.path.points[[0, -1]])
    assert np.all(np.diff(costs) <= 1e-12)
    assert costs[-1] < 0.95 * costs[0]


@pytest.mark.thorough
def test_same_seed_same_path(toy) -> None:  # type: ignore[no-untyped-def]
    problem, _ = box_problem(toy)
    first, again, other = (aorrtc(problem, seed=s, max_iterations=1500, timeout=60.0) for s in (3, 3, 4))
    assert np.array_equal(first.path.points, again.path.points)
    assert [h.iteration for h in first.history] == [h.iteration for h in again.history]
    assert not np.array_equal(first.path.points, other.path.points)


def test_callable_gives_the_same_as_toy(toy) -> None:  # type: ignore[no-untyped-def]
    problem, _ = box_problem(toy)
    code = problem.validity
    called = Problem([0, 0], [1, 1], [0.1, 0.2], [0.9, 0.3], lambda x: code(x), resolution=0.004)
    path = rrt_connect(problem).path
    results = [aorrtc(p, path, max_iterations=300, timeout=60.0) for p in (problem, called)]
    assert np.array_equal(results[0].path.points, results[1].path.points)
    assert results[0].states_checked <= results[1].states_checked  # in batches


def test_callable_that_fails_is_heard() -> None:
    def broken(states: np.ndarray) -> np.ndarray:
        if len(states) > 30:
            raise ZeroDivisionError("in the oracle")
        return np.ones(len(states), dtype=bool)

    problem = Problem([0, 0], [1, 1], [0, 0], [1, 1], broken)
    with pytest.raises(ZeroDivisionError, match="in the oracle"):
        aorrtc(problem, Path([[0, 0], [1, 0], [1, 1]]), timeout=60.0)


def test_nearest_of_several_goals_wins_in_the_end(toy) -> None:  # type: ignore[no-untyped-def]
    """The first path ends at a goal far away; the shortest leads to another one, around the wall."""
    problem, _ = box_problem(toy)
    goals = [[0.05, 0.95], [0.72, 0.75], [0.75, 0.0]]
    several = Problem([0, 0], [1, 1], [0.1, 0.2], goals, problem.validity, resolution=0.004)
    start = Path([[0.1, 0.2], [0.2, 0.9], [0.75, 0.9], [0.75, 0.0]])
    result = aorrtc(several, start, max_iterations=3000, timeout=60.0)
    assert result.goal_index == 0
    assert result.cost == pytest.approx(np.hypot(0.05, 0.75), rel=1e-6)


def test_it_stops_at_the_gap_and_at_the_straight_line(toy) -> None:  # type: ignore[no-untyped-def]
    problem, shortest = box_problem(toy)
    straight = float(np.hypot(0.8, 0.1))
    wanted = 1.03 * shortest / straight - 1.0
    result = aorrtc(problem, gap=wanted, timeout=60.0)
    assert result.stop_reason is StopReason.GAP_REACHED
    assert result.lower_bound == pytest.approx(straight)
    assert result.gap == pytest.approx(result.cost / straight - 1.0)
    assert shortest * (1 - 1e-3) < result.cost <= 1.03 * shortest * (1 + 1e-9)
    assert result.time < 30.0
    sight = Problem([0, 0], [1, 1], [0.1, 0.2], [0.2, 0.9], problem.validity, resolution=0.004)
    result = aorrtc(sight, timeout=60.0)
    assert result.stop_reason is StopReason.GAP_REACHED
    assert result.cost == pytest.approx(np.hypot(0.1, 0.7))
    assert result.time < 30.0
    assert aorrtc(problem, max_iterations=3000, timeout=60.0).stop_reason is StopReason.ITERATIONS_USED
    assert aorrtc(problem, timeout=0.05).stop_reason is StopReason.TIME_UP
    assert rrt_connect(problem).stop_reason is None


def test_time_budget_is_used_and_kept(toy) -> None:  # type: ignore[no-untyped-def]
    problem, _ = box_problem(toy)
    aorrtc(problem, max_iterations=1)
    for timeout in (0.05, 0.3):
        begun, spent = time.perf_counter(), time.thread_time()
        result = aorrtc(problem, timeout=timeout)
        passed, spent = time.perf_counter() - begun, time.thread_time() - spent
        assert result.success
        assert timeout <= result.time <= passed
        assert (
            spent < 2.0 * timeout + 1.0
        )  # of this process; by the clock others may keep it waiting for longer


def test_without_a_path_the_status_tells_why(closed_wall, toy) -> None:  # type: ignore[no-untyped-def]
    code = toy.code(closed_wall, 0.007)
    for start, goal, status in (
        ([0.1, 0.1], [0.9, 0.1], Status.OUT_OF_ITERATIONS),
        ([0.5, 0.1], [0.9, 0.1], Status.START_INVALID),
        ([0.1, 0.1], [0.5, 0.1], Status.GOAL_INVALID),
    ):
        result = aorrtc(Problem([0, 0], [1, 1], start, goal, code), max_iterations=200, timeout=60.0)
        assert result.status is status
        assert result.path is None
        assert result.history == ()


def test_weighted_ellipsoid_is_filled_evenly() -> None:
    """All samples are inside; the share within the concentric half-size ellipsoid is 2^-n."""
    n, count, weights = 3, 8000, np.array([1.0, 2.0, 0.5])
    start, goal, length = np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.6, 0.9]), 1.3
    key, sample, axis = stream_key(0, 9), np.empty(n), np.empty(n)
    samples = np.empty((count, n))
    for k in range(count):
        inside = within_ellipsoid(
            box(np.full(n, -9.0), np.full(n, 18.0), weights), key, k * 10, start, goal, length, axis, sample
        )
        assert inside
        samples[k] = sample
    by_way = sum(np.linalg.norm((samples - focus) * weights, axis=1) for focus in (start, goal))
    assert by_way.max() <= length * (1 + 1e-12)
    apart = np.linalg.norm((goal - start) * weights)
    along = (goal - start) * weights / apart
    shifted = (samples - 0.5 * (start + goal)) * weights
    onto = shifted @ along
    across = np.linalg.norm(shifted - onto[:, None] * along, axis=1)
    size = np.hypot(onto / (0.5 * length), across / (0.5 * np.sqrt(length**2 - apart**2)))
    share = np.mean(size < 0.5)
    assert share == pytest.approx(2.0**-n, abs=4 * np.sqrt(0.125 * 0.875 / count))
    assert np.all(np.abs(shifted.mean(axis=0)) < 4 * shifted.std(axis=0) / np.sqrt(count))
    assert not within_ellipsoid(
        box(np.full(n, 5.0), np.ones(n), weights), key, 0, start, goal, length, axis, sample
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (dict(gap=np.nan), "gap: got nan, expected a finite number of 0 or more, or None"),
        (dict(gap=-1.0), "gap: got -1.0"),
        (dict(timeout=0.0), "timeout: got 0.0, expected a number of seconds above 0"),
        (dict(seed=-1), "seed: got -1, expected an integer >= 0"),
        (dict(max_iterations=0.5), "max_iterations: got 0.5, expected an integer >= 0"),
        (dict(step=0.0), "step: got 0.0, expected a finite number above 0"),
    ],
)
def test_misuse_is_named(options: dict, message: str, toy) -> None:  # type: ignore[no-untyped-def]
    problem, _ = box_problem(toy)
    path = rrt_connect(problem).path
    for first in (path, None):
        with pytest.raises(InvalidValueError, match=re.escape(message)):
            aorrtc(problem, first, **options)
    with pytest.raises(InvalidValueError, match="path: got 3 coordinates, expected 2 coordinates"):
        aorrtc(problem, Path([[0, 0, 0]]))


def test_long_runs_go_on_where_python_has_listened(toy, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """Machine code returns now and then, for interrupts from the keyboard; that changes nothing."""
    problem, _ = box_problem(toy)
    whole = aorrtc(problem, seed=3, max_iterations=1500, timeout=60.0)
    slices = []
    monkeypatch.setattr("pepper_kin.planners.deadline.TIME_SLICE", 2e-4)
    time_slice = Deadline.time_slice.fget
    monkeypatch.setattr(Deadline, "time_slice", property(lambda self: slices.append(1) or time_slice(self)))
    parts = aorrtc(problem, seed=3, max_iterations=1500, timeout=60.0)
    assert len(slices) > 10
    assert np.array_equal(whole.path.points, parts.path.points)
    assert [h.iteration for h in whole.history] == [h.iteration for h in parts.history]


def test_failing_callable_ends_a_growing_roadmap() -> None:
    def broken(states: np.ndarray) -> np.ndarray:
        raise ZeroDivisionError("in the oracle")

    with pytest.raises(ZeroDivisionError, match="in the oracle"):
        Roadmap(Problem([0, 0], [1, 1], [0, 0], [1, 1], broken)).grow(10, timeout=60.0)
