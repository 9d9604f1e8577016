"""Search, short-cuts, rounding and examination of a motion in one call of machine code."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pepper_kin import planners
from pepper_kin.arrays import Array
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
    OUT_OF_TIME,
    ROUNDING,
    SEARCH,
    SEARCH_ENDED,
    SEGMENTS,
    SHORTCUTS,
    SHORTCUTS_TO_COMPARE,
    STAGE,
    TOO_MANY_POINTS,
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
from pepper_kin.planners.tree_growth import Trees, take_trees, with_capacity
from pepper_kin.trajectory.path import known_path

SHARE_OF_TIME = 0.02
"""Part of the time budget that the former may take where they are not made together with the search."""

_NODES, _POINTS = 4096, 512  # of a workspace: nodes of each tree, points of a line


class _Workspace(NamedTuple):
    """Arrays of one call, kept for the next one of the same sizes."""

    trees: Trees
    line: Polyline
    found: Array
    points: Array
    breaks: Array
    coefficients: Array


_local = threading.local()


@contextmanager
def _workspace(n: int, k: int) -> Iterator[_Workspace]:
    """Lend arrays for n joints of which k move."""
    kept: dict[tuple[int, int], _Workspace] = _local.__dict__.setdefault("kept", {})
    workspace = kept.pop((n, k), None)
    if workspace is None:
        line = new_polyline(np.empty((_POINTS, k)))
        spline = np.empty((MOST + 1, n)), np.empty(MOST + 1), np.empty((MOST, 4, n))
        trees = take_trees(k)
        if trees.states.shape[1] < _NODES:
            trees = with_capacity(trees, _NODES)
        workspace = _Workspace(trees, line, np.empty((_POINTS, k)), *spline)
    yield workspace
    kept[n, k] = workspace


class Pipeline:
    """One motion on its way to an examined curve.

    Args:
        problem: The planning problem.
        seed: Seed of all random choices.
        timeout: Time budget of search and short-cuts [s]; the latter may take a twentieth more.
    """

    def __init__(self, problem: PathProblem, seed: int, timeout: float) -> None:
        self._problem, self._seed, self._timeout = problem, seed, timeout
        self._deadline = planners.Deadline(timeout)
        self._keys = stream_key(seed, 0), stream_key(seed, STREAM)

    def searched(self, compare: bool) -> tuple[planners.Result, Way | None]:
        """Return what a search found, and the way along it; None where no spline was found that is clear.

        Args:
            compare: Whether the path may end at another goal where that is nearer.
        """
        problem = self._problem
        with _workspace(problem.start.size, problem.free.size) as workspace:
            workspace.trees.counters[:] = 0
            course = self._course(workspace, SEARCH)
            course.progress[COMPARED] = compare
            status, course = self._run(course)
            if status != SEARCH_ENDED:
                return self._result(course), self._rounded(course, status)
            result = self._elsewhere(course)
        if compare:
            result = compared(problem.search_problem, result, self._seed, self._timeout)
        return result, None if result.path is None else self.along(result.path)

    def along(self, path: planners.Path) -> Way | None:
        """Shorten and round a valid path; return None where no spline was found that is clear."""
        problem = self._problem
        short = path
        if not problem.checks.compiled:
            short = planners.shortcut(
                problem.search_problem, path, seed=self._seed, iterations=SHORTCUTS,
                resolution=problem.resolution, least_gain=LEAST_GAIN, timeout=self._timeout,
            )  # fmt: skip
        size = len(short)
        with _workspace(problem.start.size, problem.free.size) as workspace:
            if size >= len(workspace.line.points) // 2:
                points = np.empty((2 * size + _POINTS, path.n))
                workspace = workspace._replace(line=new_polyline(points))
            course = self._course(workspace, BEGIN if problem.checks.compiled else ROUNDING)
            course.line.points[:size], course.line.counters[SIZE] = short.points, size
            status, course = self._run(course)
            return self._rounded(course, status, path)

    def _course(self, workspace: _Workspace, stage: int) -> Course:
        problem, check = (
            self._problem,
            self._problem.checks.of_motion(self._problem.start, self._problem.free),
        )
        box, progress = problem.box, np.zeros(6, np.int64)
        workspace.line.counters[:] = 0
        progress[STAGE], progress[SEGMENTS] = stage, FEWEST
        if not np.isfinite(problem.reach).all():
            progress[SEGMENTS] = MOST + 1  # each curve has different bounds
        space = SearchSpace(
            validity=problem.checks.edges,
            memory=check.moving,
            clock=CLOCK,
            resolution=problem.resolution,
            reach=LONGEST_STEP * problem.diagonal,
            lower=box[0],
            extent=box[1] - box[0],
            weights=problem.metric.weights,
        )
        goals = problem.moving_goals
        order = np.zeros(len(goals), np.int64)
        if len(goals) > 1:
            order = np.argsort(problem.metric.distance(problem.moving_start, goals), kind="stable")
        margins, relaxed = np.array(problem.margins), np.array(problem.relaxed_margins)
        return Course(
            space, workspace.trees, workspace.line, check, problem.moving_start, goals, order,
            workspace.found, problem.free, problem.limits, problem.reach, margins, relaxed, problem.strictly,
            *workspace[3:], np.empty(1), progress,
        )  # fmt: skip

    def _run(self, course: Course) -> tuple[int, Course]:
        """Run to the end, whatever stops it meanwhile; return how it ended, and the course."""
        problem, extended = self._problem, False
        while True:
            status = int(problem.checks.run(run, course, self._deadline.time_slice, *self._keys))
            if status == OUT_OF_TIME and self._deadline.expired:
                if extended:
                    course.progress[STAGE] = ROUNDING
                self._deadline, extended = planners.Deadline(self._timeout / 20), True
            elif status == TOO_MANY_POINTS:
                size = 2 * len(course.line.points)
                line = new_polyline(grown(course.line.points, size))
                line.counters[:] = course.line.counters
                course = course._replace(line=line)
            elif status == LEAVES_LIMITS:
                if self._bent(course) is not None:
                    return status, course
                course.progress[SEGMENTS] *= 2
            elif status != OUT_OF_TIME:
                return status, course

    def _bent(self, course: Course) -> Way | None:
        """Return the curve through way-points that keeps the limits of joints, if it is clear."""
        points = course.points[: course.progress[SEGMENTS] + 1].copy()
        return way_through(self._problem, points, self._problem.relaxed_margins)

    def _rounded(self, course: Course, status: int, path: planners.Path | None = None) -> Way | None:
        """Return the way that was found, or one that follows the path more closely."""
        segments = int(course.progress[SEGMENTS])
        if status == DONE:
            spline = course.breaks[: segments + 1].copy(), course.coefficients[:segments].copy()
            curve = known_path(self._problem.checks.pepper, *spline)
            return Way(course.points[: segments + 1].copy(), curve)
        if status == LEAVES_LIMITS:
            return self._bent(course)
        metric = self._problem.metric
        short = planners.Path.trusted(course.line.points[: course.line.counters[SIZE]].copy(), metric)
        if path is None:
            path = planners.Path.trusted(course.found[: course.progress[FOUND_SIZE]].copy(), metric)
        return way_near(self._problem, (short, path))

    def _result(self, course: Course) -> planners.Result:
        """Return the result of the search."""
        counters, points = course.trees.counters, course.found[: course.progress[FOUND_SIZE]].copy()
        path = planners.Path.trusted(points, self._problem.metric)
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
        problem = self._problem.search_problem
        if not course.trees.counters[SAMPLES]:
            return planners.rrt_connect(problem, seed=self._seed, timeout=max(self._deadline.left, 1e-3))
        counters, deadline = course.trees.counters, self._deadline
        with machine_code_of(problem, deadline, counters=counters) as code:
            search = Search(problem, code, course.trees, self._seed, None)
            status = search.resumed(deadline)
        return search.ended(status, deadline, self._seed)


def way_along(problem: PathProblem, path: planners.Path, *, seed: int, timeout: float) -> Way | None:
    """Shorten and round a valid polyline of the joints that move.

    Args:
        problem: The planning problem.
        path: The polyline; its ends come first and last.
        seed: Seed of short-cuts.
        timeout: Time budget of short-cuts [s].

    Returns:
        Way-points and the spline through them, which has been examined; None where none is valid.
    """
    return Pipeline(problem, seed, timeout).along(path)


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
