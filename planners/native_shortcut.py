"""Short-cutting in machine code; `shortcut` is what calls it and says how it works."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, types

from .native import seconds_now, uniform
from .native_edge import edge_valid, steps_of
from .native_world import INDICES, MATRIX, WORLD, World
from .vectors import FloatArray

# How a call ends.
DONE, TIME_UP, FULL = 0, 1, 2

# Places in `counters`; those of the oracle come first.
STATES, CALLS, ITERATIONS, SIZE = range(4)
COUNTERS = 4

DRAWS = 4  # random numbers of one iteration
MOST_NEW = 2  # way-points that one iteration may add


@njit(nogil=True, cache=True, error_model="numpy")
def _measure(points: FloatArray, size: int, weights: FloatArray, lengths: FloatArray) -> None:
    """Write the length from the first to each point."""
    lengths[0] = 0.0
    for k in range(1, size):
        total = 0.0
        for i in range(weights.size):
            scaled = (points[k, i] - points[k - 1, i]) * weights[i]
            total += scaled * scaled
        lengths[k] = lengths[k - 1] + math.sqrt(total)


@njit(nogil=True, cache=True, error_model="numpy")
def _copy(source: FloatArray, first: int, count: int, target: FloatArray, place: int) -> None:
    """Copy points to places before or behind their own, in an order that overwrites none."""
    for j in range(count):
        k = j if place <= first else count - 1 - j
        for i in range(source.shape[1]):
            target[place + k, i] = source[first + k, i]


@njit(nogil=True, cache=True, error_model="numpy")
def drop_flat(points: FloatArray, size: int, weights: FloatArray, tolerance: float) -> int:
    """Drop way-points on the edge between their neighbours, in place; return how many are left."""
    kept = 1
    for k in range(1, size - 1):
        square = along = 0.0
        for i in range(weights.size):
            chord = (points[k + 1, i] - points[kept - 1, i]) * weights[i]
            square += chord * chord
            along += (points[k, i] - points[kept - 1, i]) * weights[i] * chord
        along = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
        off = 0.0
        for i in range(weights.size):
            ends = points[k + 1, i] - points[kept - 1, i]
            aside = (points[k, i] - points[kept - 1, i] - along * ends) * weights[i]
            off += aside * aside
        if math.sqrt(off) > tolerance:
            _copy(points, k, 1, points, kept)
            kept += 1
    if size > 1:
        _copy(points, size - 1, 1, points, kept)
        kept += 1
    return kept


@njit(nogil=True, cache=True, error_model="numpy")
def _below(lengths: FloatArray, size: int, s: float) -> int:
    """Return how many arc lengths are less than s."""
    count = 0
    while count < size and lengths[count] < s:
        count += 1
    return count


@njit(nogil=True, cache=True, error_model="numpy")
def _up_to(lengths: FloatArray, size: int, s: float) -> int:
    """Return how many arc lengths are s or less."""
    count = 0
    while count < size and lengths[count] <= s:
        count += 1
    return count


@njit(nogil=True, cache=True, error_model="numpy")
def _choose(key: np.uint64, number: int, lengths: FloatArray, size: int, places: FloatArray) -> bool:
    """Draw two arc lengths that are not on the same edge, of way-points or anywhere; False without luck."""
    u, v = uniform(key, number + 1), uniform(key, number + 2)
    if uniform(key, number) < 0.5:
        first = int(u * size)
        second = int(v * (size - 1))
        second += 1 if second >= first else 0
        places[0], places[1] = lengths[min(first, second)], lengths[max(first, second)]
        return abs(first - second) > 1
    places[0], places[1] = min(u, v) * lengths[size - 1], max(u, v) * lengths[size - 1]
    return _below(lengths, size, places[1]) > _up_to(lengths, size, places[0])


@njit(nogil=True, cache=True, error_model="numpy")
def _state_at(points: FloatArray, lengths: FloatArray, size: int, s: float, state: FloatArray) -> None:
    edge = min(max(_up_to(lengths, size, s) - 1, 0), size - 2)
    span = lengths[edge + 1] - lengths[edge]
    fraction = min((s - lengths[edge]) / span, 1.0) if span > 0.0 else 0.0
    for i in range(state.size):
        state[i] = points[edge, i] + fraction * (points[edge + 1, i] - points[edge, i])
        if fraction == 1.0:
            state[i] = points[edge + 1, i]


@njit(nogil=True, cache=True, error_model="numpy")
def _straighten(
    piece: FloatArray, count: int, lengths: FloatArray, coordinate: int, weights: FloatArray
) -> None:
    """Let one coordinate of a polyline run straight from its first to its last point."""
    _measure(piece, count, weights, lengths)
    change, whole = piece[count - 1, coordinate] - piece[0, coordinate], lengths[count - 1]
    for k in range(1, count - 1):
        piece[k, coordinate] = piece[0, coordinate] + lengths[k] / whole * change


@njit(nogil=True, cache=True, error_model="numpy")
def _valid(
    world: World, piece: FloatArray, count: int, lengths: FloatArray, rows: FloatArray, counters: np.ndarray
) -> bool:
    """Return whether a polyline is valid, its first point included, which may be any place on an edge."""
    for k in range(count - 1):
        steps = steps_of(lengths[k + 1] - lengths[k], world.resolution)
        if not edge_valid(world.address, world.memory, piece[k], piece[k + 1], steps, rows, counters, k == 0):
            return False
    return True


@njit(nogil=True, cache=True, error_model="numpy")
def _replace(points: FloatArray, size: int, before: int, after: int, piece: FloatArray, count: int) -> int:
    """Put a polyline in the place of the points from `before` up to `after`; return the new size."""
    _copy(points, after, size - after, points, before + count)
    _copy(piece, 0, count, points, before)
    return before + count + size - after


@njit(
    types.int64(
        WORLD, types.int64, types.float64, types.float64, types.float64, types.uint64, types.int64, MATRIX,
        MATRIX, MATRIX, MATRIX, INDICES,
    ),
    nogil=True,
    cache=True,
    error_model="numpy",
)  # fmt: skip
def shorten(
    world: World,
    clock: int,
    seconds: float,
    least_gain: float,
    flat: float,
    key: np.uint64,
    iterations: int,
    points: FloatArray,
    piece: FloatArray,
    lengths: FloatArray,
    rows: FloatArray,
    counters: np.ndarray,
) -> int:
    """Shorten a polyline in place by random short-cuts; see `shortcut`.

    Time is given in seconds, gain and flatness as parts of the length, `iterations` in all, those of earlier
    calls included.  `points` holds counters[SIZE] points and room for more, shape (m, n); `piece`, shape
    (m, n), `lengths`, shape (2, m), and `rows`, shape (2, n), are room.

    Returns:
        DONE, TIME_UP, or FULL if there may be no room for the points of one more attempt.
    """
    clock_room, places, weights = np.empty(2, np.int64), np.empty(2), world.weights
    end, along, n = seconds_now(clock, clock_room) + seconds, lengths[0], weights.size
    while counters[ITERATIONS] < iterations and counters[SIZE] > 2:
        size = counters[SIZE]
        if seconds_now(clock, clock_room) >= end:
            return TIME_UP
        if size + MOST_NEW > points.shape[0]:
            return FULL
        number, single = counters[ITERATIONS] * DRAWS, counters[ITERATIONS] % 2 == 1 and n > 1
        counters[ITERATIONS] += 1
        _measure(points, size, weights, along)
        if not _choose(key, number, along, size, places):
            continue
        low, high = places[0], places[1]
        inner, last_inner = _up_to(along, size, low), _below(along, size, high)
        count = 2 + (last_inner - inner if single else 0)
        _state_at(points, along, size, low, piece[0])
        _state_at(points, along, size, high, piece[count - 1])
        if single:
            _copy(points, inner, count - 2, piece, 1)
            _straighten(piece, count, lengths[1], int(uniform(key, number + 3) * n), weights)
        _measure(piece, count, weights, lengths[1])
        gain = high - low - lengths[1, count - 1]
        if gain > least_gain * along[size - 1] and _valid(world, piece, count, lengths[1], rows, counters):
            before, after = _below(along, size, low), _up_to(along, size, high)
            size = _replace(points, size, before, after, piece, count)
            _measure(points, size, weights, along)
            counters[SIZE] = drop_flat(points, size, weights, flat * along[size - 1])
    return DONE
