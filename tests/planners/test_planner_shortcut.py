import itertools
from dataclasses import replace

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import MotionValidator, Path, Problem, rrt_connect, shortcut
from pepper_kin.planners.deadline import Deadline
from pepper_kin.planners.motion_validator import machine_code_of
from pepper_kin.planners.search_space import space_of
from pepper_kin.planners.shortcut import SIZE, new_polyline, skip_ahead, straighten_each

ENDS = ([0.1, 0.1], [0.9, 0.15])


def planned(world, seed: int, margin: float = 0.007) -> tuple[Problem, Path]:  # type: ignore[no-untyped-def]
    start, goal = ENDS
    problem = Problem(np.zeros(2), np.ones(2), start, goal, world.padded(margin), resolution=0.014)
    result = rrt_connect(problem, seed=seed, timeout=60.0)
    assert result.success
    return problem, result.path


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["wall", "maze", "discs"])
def test_never_longer_always_valid_same_ends(name: str, request: pytest.FixtureRequest) -> None:
    world = request.getfixturevalue(name)
    for seed in range(4):
        problem, path = planned(world, seed)
        lengths = [path.length]
        for iterations in (1, 10, 100):
            short = shortcut(problem, path, seed=seed, iterations=iterations, timeout=60.0)
            assert world.path_free(short.points)
            assert np.array_equal(short.points[[0, -1]], path.points[[0, -1]])
            lengths.append(short.length)
        # The choices of a shorter run are a prefix of a longer one's.
        assert np.all(np.diff(lengths) <= 1e-12)
        assert lengths[-1] < lengths[0]


def test_wall_path_comes_near_the_shortest(wall) -> None:  # type: ignore[no-untyped-def]
    """The shortest path bends at two corners of the grown wall's gap: its length is known."""
    problem, path = planned(wall, 0)
    corners = np.array([ENDS[0], [0.473, 0.457], [0.527, 0.457], ENDS[1]])
    shortest = np.linalg.norm(np.diff(corners, axis=0), axis=1).sum()
    short = shortcut(problem, path, iterations=600, timeout=60.0)
    assert 0.99 * shortest < short.length < 1.02 * shortest


def test_same_seed_same_path(maze) -> None:  # type: ignore[no-untyped-def]
    problem, path = planned(maze, 1)
    first, again, other = (shortcut(problem, path, seed=s, timeout=60.0) for s in (3, 3, 4))
    assert np.array_equal(first.points, again.points)
    assert not np.array_equal(first.points, other.points)


def test_one_coordinate_is_straightened_where_the_whole_edge_is_blocked() -> None:
    """x must pass a hump that fills the straight edge; the detour of y may go, coordinate by coordinate."""

    def free(q: np.ndarray) -> np.ndarray:
        return q[:, 0] > np.sin(np.pi * np.clip(q[:, 2], 0, 1)) * 0.8 - 0.05

    z = np.linspace(0, 1, 9)
    points = np.column_stack((0.9 * np.sin(np.pi * z), 0.5 * (-1.0) ** np.arange(9), z))
    problem = Problem([-1, -1, 0], [1, 1, 1], points[0], points[-1], free, resolution=0.01)
    short = shortcut(problem, Path(points), iterations=400, timeout=60.0)
    assert np.abs(short.points[:, 1] - 0.5).max() < 0.05
    assert short.points[:, 0].max() > 0.7
    assert np.all(free(short.resample(0.001).points))


def test_weights_decide_what_is_short(discs) -> None:  # type: ignore[no-untyped-def]
    start, goal = ENDS
    weights = np.array([5.0, 1.0])
    problem = Problem(
        np.zeros(2), np.ones(2), start, goal, discs.padded(0.01), weights=weights, resolution=0.02
    )
    path = rrt_connect(problem, seed=0, timeout=60.0).path
    assert path is not None
    short = shortcut(problem, path, timeout=60.0)
    assert short.length <= path.length
    assert np.array_equal(short.weights, weights)


def test_short_cut_through_an_obstacle_would_be_caught(wall, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    problem, path = planned(wall, 0)
    monkeypatch.setattr(MotionValidator, "last_valid_step", lambda self, a, b, steps: steps)
    assert not wall.path_free(shortcut(problem, path, timeout=60.0).points)


def test_straight_way_points_are_dropped(wall) -> None:  # type: ignore[no-untyped-def]
    problem, _ = planned(wall, 0)
    dense = Path([[0.0, 0.0], [0.2, 0.1], [0.2, 0.4]]).resample(0.01)
    assert np.allclose(shortcut(problem, dense, iterations=0).points, [[0.0, 0.0], [0.2, 0.1], [0.2, 0.4]])


@pytest.mark.parametrize("points", [[[0.1, 0.1]], [[0.1, 0.1], [0.1, 0.1]], [[0.1, 0.1], [0.2, 0.1]]])
def test_nothing_to_shorten(wall, points: list) -> None:  # type: ignore[no-untyped-def]
    problem, _ = planned(wall, 0)
    assert np.array_equal(shortcut(problem, Path(points)).points, points)


def test_misuse_is_named(wall) -> None:  # type: ignore[no-untyped-def]
    problem, path = planned(wall, 0)
    with pytest.raises(InvalidValueError, match="path: got 3 coordinates, expected 2 coordinates"):
        shortcut(problem, Path([[0, 0, 0]]))
    with pytest.raises(InvalidValueError, match="iterations: got -1"):
        shortcut(problem, path, iterations=-1)
    with pytest.raises(InvalidValueError, match="resolution: got 0, expected a finite number above 0"):
        shortcut(problem, path, resolution=0)


def test_finest_resolution_of_a_problem_can_be_shortened() -> None:
    problem = Problem([0, 0], [1, 1], [0, 0], [1, 0], lambda x: x[:, 0] >= 0, resolution=1.5e-6)
    assert shortcut(problem, Path([[0, 0], [1e-3, 1e-3], [2e-3, 0]]), timeout=60.0).length == pytest.approx(
        2e-3
    )


def test_short_cuts_that_save_little_are_not_made(maze) -> None:  # type: ignore[no-untyped-def]
    problem, path = planned(maze, 2)
    untouched = shortcut(problem, path, iterations=200, timeout=60.0, least_gain=0.999)
    assert untouched.length == pytest.approx(path.length, rel=1e-12)
    some = shortcut(problem, path, iterations=200, timeout=60.0, least_gain=0.02)
    assert some.length < path.length
    assert maze.path_free(some.points)


def test_a_gain_that_is_no_share_is_refused(maze) -> None:
    for gain in [-0.1, 1.0, float("nan")]:
        problem, path = planned(maze, 2)
        with pytest.raises(
            InvalidValueError, match=r"least_gain: got .*, expected a number from 0 to below 1"
        ):
            shortcut(problem, path, least_gain=gain)


@pytest.mark.parametrize("n", [3, 6])
def test_a_callable_leads_to_the_same_path_as_machine_code(n: int, balls, machine_code) -> None:  # type: ignore[no-untyped-def]
    code = machine_code(balls(n))
    ends = np.full(n, 0.1), np.full(n, 0.9)
    compiled, plain = (Problem(np.zeros(n), np.ones(n), *ends, f) for f in (code, lambda x: code(x)))
    for seed in range(4):
        path = rrt_connect(compiled, seed=seed, timeout=60.0).path
        first, second = (
            shortcut(p, path, seed=seed, iterations=100, timeout=60.0, detours=bool(seed % 2))
            for p in (compiled, plain)
        )
        assert first.length < path.length
        assert np.array_equal(first.points, second.points)


@pytest.mark.thorough
def test_detours_bring_a_path_to_the_shortest_around_a_ball() -> None:
    """Two tangents and an arc: 2 sqrt(d^2 - r^2) + r (pi - 2 acos(r / d)), in any number of dimensions."""
    weights, radius, away = np.array([1.0, 0.25, 4.0, 2.0]), 0.5, 0.8
    start, goal = np.array([-away, 0.0, 0.0, 0.0]), np.array([away, 0.0, 0.0, 0.0])

    def validity(states: np.ndarray) -> np.ndarray:
        return np.linalg.norm(states * weights, axis=1) > radius

    box = 2.0 / weights
    problem = Problem(-box, box, start / weights, goal / weights, validity, weights, resolution=0.02)
    shortest = 2.0 * np.sqrt(away**2 - radius**2) + radius * (np.pi - 2.0 * np.arccos(radius / away))
    for seed in range(2):
        path = rrt_connect(problem, seed=seed, timeout=60.0).path
        short = shortcut(problem, path, seed=seed, iterations=6000, timeout=60.0, detours=True)
        assert shortest * 0.999 < short.length < shortest * 1.01
        plain = shortcut(problem, path, seed=seed, iterations=6000, timeout=60.0)
        assert short.length < plain.length
        assert validity(short.resample(0.002).points).mean() > 0.99


def test_detours_never_leave_the_box() -> None:
    """A path wiggles in a face of the box, over a hump: contracting it along a direction leads outside."""

    def free(q: np.ndarray) -> np.ndarray:
        return q[:, 1] > 0.4 * np.sin(np.pi * np.clip(q[:, 2], 0, 1)) - 0.05

    z = np.linspace(0, 1, 15)
    wiggles = 0.1 * (np.arange(15) % 2) * (z > 0) * (z < 1)
    points = np.column_stack((np.full(15, -0.7), 0.4 * np.sin(np.pi * z) + wiggles, z))
    problem = Problem([-0.7, -0.2, -0.1], [0.4, 0.9, 1.3], points[0], points[-1], free, resolution=0.02)
    path = Path(points, problem.metric.weights)
    for seed in range(10):
        short = shortcut(problem, path, seed=seed, iterations=20, timeout=60.0, detours=True)
        assert short.length < path.length
        assert np.all((short.points >= problem.lower) & (short.points <= problem.upper))


@pytest.mark.parametrize("name", ["wall", "maze", "discs"])
def test_skipping_ahead_goes_straight_as_far_as_it_can(name: str, request: pytest.FixtureRequest) -> None:
    """What is kept, and what was skipped, is looked at by the exact test of whole segments.

    A new edge is free of the obstacles; of the waypoints that it could have gone to and that were asked for
    before, none can be reached straight even past obstacles grown by the margin.
    """
    world, margin = request.getfixturevalue(name), 0.007
    grown = replace(
        world,
        box_lower=world.box_lower - margin,
        box_upper=world.box_upper + margin,
        radii=world.radii + margin,
    )
    skipped = 0
    for seed in range(6):
        problem, path = planned(world, seed, margin)
        points = path.resample(0.04).points
        line = new_polyline(np.concatenate([points, np.full((5, 2), np.nan)]))
        line.counters[SIZE] = len(points)
        with machine_code_of(problem, Deadline()) as code:
            skip_ahead(space_of(problem, code, problem.spacing), line)
        kept = line.points[: line.counters[SIZE]]
        places = [int(np.flatnonzero((points == point).all(axis=1))[0]) for point in kept]
        assert places[0] == 0
        assert places[-1] == len(points) - 1
        assert world.path_free(kept)
        for here, there in itertools.pairwise(places):
            asked = len(points) - 1
            while asked > there:
                assert not grown.edge_free(points[here], points[asked])
                asked = here + (asked - here + 1) // 2
            assert asked == there
            skipped += there - here - 1
    assert skipped > 20


def test_skipping_ahead_leaves_the_ends_where_nothing_is_in_the_way() -> None:
    points = np.random.default_rng(0).uniform(0.1, 0.9, (17, 3))
    problem = Problem(np.zeros(3), np.ones(3), points[0], points[-1], lambda q: np.ones(len(q), bool))
    line = new_polyline(points.copy())
    line.counters[SIZE] = len(points)
    with machine_code_of(problem, Deadline()) as code:
        skip_ahead(space_of(problem, code, problem.spacing), line)
    assert np.array_equal(line.points[: line.counters[SIZE]], points[[0, -1]])


def test_coordinates_that_need_no_detour_run_straight() -> None:
    """A wall at x = 0.5 is passed above y = 0.8 only; z, which goes to and fro, has no reason to."""

    def valid(q: np.ndarray) -> np.ndarray:
        return (np.abs(q[:, 0] - 0.5) > 0.05) | (q[:, 1] > 0.8)

    x, y, z = [0.1, 0.4, 0.6, 0.9], [0.1, 0.9, 0.9, 0.1], [0.2, 0.9, 0.1, 0.6]
    points = np.array([x, y, z]).T
    problem = Problem(np.zeros(3), np.ones(3), points[0], points[-1], valid, resolution=0.01)
    line = new_polyline(np.concatenate([points, np.full((3, 3), np.nan)]))
    line.counters[SIZE] = len(points)
    with machine_code_of(problem, Deadline()) as code:
        straighten_each(space_of(problem, code, problem.spacing), line, 0.005)
    found = line.points[: line.counters[SIZE]]
    assert np.array_equal(found[[0, -1]], points[[0, -1]])
    assert found[:, 1].max() == 0.9  # the straight way is blocked
    np.testing.assert_array_equal(np.sort(found[:, 2]), found[:, 2])
    assert Path(found).length < Path(points).length - 0.5
    assert valid(Path(found).resample(0.005).points).all()
