import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import Deadline, Metric, MotionValidator, StateValidityChecker
from pepper_kin.planners.motion_validator import MAX_BATCH


class Recorder:
    """Remembers every state; invalid inside an open interval of the first coordinate."""

    def __init__(self, low: float = np.inf, high: float = np.inf) -> None:
        self.low, self.high, self.batches = low, high, []

    def __call__(self, states: np.ndarray) -> np.ndarray:
        self.batches.append(states.copy())
        return ~((states[:, 0] > self.low) & (states[:, 0] < self.high))

    @property
    def visited(self) -> np.ndarray:
        return np.concatenate(self.batches)


@given(st.floats(0.001, 1.2), st.integers(1, 400))
def test_an_edge_is_followed_to_the_last_valid_step(low: float, steps: int) -> None:
    """Against brute force: count the steps below the obstacle one by one."""
    record = Recorder(low, 9.0)
    validator = MotionValidator(record, Metric(np.ones(1)), 1.0)
    expected = 0
    while expected < steps and (expected + 1) / steps <= low:
        expected += 1
    assert validator.last_valid_step(np.array([0.0]), np.array([1.0]), steps) == expected
    assert (validator.calls, validator.states) == (len(record.batches), sum(map(len, record.batches)))
    assert max(map(len, record.batches)) <= MAX_BATCH


def test_what_is_not_checked_in_time_is_not_valid(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("pepper_kin.kernels.working_time.perf_counter", lambda: now[0])

    def slow(states: np.ndarray) -> np.ndarray:
        now[0] += 0.01 * len(states)
        return np.ones(len(states), dtype=bool)

    validator = MotionValidator(slow, Metric(np.ones(1)), 0.001, Deadline(1.0))
    assert 100 <= validator.last_valid_step(np.array([0.0]), np.array([1.0]), 1000) < 1000
    assert now[0] <= 1.0 + 0.01 * MAX_BATCH
    asked = validator.states
    assert validator.last_valid_step(np.array([0.0]), np.array([1.0]), 5) == 0
    assert validator.states == asked


def test_wrong_answers_are_refused() -> None:
    for answer, message in [
        (
            lambda x: np.ones((len(x), 1), bool),
            "got bool of shape (3, 1) for 3 states, expected bool of shape (3,)",
        ),
        (lambda x: np.ones(len(x)), "answer of the checker: got float64 of shape (3,)"),
        (lambda x: True, "answer of the checker: got bool of shape () for 3 states"),
    ]:
        with pytest.raises(InvalidValueError, match=re.escape(message)):
            MotionValidator(answer, Metric(np.ones(2)), 0.1).states_valid(np.zeros((3, 2)))


def test_misuse_is_named() -> None:
    metric = Metric(np.ones(1))
    with pytest.raises(InvalidValueError, match="validity: got 3, expected a callable"):
        MotionValidator(3, metric, 0.1)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="timeout: got nan"):
        Deadline(np.nan)
    assert isinstance(Recorder(), StateValidityChecker)
