"""Constraints of closed form: circle, sphere and torus."""

import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.planners import (
    CompiledManifold,
    CompiledMotionValidator,
    ConstraintManifold,
    Problem,
    Status,
    cbirrt,
    constrained_shortcut,
    constrained_smooth,
    deadline,
    project,
)

TOLERANCE = 1e-3


def sphere(x):
    return (x**2).sum(axis=1, keepdims=True) - 1.0, 2.0 * x[:, None, :]


def torus(x, major=1.0, minor=0.4):
    ring = np.linalg.norm(x[:, :2], axis=1)
    value = (ring - major) ** 2 + x[:, 2] ** 2 - minor**2
    slope = np.empty((len(x), 1, 3))
    slope[:, 0, :2] = (2.0 * (ring - major) / ring)[:, None] * x[:, :2]
    slope[:, 0, 2] = 2.0 * x[:, 2]
    return value[:, None], slope


def everywhere(states):
    return np.ones(len(states), dtype=bool)


def wall_with_a_hole(states):
    """A belt around the equator of a sphere with a passage at longitude 0."""
    longitude = np.arctan2(states[:, 1], states[:, 0])
    return (np.abs(states[:, 2]) > 0.1) | (np.abs(longitude) < 0.3)


def dense(path, spacing=1e-3):
    return path.resample(spacing).points


@pytest.fixture
def through_the_hole():
    ends = [0.0, -0.6, 0.8], [0.0, -0.6, -0.8]
    problem = Problem([-1.2] * 3, [1.2] * 3, *ends, wall_with_a_hole, resolution=0.02)
    return problem, ConstraintManifold(sphere, 3, 1, TOLERANCE)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(4))
def test_every_point_of_a_path_through_a_hole_is_on_the_sphere_and_valid(through_the_hole, seed):
    problem, manifold = through_the_hole
    found = cbirrt(problem, manifold, seed=seed, timeout=60.0)
    assert found.success
    assert found.residual <= 1.0
    paths = [found.path, constrained_shortcut(problem, manifold, found.path, seed=seed, timeout=30.0)]
    paths.append(constrained_smooth(problem, manifold, paths[1], timeout=30.0))
    for path in paths:
        np.testing.assert_array_equal(path.points[0], problem.start)
        np.testing.assert_array_equal(path.points[-1], problem.goals[0])
        assert np.abs((dense(path) ** 2).sum(axis=1) - 1.0).max() <= TOLERANCE  # between waypoints too
        assert wall_with_a_hole(path.points).all()
        assert np.diff(path.arc_lengths).max() <= problem.spacing * (1 + 1e-12)
    assert paths[1].length <= found.path.length


@pytest.mark.thorough
def test_the_shortened_path_is_near_the_geodesic_through_the_hole(through_the_hole):
    problem, manifold = through_the_hole
    found = cbirrt(problem, manifold, timeout=60.0)
    short = constrained_shortcut(problem, manifold, found.path, iterations=300, timeout=10.0)
    corners = [[np.sqrt(0.99) * np.cos(0.3), -np.sqrt(0.99) * np.sin(0.3), height] for height in (0.1, -0.1)]
    stops = [problem.start, *map(np.array, corners), problem.goals[0]]
    geodesic = sum(np.arccos(a @ b) for a, b in pairwise(stops))
    # Half the tolerance of |x|^2 may be lost on the inside, and chords are shorter than arcs.
    assert geodesic * (1 - TOLERANCE) <= short.length <= 1.02 * geodesic


def test_a_straight_walk_on_a_sphere_is_a_great_circle():
    problem = Problem([-1.2] * 3, [1.2] * 3, [1, 0, 0], [0, 0.6, 0.8], everywhere, resolution=0.02)
    found = cbirrt(problem, ConstraintManifold(sphere, 3, 1, TOLERANCE), timeout=60.0)
    assert found.iterations == 0
    assert found.cost == pytest.approx(np.pi / 2, rel=1e-3)


def test_a_circle_is_gone_round_the_long_way_where_the_short_one_is_blocked():
    def circle(x):
        return (x**2).sum(axis=1, keepdims=True) - 1.0, 2.0 * x[:, None, :]

    def valid(states):
        return states[:, 0] < 0.8

    ends = [0.6, 0.8], [0.6, -0.8]
    problem = Problem([-1.5] * 2, [1.5] * 2, *ends, valid, resolution=0.02)
    found = cbirrt(problem, ConstraintManifold(circle, 2, 1, 1e-4), timeout=60.0)
    assert found.success
    assert found.cost == pytest.approx(2 * np.pi - 2 * np.arctan2(0.8, 0.6), rel=1e-3)


def test_a_torus_is_gone_round_through_its_outside():
    def valid(states):
        return np.linalg.norm(states[:, :2], axis=1) > 0.9  # the inner half is closed

    ends = [1.4, 0.0, 0.0], [-1.4, 0.0, 0.0]
    problem = Problem([-1.5] * 3, [1.5] * 3, *ends, valid, resolution=0.03)
    manifold = ConstraintManifold(torus, 3, 1, TOLERANCE)
    found = cbirrt(problem, manifold, seed=3, timeout=60.0)
    assert found.success
    short = constrained_shortcut(problem, manifold, found.path, seed=3, timeout=30.0)
    assert np.abs(torus(dense(short))[0]).max() <= TOLERANCE
    # Every way round is at least as long as half the circle that closes the inside, and none need be longer
    # than half the outer one.
    assert 0.9 * np.pi - 0.03 <= short.length <= 1.4 * np.pi


def test_a_wide_tolerance_is_entered_and_no_more():
    band = ConstraintManifold(lambda x: (x[:, 1:], np.tile([[[0.0, 1.0]]], (len(x), 1, 1))), 2, 1, 0.4)
    problem = Problem([-1, -1], [1, 1], [-0.5, 0.0], [0.5, 0.0], everywhere)
    moved, done = project(problem, band, [[0.3, 0.1], [0.2, 0.9], [0.1, -0.7]])
    assert done.all()
    np.testing.assert_array_equal(moved[0], [0.3, 0.1])
    np.testing.assert_allclose(moved[:, 0], [0.3, 0.2, 0.1], atol=1e-12)
    assert 0.1 < moved[1, 1] <= 0.2
    assert -0.2 <= moved[2, 1] < -0.1


def test_the_projection_is_the_nearest_point_in_the_metric():
    plane = ConstraintManifold(
        lambda x: (x.sum(axis=1, keepdims=True) - 1.0, np.ones((len(x), 1, 2))), 2, 1, 1e-9
    )
    problem = Problem([-5, -5], [5, 5], [0, 1], [1, 0], everywhere, weights=[1.0, 2.0])
    moved, done = project(problem, plane, [[0.0, 0.0]])
    # min dx^2 + 4 dy^2 with dx + dy = 1: dx = 4 / 5.
    assert done.all()
    np.testing.assert_allclose(moved[0], [0.8, 0.2], atol=1e-8)


def test_the_projection_stays_in_the_box_by_moving_along_its_side():
    plane = ConstraintManifold(
        lambda x: (x.sum(axis=1, keepdims=True) - 1.0, np.ones((len(x), 1, 2))), 2, 1, 1e-9
    )
    problem = Problem([-5, -5], [0.1, 5], [0, 1], [-1, 2], everywhere)
    moved, done = project(problem, plane, [[0.0, 0.0]])
    assert done.all()
    np.testing.assert_allclose(moved[0], [0.1, 0.9], atol=1e-8)
    unreachable = Problem([-5, -5], [0.1, 0.1], [0, 0.1], [0.1, 0], everywhere)
    assert not project(unreachable, plane, [[0.0, 0.0]])[1].any()


@given(st.lists(st.floats(-1.2, 1.2), min_size=3, max_size=3))
@settings(max_examples=50, deadline=None)
def test_projection_onto_a_sphere_goes_along_the_radius(point):
    state = np.array(point)
    radius = np.linalg.norm(state)
    if radius < 0.2:
        return
    problem = Problem([-3] * 3, [3] * 3, [1, 0, 0], [0, 1, 0], everywhere)
    moved, done = project(problem, ConstraintManifold(sphere, 3, 1, 1e-9), state[None])
    assert done.all()
    np.testing.assert_allclose(moved[0], state / radius, atol=1e-8)


def test_two_constraints_at_once_and_a_redundant_one():
    def two(x):
        value, slope = sphere(x)
        level = x[:, 2:] - 0.6
        up = np.tile([[[0.0, 0.0, 1.0]]], (len(x), 1, 1))
        return np.hstack((value, level, 2 * level)), np.concatenate((slope, up, 2 * up), axis=1)

    manifold = ConstraintManifold(
        two, 3, 3, [1e-3, 1e-2, 1e-2], groups=[0, 1, 2], names=("ball", "level", "again")
    )
    ends = [0.8, 0.0, 0.6], [-0.8, 0.0, 0.6]
    problem = Problem([-1.2] * 3, [1.2] * 3, *ends, everywhere, resolution=0.02)
    found = cbirrt(problem, manifold, timeout=60.0)
    assert found.success
    assert (manifold.errors(dense(found.path)) <= [1e-3, 1e-2, 1e-2]).all()
    short = constrained_shortcut(problem, manifold, found.path, timeout=30.0)
    assert short.length == pytest.approx(0.8 * np.pi, rel=0.02)  # half a circle of latitude


def test_an_end_off_the_manifold_is_named_with_its_error():
    for start, goal, status, residual in [
        ([1.0, 0.0, 0.1], [0, 1, 0], Status.START_OFF_MANIFOLD, 0.01 / TOLERANCE),
        ([1, 0, 0], [0.0, 1.0, -0.2], Status.GOAL_OFF_MANIFOLD, 0.04 / TOLERANCE),
    ]:
        problem = Problem([-1.2] * 3, [1.2] * 3, start, goal, everywhere)
        found = cbirrt(problem, ConstraintManifold(sphere, 3, 1, TOLERANCE), timeout=60.0)
        assert found.status is status
        assert found.residual == pytest.approx(residual)
        assert "constraints" in found.status.advice


def test_ends_that_are_invalid_and_goals_of_which_one_will_do():
    manifold = ConstraintManifold(sphere, 3, 1, TOLERANCE)
    below = lambda states: states[:, 2] < 0.9  # noqa: E731
    box = [-1.2] * 3, [1.2] * 3
    assert cbirrt(Problem(*box, [0, 0, 1], [1, 0, 0], below), manifold).status is (Status.START_INVALID)
    assert cbirrt(Problem(*box, [1, 0, 0], [0, 0, 1], below), manifold).status is (Status.GOAL_INVALID)
    several = Problem(*box, [1, 0, 0], [[0, 0, 1], [0.5, 0, 0], [0, 1, 0]], below)
    assert cbirrt(several, manifold, timeout=60.0).goal_index == 2


def test_the_same_seed_gives_the_same_path(through_the_hole):
    problem, manifold = through_the_hole
    runs = [cbirrt(problem, manifold, seed=7, timeout=60.0) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].path.points, runs[1].path.points)
    short = [constrained_shortcut(problem, manifold, runs[0].path, seed=5, timeout=30) for _ in range(2)]
    np.testing.assert_array_equal(short[0].points, short[1].points)
    other = cbirrt(problem, manifold, seed=8, timeout=60.0)
    assert not np.array_equal(other.path.points[:50], runs[0].path.points[:50])


@pytest.mark.parametrize("seconds", [1e-5, 1e-4, 3e-4, 1e-3, 60.0])
def test_a_path_does_not_depend_on_how_long_machine_code_runs_at_once(through_the_hole, monkeypatch, seconds):
    problem, manifold = through_the_hole
    usual = cbirrt(problem, manifold, seed=7, timeout=60.0)
    monkeypatch.setattr(deadline, "TIME_SLICE", seconds)
    other = cbirrt(problem, manifold, seed=7, timeout=60.0)
    assert other.iterations == usual.iterations > 10
    np.testing.assert_array_equal(other.path.points, usual.path.points)


def test_a_closed_belt_ends_by_iterations_or_by_time():
    closed = lambda states: np.abs(states[:, 2]) > 0.1  # noqa: E731
    ends = [0.0, -0.6, 0.8], [0.0, -0.6, -0.8]
    problem = Problem([-1.2] * 3, [1.2] * 3, *ends, closed, resolution=0.05)
    manifold = ConstraintManifold(sphere, 3, 1, TOLERANCE)
    found = cbirrt(problem, manifold, max_iterations=20, timeout=60.0)
    assert found.status is Status.OUT_OF_ITERATIONS
    assert found.iterations == 20
    spent = time.thread_time()
    found = cbirrt(problem, manifold, timeout=0.2)
    assert found.status is Status.NO_PATH_IN_TIME
    assert found.time >= 0.2
    assert time.thread_time() - spent < 2.0


@compiled("void(int64, int64, int64)", by_address=True)
def ellipsoid(given, out, work):  # type: ignore[no-untyped-def]
    """x^2 / a + y^2 / b + z^2 / c - 1 of the input (a, b, c, x, y, z); the Jacobian is by (z, y, x)."""
    x, result, total = floats_at(given, 6), floats_at(out, 4), -1.0
    for i in range(3):
        total += x[3 + i] ** 2 / x[i]
        result[1 + 2 - i] = 2.0 * x[3 + i] / x[i]
    result[0] = total


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def valid_steps(start, end, steps, memory):  # type: ignore[no-untyped-def]
    a, b = floats_at(start, 3), floats_at(end, 3)
    for j in range(1, steps + 1):
        z = b[2] if j == steps else a[2] + (b[2] - a[2]) * j / steps
        x = b[0] if j == steps else a[0] + (b[0] - a[0]) * j / steps
        if abs(z) <= 0.1 and x < 0.5:
            return j - 1
    return steps


def test_machine_code_for_constraints_and_validity_gives_what_python_gives():
    code = CompiledManifold(
        ellipsoid.address,
        np.array([1.0, 1.0, 4.0, 0, 0, 0]),
        np.array([3, 4, 5]),
        np.array([2, 1, 0]),
        3,
        keep_alive=ellipsoid,
    )

    def python(x):
        axes = np.array([1.0, 1.0, 4.0])
        return (x**2 / axes).sum(axis=1, keepdims=True) - 1.0, (2.0 * x / axes)[:, None, :]

    def valid(states):
        return ~((np.abs(states[:, 2]) <= 0.1) & (states[:, 0] < 0.5))

    box = [-1.2, -1.2, -2.2], [1.2, 1.2, 2.2]
    ends = [-0.6, 0.0, 1.6], [-0.6, 0.0, -1.6]
    paths = []
    for function, checker in ((code, CompiledMotionValidator(valid_steps.address, 3)), (python, valid)):
        manifold = ConstraintManifold(function, 3, 1, 1e-3)
        found = cbirrt(Problem(*box, *ends, checker, resolution=0.03), manifold, seed=2, timeout=60.0)
        assert found.success
        paths.append(found.path.points)
    assert np.abs(python(paths[0])[0]).max() <= 1e-3
    assert valid(paths[0]).all()
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-9)


def test_what_a_residual_function_raises_comes_out():
    def broken(x):
        raise ZeroDivisionError("no residual today")

    problem = Problem([-1.2] * 3, [1.2] * 3, [1, 0, 0], [0, 1, 0], everywhere)
    with pytest.raises(ZeroDivisionError, match="no residual today"):
        cbirrt(problem, ConstraintManifold(broken, 3, 1))
    wrong = ConstraintManifold(lambda x: (np.zeros((1, 2)), np.zeros((1, 2, 3))), 3, 1)
    with pytest.raises(InvalidValueError, match="answer of the manifold"):
        project(problem, wrong, [[1.0, 0.0, 0.0]])


def test_a_residual_that_is_nan_is_no_state_of_the_manifold():
    def nan(x):
        return np.full((len(x), 1), np.nan), np.ones((len(x), 1, 3))

    problem = Problem([-1.2] * 3, [1.2] * 3, [1, 0, 0], [0, 1, 0], everywhere)
    assert not project(problem, ConstraintManifold(nan, 3, 1), [[1.0, 0.0, 0.0]])[1].any()
    assert cbirrt(problem, ConstraintManifold(nan, 3, 1)).status is Status.START_OFF_MANIFOLD


def test_what_is_no_manifold_is_refused_by_name():
    for change, named in [
        (dict(n=0), "n"),
        (dict(rows=0), "rows"),
        (dict(function=3), "function"),
        (dict(tolerances=0.0), "tolerances"),
        (dict(tolerances=[1.0, np.nan]), "tolerances"),
        (dict(groups=[0, 2]), "groups"),
        (dict(groups=[0]), "groups"),
        (dict(names=("one", "two", "three")), "names"),
    ]:
        fields = dict(function=sphere, n=3, rows=2, tolerances=[1e-3, 1e-3], groups=[0, 1])
        with pytest.raises(InvalidValueError, match=named):
            ConstraintManifold(**(fields | change))


def test_a_problem_that_does_not_fit_is_refused():
    problem = Problem([-1] * 2, [1] * 2, [1, 0], [0, 1], everywhere)
    manifold = ConstraintManifold(sphere, 3, 1)
    with pytest.raises(InvalidValueError, match=r"3 coordinates.*2 coordinates"):
        cbirrt(problem, manifold)
    drawn = Problem([-1] * 3, [1] * 3, [1, 0, 0], lambda rng: np.zeros(3), everywhere)
    with pytest.raises(InvalidValueError, match="sampler"):
        cbirrt(drawn, manifold)
    whole = Problem([-1] * 3, [1] * 3, [1, 0, 0], [0, 1, 0], everywhere)
    with pytest.raises(InvalidValueError, match=r"states\[1\]\[2\]"):
        project(whole, manifold, [[0, 0, 0], [0, 0, 2.0]])


def test_an_end_that_was_not_looked_at_in_time_is_not_called_invalid(through_the_hole):
    assert cbirrt(*through_the_hole, timeout=1e-9).status is Status.NO_PATH_IN_TIME
