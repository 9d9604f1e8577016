"""Paths of a car among obstacles: two trees whose edges are shortest curves.

RRT-Connect (J. J. Kuffner and S. M. LaValle, ICRA 2000) with curves of `car_curves` in place of straight
edges.  The tree of the goals grows backward along curves that lead to it, so that a car that only goes
forward is planned for in the same way.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1

from .car_curves import PIECES, CarCurve, car_curve, pose_on_curve, shortest_curve
from .deadline import Deadline, load_code
from .frontier import spread
from .motion_validator import machine_code_of
from .problem import Problem
from .result import Result, Status
from .sampling import stream_key, uniform
from .search_space import ITERATIONS, STOP, SearchSpace, last_valid_step, space_of
from .tree import (
    BY_EDGE,
    FOUND,
    FULL,
    GOAL_NODE,
    GOAL_SIZE,
    OWN_COUNTERS,
    SAMPLE,
    START_NODE,
    START_SIZE,
    TARGET,
    TIME_UP,
    Trees,
    add_node,
    leave_trees,
    room,
    take_trees,
    trace,
    traced,
    with_room,
)
from .vectors import FloatArray, positive_number, read_only, seed_number

SIZE = OWN_COUNTERS  # index of the counter for the number of pieces of the path that is shortened

_REACH = 6.0  # maximum length of an extension, in turning radii
_STRIDE = 16  # stride in states of each pass over a curve: far-apart states are checked first
_LEAST_GAIN = 0.01  # minimum ratio of the length that a shortcut has to save
_SHORTCUTS = 400  # number of attempts
_LEAST_PIECE = 1e-12  # length below which a piece comes from rounding [m]
_STREAM = 0xCA2


class Car(NamedTuple):
    """Kinematics of a car, and the metric along its curves.

    Attributes:
        radius: Minimum turning radius [m].
        backward: Whether the car drives backward too.
        rate: Maximum length in the metric of one meter of a curve [length unit of the metric / m].
        reach: Maximum length of an extension [m].
    """

    radius: float
    backward: bool
    rate: float
    reach: float


@dataclass(frozen=True, eq=False)
class CarResult(Result):
    """Result of `car_connect`; its `path` is None, and `cost` is infinite.

    Attributes:
        curve: The path from the start to a goal, of any number of pieces; None unless solved.
    """

    curve: CarCurve | None = None

    @property
    def length(self) -> float:
        """Length of the path [m]; nan unless solved."""
        return math.nan if self.curve is None else self.curve.length


def car_connect(
    problem: Problem, radius: float, *, backward: bool = True, seed: int = 0, timeout: float = 5.0
) -> CarResult:
    """Search a path of a car, and shorten it.

    Args:
        problem: A problem of three coordinates, x, y [m] and yaw [rad]; yaw is not bounded, and goals are met
            up to full turns.
        radius: Minimum turning radius [m].
        backward: Whether the car drives backward too (Reeds and Shepp), or forward only (Dubins).
        seed: Seed of the samples; the same seed gives the same path unless time runs out.
        timeout: Time budget [s], shortcuts included.

    Returns:
        The result; its curve is valid at the problem's resolution.

    Raises:
        InvalidValueError: The problem does not have three coordinates, its goals are drawn by a sampler, or
            an option is wrong.
    """
    load_code(grow_car, shorten_car, add_node, trace)
    deadline, radius = Deadline(timeout), positive_number("radius", radius)
    if problem.n != 3 or problem.goal_sampler is not None:
        raise InvalidValueError("problem", f"{problem.n} coordinates", "three, and goals that are given")
    key, weights, trees = stream_key(seed_number(seed), _STREAM), problem.metric.weights, take_trees(3)
    counters = trees.counters
    rate = math.hypot(float(weights[:2].max()), float(weights[2]) / radius)
    car = Car(radius, bool(backward), rate, _REACH * radius)
    with machine_code_of(problem, deadline, counters=counters) as code:
        space = space_of(problem, code, problem.spacing)
        status, curve, goal, frontier = _searched(problem, space, car, trees, key, deadline)
        if curve is not None:
            curve = _shortened(space, car, curve, counters, deadline, stream_key(seed, _STREAM + 1))
    start, end = counters[START_SIZE : GOAL_SIZE + 1].tolist()
    leave_trees(trees)
    sizes = None if frontier is None else (start, end)
    return CarResult.of_run(
        status, counters, deadline, seed, goal=goal, curve=curve, tree_sizes=sizes, frontier=frontier
    )


def _searched(
    problem: Problem, space: SearchSpace, car: Car, trees: Trees, key: np.uint64, deadline: Deadline
) -> tuple[Status, CarCurve | None, int | None, FloatArray | None]:
    """Return the status, the path, its goal's index, and without a path some nodes of the smaller tree."""
    start, goals, counters = problem.start.copy(), problem.goals.copy(), trees.counters
    if last_valid_step(space, start, start, 1, counters) != 1:
        return Status.START_INVALID, None, None, None
    valid = [k for k, goal in enumerate(goals) if last_valid_step(space, goal, goal, 1, counters) == 1]
    if not valid:
        return Status.GOAL_INVALID, None, None, None
    trees, segments = with_room(trees, len(valid)), np.zeros((2, 2, PIECES))
    add_node(space, trees, 0, -1, start)
    for k in valid:
        add_node(space, trees, 1, -1 - k, goals[k])
    while True:
        ended = grow_car(space, car, trees, segments, deadline.time_slice, key)
        if ended == FOUND:
            return Status.SOLVED, *_path(trees, car), None
        if ended == FULL:
            trees = with_room(trees, 1)
        elif deadline.expired or counters[STOP]:
            side = int(counters[GOAL_SIZE] < counters[START_SIZE])
            nodes = spread(trees.states[side, : counters[START_SIZE + side]])
            return Status.NO_PATH_IN_TIME, None, None, nodes


def _path(trees: Trees, car: Car) -> tuple[CarCurve, int]:
    """Return the curve through the nodes that join the trees, and the index of its goal."""
    ends, goal = traced(trees)
    curves = [car_curve(a, b, car.radius, backward=car.backward) for a, b in itertools.pairwise(ends)]
    turns, lengths = (np.concatenate([getattr(one, name) for one in curves]) for name in ("turns", "lengths"))
    return CarCurve(read_only(ends[0]), read_only(turns), read_only(lengths), car.radius), goal


def _shortened(
    space: SearchSpace, car: Car, curve: CarCurve, counters: Ints1, deadline: Deadline, key: np.uint64
) -> CarCurve:
    """Return a path, parts of which are replaced by single curves that are shorter and free."""
    count = curve.lengths.size
    spare = np.zeros((3, 2, count + (PIECES + 2) * _SHORTCUTS))
    spare[0, :, :count] = curve.segments
    counters[SIZE] = count
    shorten_car(space, car, curve.start.copy(), spare, counters, key, max(deadline.left, 0.0))
    turns, lengths = spare[0, :, : counters[SIZE]]
    return CarCurve(curve.start, read_only(turns.copy()), read_only(lengths.copy()), curve.radius)


@compiled
def _cut(source: Floats2, count: int, begin: float, end: float, target: Floats2, place: int) -> int:
    """Append the pieces between two lengths along a path to `target`; return the new number of pieces."""
    passed = 0.0
    for k in range(count):
        length = abs(source[1, k])
        kept = min(passed + length, end) - max(passed, begin)
        passed += length
        if kept > _LEAST_PIECE:
            target[0, place] = source[0, k]
            target[1, place] = kept if source[1, k] > 0.0 else -kept
            place += 1
    return place


@compiled("void(SearchSpace, Car, float64[::1], float64[:, :, ::1], int64[::1], uint64, float64)")
def shorten_car(
    space: SearchSpace,
    car: Car,
    start: Floats1,
    spare: Floats3,
    counters: Ints1,
    key: np.uint64,
    seconds: float,
) -> None:
    """Shorten a path in place by random shortcuts.

    Args:
        space: Box, metric and validity.
        car: Kinematics of the car.
        start: Start pose of the path (x, y, yaw) [m, m, rad], shape (3,).
        spare: The path's counters[SIZE] pieces, then memory for as many more and for a curve, shape (3, 2,
            m).
        counters: Counters of the planner.
        key: Key of the stream of random numbers.
        seconds: Time budget [s].
    """
    clock, a, b, short = np.empty(2, np.int64), np.empty(3), np.empty(3), spare[2]
    end, path, other = seconds_now(space.clock, clock) + seconds, spare[0], spare[1]
    for trial in range(_SHORTCUTS):
        if counters[STOP] != 0 or seconds_now(space.clock, clock) >= end:
            return
        count, whole = counters[SIZE], 0.0
        for k in range(count):
            whole += abs(path[1, k])
        u, v = uniform(key, 2 * trial), uniform(key, 2 * trial + 1)
        low, high = min(u, v) * whole, max(u, v) * whole
        low, high = (0.0 if low < 0.1 * whole else low), (whole if high > 0.9 * whole else high)
        pose_on_curve(start, path[:, :count], car.radius, low, a)
        pose_on_curve(start, path[:, :count], car.radius, high, b)
        length = shortest_curve(a, b, car.radius, car.backward, short)
        if length > high - low - _LEAST_GAIN * whole:
            continue
        if not curve_is_free(space, car, a, short[:, :PIECES], length, counters):
            continue
        size = _cut(path, count, 0.0, low, other, 0)
        size = _cut(short, PIECES, 0.0, length, other, size)
        size = _cut(path, count, high, whole, other, size)
        for k in range(size):
            path[0, k], path[1, k] = other[0, k], other[1, k]
        counters[SIZE] = size


@compiled
def curve_is_free(
    space: SearchSpace, car: Car, a: Floats1, segments: Floats2, length: float, counters: Ints1
) -> bool:
    """Return whether a curve stays in the box and all its states are valid, those far apart first.

    Args:
        space: The space.
        car: Kinematics of the car.
        a: Start pose of the curve (x, y, yaw) [m, m, rad], shape (3,).
        segments: Turns and signed lengths [m], shape (2, k).
        length: Length of the part of the curve that is checked [m].
        counters: Counters of the planner.
    """
    pose, steps = np.empty(3), max(1, math.ceil(length * car.rate / space.resolution))
    for first in range(_STRIDE, 0, -1):
        for k in range(first, steps + 1, _STRIDE):
            pose_on_curve(a, segments, car.radius, length * k / steps, pose)
            for i in range(2):
                if not 0.0 <= pose[i] - space.lower[i] <= space.extent[i]:
                    return False
            if last_valid_step(space, pose, pose, 1, counters) != 1:
                return False
    return True


@compiled
def _nearest(trees: Trees, car: Car, side: int, target: Floats1, segments: Floats2) -> int:
    """Return the node with the shortest curve to a pose or, in the tree of the goals, from the pose."""
    best, found = math.inf, -1
    for k in range(trees.counters[START_SIZE + side]):
        node = trees.states[side, k]
        if math.hypot(node[0] - target[0], node[1] - target[1]) >= best:
            continue
        if side == 0:
            length = shortest_curve(node, target, car.radius, car.backward, segments)
        else:
            length = shortest_curve(target, node, car.radius, car.backward, segments)
        if length < best:
            best, found = length, k
    return found


@compiled
def _edge_is_free(
    space: SearchSpace, car: Car, trees: Trees, side: int, node: int, pose: Floats1, segments: Floats2
) -> bool:
    """Return whether the curve between a node and a pose, towards the goals, is free."""
    own = trees.states[side, node]
    first = own if side == 0 else pose
    last = pose if side == 0 else own
    length = shortest_curve(first, last, car.radius, car.backward, segments)
    return curve_is_free(space, car, first, segments, length, trees.counters)


@compiled("int64(SearchSpace, Car, Trees, float64[:, :, ::1], float64, uint64)")
def grow_car(
    space: SearchSpace, car: Car, trees: Trees, curves: Floats3, seconds: float, key: np.uint64
) -> int:
    """Grow the smaller of two trees until they meet; see the module.

    Args:
        space: Box, metric and validity.
        car: Kinematics of the car.
        trees: The trees.
        curves: Memory for two curves, shape (2, 2, PIECES).
        seconds: Time budget [s].
        key: Key of the stream of random numbers.

    Returns:
        FOUND (counters[START_NODE] and counters[GOAL_NODE] are joined by a curve), TIME_UP or FULL.
    """
    counters, spare = trees.counters, np.empty(2, np.int64)
    sample, new, tried, segments = trees.rows[SAMPLE], trees.rows[TARGET], curves[0], curves[1]
    end = seconds_now(space.clock, spare) + seconds
    while True:
        if counters[STOP] != 0 or seconds_now(space.clock, spare) >= end:
            return TIME_UP
        if room(trees) < 1:
            return FULL
        number = counters[ITERATIONS]
        counters[ITERATIONS] += 1
        side = 0 if counters[START_SIZE] <= counters[GOAL_SIZE] else 1
        if number > 0:  # the first iterations try the curves between the roots
            for i in range(2):
                sample[i] = space.lower[i] + space.extent[i] * uniform(key, 3 * number + i)
            sample[2] = math.pi * (2.0 * uniform(key, 3 * number + 2) - 1.0)
            near = _nearest(trees, car, side, sample, tried)
            own = trees.states[side, near]
            if side == 0:
                length = shortest_curve(own, sample, car.radius, car.backward, segments)
                pose_on_curve(own, segments, car.radius, min(length, car.reach), new)
            else:
                length = shortest_curve(sample, own, car.radius, car.backward, segments)
                pose_on_curve(sample, segments, car.radius, max(length - car.reach, 0.0), new)
            if not _edge_is_free(space, car, trees, side, near, new, segments):
                continue
            node = add_node(space, trees, side, near, new)
        else:
            side, node = 0, 0
        pose = trees.states[side, node]
        meeting = _nearest(trees, car, 1 - side, pose, tried)
        if _edge_is_free(space, car, trees, 1 - side, meeting, pose, segments):
            counters[START_NODE + side], counters[GOAL_NODE - side] = node, meeting
            counters[BY_EDGE] = 1
            return FOUND
