"""Shortening of a path by random shortcuts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

from .deadline import Deadline, load_code
from .motion_validator import machine_code_of
from .path import Path
from .problem import FINEST_RESOLUTION, Problem
from .sampling import normal_number, stream_key, uniform, within_ellipsoid
from .search_space import (
    ITERATIONS,
    STOP,
    SearchSpace,
    distance,
    edge_valid,
    measure,
    space_of,
    step_count,
)
from .tree import grown
from .vectors import FloatArray, seed_number, whole_number

LEAST_GAIN = 1e-5
"""Minimum gain relative to the length: a smaller one is not worth validity checks."""

FLAT = 1e-9  # distance to the neighbors' chord, relative to the length, up to which a waypoint is dropped
_FINER = 8  # factor of finer checks than in a search, since accepted edges graze obstacles
STREAM = 1
_SPARE = 32  # minimum number of points by which the capacity grows
_DRAWS = 4  # random numbers of one iteration
_MOST_NEW = 3  # maximum number of waypoints that one iteration adds

# Attempts with detours: fractions that contract along a direction and that go over another state, fraction
# whose two arc lengths are drawn near each other, their minimum distance (exp(-value), relative to the
# length), and maximum contraction before it is cut to 1.
_CONTRACTS, _VIA, _LOCAL, _NARROWEST, _MOST_SHARE = 0.6, 0.2, 0.2, 4.0, 4.0

_INSIDE = 1.0 - 1e-12  # fraction of the box's extent that is used, for rounding

# Statuses of a call.
DONE, TIME_UP, FULL = range(3)

# Indices into `counters`, after the indices common to all planners.
SIZE, GAINED = ITERATIONS + 1, ITERATIONS + 2
_COUNTERS = GAINED + 1


class Polyline(NamedTuple):
    """A polyline in arrays of m points.

    Attributes:
        points: Waypoints, counters[SIZE] of them, shape (m, n).
        part: Workspace for a part of the polyline, shape (m, n).
        lengths: Arc lengths of `points`, and of `part`, shape (2, m).
        rows: Workspace, shape (2, n).
        counters: Counters, see the indices above.
    """

    points: Floats2
    part: Floats2
    lengths: Floats2
    rows: Floats2
    counters: Ints1


def shortcut(
    problem: Problem,
    path: Path,
    *,
    seed: int = 0,
    iterations: int = 200,
    timeout: float = 1.0,
    resolution: float | None = None,
    least_gain: float = LEAST_GAIN,
    detours: bool = False,
) -> Path:
    """Shorten a valid path; the result is never longer, and has the same ends.

    Each iteration picks two points of the path, waypoints or points on edges, and tries to replace the part
    between them: by the straight edge, or (every other time) by making a single coordinate linear while the
    others stay, which removes the detour of one coordinate where the whole edge is blocked.

    Source of the single-coordinate variant: R. Geraerts and M. H. Overmars, Creating high-quality paths for
    motion planning, Int. J. of Robotics Research 26(8), 2007.

    It runs as machine code; a validity checker that is a Python callable is called back from there.

    With detours, one iteration in five replaces the part by two edges over a state that is drawn uniformly
    from the states that make the part shorter, and three in five draw a direction of the space along which
    the part is contracted towards the straight edge, fully or partly, while it is unchanged across.  Detours
    let a path slide along obstacles and past corners where no straight edge is free: where one obstacle
    blocks the straight edge, many directions are free.

    Args:
        problem: Supplies the validity, the metric and the resolution; its start and goals are not used.
        path: A valid path of the problem's coordinates.
        seed: Seed of the choices; the same seed gives the same path unless time runs out.
        iterations: Number of attempts.
        timeout: Time budget [s].
        resolution: Maximum distance between checked states of a new edge [length unit of the metric]; an
            eighth of the problem's if omitted, because shortcuts tend to graze obstacles.
        least_gain: Minimum ratio of the path's length, from 0 to below 1, that a shortcut has to save.  With
            a hundredth, most time goes into shortcuts that matter.
        detours: Whether two edges over another state, and contraction along directions, are tried too; for
            the shortest paths, with hundreds of iterations or more.

    Returns:
        The shortened path.  Edges that were not replaced are not checked again.

    Raises:
        InvalidValueError: The path has another number of coordinates, or an option is not allowed.
    """
    load_code(drop_flat, shorten)
    deadline = Deadline(timeout)
    problem.require_same("path", path.n)
    seed, iterations = seed_number(seed), whole_number("iterations", iterations)
    if not 0.0 <= least_gain < 1.0:
        raise InvalidValueError("least_gain", least_gain, "a number from 0 to below 1")
    if len(path) < 3:
        return path
    if resolution is None:
        resolution = max(problem.spacing / _FINER, FINEST_RESOLUTION * problem.diagonal)
    resolution = problem.validator(resolution=resolution).resolution
    counters, key = np.zeros(_COUNTERS, dtype=np.int64), stream_key(seed, STREAM)
    points = np.array(path.points)
    counters[SIZE] = drop_flat(points, len(points), problem.metric.weights, FLAT * path.length)
    with machine_code_of(problem, deadline, resolution, counters) as code:
        space = space_of(problem, code, resolution)
        line, ended = new_polyline(points, counters), FULL
        while ended == FULL or (ended == TIME_UP and not (deadline.expired or counters[STOP])):
            if ended == FULL:
                size = int(counters[SIZE])
                line = new_polyline(grown(line.points[:size], size + max(size, _SPARE)), counters)
            seconds = deadline.time_slice
            ended = shorten(space, line, seconds, float(least_gain), key, iterations, iterations, detours)
    return Path.trusted(line.points[: counters[SIZE]].copy(), problem.metric)


def new_polyline(points: FloatArray, counters: Ints1 | None = None) -> Polyline:
    """Return a polyline in an array of points, shape (m, n), of which the first counters[SIZE] count."""
    if counters is None:
        counters = np.zeros(_COUNTERS, dtype=np.int64)
    return Polyline(
        points, np.empty_like(points), np.empty((2, len(points))), np.empty((2, points.shape[1])), counters
    )


@compiled
def _copy(source: FloatArray, first: int, count: int, target: FloatArray, place: int) -> None:
    """Copy points to index `place` of an array that may be their own, in an order that overwrites none."""
    for j in range(count):
        k = j if place <= first else count - 1 - j
        for i in range(source.shape[1]):
            target[place + k, i] = source[first + k, i]


@compiled("int64(float64[:, ::1], int64, float64[::1], float64)")
def drop_flat(points: Floats2, size: int, weights: Floats1, tolerance: float) -> int:
    """Drop waypoints on the edge between their neighbors, in place; return how many are left."""
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


@compiled
def _below(lengths: FloatArray, size: int, s: float) -> int:
    """Return how many arc lengths are less than s."""
    count = 0
    while count < size and lengths[count] < s:
        count += 1
    return count


@compiled
def _up_to(lengths: FloatArray, size: int, s: float) -> int:
    """Return how many arc lengths are s or less."""
    count = 0
    while count < size and lengths[count] <= s:
        count += 1
    return count


@compiled
def _choose(key: np.uint64, number: int, lengths: FloatArray, size: int, places: FloatArray) -> bool:
    """Draw two arc lengths, of waypoints or anywhere; return False if they are on one edge."""
    u, v = uniform(key, number + 1), uniform(key, number + 2)
    if uniform(key, number) < 0.5:
        first = int(u * size)
        second = int(v * (size - 1))
        second += 1 if second >= first else 0
        places[0], places[1] = lengths[min(first, second)], lengths[max(first, second)]
        return abs(first - second) > 1
    places[0], places[1] = min(u, v) * lengths[size - 1], max(u, v) * lengths[size - 1]
    return _below(lengths, size, places[1]) > _up_to(lengths, size, places[0])


@compiled
def _choose_near(key: np.uint64, number: int, lengths: FloatArray, size: int, places: FloatArray) -> bool:
    """Draw two arc lengths, their distance uniform in its logarithm; return False if they are on one edge."""
    whole = lengths[size - 1]
    half = 0.5 * whole * math.exp(-_NARROWEST * uniform(key, number + 1))
    middle = whole * uniform(key, number + 2)
    places[0], places[1] = max(middle - half, 0.0), min(middle + half, whole)
    return _below(lengths, size, places[1]) > _up_to(lengths, size, places[0])


@compiled
def _state_at(points: FloatArray, lengths: FloatArray, size: int, s: float, state: FloatArray) -> None:
    """Write the state of a polyline at an arc length, by linear interpolation."""
    edge = min(max(_up_to(lengths, size, s) - 1, 0), size - 2)
    span = lengths[edge + 1] - lengths[edge]
    fraction = min((s - lengths[edge]) / span, 1.0) if span > 0.0 else 0.0
    for i in range(state.size):
        state[i] = points[edge, i] + fraction * (points[edge + 1, i] - points[edge, i])
        if fraction == 1.0:
            state[i] = points[edge + 1, i]


@compiled
def _straighten(
    part: FloatArray, count: int, lengths: FloatArray, coordinate: int, weights: FloatArray
) -> None:
    """Make one coordinate of a polyline linear from its first to its last point."""
    measure(part, count, weights, lengths)
    change, whole = part[count - 1, coordinate] - part[0, coordinate], lengths[count - 1]
    for k in range(1, count - 1):
        part[k, coordinate] = part[0, coordinate] + lengths[k] / whole * change


@compiled
def _contract(
    space: SearchSpace,
    part: FloatArray,
    count: int,
    lengths: FloatArray,
    direction: FloatArray,
    share: float,
) -> None:
    """Move a polyline towards its chord along one direction of the metric, by a ratio `share` of its offset.

    States that leave the box are clipped to its faces.
    """
    weights = space.weights
    measure(part, count, weights, lengths)
    whole, last = lengths[count - 1], count - 1
    for k in range(1, last):
        fraction, off = lengths[k] / whole if whole > 0.0 else 0.0, 0.0
        for i in range(weights.size):
            chord = part[0, i] + fraction * (part[last, i] - part[0, i])
            off += direction[i] * weights[i] * (chord - part[k, i])
        for i in range(weights.size):
            value = part[k, i] + share * off * direction[i] / weights[i]
            upper = space.lower[i] + _INSIDE * space.extent[i]
            part[k, i] = min(max(value, space.lower[i]), upper)


@compiled
def _draw_direction(key: np.uint64, place: int, direction: FloatArray) -> None:
    """Write a uniformly drawn direction, shape (n,)."""
    square = 0.0
    for i in range(direction.size):
        direction[i] = normal_number(key, place + 2 * i)
        square += direction[i] * direction[i]
    for i in range(direction.size):
        direction[i] /= math.sqrt(square)


@compiled
def _valid(space: SearchSpace, line: Polyline, count: int) -> bool:
    """Return whether the part is valid, its first point included, which may be any point on an edge.

    The edges in the middle, which are farthest from the old path, are checked first.
    """
    part, lengths, middle = line.part, line.lengths[1], (count - 1) // 2
    for j in range(count - 1):
        k = middle + ((j + 1) // 2 if j % 2 == 1 else -(j // 2))
        k = k if k < count - 1 else 0
        steps = step_count(lengths[k + 1] - lengths[k], space.resolution)
        if not edge_valid(space, part[k], part[k + 1], steps, line.rows, line.counters, k == 0):
            return False
    return True


@compiled
def _replace(points: FloatArray, size: int, before: int, after: int, part: FloatArray, count: int) -> int:
    """Replace the points from `before` up to `after` by a polyline; return the new size."""
    _copy(points, after, size - after, points, before + count)
    _copy(part, 0, count, points, before)
    return before + count + size - after


@compiled
def skip_ahead(space: SearchSpace, line: Polyline) -> None:
    """Replace a polyline in place, from each waypoint in turn, by the edge to a waypoint far ahead.

    The last waypoint is tried first, then the one halfway to it, and so on: few checks make few long edges.
    They do most of the work of random shortcuts, which check most of the path again each time.
    """
    points, part, lengths, counters, k = line.points, line.part, line.lengths[1], line.counters, 0
    while k + 2 < counters[SIZE]:
        other = counters[SIZE] - 1
        while other > k + 1:
            _copy(points, k, 1, part, 0)
            _copy(points, other, 1, part, 1)
            measure(part, 2, space.weights, lengths)
            steps = step_count(lengths[1], space.resolution)
            if edge_valid(space, part[0], part[1], steps, line.rows, counters, False):
                counters[SIZE] = _replace(points, counters[SIZE], k + 1, other, part, 0)
                break
            other = k + (other - k + 1) // 2
        k += 1


@compiled
def straighten_each(space: SearchSpace, line: Polyline, least_gain: float) -> None:
    """Make each coordinate of a polyline, in turn, linear from its start to its end where that is valid.

    The minimum gain is a ratio of the length.
    """
    points, part, counters, weights = line.points, line.part, line.counters, space.weights
    lengths = line.lengths
    for i in range(weights.size):
        size = counters[SIZE]
        if size < 3:
            return
        measure(points, size, weights, lengths[0])
        _copy(points, 0, size, part, 0)
        _straighten(part, size, lengths[1], i, weights)
        measure(part, size, weights, lengths[1])
        gain = lengths[0, size - 1] - lengths[1, size - 1]
        if gain > least_gain * lengths[0, size - 1] and _valid(space, line, size):
            _copy(part, 0, size, points, 0)
            counters[SIZE] = drop_flat(points, size, weights, FLAT * lengths[0, size - 1])


@compiled("int64(SearchSpace, Polyline, float64, float64, uint64, int64, int64, boolean)")
def shorten(
    space: SearchSpace,
    line: Polyline,
    seconds: float,
    least_gain: float,
    key: np.uint64,
    iterations: int,
    patience: int,
    detours: bool,
) -> int:
    """Shorten a polyline in place by random shortcuts; see `shortcut`.

    Args:
        space: Box, metric and validity.
        line: The polyline.
        seconds: Time budget [s].
        least_gain: Minimum ratio of the length that a shortcut has to save.
        key: Key of the stream of random numbers.
        iterations: Number of attempts in all, earlier calls included.
        patience: Number of attempts in a row without a gain after which it ends.
        detours: Whether to go over other states and to contract along directions, in place of single
            coordinates.

    Returns:
        DONE, TIME_UP, or FULL if there may be no space for the points of one more attempt.
    """
    points, part, lengths, counters = line.points, line.part, line.lengths, line.counters
    clock_words, places, weights = np.empty(2, np.int64), np.empty(2), space.weights
    end, along, n = seconds_now(space.clock, clock_words) + seconds, lengths[0], weights.size
    last = _DRAWS + 2 * n + 1
    draws = last + 2 if detours else _DRAWS
    while counters[ITERATIONS] < min(iterations, counters[GAINED] + patience) and counters[SIZE] > 2:
        size = counters[SIZE]
        if counters[STOP] != 0 or seconds_now(space.clock, clock_words) >= end:
            return TIME_UP
        if size + _MOST_NEW > points.shape[0]:
            return FULL
        number = counters[ITERATIONS] * draws
        counters[ITERATIONS] += 1
        single, turned, via, near = n > 1 and counters[ITERATIONS] % 2 == 0, False, False, False
        if detours:
            pick = uniform(key, number + last)
            turned, via = pick < _CONTRACTS, pick >= 1.0 - _VIA
            single, near = False, uniform(key, number + last + 1) < _LOCAL
        measure(points, size, weights, along)
        dropped = detours and near and not (turned or via)
        if dropped:
            k = 1 + int(uniform(key, number + 1) * (size - 2))
            places[0], places[1] = along[k - 1], along[k + 1]
        elif near:
            if not _choose_near(key, number, along, size, places):
                continue
        elif not _choose(key, number, along, size, places):
            continue
        low, high = places[0], places[1]
        inner, last_inner = _up_to(along, size, low), _below(along, size, high)
        count = 2 + (last_inner - inner if single or turned else 0) + (1 if via else 0)
        _state_at(points, along, size, low, part[0])
        _state_at(points, along, size, high, part[count - 1])
        if single or turned:
            _copy(points, inner, count - 2, part, 1)
        if turned:
            _draw_direction(key, number + 4, line.rows[0])
            share = min(1.0, _MOST_SHARE * uniform(key, number + 3))
            _contract(space, part, count, lengths[1], line.rows[0], share)
        if single:
            _straighten(part, count, lengths[1], int(uniform(key, number + 3) * n), weights)
        if via:
            straight = distance(part[0], part[2], weights)
            within = straight + (high - low - straight) * uniform(key, number + 3)
            if not within_ellipsoid(space, key, number + 4, part[0], part[2], within, line.rows[0], part[1]):
                continue
        measure(part, count, weights, lengths[1])
        gain = high - low - lengths[1, count - 1]
        if gain > (0.0 if dropped else least_gain) * along[size - 1] and _valid(space, line, count):
            before, after = _below(along, size, low), _up_to(along, size, high)
            size = _replace(points, size, before, after, part, count)
            measure(points, size, weights, along)
            counters[SIZE] = drop_flat(points, size, weights, FLAT * along[size - 1])
            counters[GAINED] = counters[ITERATIONS]
    return DONE
