import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import Path

polylines = st.integers(1, 8).flatmap(lambda k: arrays(float, (k, 3), elements=st.floats(-10, 10, width=16)))
weight_vectors = arrays(float, 3, elements=st.floats(0.25, 4))


def test_points_are_a_read_only_copy() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0]])
    path = Path(points)
    points[0, 0] = 9.0
    assert path.points[0, 0] == 0.0
    for array in (path.points, path.weights, path.arc_lengths):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0


def test_length_in_closed_form() -> None:
    corner = np.array([[0, 0], [3, 4], [3, 10]])
    assert Path(corner).length == pytest.approx(11.0)
    assert Path(corner, [2.0, 1.0]).length == pytest.approx(np.hypot(6, 4) + 6)


@given(polylines, weight_vectors)
def test_reversal_and_resampling_keep_the_length(points: np.ndarray, weights: np.ndarray) -> None:
    path = Path(points, weights)
    dense = path.resample(0.7)
    assert path.reversed().length == pytest.approx(path.length)
    assert dense.length == pytest.approx(path.length)
    assert np.all(np.diff(dense.arc_lengths) <= 0.7 * (1 + 1e-9))
    assert len(dense) >= len(path)
    assert {tuple(p) for p in points} <= {tuple(p) for p in dense.points}
    assert np.array_equal(path.reversed().reversed().points, path.points)


@given(polylines, weight_vectors, st.lists(st.floats(0, 1), min_size=2, max_size=5))
def test_interpolation_is_by_arc_length(points: np.ndarray, weights: np.ndarray, places: list[float]) -> None:
    """Walking a distance along the path never moves the state further than that (unit speed)."""
    path = Path(points, weights)
    s = np.sort(places) * path.length
    states = path(s)
    assert states.shape == (len(s), 3)
    assert np.all(path.metric.distance(states[:-1], states[1:]) <= np.diff(s) + 1e-9)
    assert np.array_equal(path(0.0), points[0])
    assert np.array_equal(path(path.length), points[-1])
    for q, value in zip(states, s, strict=True):  # the part walked has the length asked for
        before = points[path.arc_lengths < value]
        walked = Path(np.vstack((before, q)), weights).length
        assert walked == pytest.approx(value, abs=1e-9)


@given(polylines, weight_vectors)
def test_merging_leaves_no_near_neighbors_and_keeps_the_ends(points: np.ndarray, weights: np.ndarray) -> None:
    merged = Path(np.repeat(points, 2, axis=0), weights).merged(0.5)
    assert np.array_equal(merged.points[0], points[0])
    if len(merged) > 1:
        assert np.array_equal(merged.points[-1], points[-1])
        gaps = merged.metric.distance(merged.points[:-1], merged.points[1:])
        assert np.all(gaps[:-1] > 0.0)
        assert np.all(gaps > 0.0) or np.array_equal(points[0], points[-1])


def test_loop_keeps_its_end_when_merged() -> None:
    assert len(Path([[0, 0], [1, 0], [0, 0]]).merged(1e-6)) == 3
    assert len(Path([[0, 0], [1e-9, 0], [0, 0]]).merged(1e-6)) == 1


def test_misuse_is_named() -> None:
    for call, message in [
        (lambda: Path([[0, np.nan]]), "points[0][1]: got nan, expected a finite number"),
        (lambda: Path([0, 1]), "points: got shape (2,), expected points of shape (k, n)"),
        (lambda: Path([[0, 1]], [1, -1]), "weights[1]: got -1.0, expected a finite number above 0"),
        (lambda: Path([[0], [1]])(1.5), "s: got 1.5, expected arc lengths within [0, 1]"),
        (lambda: Path([[0], [1]])(np.nan), "s: got nan, expected arc lengths within [0, 1]"),
        (lambda: Path([[0], [1]]).resample(0), "spacing: got 0, expected a finite number above 0"),
        (lambda: Path([[0], [1]]).merged(np.inf), "tolerance: got inf, expected a finite number above 0"),
    ]:
        with pytest.raises(InvalidValueError, match=re.escape(message)):
            call()
