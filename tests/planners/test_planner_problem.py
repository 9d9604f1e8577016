import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pepper_kin.exceptions import InvalidValueError, PepperKinError
from pepper_kin.planners import Metric, Problem


def everywhere(states: np.ndarray) -> np.ndarray:
    return np.ones(len(states), dtype=bool)


def make(**changes: object) -> Problem:
    values: dict = dict(lower=[0, 0], upper=[1, 2], start=[0.1, 0.2], goals=[[0.9, 1.8]], validity=everywhere)
    return Problem(**(values | changes))


def test_fields_are_read_only_copies() -> None:
    start, goals = np.array([0.1, 0.2]), np.array([[0.9, 1.8]])
    problem = make(start=start, goals=goals)
    start[0] = goals[0, 0] = 0.5
    assert problem.start[0] == 0.1
    assert problem.goals[0, 0] == 0.9
    for array in (problem.lower, problem.upper, problem.start, problem.goals, problem.weights):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0
    with pytest.raises(AttributeError):
        problem.start = np.zeros(2)  # type: ignore[misc]


def test_single_goal_may_be_a_vector() -> None:
    assert make(goals=[0.9, 1.8]).goals.shape == (1, 2)


def test_default_resolution_is_a_hundredth_of_the_weighted_diagonal() -> None:
    problem = make(weights=[3.0, 2.0])
    assert problem.diagonal == pytest.approx(5.0)
    assert problem.resolution == pytest.approx(0.05)


LABELS = ("HeadYaw", "HeadPitch")


def test_misuse_is_named() -> None:
    for changes, message in [
        (dict(lower=[0, -np.inf]), "lower[1]: got -inf, expected a finite bound"),
        (dict(upper=[1, np.inf], labels=LABELS), "upper[1] (HeadPitch): got inf, expected a finite bound"),
        (dict(upper=[1, np.inf]), "give an unbounded coordinate a finite sampling range"),
        (dict(lower=[0, 3]), "upper[1]: got 2.0, expected at least lower, 3"),
        (dict(lower=[1, 2]), "one coordinate or more with upper > lower"),
        (dict(lower=[0, np.nan]), "lower[1]: got nan, expected a finite number"),
        (dict(upper=[1, 2, 3]), "upper: got shape (3,), expected a vector of shape (2,)"),
        (dict(start=[0.1, 2.5]), "start[1]: got 2.5, expected a value within the bounds [0, 2]"),
        (dict(start=[0.1, 2.5], labels=LABELS), "start[1] (HeadPitch): got 2.5"),
        (dict(start=[np.nan, 0], labels=LABELS), "start[0] (HeadYaw): got nan, expected a finite number"),
        (dict(start=[0.1]), "start: got shape (1,), expected a vector of shape (2,)"),
        (dict(start=["a", "b"]), "expected a vector of shape (2,) of finite numbers"),
        (dict(goals=[[0.5, 0.5], [-0.1, 0]], labels=LABELS), "goals[1][0] (HeadYaw): got -0.1"),
        (dict(goals=[[0.5, np.inf]]), "goals[0][1]: got inf, expected a finite number"),
        (dict(goals=np.empty((0, 2))), "goals: got shape (0, 2), expected points of shape (k, 2)"),
        (dict(goals=[[0.5], [0.5, 0.5]]), "goals: got [[0.5], [0.5, 0.5]], expected points of shape (k, 2)"),
        (dict(validity=None), "validity: got None, expected a callable"),
        (dict(weights=[1.0, 0.0]), "weights[1]: got 0.0, expected a finite number above 0"),
        (dict(weights=[1.0]), "weights: got shape (1,), expected a vector of shape (2,)"),
        (dict(resolution=0.0), "resolution: got 0.0, expected a finite number above 0"),
        (dict(resolution=1e-9), "resolution: got 1e-09, expected at least 1e-06 of the diagonal"),
        (dict(labels=("a", "a")), "labels: got ('a', 'a'), expected n different names"),
        (dict(labels="ab"), "labels: got ab, expected n different names"),
        (dict(labels=("a", "b", "c")), "lower: got shape (2,), expected a vector of shape (3,)"),
    ]:
        with pytest.raises(InvalidValueError, match=re.escape(message)):
            make(**changes)


numbers = st.floats(allow_nan=True, allow_infinity=True, width=32)


def made_or_refused(lower: np.ndarray, upper: np.ndarray, start: np.ndarray) -> Problem | PepperKinError:
    try:
        return Problem(lower, upper, start, start, everywhere)
    except PepperKinError as error:
        return error


@given(
    arrays(float, 3, elements=numbers), arrays(float, 3, elements=numbers), arrays(float, 3, elements=numbers)
)
def test_a_problem_is_sound_or_refused(lower: np.ndarray, upper: np.ndarray, start: np.ndarray) -> None:
    """Whatever comes in, a problem that can be made is finite, ordered and holds its start."""
    outcome = made_or_refused(lower, upper, start)
    if isinstance(outcome, PepperKinError):
        assert re.match(r"(lower|upper|start|resolution)(\[\d\])*: got", str(outcome))
        return
    problem = outcome
    assert np.all(np.isfinite(problem.lower) & np.isfinite(problem.upper))
    assert np.all((problem.lower <= problem.start) & (problem.start <= problem.upper))
    assert problem.resolution is not None
    assert problem.resolution > 0.0


points = arrays(float, (3, 4), elements=st.floats(-100, 100))


@given(points, arrays(float, 4, elements=st.floats(0.1, 10)))
def test_metric_axioms(p: np.ndarray, weights: np.ndarray) -> None:
    metric = Metric(weights)
    ab, bc, ac = metric.distance(p[0], p[1]), metric.distance(p[1], p[2]), metric.distance(p[0], p[2])
    assert metric.distance(p[0], p[0]) == 0.0
    assert ab == metric.distance(p[1], p[0])
    assert ac <= ab + bc + 1e-9
    assert ab == pytest.approx(np.linalg.norm((p[1] - p[0]) * weights), rel=1e-12)


def test_another_validity_leaves_the_rest_alone() -> None:
    goals = [[0.2, 0.3], [0.8, 0.9]]
    problem = Problem([0, 0], [1, 1], [0.5, 0.5], goals, lambda q: q[:, 0] > 0, weights=[1, 2])
    other = problem.with_validity(lambda q: q[:, 0] < 0)
    assert not other.validity(np.array([[0.5, 0.5]])).any()
    assert problem.validity(np.array([[0.5, 0.5]])).all()
    np.testing.assert_array_equal(problem.goals, goals)
    assert other.resolution == problem.resolution
    np.testing.assert_array_equal(other.metric.weights, [1, 2])
    with pytest.raises(ValueError, match="read-only"):
        other.goals[0, 0] = 3.0
    with pytest.raises(InvalidValueError, match="validity"):
        problem.with_validity(None)


@pytest.mark.parametrize(
    "ends",
    [([0.2], [[0.8, 0.8]]), ([0.2, np.nan], [[0.8, 0.8]]), ([0.2, 0.2], [[0.8]]), ([0.2, 0.2], [0.8, 0.8])],
)
def test_other_ends_have_the_shape_that_searches_read(ends):
    problem = Problem([0, 0], [1, 1], [0.1, 0.1], [0.9, 0.9], lambda x: np.ones(len(x), dtype=bool))
    np.testing.assert_array_equal(problem.begun_at([0.2, 0.2], [[0.8, 0.8]]).start, [0.2, 0.2])
    with pytest.raises(InvalidValueError, match=r"start|goals"):
        problem.begun_at(*ends)
