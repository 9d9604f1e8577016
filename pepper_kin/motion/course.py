"""Search, short-cuts, rounding and examination of a motion, in machine code."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.collision.check import set_margins
from pepper_kin.core.collision.curve_check import MotionCheck, blocked, is_clear
from pepper_kin.core.splines import bounded_cubic_spline
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1
from pepper_kin.planners.rejoin import Route, shortest_end
from pepper_kin.planners.search_space import SearchSpace
from pepper_kin.planners.shortcut import (
    FLAT,
    GAINED,
    ITERATIONS,
    SIZE,
    TIME_UP,
    Polyline,
    drop_flat,
    measure,
    shorten,
    skip_ahead,
)
from pepper_kin.planners.shortcut import FULL as LINE_FULL
from pepper_kin.planners.smooth import schoenberg_spline
from pepper_kin.planners.tree_growth import (
    FOUND,
    FULL,
    GOING_ON,
    ROUND,
    Trees,
    first_round,
    trace,
    way_point_count,
)
from pepper_kin.planners.tree_growth import ITERATIONS as SAMPLES
from pepper_kin.trajectory.path import LIMIT_TOLERANCE, SAME

SHORTCUTS_TO_COMPARE, GAIN_TO_COMPARE, GAIN_OF_OTHER = 40, 0.02, 0.01
"""Short-cuts tried before other goals are, what each has to save, and what another goal has to, as parts of
the length."""
SHORTCUTS, PATIENCE, LEAST_GAIN = 120, 60, 0.005
"""Short-cuts tried on the way that is rounded, after how many in a row without a gain no more are, and what
each has to save as a part of the length."""
FEWEST, MOST = 6, 48
"""Segments of a path that is rounded everywhere alike: as many, doubled until it is clear, up to the most."""

# Where a call begins, and goes on after it has ended early.
SEARCH, BEGIN, SHORTEN, ROUNDING = range(4)

# How a call ends.
DONE, SEARCH_ENDED, OUT_OF_TIME, TOO_MANY_POINTS, LEAVES_LIMITS, NOT_CLEAR = range(6)

# Places in `progress`.
STAGE, SEGMENTS, GOAL, FOUND_SIZE, ENDED, COMPARED = range(6)


class Course(NamedTuple):
    """All that a call needs.

    Attributes:
        space: Box, metric and validity of the k joints that move, of which the memory is `check.moving`.
        trees: Of the search.
        line: The path that is shortened.
        check: Checks of whole configurations.
        start: Start, shape (k,).
        goals: Goals, shape (m, k).
        order: Goals in the order in which they are tried, shape (m,).
        found: Receives the path of the search, progress[FOUND_SIZE] points, as many rows as `line` has.
        free: Places of the joints that move, shape (k,).
        limits: Lower and upper limits of all joints, shape (2, n).
        reach: How far a joint moves a point of the body, shape (n,), see `motion_bounds`.
        margins: Kept by the path to the scene and to the robot itself [m].
        relaxed: Kept by the curve [m].
        strictly: Whether its margin to the scene is to be proven at every point.
        points: Receives way-points, progress[SEGMENTS] + 1 of them, shape (MOST + 1, n).
        breaks: Receives the breaks of the spline through them, shape (MOST + 1,).
        coefficients: Receives its coefficients, shape (MOST, 4, n).
        cost: Receives the length of the path that was found, in the metric, shape (1,).
        progress: See the places above.
    """

    space: SearchSpace
    trees: Trees
    line: Polyline
    check: MotionCheck
    start: Floats1
    goals: Floats2
    order: Ints1
    found: Floats2
    free: Ints1
    limits: Floats2
    reach: Floats1
    margins: Floats1
    relaxed: Floats1
    strictly: bool
    points: Floats2
    breaks: Floats1
    coefficients: Floats3
    cost: Floats1
    progress: Ints1


@compiled
def _copy_row(source: Array, target: Array) -> None:
    """Copy an array, shape (n,), into another of the same shape."""
    for i in range(source.size):
        target[i] = source[i]


@compiled
def _search(course: Course, seconds: float, key: np.uint64) -> int:
    """Search in a first round; return FOUND or how it ended.  See `rrt_connect`."""
    trees, progress = course.trees, course.progress
    start, goals, order = course.start, course.goals, course.order
    progress[ENDED] = first_round(course.space, trees, seconds, start, goals, order, key, ROUND)
    used_up = progress[ENDED] == GOING_ON and trees.counters[SAMPLES] > 0
    return FULL if used_up else progress[ENDED]


@compiled
def _take_path(course: Course) -> int:
    """Write the path along which the trees have met into `line`; return its length, 0 for too many points."""
    line, count = course.line, way_point_count(course.trees)
    if count > line.points.shape[0]:
        return 0
    course.progress[GOAL] = trace(course.space, course.trees, line.points[:count], line.lengths[0][:count])
    return count


@compiled
def _begin_shortening(course: Course, size: int) -> None:
    """Get the first points of `line` ready to be shortened."""
    line, weights = course.line, course.space.weights
    measure(line.points, size, weights, line.lengths[0])
    line.counters[ITERATIONS] = line.counters[GAINED] = 0
    line.counters[SIZE] = drop_flat(line.points, size, weights, FLAT * line.lengths[0, size - 1])


@compiled
def _compare_goals(course: Course, key: np.uint64) -> None:
    """Let the path end at another goal where that makes it shorter; see `rejoin`.

    The few short-cuts are all tried, however slow the machine is: the path must not depend on its load.
    """
    line, space, size = course.line, course.space, course.line.counters[SIZE]
    _begin_shortening(course, size)
    shorten(space, line, math.inf, GAIN_TO_COMPARE, key, SHORTCUTS_TO_COMPARE, SHORTCUTS_TO_COMPARE, False)
    size = line.counters[SIZE]
    measure(line.points, size, space.weights, line.lengths[0])
    order, tried = course.order, 0
    for k in range(order.size):
        if k != course.progress[GOAL]:
            order[tried] = k
            tried += 1
    route = Route(line.points[:size], line.lengths[0][:size])
    gain = GAIN_OF_OTHER * line.lengths[0, size - 1]
    last = shortest_end(space, route, course.goals, order[:tried], gain, line.rows, line.counters)
    if last >= 0:
        _copy_row(course.goals[order[0]], line.points[last + 1])
        course.progress[GOAL], line.counters[SIZE] = order[0], last + 2


@compiled
def _write_waypoints(course: Course, segments: int, size: int) -> None:
    """Write the way-points of the rounded path; see `rounded_waypoints`."""
    line, lengths, points, check = course.line, course.line.lengths[0], course.points, course.check
    breaks, abscissae = np.empty(segments + 1), np.empty(segments + 3)
    coefficients = np.empty((segments, 4, course.free.size))
    for i in range(segments + 1):
        breaks[i] = lengths[size - 1] * i / segments
    schoenberg_spline(line.points[:size], lengths[:size], breaks, abscissae, coefficients)
    for i in range(segments + 1):
        for j in range(check.standing.size):
            points[i, j] = check.standing[j]
        for j in range(course.free.size):
            value = line.points[size - 1, j] if i == segments else coefficients[i, 0, j]
            low = course.space.lower[j]
            points[i, course.free[j]] = min(max(value, low), low + course.space.extent[j])


@compiled
def _round(course: Course) -> int:
    """Look for few way-points along a path that is rounded everywhere alike whose spline is clear."""
    line, progress, check = course.line, course.progress, course.check
    size, relaxed = line.counters[SIZE], course.relaxed
    measure(line.points, size, course.space.weights, line.lengths[0])
    while progress[SEGMENTS] <= MOST:
        segments = progress[SEGMENTS]
        _write_waypoints(course, segments, size)
        points, breaks, coefficients = (
            course.points[: segments + 1],
            course.breaks[: segments + 1],
            course.coefficients[:segments],
        )
        low, high = course.limits[0], course.limits[1]
        if bounded_cubic_spline(points, low, high, SAME, breaks, coefficients) > LIMIT_TOLERANCE:
            return LEAVES_LIMITS
        kept, kept_self, strictly = relaxed[0], relaxed[1], course.strictly
        if is_clear(check, breaks, coefficients, course.reach, kept, kept_self, True, strictly):
            return DONE
        progress[SEGMENTS] *= 2
    return NOT_CLEAR


@compiled("int64(Course, float64, uint64, uint64)")
def run(course: Course, seconds: float, key: np.uint64, shortcut_key: np.uint64) -> int:
    """Search a path, shorten and round it, and examine the curve; go on where the last call has ended.

    Args:
        course: What is planned, and how far it has come: progress[STAGE] is where to begin.
        seconds: Time budget of search and short-cuts [s].
        key: Of the stream of random numbers of the search.
        shortcut_key: Of that of the short-cuts.

    Returns:
        DONE, with progress[SEGMENTS] + 1 way-points; SEARCH_ENDED where the search has to go on elsewhere or
        found nothing (progress[ENDED] is how it ended); OUT_OF_TIME or TOO_MANY_POINTS while it shortens;
        LEAVES_LIMITS where the spline through the way-points does; NOT_CLEAR where none of the splines is.
    """
    progress, line = course.progress, course.line
    check, margins = course.check, course.margins
    set_margins(check.moving, margins[0], margins[1], check.radius)
    if progress[STAGE] == SEARCH:
        if blocked(check, margins[0], margins[1]):
            return SEARCH_ENDED
        if _search(course, seconds, key) != FOUND:
            return SEARCH_ENDED
        line.counters[SIZE] = _take_path(course)
        if line.counters[SIZE] == 0:
            return SEARCH_ENDED
        if progress[COMPARED] != 0 and course.goals.shape[0] > 1:
            _compare_goals(course, shortcut_key)
        progress[FOUND_SIZE] = line.counters[SIZE]
        for k in range(progress[FOUND_SIZE]):
            _copy_row(line.points[k], course.found[k])
        measure(line.points, line.counters[SIZE], course.space.weights, line.lengths[0])
        course.cost[0] = line.lengths[0, line.counters[SIZE] - 1]
        progress[STAGE] = BEGIN
    if progress[STAGE] == BEGIN:
        _begin_shortening(course, line.counters[SIZE])
        skip_ahead(course.space, line)
        progress[STAGE] = SHORTEN
    if progress[STAGE] == SHORTEN:
        ended = shorten(course.space, line, seconds, LEAST_GAIN, shortcut_key, SHORTCUTS, PATIENCE, False)
        if ended == TIME_UP:
            return OUT_OF_TIME
        if ended == LINE_FULL:
            return TOO_MANY_POINTS
        progress[STAGE] = ROUNDING
    return _round(course)
