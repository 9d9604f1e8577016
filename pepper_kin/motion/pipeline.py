"""From the ends of a motion to an examined curve in one call of machine code."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin import planners
from pepper_kin.core.clock import CLOCK
from pepper_kin.motion.course import (
    BEGIN,
    COMPARED,
    DONE,
    FEWEST,
    FOUND_SIZE,
    GAIN_OF_OTHER,
    GAIN_TO_COMPARE,
    GOAL,
    LEAST_GAIN,
    LEAVES_LIMITS,
    MOST,
    NO_ROOM,
    OUT_OF_TIME,
    PIECES,
    ROUNDING,
    SEARCH,
    SEARCH_ENDED,
    SHORTCUTS,
    SHORTCUTS_TO_COMPARE,
    STAGE,
    Course,
    run,
)
from pepper_kin.motion.problem import PathProblem
from pepper_kin.motion.waypoints import Way, way_near, way_through
from pepper_kin.planners.motion_validator import machine_code_of
from pepper_kin.planners.rrt_connect import LONGEST_STEP, Search
from pepper_kin.planners.sampling import stream_key
from pepper_kin.planners.search_space import CALLS, STATES, SearchSpace
from pepper_kin.planners.shortcut import SIZE, STREAM, Polyline, new_polyline
from pepper_kin.planners.tree import grown
from pepper_kin.planners.tree_growth import ITERATIONS as SAMPLES
from pepper_kin.planners.tree_growth import Trees, take_trees, with_room
from pepper_kin.trajectory.path import known_path

Array = NDArray[np.float64]

SHARE_OF_TIME = 0.02
"""Part of the time budget that the former may take where they are not made together with the search."""

_NODES, _POINTS = 4096, 512  # there is room for


class _Rooms(NamedTuple):
    """Arrays of one call, kept for the next one of the same sizes."""

    trees: Trees
    line: Polyline
    found: Array
    points: Array
    breaks: Array
    coefficients: Array


_local = threading.local()


@contextmanager
def _rooms(n: int, k: int) -> Iterator[_Rooms]:
    """Lend arrays for n joints of which k move."""
    kept: dict[tuple[int, int], _Rooms] = _local.__dict__.setdefault("kept", {})
    rooms = kept.pop((n, k), None)
    if rooms is None:
        line = new_polyline(np.empty((_POINTS, k)))
        spline = np.empty((MOST + 1, n)), np.empty(MOST + 1), np.empty((MOST, 4, n))
        trees = take_trees(k)
        if trees.states.shape[1] < _NODES:
            trees = with_room(trees, _NODES)
        rooms = _Rooms(trees, line, np.empty((_POINTS, k)), *spline)
    yield rooms
    kept[n, k] = rooms


class Pipeline:
    """One motion on its way to an examined curve.

    Args:
        room: The planning problem.
        seed: Seed of all random choices.
        timeout: Time budget of search and short-cuts [s]; the latter may take a twentieth more.
    """

    def __init__(self, room: PathProblem, seed: int, timeout: float) -> None:
        self._room, self._seed, self._timeout = room, seed, timeout
        self._deadline = planners.Deadline(timeout)
        self._keys = stream_key(seed, 0), stream_key(seed, STREAM)

    def searched(self, compare: bool) -> tuple[planners.Result, Way | None]:
        """Return what a search found, and the way along it; None where no spline was found that is clear.

        Args:
            compare: Whether the path may end at another goal where that is nearer.
        """
        room = self._room
        with _rooms(room.start.size, room.free.size) as rooms:
            rooms.trees.counters[:] = 0
            course = self._course(rooms, SEARCH)
            course.progress[COMPARED] = compare
            status, course = self._run(course)
            if status != SEARCH_ENDED:
                return self._result(course), self._rounded(course, status)
            result = self._elsewhere(course)
        if compare:
            result = compared(room.problem, result, self._seed, self._timeout)
        return result, None if result.path is None else self.along(result.path)

    def along(self, path: planners.Path) -> Way | None:
        """Shorten and round a valid path; return None where no spline was found that is clear."""
        room = self._room
        short = path
        if not room.checks.compiled:
            short = planners.shortcut(
                room.problem, path, seed=self._seed, iterations=SHORTCUTS, resolution=room.resolution,
                least_gain=LEAST_GAIN, timeout=self._timeout,
            )  # fmt: skip
        size = len(short)
        with _rooms(room.start.size, room.free.size) as rooms:
            if size >= len(rooms.line.points) // 2:
                points = np.empty((2 * size + _POINTS, path.n))
                rooms = rooms._replace(line=new_polyline(points))
            course = self._course(rooms, BEGIN if room.checks.compiled else ROUNDING)
            course.line.points[:size], course.line.counters[SIZE] = short.points, size
            status, course = self._run(course)
            return self._rounded(course, status, path)

    def _course(self, rooms: _Rooms, stage: int) -> Course:
        room, check = self._room, self._room.checks.of_motion(self._room.start, self._room.free)
        box, progress = room.box, np.zeros(6, np.int64)
        rooms.line.counters[:] = 0
        progress[STAGE], progress[PIECES] = stage, FEWEST
        if not np.isfinite(room.reach).all():
            progress[PIECES] = MOST + 1  # each curve has bounds of its own
        space = SearchSpace(
            validity=room.checks.edges,
            memory=check.moving,
            clock=CLOCK,
            resolution=room.resolution,
            reach=LONGEST_STEP * room.diagonal,
            lower=box[0],
            extent=box[1] - box[0],
            weights=room.metric.weights,
        )
        goals = room.moving_goals
        order = np.zeros(len(goals), np.int64)
        if len(goals) > 1:
            order = np.argsort(room.metric.distance(room.moving_start, goals), kind="stable")
        margins, relaxed = np.array(room.margins), np.array(room.relaxed_margins)
        return Course(
            space, rooms.trees, rooms.line, check, room.moving_start, goals, order, rooms.found,
            room.free, room.limits, room.reach, margins, relaxed, room.strictly, *rooms[3:], np.empty(1),
            progress,
        )  # fmt: skip

    def _run(self, course: Course) -> tuple[int, Course]:
        """Run to the end, whatever stops it meanwhile; return how it ended, and the course with its room."""
        room, extended = self._room, False
        while True:
            status = int(room.checks.run(run, course, self._deadline.time_slice, *self._keys))
            if status == OUT_OF_TIME and self._deadline.expired:
                if extended:
                    course.progress[STAGE] = ROUNDING
                self._deadline, extended = planners.Deadline(self._timeout / 20), True
            elif status == NO_ROOM:
                size = 2 * len(course.line.points)
                line = new_polyline(grown(course.line.points, size))
                line.counters[:] = course.line.counters
                course = course._replace(line=line)
            elif status == LEAVES_LIMITS:
                if self._bent(course) is not None:
                    return status, course
                course.progress[PIECES] *= 2
            elif status != OUT_OF_TIME:
                return status, course

    def _bent(self, course: Course) -> Way | None:
        """Return the curve through way-points that keeps the limits of joints, if it is clear."""
        points = course.points[: course.progress[PIECES] + 1].copy()
        return way_through(self._room, points, self._room.relaxed_margins)

    def _rounded(self, course: Course, status: int, path: planners.Path | None = None) -> Way | None:
        """Return the way that was found, or one that follows the path more closely."""
        pieces = int(course.progress[PIECES])
        if status == DONE:
            curve = known_path(course.breaks[: pieces + 1].copy(), course.coefficients[:pieces].copy())
            return Way(course.points[: pieces + 1].copy(), curve)
        if status == LEAVES_LIMITS:
            return self._bent(course)
        metric = self._room.metric
        short = planners.Path.trusted(course.line.points[: course.line.counters[SIZE]].copy(), metric)
        if path is None:
            path = planners.Path.trusted(course.found[: course.progress[FOUND_SIZE]].copy(), metric)
        return way_near(self._room, (short, path))

    def _result(self, course: Course) -> planners.Result:
        """Return the result of the search."""
        counters, points = course.trees.counters, course.found[: course.progress[FOUND_SIZE]].copy()
        path = planners.Path.trusted(points, self._room.metric)
        return planners.Result.trusted(
            status=planners.Status.SOLVED,
            path=path,
            goal_index=int(course.progress[GOAL]),
            cost=float(course.cost[0]),
            iterations=int(counters[SAMPLES]),
            states_checked=int(counters[STATES]),
            validity_calls=int(counters[CALLS]),
            time=self._deadline.elapsed,
            seed=self._seed,
        )

    def _elsewhere(self, course: Course) -> planners.Result:
        """Return the result of a search that goes on for longer, or of one that cannot begin."""
        problem = self._room.problem
        if not course.trees.counters[SAMPLES]:
            return planners.rrt_connect(problem, seed=self._seed, timeout=max(self._deadline.left, 1e-3))
        counters, deadline = course.trees.counters, self._deadline
        with machine_code_of(problem, deadline, counters=counters) as code:
            search = Search(problem, code, course.trees, self._seed, None)
            status = search.resumed(deadline)
        return search.ended(status, deadline, self._seed)


def way_along(room: PathProblem, path: planners.Path, *, seed: int, timeout: float) -> Way | None:
    """Shorten and round a valid polyline of the joints that move.

    Args:
        room: The planning problem.
        path: The polyline; its ends come first and last.
        seed: Seed of short-cuts.
        timeout: Time budget of short-cuts [s].

    Returns:
        Way-points and the spline through them, which has been examined; None where none is valid.
    """
    return Pipeline(room, seed, timeout).along(path)


def compared(
    problem: planners.Problem, result: planners.Result, seed: int, timeout: float
) -> planners.Result:
    """Return a search's result with a path that ends at another goal where that is nearer."""
    if result.path is None or len(problem.goals) == 1:
        return result
    short = planners.shortcut(
        problem, result.path, seed=seed, iterations=SHORTCUTS_TO_COMPARE, resolution=problem.spacing,
        least_gain=GAIN_TO_COMPARE, timeout=SHARE_OF_TIME * timeout,
    )  # fmt: skip
    path, goal = planners.rejoin(problem, short, int(result.goal_index or 0), gain=GAIN_OF_OTHER)
    return replace(result, path=path, cost=path.length, goal_index=goal)
