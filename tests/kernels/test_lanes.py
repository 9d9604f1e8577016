"""Eight floats side by side: each operation against NumPy's."""

import numpy as np
import pytest

from pepper_kin.core.collision.ball_check import sine_cosine
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.lanes import (
    LANE_BYTES,
    double_at,
    greatest_lane,
    lane_abs,
    lane_maximum,
    lane_minimum,
    lane_round,
    lane_sqrt,
    lanes_below,
    least_lane,
    load_lanes,
    lowest_bit,
    single_at,
    spread,
    store_double,
    store_lanes,
    store_single,
    store_word,
    word_at,
)
from pepper_kin.kernels.signatures import Floats1, Ints1, Singles1, Singles2


@compiled("int64(float32[::1], float32[::1], float64, float32[:, ::1])")
def every_operation(x: Singles1, y: Singles1, number: float, found: Singles2) -> int:
    a, b, place = load_lanes(x.ctypes.data), load_lanes(y.ctypes.data), found.ctypes.data
    store_lanes(place, a + b)
    store_lanes(place + LANE_BYTES, a - b)
    store_lanes(place + 2 * LANE_BYTES, a * b)
    store_lanes(place + 3 * LANE_BYTES, a / b)
    store_lanes(place + 4 * LANE_BYTES, number - a)
    store_lanes(place + 5 * LANE_BYTES, a * number)
    store_lanes(place + 6 * LANE_BYTES, lane_minimum(a, b))
    store_lanes(place + 7 * LANE_BYTES, lane_maximum(a, spread(number)))
    store_lanes(place + 8 * LANE_BYTES, lane_abs(a))
    store_lanes(place + 9 * LANE_BYTES, lane_sqrt(lane_abs(a)))
    store_lanes(place + 10 * LANE_BYTES, lane_round(a))
    sine, cosine = sine_cosine(a)
    store_lanes(place + 11 * LANE_BYTES, sine)
    store_lanes(place + 12 * LANE_BYTES, cosine)
    store_lanes(place + 13 * LANE_BYTES, spread(least_lane(a)))
    store_lanes(place + 14 * LANE_BYTES, spread(greatest_lane(a)))
    return lanes_below(a, b)


@pytest.mark.thorough
def test_operations_are_those_of_numpy():
    rng = np.random.default_rng(0)
    for _ in range(200):
        x, y = (rng.uniform(-16.0, 16.0, 8).astype(np.float32) for _ in range(2))
        found = np.zeros((15, 8), np.float32)
        below = every_operation(x, y, 2.5, found)
        expected = [
            x + y, x - y, x * y, x / y, np.float32(2.5) - x, x * np.float32(2.5), np.minimum(x, y),
            np.maximum(x, np.float32(2.5)), np.abs(x), np.sqrt(np.abs(x)), np.rint(x),
        ]  # fmt: skip
        np.testing.assert_allclose(found[:11], expected, rtol=3e-7)
        wide = x.astype(float)
        np.testing.assert_allclose(found[11:13], [np.sin(wide), np.cos(wide)], rtol=0.0, atol=2.5e-7)
        assert (found[13] == x.min()).all()
        assert (found[14] == x.max()).all()
        assert below == sum(1 << i for i in range(8) if x[i] < y[i])


@compiled("float64(float32[::1], float64[::1], int64[::1])")
def scalars(singles: Singles1, doubles: Floats1, words: Ints1) -> float:
    store_single(singles.ctypes.data + 4, 0.1)
    store_word(words.ctypes.data, word_at(words.ctypes.data + 8) + 1)
    store_double(doubles.ctypes.data, 0.75)
    return single_at(singles.ctypes.data) + double_at(doubles.ctypes.data + 8)


@compiled("float64(float32[::1])")
def greatest(singles: Singles1) -> float:
    return 1.0 * greatest_lane(load_lanes(singles.ctypes.data))


def test_numbers_at_addresses():
    singles, doubles, words = np.array([1.5, 0.0], np.float32), np.array([0.0, 2.25]), np.array([0, 41])
    assert scalars(singles, doubles, words) == 3.75
    assert singles[1] == np.float32(0.1)
    assert words[0] == 42
    assert doubles[0] == 0.75


def test_greatest_lane():
    rng = np.random.default_rng(1)
    for _ in range(50):
        singles = rng.normal(size=8).astype(np.float32)
        assert greatest(singles) == singles.max()


@compiled("int64(int64)")
def lowest(bits: int) -> int:
    return lowest_bit(bits)


def test_the_lowest_bit():
    assert [lowest(1 << i | 1 << 40) for i in range(41)] == list(range(41))


@pytest.mark.parametrize("far", [0.0, 3.0, 16.0])
def test_sine_and_cosine_of_both_signs_and_at_whole_turns(far):
    x = (far + np.pi * np.arange(-4, 4) / 2).astype(np.float32)
    x = np.clip(x, -16, 16)
    found = np.zeros((15, 8), np.float32)
    every_operation(x, x, 0.0, found)
    np.testing.assert_allclose(found[11], np.sin(x.astype(float)), rtol=0.0, atol=2.5e-7)
    np.testing.assert_allclose(found[12], np.cos(x.astype(float)), rtol=0.0, atol=2.5e-7)
