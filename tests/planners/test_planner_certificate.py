import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import Path, Problem, certify, smooth


def left_half(states: np.ndarray) -> np.ndarray:
    return states[:, 0] < 0.5


def test_certificate_tells_what_is_wrong() -> None:
    problem = Problem([0, 0], [1, 1], [0.1, 0.1], [[0.4, 0.1], [0.4, 0.9]], left_half, resolution=0.01)
    good = certify(problem, Path([[0.1, 0.1], [0.4, 0.9]]))
    assert good.success
    assert good.first_invalid is None
    assert good.states_checked >= np.hypot(0.3, 0.8) / 0.01
    blocked = certify(problem, Path([[0.1, 0.1], [0.7, 0.1], [0.4, 0.1]]))
    assert not blocked.success
    assert blocked.first_invalid == pytest.approx([0.5, 0.1], abs=0.011)
    outside = certify(problem, Path([[0.1, 0.1], [-0.2, 0.1], [0.4, 0.1]]))
    assert not outside.success
    assert not outside.within_bounds
    assert outside.first_invalid is None
    elsewhere = certify(problem, Path([[0.1, 0.2], [0.4, 0.4]]))
    assert elsewhere.start_error == pytest.approx(0.1)
    assert elsewhere.goal_error == pytest.approx(0.3)
    assert not elsewhere.success


def test_finer_certificate_sees_what_a_coarse_one_misses() -> None:
    def sliver(states: np.ndarray) -> np.ndarray:
        return np.abs(states[:, 0] - 0.123456) > 1e-4

    problem = Problem([0, 0], [1, 1], [0, 0], [1, 0], sliver, resolution=0.1)
    curve = smooth(Problem([0, 0], [1, 1], [0, 0], [1, 0], lambda x: x[:, 0] >= 0), Path([[0, 0], [1, 0]]))
    for path in (Path([[0, 0], [1, 0]]), curve):
        assert certify(problem, path).success
        assert not certify(problem, path, resolution=1e-5).success


def test_wrong_size_is_named() -> None:
    problem = Problem([0, 0], [1, 1], [0, 0], [1, 0], left_half)
    with pytest.raises(InvalidValueError, match="path: got 1 coordinates, expected 2 coordinates"):
        certify(problem, Path([[0.0], [1.0]]))
