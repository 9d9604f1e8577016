from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import Deadline, Metric, Oracle, StateValidity
from pepper_kin.planners.oracle import MAX_BATCH, visiting_order


class Recorder:
    """Remembers every state; invalid inside an open interval of the first coordinate."""

    def __init__(self, low: float = np.inf, high: float = np.inf) -> None:
        self.low, self.high, self.batches = low, high, []

    def __call__(self, states: np.ndarray) -> np.ndarray:
        self.batches.append(states.copy())
        return ~((states[:, 0] > self.low) & (states[:, 0] < self.high))

    @property
    def seen(self) -> np.ndarray:
        return np.concatenate(self.batches)


def test_visiting_order_is_the_mirrored_counter() -> None:
    assert visiting_order(8).tolist() == [0, 4, 2, 6, 1, 5, 3, 7]


@given(st.integers(1, 500), st.integers(1, 500))
def test_prefixes_of_the_visiting_order_are_spread_evenly(count: int, prefix: int) -> None:
    order = visiting_order(count)
    assert sorted(order) == list(range(count))
    visited = np.sort(np.concatenate(([-1], order[:prefix], [count])))
    power = 1 << (min(prefix, count).bit_length() - 1)  # a full level of the sequence has been visited
    assert np.max(np.diff(visited)) <= 2 * count / power + 1


@pytest.mark.parametrize("length", [0.0, 0.05, 0.1, 1.0, 7.77])
def test_valid_edge_is_seen_at_the_resolution_with_both_ends(length: float) -> None:
    record = Recorder()
    metric = Metric(np.array([2.0, 1.0]))
    a, b = np.array([0.3, 0.1]), np.array([0.3 + length / 2.0, 0.1])  # weighted length: `length`
    oracle = Oracle(record, metric, 0.1)
    assert oracle.edge_valid(a, b)
    x = np.sort(record.seen[:, 0])
    assert x[0] == a[0]
    assert x[-1] == pytest.approx(b[0], abs=1e-15)
    assert np.all(2.0 * np.diff(x) <= 0.1 + 1e-12)
    assert (oracle.calls, oracle.states) == (len(record.batches), len(record.seen))
    assert max(map(len, record.batches)) <= MAX_BATCH


@given(st.floats(0.0, 0.98), st.floats(0.011, 0.5), st.booleans())
def test_no_obstacle_wider_than_the_resolution_is_missed(low: float, width: float, backwards: bool) -> None:
    ends = np.array([[0.0], [1.0]])
    if backwards:
        ends = ends[::-1]
    oracle = Oracle(Recorder(low, low + width), Metric(np.ones(1)), 0.01)
    assert not oracle.edge_valid(*ends)


@pytest.mark.parametrize("high", [0.0, 1.0])
def test_invalid_ends_are_seen(high: float) -> None:
    oracle = Oracle(Recorder(high - 1e-6, high + 1e-6), Metric(np.ones(1)), 0.01)
    assert not oracle.edge_valid(np.array([0.0]), np.array([1.0]))


def test_middle_obstacle_ends_the_check_early() -> None:
    record = Recorder(0.45, 0.55)
    oracle = Oracle(record, Metric(np.ones(1)), 0.001)
    assert not oracle.edge_valid(np.array([0.0]), np.array([1.0]))
    assert oracle.states < 50


@given(st.floats(0.001, 1.2), st.floats(0.003, 0.3))
def test_advance_stops_at_the_last_valid_step(low: float, resolution: float) -> None:
    """Against brute force: count the steps below the obstacle one by one."""
    oracle = Oracle(Recorder(low, 9.0), Metric(np.ones(1)), resolution)
    advance = oracle.advance(np.array([0.0]), np.array([1.0]))
    expected = 0
    while expected < advance.steps and (expected + 1) / advance.steps <= low:
        expected += 1
    assert 1.0 / advance.steps <= resolution * (1 + 1e-12)
    assert advance.valid_steps == expected
    assert advance.reached == (low >= 1.0)


def test_what_is_not_checked_in_time_is_not_valid(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("pepper_kin.planners.deadline.perf_counter", lambda: now[0])

    def slow(states: np.ndarray) -> np.ndarray:
        now[0] += 0.01 * len(states)
        return np.ones(len(states), dtype=bool)

    oracle = Oracle(slow, Metric(np.ones(1)), 0.001, Deadline(1.0))
    advance = oracle.advance(np.array([0.0]), np.array([1.0]))
    assert 100 <= advance.valid_steps < advance.steps == 1000
    assert now[0] <= 1.0 + 0.01 * MAX_BATCH
    asked = oracle.states
    assert not oracle.edge_valid(np.array([0.0]), np.array([1.0]))
    assert oracle.states == asked


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            lambda x: np.ones((len(x), 1), bool),
            "got bool of shape (3, 1) for 3 states, expected bool of shape (3,)",
        ),
        (lambda x: np.ones(len(x)), "answer of the oracle: got float64 of shape (3,)"),
        (lambda x: True, "answer of the oracle: got bool of shape () for 3 states"),
    ],
)
def test_wrong_answers_are_refused(answer, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidValueError, match=re.escape(message)):
        Oracle(answer, Metric(np.ones(2)), 0.1).states_valid(np.zeros((3, 2)))


def test_misuse_is_named() -> None:
    metric = Metric(np.ones(1))
    with pytest.raises(InvalidValueError, match="oracle: got 3, expected a callable"):
        Oracle(3, metric, 0.1)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="edge: got length nan, expected finite end states"):
        Oracle(Recorder(), metric, 0.1).edge_valid(np.array([0.0]), np.array([np.nan]))
    with pytest.raises(InvalidValueError, match="timeout: got nan"):
        Deadline(np.nan)
    assert isinstance(Recorder(), StateValidity)
