import re
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pepper_kin.core.clock import CLOCK, seconds_now
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import (
    CompiledMotionValidator,
    Deadline,
    Metric,
    MotionValidator,
    Problem,
    rrt_connect,
)
from pepper_kin.planners.motion_validator import ValidatorCallback
from pepper_kin.planners.sampling import stream_key, uniform
from pepper_kin.planners.search_space import STOP, SearchSpace, edge_valid, last_valid_step
from pepper_kin.planners.tree import ABREAST, k_nearest, nearest, set_lane


def space_of(code: CompiledMotionValidator) -> SearchSpace:
    one = np.ones(code.n)
    return SearchSpace(code.address, code.fresh_memory(), CLOCK, 1.0, 1.0, 0.0 * one, one, one)


def test_batch_answers_are_those_of_the_world(balls, machine_code) -> None:  # type: ignore[no-untyped-def]
    world = balls(4)
    states = np.random.default_rng(0).random((500, 4))
    answers = machine_code(world)(states)
    assert answers.dtype == np.bool_
    assert np.array_equal(answers, world.free(states))
    assert 0 < answers.sum() < 500


class Interval:
    """Invalid inside an open interval of the first coordinate; remembers all states it was asked about."""

    def __init__(self, low: float, high: float) -> None:
        self.low, self.high, self.visited = low, high, []

    def __call__(self, states: np.ndarray) -> np.ndarray:
        self.visited += states[:, 0].tolist()
        return ~((states[:, 0] > self.low) & (states[:, 0] < self.high))


def whole_edge(valid, a: float, b: float, steps: int) -> bool:  # type: ignore[no-untyped-def]
    counters, ends = np.zeros(STOP + 1, dtype=np.int64), (np.array([a]), np.array([b]))
    with ValidatorCallback(MotionValidator(valid, Metric(np.ones(1)), 1.0), 1) as code:
        return edge_valid(space_of(code), *ends, steps, np.empty((2, 1)), counters, False)


@pytest.mark.parametrize("steps", [1, 7, 8, 9, 40, 300])
def test_the_start_of_an_edge_is_looked_at_where_it_is_asked_for(steps: int) -> None:
    rows, counters = np.empty((2, 1)), np.zeros(STOP + 1, dtype=np.int64)
    a, b = np.array([0.0]), np.array([1.0])
    verdicts = []
    for low, high in ((-1e-6, 1e-6), (9.0, 9.0)):  # only the start is invalid; nothing is
        valid = Interval(low, high)
        with ValidatorCallback(MotionValidator(valid, Metric(np.ones(1)), 1.0), 1) as code:
            for with_start in (False, True):
                verdicts.append(edge_valid(space_of(code), a, b, steps, rows, counters, with_start))
        assert min(abs(x) for x in valid.visited) < 1e-12
    assert verdicts == [True, False, True, True]


@settings(deadline=None, max_examples=50)
@given(st.integers(1, 700))
def test_halving_sees_every_step_of_a_free_edge_once(steps: int) -> None:
    free = Interval(9.0, 9.0)
    assert whole_edge(free, 0.0, 1.0, steps)
    visited = np.sort(free.visited)
    assert np.max(np.diff(visited, prepend=0.0)) <= 1.0 / steps + 1e-12
    assert np.min(np.diff(visited)) > 0.5 / len(visited) if len(visited) > 1 else visited == [1.0]
    assert visited[-1] == 1.0
    assert len(visited) <= steps + steps // 4 + 1


@settings(deadline=None, max_examples=50)
@given(st.floats(0.0, 0.98), st.floats(0.011, 0.5), st.booleans())
def test_no_obstacle_wider_than_a_step_is_missed(low: float, width: float, backwards: bool) -> None:
    ends = (1.0, 0.0) if backwards else (0.0, 1.0)
    assert not whole_edge(Interval(low, low + width), *ends, 100) or (backwards and low + width > 1.0)


def test_obstacle_is_seen_early() -> None:
    middle = Interval(0.45, 0.6)
    assert not whole_edge(middle, 0.0, 1.0, 1024)
    assert len(middle.visited) <= 32


def test_a_callable_is_followed_as_far_as_machine_code(discs, machine_code) -> None:  # type: ignore[no-untyped-def]
    code, rng = machine_code(discs), np.random.default_rng(2)
    counted = np.zeros((2, 2), dtype=np.int64)
    with ValidatorCallback(MotionValidator(discs.free, Metric(np.ones(2)), 1.0), 2) as called:
        for a, b in rng.random((100, 2, 2)):
            steps = max(1, int(np.ceil(np.linalg.norm(b - a) / 0.013)))
            found = [
                last_valid_step(space_of(checker), a, b, steps, counts)
                for checker, counts in zip((code, called), counted, strict=True)
            ]
            assert found[0] == found[1]
            if found[0] < steps:
                assert not discs.free((a + (b - a) * (found[0] + 1) / steps)[None])[0]
    assert np.array_equal(*counted)


def test_what_a_callable_raises_comes_out_at_the_end() -> None:
    def broken(states: np.ndarray) -> np.ndarray:
        raise ZeroDivisionError("in the oracle")

    checker = MotionValidator(broken, Metric(np.ones(1)), 0.1)
    with pytest.raises(ZeroDivisionError, match="in the oracle"), ValidatorCallback(checker, 1) as code:
        assert last_valid_step(space_of(code), np.zeros(1), np.ones(1), 5, np.zeros(3, np.int64)) == 0


def test_wrong_answers_of_a_callable_are_named() -> None:
    checker = MotionValidator(lambda x: np.ones(len(x)), Metric(np.ones(1)), 0.1)
    with (
        pytest.raises(InvalidValueError, match="answer of the checker: got float64"),
        ValidatorCallback(checker, 1) as code,
    ):
        last_valid_step(space_of(code), np.zeros(1), np.ones(1), 5, np.zeros(3, np.int64))


def test_threads_have_their_own_memory(maze, machine_code) -> None:  # type: ignore[no-untyped-def]
    """Machine code runs without Python's lock; the results are those of one after the other."""
    made: list[np.ndarray] = []
    code = machine_code(maze, 0.007)
    recorded = CompiledMotionValidator(
        code.address, 2, lambda: made.append(code.new_memory()) or made[-1], code
    )
    problem = Problem([0, 0], [1, 1], [0.05, 0.05], [0.95, 0.95], recorded, resolution=0.014)
    expected = [rrt_connect(problem, seed=seed, timeout=60.0).path.points for seed in range(8)]
    found: dict[int, np.ndarray] = {}

    def work(seed: int) -> None:
        found[seed] = rrt_connect(problem, seed=seed, timeout=60.0).path.points

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(found[seed], expected[seed]) for seed in range(8))
    assert len({id(memory) for memory in made}) == len(made) == 16


def test_random_numbers_are_even_and_streams_differ() -> None:
    """Moments and correlations of the uniform distribution, within four standard deviations."""
    keys = [stream_key(seed, stream) for seed in (0, 1, 2, 2**64, 2**64 + 1) for stream in (0, 1, 2)]
    assert len({int(key) for key in keys}) == len(keys)
    count = 20000
    numbers = np.array([[uniform(key, i) for i in range(count)] for key in keys])
    assert numbers.min() >= 0.0
    assert numbers.max() < 1.0
    four = 4.0 / np.sqrt(count)
    assert np.all(np.abs(numbers.mean(axis=1) - 0.5) < four * np.sqrt(1 / 12))
    assert np.all(np.abs(numbers.var(axis=1) - 1 / 12) < four * np.sqrt(1 / 180))
    between = np.corrcoef(numbers)
    assert np.all(np.abs(between - np.eye(len(between))) < four)
    assert all(abs(np.corrcoef(row[:-1], row[1:])[0, 1]) < four for row in numbers)
    assert uniform(keys[0], 77) == numbers[0, 77]


@pytest.mark.parametrize("n", [1, 2, 7, 15])
def test_nearest_nodes_against_brute_force(n: int) -> None:
    rng = np.random.default_rng(n)
    states, weights = rng.random((333, n)), rng.uniform(0.2, 3.0, n)
    lanes, space = np.full((21, n, ABREAST), np.nan, np.float32), np.empty(ABREAST, np.float32)
    found, squares = np.empty(50, dtype=np.int64), np.empty(50)
    filled = 0
    for size in (1, 2, 16, 17, 333):
        while filled < size:
            set_lane(lanes, filled, states[filled], weights)
            filled += 1
        for query in rng.random((20, n)):
            apart = Metric(weights).distance(states[:size], query)
            order = np.argsort(apart)
            scaled = (query * weights).astype(np.float32)
            assert nearest(lanes, size, scaled, space) == order[0]
            wanted = min(size, 17)
            count = k_nearest(lanes, size, scaled, wanted, found, squares, space)
            assert count == wanted
            assert np.array_equal(found[:wanted], order[:wanted])
            assert np.sqrt(squares[:wanted]) == pytest.approx(apart[order[:wanted]], rel=1e-5, abs=1e-6)


def test_clock_is_the_one_of_deadlines() -> None:
    place = np.empty(2, dtype=np.int64)
    longer = Deadline()
    begun = seconds_now(CLOCK, place)
    shorter = Deadline()
    while (least := shorter.elapsed) < 0.02:
        pass
    passed = seconds_now(CLOCK, place) - begun
    assert least - 1e-4 < passed < longer.elapsed + 1e-4
    assert Deadline(5.0).left == pytest.approx(5.0, abs=0.5)


def test_misuse_is_named(maze, machine_code) -> None:
    for call, message in [
        (lambda c: CompiledMotionValidator(0, 2), "address: got 0, expected an integer >= 1"),
        (lambda c: CompiledMotionValidator("f", 2), "address: got f"),
        (lambda c: CompiledMotionValidator(c.address, 0), "n: got 0, expected an integer >= 1"),
        (lambda c: CompiledMotionValidator(c.address, 2, 3), "new_memory: got 3, expected a callable"),
        (
            lambda c: CompiledMotionValidator(c.address, 2, lambda: [0.0])(np.zeros((1, 2))),
            "memory: got <class 'list'>",
        ),
        (lambda c: CompiledMotionValidator(c.address, 2, lambda: np.zeros(0)).fresh_memory(), "memory: got"),
        (lambda c: c(np.zeros((4, 3))), "states: got shape (4, 3), expected shape (m, 2)"),
        (
            lambda c: Problem([0] * 3, [1] * 3, [0] * 3, [1] * 3, c),
            "validity: got machine code for 2 coordinates",
        ),
    ]:
        with pytest.raises(InvalidValueError, match=re.escape(message)):
            call(machine_code(maze))
