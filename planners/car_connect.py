"""Paths of a car among obstacles: two trees whose edges are shortest curves.

RRT-Connect (J. J. Kuffner and S. M. LaValle, ICRA 2000) with curves of `car_curves` in place of straight
edges.  The tree of the goals grows backward along curves that lead to it, so that a car that only goes
forward is planned for in the same way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1, Ints2

from .car_curves import PIECES, CarCurve, car_curve, pose_on_curve, shortest_curve
from .deadline import Deadline, load_code
from .motion_validator import machine_code_of
from .problem import Problem
from .result import Status
from .sampling import stream_key, uniform
from .search_space import STOP, SearchSpace, last_valid_step, space_of
from .tree import grown
from .vectors import positive_number, whole_number

ITERATIONS, START_SIZE, GOAL_SIZE, START_NODE, GOAL_NODE = range(STOP + 1, STOP + 6)
_COUNTERS = GOAL_NODE + 1

FOUND, GOING_ON, TIME_UP, FULL = range(4)

_REACH = 6.0  # longest extension, in turning radii
_FIRST_CAPACITY = 256
_STRIDE = 16  # states of a curve that are looked at first
_LEAST_GAIN = 0.01  # of the length: what a short-cut has to save
_SHORTCUTS = 150
_STREAM = 0xCA2


class CarTrees(NamedTuple):
    """Two trees of poses, and room for a curve.

    Attributes:
        poses: (x, y, yaw), shape (2, capacity, 3).
        parents: Numbers of the nodes before; -1 - k for root k, shape (2, capacity).
        pieces: Room for two curves, shape (2, 2, PIECES).
        rows: Room for poses, shape (4, 3).
        counters: See the places above.
    """

    poses: Floats3
    parents: Ints2
    pieces: Floats3
    rows: Floats2
    counters: Ints1


class Car(NamedTuple):
    """How a car turns.

    Attributes:
        radius: Least turning radius [m].
        backward: Whether it goes backward too.
        rate: Length of a curve in the metric, for each metre of it, at most.
        reach: Longest extension [m].
    """

    radius: float
    backward: bool
    rate: float
    reach: float


@dataclass(frozen=True, eq=False)
class CarResult:
    """The outcome of `car_connect`.

    Attributes:
        status: How it ended.
        curves: Curves from the start to a goal, each beginning where the one before ends; none unless solved.
        goal_index: Which of the goals was reached; None unless solved.
        iterations: Number of samples drawn.
        states_checked: Number of states whose validity was asked for.
        time: Wall time [s].
        seed: Seed of the run.
    """

    status: Status
    curves: tuple[CarCurve, ...]
    goal_index: int | None
    iterations: int
    states_checked: int
    time: float
    seed: int

    @property
    def length(self) -> float:
        """Length of all curves [m]."""
        return sum(curve.length for curve in self.curves)


def car_connect(
    problem: Problem, radius: float, *, backward: bool = True, seed: int = 0, timeout: float = 5.0
) -> CarResult:
    """Search a path of a car, and shorten it.

    Args:
        problem: Of three coordinates, x, y [m] and yaw [rad]; yaw is not bounded, and goals are met up to
            full turns.
        radius: Least turning radius [m].
        backward: Whether the car goes backward too (Reeds and Shepp), or forward only (Dubins).
        seed: Seed of the samples; the same seed gives the same path unless time runs out.
        timeout: Time budget [s], short-cuts included.

    Returns:
        The result; valid at the problem's resolution.

    Raises:
        InvalidValueError: The problem has not three coordinates or draws its goals, or an option is wrong.
    """
    load_code(grow_car, curve_is_free)
    deadline, radius = Deadline(timeout), positive_number("radius", radius)
    if problem.n != 3 or problem.goal_sampler is not None:
        raise InvalidValueError("problem", f"{problem.n} coordinates", "three, and goals that are given")
    counters, key = np.zeros(_COUNTERS, np.int64), stream_key(whole_number("seed", seed), _STREAM)
    weights = problem.metric.weights
    rate = math.hypot(float(weights[:2].max()), float(weights[2]) / radius)
    car = Car(radius, bool(backward), rate, _REACH * radius)
    with machine_code_of(problem, deadline, counters=counters) as code:
        space = space_of(problem, code, problem.spacing)
        status, curves, goal = _searched(problem, space, car, counters, key, deadline)
        if curves:
            curves = _shortened(space, car, curves, counters, deadline, seed)
    states = int(counters[0])
    return CarResult(status, curves, goal, int(counters[ITERATIONS]), states, deadline.elapsed, seed)


def _searched(
    problem: Problem, space: SearchSpace, car: Car, counters: Ints1, key: np.uint64, deadline: Deadline
) -> tuple[Status, tuple[CarCurve, ...], int | None]:
    start, goals = problem.start.copy(), problem.goals.copy()
    if last_valid_step(space, start, start, 1, counters) != 1:
        return Status.START_INVALID, (), None
    valid = [k for k, goal in enumerate(goals) if last_valid_step(space, goal, goal, 1, counters) == 1]
    if not valid:
        return Status.GOAL_INVALID, (), None
    capacity = _FIRST_CAPACITY + len(valid)
    trees = CarTrees(
        np.empty((2, capacity, 3)), np.empty((2, capacity), np.int64), np.zeros((2, 2, PIECES)),
        np.empty((4, 3)), counters,
    )  # fmt: skip
    trees.poses[0, 0], trees.parents[0, 0] = start, -1
    trees.poses[1, : len(valid)], trees.parents[1, : len(valid)] = goals[valid], -1 - np.array(valid)
    counters[START_SIZE], counters[GOAL_SIZE] = 1, len(valid)
    while True:
        ended = grow_car(space, car, trees, deadline.time_slice, key)
        if ended == FOUND:
            return Status.SOLVED, *_path(trees, car)
        if ended == FULL:
            capacity *= 2
            trees = trees._replace(
                poses=grown(trees.poses, capacity, axis=1), parents=grown(trees.parents, capacity, axis=1)
            )
        elif deadline.expired or counters[STOP]:
            return Status.NO_PATH_IN_TIME, (), None


def _path(trees: CarTrees, car: Car) -> tuple[tuple[CarCurve, ...], int]:
    branches = []
    for side, node in enumerate(trees.counters[[START_NODE, GOAL_NODE]]):
        poses, place = [], int(node)
        while place >= 0:
            poses.append(trees.poses[side, place].copy())
            place = int(trees.parents[side, place])
        branches.append(poses)
    ends = [*reversed(branches[0]), *branches[1]]
    curves, pose = [], ends[0]
    for end in ends[1:]:
        curve = car_curve(pose, end, car.radius, backward=car.backward)
        if curve.lengths.size:
            curves.append(curve)
            pose = curve(curve.length)  # the yaw of the end, without full turns left out
    return tuple(curves), -1 - place


def _shortened(
    space: SearchSpace, car: Car, curves: tuple[CarCurve, ...], counters: Ints1, deadline: Deadline, seed: int
) -> tuple[CarCurve, ...]:
    """Replace parts of a path by single curves that are shorter and free."""
    rng = np.random.default_rng((_STREAM, seed))
    for _ in range(_SHORTCUTS):
        if deadline.expired or counters[STOP]:
            break
        ends = np.cumsum([0.0, *(curve.length for curve in curves)])
        a, b = np.sort(rng.uniform(0.0, ends[-1], 2))
        a, b = (0.0 if a < 0.1 * ends[-1] else a), (ends[-1] if b > 0.9 * ends[-1] else b)
        before, after = cut_at(curves, 0.0, a), cut_at(curves, b, ends[-1])
        begin = before[-1](before[-1].length) if before else curves[0].start
        target = after[0].start if after else curves[-1](curves[-1].length)
        short = car_curve(begin, target, car.radius, backward=car.backward)
        if short.length > (b - a) - _LEAST_GAIN * ends[-1] or not short.lengths.size:
            continue
        if not curve_is_free(space, car, begin.copy(), short.pieces, short.length, counters):
            continue
        curves, pose = (*before, short), short(short.length)
        for rest in after:
            curves = (*curves, CarCurve(pose, rest.turns, rest.lengths, rest.radius))
            pose = curves[-1](rest.length)
    return curves


def cut_at(curves: tuple[CarCurve, ...], begin: float, end: float) -> tuple[CarCurve, ...]:
    """Return the curves between two lengths along all of them [m]."""
    kept, passed = [], 0.0
    for curve in curves:
        part = curve.part(begin - passed, min(end - passed, curve.length))
        passed += curve.length
        if part.lengths.size:
            kept.append(part)
    return tuple(kept)


@compiled("boolean(SearchSpace, Car, float64[::1], float64[:, ::1], float64, int64[::1])")
def curve_is_free(
    space: SearchSpace, car: Car, a: Floats1, pieces: Floats2, length: float, counters: Ints1
) -> bool:
    """Return whether a curve stays in the box and all its states are valid, those far apart first.

    Args:
        space: The space.
        car: How the car turns.
        a: Where the curve begins.
        pieces: See `car_curves`.
        length: How much of the curve is looked at [m].
        counters: Of the planner.
    """
    pose, steps = np.empty(3), max(1, math.ceil(length * car.rate / space.resolution))
    for first in range(_STRIDE, 0, -1):
        for k in range(first, steps + 1, _STRIDE):
            pose_on_curve(a, pieces, car.radius, length * k / steps, pose)
            for i in range(2):
                if not 0.0 <= pose[i] - space.lower[i] <= space.extent[i]:
                    return False
            if last_valid_step(space, pose, pose, 1, counters) != 1:
                return False
    return True


@compiled
def _nearest(trees: CarTrees, car: Car, side: int, target: Floats1) -> int:
    """Return the node from which the curve to a pose (or to which that from it) is shortest."""
    best, found, pieces = math.inf, -1, trees.pieces[0]
    for k in range(trees.counters[START_SIZE + side]):
        node = trees.poses[side, k]
        if math.hypot(node[0] - target[0], node[1] - target[1]) >= best:
            continue
        if side == 0:
            length = shortest_curve(node, target, car.radius, car.backward, pieces)
        else:
            length = shortest_curve(target, node, car.radius, car.backward, pieces)
        if length < best:
            best, found = length, k
    return found


@compiled
def _edge_is_free(space: SearchSpace, car: Car, trees: CarTrees, side: int, node: int, pose: Floats1) -> bool:
    """Return whether the curve between a node and a pose, towards the goals, is free."""
    own, pieces = trees.poses[side, node], trees.pieces[1]
    first = own if side == 0 else pose
    last = pose if side == 0 else own
    length = shortest_curve(first, last, car.radius, car.backward, pieces)
    return curve_is_free(space, car, first, pieces, length, trees.counters)


@compiled("int64(SearchSpace, Car, CarTrees, float64, uint64)")
def grow_car(space: SearchSpace, car: Car, trees: CarTrees, seconds: float, key: np.uint64) -> int:
    """Grow the smaller of two trees until they meet; see the module.

    Args:
        space: Box, metric and validity.
        car: How the car turns.
        trees: The trees.
        seconds: Time budget [s].
        key: Of the stream of random numbers.

    Returns:
        FOUND (counters[START_NODE] and counters[GOAL_NODE] are joined by a curve), TIME_UP or FULL.
    """
    counters, room = trees.counters, np.empty(2, np.int64)
    sample, new, pieces = trees.rows[0], trees.rows[1], trees.pieces[1]
    end = seconds_now(space.clock, room) + seconds
    while True:
        if counters[STOP] != 0 or seconds_now(space.clock, room) >= end:
            return TIME_UP
        if max(counters[START_SIZE], counters[GOAL_SIZE]) >= trees.parents.shape[1]:
            return FULL
        number = counters[ITERATIONS]
        counters[ITERATIONS] += 1
        side = 0 if counters[START_SIZE] <= counters[GOAL_SIZE] else 1
        if number > 0:  # first of all, the curves between the roots
            for i in range(2):
                sample[i] = space.lower[i] + space.extent[i] * uniform(key, 3 * number + i)
            sample[2] = math.pi * (2.0 * uniform(key, 3 * number + 2) - 1.0)
            near = _nearest(trees, car, side, sample)
            own = trees.poses[side, near]
            if side == 0:
                length = shortest_curve(own, sample, car.radius, car.backward, pieces)
                pose_on_curve(own, pieces, car.radius, min(length, car.reach), new)
            else:
                length = shortest_curve(sample, own, car.radius, car.backward, pieces)
                pose_on_curve(sample, pieces, car.radius, max(length - car.reach, 0.0), new)
            if not _edge_is_free(space, car, trees, side, near, new):
                continue
            node = counters[START_SIZE + side]
            for i in range(3):
                trees.poses[side, node, i] = new[i]
            trees.parents[side, node] = near
            counters[START_SIZE + side] += 1
        else:
            side, node = 0, 0
        meeting = _nearest(trees, car, 1 - side, trees.poses[side, node])
        if _edge_is_free(space, car, trees, 1 - side, meeting, trees.poses[side, node]):
            counters[START_NODE + side], counters[GOAL_NODE - side] = node, meeting
            return FOUND
