import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.fft import dst
from scipy.interpolate import BSpline

from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.planners import Path, Problem, SmoothPath, certify, rrt_connect, shortcut, smooth
from pepper_kin.planners.smooth import power_basis, sine_waypoints


def everywhere(states: np.ndarray) -> np.ndarray:
    return np.ones(len(states), dtype=bool)


def free_problem(n: int, **options) -> Problem:  # type: ignore[no-untyped-def]
    return Problem(np.zeros(n), np.ones(n), np.zeros(n), np.ones(n), everywhere, **options)


polylines = st.integers(2, 7).flatmap(
    lambda k: arrays(float, (k, 3), elements=st.floats(0, 1, width=16), unique=True)
)


@settings(deadline=None, max_examples=60)
@given(polylines, st.floats(0.02, 0.5))
def test_curve_is_c2_within_bounds_and_meets_its_ends(points: np.ndarray, spacing: float) -> None:
    problem = free_problem(3, weights=[1.0, 2.0, 0.5])
    path = Path(points, problem.weights)
    curve = smooth(problem, path, spacing=spacing)
    assert np.array_equal(curve(0.0), points[0])
    assert np.array_equal(curve(curve.length), points[-1])
    assert curve.length == pytest.approx(path.length)
    inner = curve.breaks[1:-1]
    before = np.diff(curve.breaks)[:-1]
    c = curve.coefficients[:-1]
    ends = np.stack(  # limits from the left, in closed form
        [
            c[:, 0] + before[:, None] * (c[:, 1] + before[:, None] * (c[:, 2] + before[:, None] * c[:, 3])),
            c[:, 1] + before[:, None] * (2 * c[:, 2] + 3 * before[:, None] * c[:, 3]),
            2 * c[:, 2] + 6 * before[:, None] * c[:, 3],
        ]
    )
    for derivative in range(3):
        np.testing.assert_allclose(
            ends[derivative], curve(inner, derivative), rtol=1e-7, atol=1e-9 / spacing**2
        )
    s = np.linspace(0.0, curve.length, 400)
    low, high = points.min(axis=0), points.max(axis=0)
    assert np.all((curve(s) >= low - 1e-12) & (curve(s) <= high + 1e-12))
    speed = np.linalg.norm(curve(s, 1) * problem.weights, axis=1)
    assert np.all(speed <= 1.0 + 1e-9)
    assert speed[0] > 0.0
    assert speed[-1] > 0.0


def test_derivatives_agree_with_finite_differences() -> None:
    curve = smooth(free_problem(2), Path([[0, 0], [1, 0.2], [0.3, 0.9], [1, 1]]))
    s = np.linspace(0.01, curve.length - 0.01, 77)
    h = 1e-4
    s = s[np.min(np.abs(s[:, None] - curve.breaks), axis=1) > 2 * h]
    for derivative in (1, 2, 3):
        difference = (curve(s + h, derivative - 1) - curve(s - h, derivative - 1)) / (2 * h)
        np.testing.assert_allclose(curve(s, derivative), difference, rtol=1e-5, atol=1e-5)


def test_straight_path_is_reproduced_at_unit_speed() -> None:
    a, b = np.array([0.1, 0.2, 0.9]), np.array([0.8, 0.9, 0.1])
    curve = smooth(free_problem(3), Path([a, a + (b - a) * 0.3, a + (b - a) * 0.3, b]))
    s = np.linspace(0, curve.length, 50)
    np.testing.assert_allclose(curve(s), a + s[:, None] / curve.length * (b - a), atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(curve(s, 1), axis=1), 1.0, atol=1e-12)


def test_smaller_spacing_keeps_nearer_to_the_path() -> None:
    """The distance at a corner shrinks in proportion to the spacing: fitted order one."""
    path = Path([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9]])
    spacings = 0.2 / 2.0 ** np.arange(5)
    far = []
    for spacing in spacings:
        curve = smooth(free_problem(2), path, spacing=spacing)
        far.append(
            np.min(np.linalg.norm(curve(np.linspace(0, curve.length, 20001)) - path.points[1], axis=1))
        )
    assert np.polyfit(np.log(spacings), np.log(far), 1)[0] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("name", ["wall", "maze", "discs"])
def test_planned_paths_stay_free_between_the_checked_states(
    name: str, request: pytest.FixtureRequest
) -> None:
    """The oracle keeps half a resolution as margin, so the curve is free at every point."""
    world = request.getfixturevalue(name)
    resolution, ends = 0.014, ([0.1, 0.1], [0.9, 0.15])
    problem = Problem(np.zeros(2), np.ones(2), *ends, world.padded(resolution), resolution=resolution)
    nearer = Problem(np.zeros(2), np.ones(2), *ends, world.padded(resolution / 2), resolution=resolution)
    for seed in range(4):
        result = rrt_connect(problem, seed=seed, timeout=60.0)
        assert result.path is not None
        curve = smooth(nearer, shortcut(problem, result.path, seed=seed, timeout=60.0))
        assert np.all(world.free(curve.sample(resolution / 50)))
        assert certify(nearer, curve).success
        assert curve.breaks.size < 400


def tight_corner(space: float) -> tuple[Problem, Path]:
    """An obstacle fills the inside of a right-angled turn, up to a distance from the path."""

    def checker(q: np.ndarray) -> np.ndarray:
        return ~((q[:, 0] < 0.9 - space) & (q[:, 1] > 0.1 + space))

    problem = Problem(np.zeros(2), np.ones(2), [0.1, 0.1], [0.9, 0.9], checker, resolution=0.01)
    return problem, Path([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9]])


@pytest.mark.parametrize("space", [0.1, 0.01, 0.001, 0.0001])
def test_knots_are_refined_at_a_tight_corner_only(space: float) -> None:
    problem, path = tight_corner(space)
    curve = smooth(problem, path)
    s = np.linspace(0, curve.length, 100001)
    assert np.all(problem.validity(curve(s[np.abs(s - 0.8) < 0.05])))
    widths = np.diff(curve.breaks)
    assert widths.max() > 0.05  # far from the corner the pieces stay long
    assert curve.breaks.size < 150
    corner = np.searchsorted(curve.breaks, 0.8) - 1
    assert space > 0.05 or widths[corner] < 20 * space


def test_without_space_the_corner_is_named() -> None:
    problem, path = tight_corner(1e-9)
    with pytest.raises(
        InfeasibleError, match=r"no smooth path: the path leaves no space for a smooth corner near \[0\.9"
    ) as caught:
        smooth(problem, path)
    assert "let the checker keep a margin" in caught.value.advice


def test_invalid_path_is_named() -> None:
    def checker(q: np.ndarray) -> np.ndarray:
        return np.abs(q[:, 0] - 0.5) > 0.1

    problem = Problem(np.zeros(2), np.ones(2), [0, 0], [1, 0], checker)
    with pytest.raises(InfeasibleError, match=r"the path itself is not valid near \[0\.[3-6]"):
        smooth(problem, Path([[0, 0], [1, 0]]))


def test_path_without_length_is_refused() -> None:
    for points in [[[0.5, 0.5]], [[0.5, 0.5], [0.5, 0.5]], [[0.5, 0.5], [0.5, 0.5 + 1e-12]]]:
        with pytest.raises(
            InvalidValueError, match=r"path: got length .*, expected a path whose waypoints differ"
        ):
            smooth(free_problem(2), Path(points))


def test_smooth_path_checks_and_locks_its_fields() -> None:
    curve = smooth(free_problem(2), Path([[0, 0], [1, 1]]))
    for array in (curve.breaks, curve.coefficients, curve.goal):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0
    breaks, coefficients = curve.breaks, curve.coefficients
    backwards, shifted = breaks[::-1].copy(), curve.goal + 0.1
    for arguments, message in (
        ((backwards, coefficients, curve.goal), "breaks: got"),
        ((breaks, coefficients[:-1], curve.goal), "coefficients: got shape"),
        ((breaks, coefficients * np.nan, curve.goal), "coefficients: got NaN or infinity"),
        ((breaks, coefficients, shifted), "goal: got [1.1 1.1], expected the end of the last piece"),
    ):
        with pytest.raises(InvalidValueError, match=re.escape(message)):
            SmoothPath(*arguments)
    for call, message in (
        (lambda: curve(-0.1), "s: got -0.1, expected parameters within [0, 1.41421]"),
        (lambda: curve(np.nan), "s: got nan"),
        (lambda: curve(0.0, 4), "derivative: got 4, expected 0, 1, 2 or 3"),
        (lambda: curve.sample(0.0), "spacing: got 0.0"),
        (lambda: smooth(free_problem(3), Path([[0, 0], [1, 1]])), "path: got 2 coordinates, expected 3"),
        (lambda: smooth(free_problem(2), Path([[0, 0], [1, 1]]), spacing=-1), "spacing: got -1"),
    ):
        with pytest.raises(InvalidValueError, match=re.escape(message)):
            call()


def test_shapes_follow_the_parameter() -> None:
    curve = smooth(free_problem(2), Path([[0, 0], [1, 0.3], [1, 1]]))
    assert curve(0.3).shape == (2,)
    assert curve(np.full((3, 4), 0.3), 2).shape == (3, 4, 2)
    assert curve.n == 2
    assert np.array_equal(curve.start, [0, 0])


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 12), st.integers(0, 10_000))
def test_pieces_are_those_of_the_b_spline(segments: int, seed: int) -> None:
    """Against scipy's B-splines, values and derivatives, on uneven knots."""
    rng = np.random.default_rng(seed)
    breaks = np.concatenate(([0.0], np.cumsum(rng.uniform(0.05, 1.0, segments))))
    knots = np.concatenate((breaks[:1].repeat(3), breaks, breaks[-1:].repeat(3)))
    control = rng.normal(size=(segments + 3, 2))
    spline = BSpline(knots, control, 3)
    coefficients = np.empty((segments, 4, 2))
    power_basis(knots, control, coefficients)
    assert np.array_equal(coefficients[0, 0], control[0])
    for power, factorial in enumerate((1.0, 1.0, 2.0, 6.0)):
        expected = spline.derivative(power)(breaks[:-1]) if power else spline(breaks[:-1])
        assert coefficients[:, power] == pytest.approx(expected / factorial, rel=1e-9, abs=1e-9 / 0.05**power)


@pytest.mark.parametrize(("waves", "scale"), [(1, 1.0), (3, 1.25), (31, 1.0)])
def test_sine_waypoints_are_the_first_terms_of_scipys_sine_transform(waves: int, scale: float) -> None:
    points = np.random.default_rng(3).normal(size=(5, 3))
    path, share = Path(points), np.linspace(0.0, 1.0, 33)
    straight = points[0] + share[:, None] * (points[-1] - points[0])
    off = np.array([path(s) for s in share * path.length]) - straight
    kept = dst(off[1:-1], type=1, axis=0, norm="forward") * (np.arange(1, 32) <= waves)[:, None]
    expected = straight.copy()
    expected[1:-1] += scale * dst(kept, type=1, axis=0, norm="backward")
    if waves == 31:  # all of them: the polyline itself
        np.testing.assert_allclose(expected, straight + off, atol=1e-12)
    found = np.empty_like(expected)
    sine_waypoints(points, path.arc_lengths, waves, scale, found)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.array_equal(found[[0, -1]], points[[0, -1]])
