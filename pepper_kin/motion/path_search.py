"""Search, shortcuts, smoothing and examination of a path, in one call of machine code.

`run` does all steps from start and goals to an examined curve, with functions that `planners` offers
separately.  It returns early if an array is full, time is up, or Python has to decide; `PathSearch` provides
the arrays, which are reused by the next call, supplies what is missing, and calls `run` again from the next
stage.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.core.clock import CLOCK
from pepper_kin.core.collision.check import set_margins
from pepper_kin.core.collision.curve_check import MotionCheck, blocked, is_clear
from pepper_kin.core.splines import bounded_cubic_spline
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1
from pepper_kin.motion.problem import PathProblem
from pepper_kin.motion.waypoints import Way, way_near, way_through
from pepper_kin.planners.compiled import (
    CALLS,
    FLAT,
    FOUND,
    GAINED,
    GOAL,
    ITERATIONS,
    LINE_FULL,
    LONGEST_STEP,
    ROUND,
    SIZE,
    STATES,
    STREAM,
    WAY_POINTS,
    PathEnds,
    PausedClock,
    Polyline,
    Search,
    SearchSpace,
    Slices,
    Trees,
    drop_flat,
    first_round,
    grown,
    last_valid_step,
    machine_code_of,
    measure,
    new_polyline,
    schoenberg_spline,
    shorten,
    shortest_end,
    sine_waypoints,
    skip_ahead,
    straighten_each,
    stream_key,
    take_trees,
    whole,
    with_room,
)
from pepper_kin.planners.compiled import LINE_TIME_UP as TIME_UP
from pepper_kin.planners.compiled import PathTable as Route
from pepper_kin.trajectory.path import LIMIT_TOLERANCE, SAME, known_path

SHORTCUTS_TO_COMPARE, GAIN_TO_COMPARE, GAIN_OF_OTHER = 40, 0.02, 0.01
"""Number of shortcuts tried before other goals, minimum gain of each, and minimum gain of another goal;
gains are relative to the length."""
SHORTCUTS, PATIENCE, LEAST_GAIN = 120, 60, 0.005
"""Maximum number of shortcuts before smoothing, number of successive ones without a gain that ends them, and
minimum gain of each, relative to the length."""
FEWEST, MOST = 6, 48
"""Minimum and maximum number of segments of a uniformly smoothed path; it is doubled until it is clear."""

SINES = ((1, 1.1), (2, 1.1), (3, 1.1), (1, 1.25), (2, 1.25))
"""Numbers of sines, and factors of amplitudes, of the curves tried first; see `sine_waypoints`."""

SAMPLES_TO_FIRST = 512
"""Number of samples of a search for a path to the preferred goal, before a search to all goals."""

SHARE_OF_TIME = 0.02
"""Fraction of the time budget for shortcuts before other goals, if they are not part of the search."""

# Stages at which a call may begin.
SEARCH, SHORTEN, SHORTEN_ON, ROUNDING = range(4)

# Statuses of a call.
DONE, SEARCH_ENDED, OUT_OF_TIME, TOO_MANY_POINTS, LEAVES_LIMITS, NOT_CLEAR = range(6)

_NODES, _POINTS = 4096, 512  # sizes of a workspace: nodes of each tree, points of a line
_LOOKED_AT = 8  # number of states checked first on a straight way


class PlannerPath(NamedTuple):
    """Path of a search.

    Attributes:
        points: Points of the path, shape (m, k), of which the first `size` count.
        size: Number of points, shape (1,).
        goal: Index of the goal that the path ends at, shape (1,).
        cost: Length of the path in the metric, shape (1,).
    """

    points: Floats2
    size: Ints1
    goal: Ints1
    cost: Floats1


class Spline(NamedTuple):
    """A spline through waypoints.

    Attributes:
        points: Waypoints, shape (MOST + 1, n), of which the first segments[0] + 1 count.
        breaks: Ends of the segments, shape (MOST + 1,).
        coefficients: Coefficients of each segment, constant term first, shape (MOST, 4, n).
        segments: Number of segments, shape (1,).
    """

    points: Floats2
    breaks: Floats1
    coefficients: Floats3
    segments: Ints1


class PlanningState(NamedTuple):
    """Data of a path search for compiled functions.

    Attributes:
        space: Box, metric and validity of the k joints that move; its memory is `check.moving`.
        check: Checks of whole configurations.
        ends: Start, shape (k,), and goals, shape (m, k).
        compare: Whether the path may end at another goal if that makes it shorter.
        prefer: Whether the first goal is preferred to nearer ones, if there is a path to it.
        free: Indices of the joints that move, shape (k,).
        limits: Lower and upper limits of all joints, shape (2, n).
        reach: Bounds on how far each joint moves a point of the body, shape (n,), see `motion_bounds`.
        margins: Margins of the path to the scene and of the robot to itself [m], shape (2,).
        relaxed: Margins of the curve [m], shape (2,).
        strictly: Whether the curve's margin to the scene must be proven at every point.
        trees: Trees of the search.
        line: The path that is shortened.
        found: Receives the path of the search; it has as many rows as `line`.
        spline: Receives the spline through few points of the shortened path.
    """

    space: SearchSpace
    check: MotionCheck
    ends: PathEnds
    compare: bool
    prefer: bool
    free: Ints1
    limits: Floats2
    reach: Floats1
    margins: Floats1
    relaxed: Floats1
    strictly: bool
    trees: Trees
    line: Polyline
    found: PlannerPath
    spline: Spline


@compiled
def _copy_row(source: Array, target: Array) -> None:
    """Copy an array, shape (n,), into another of the same shape."""
    for i in range(source.size):
        target[i] = source[i]


@compiled
def _begin_shortening(state: PlanningState, size: int) -> None:
    """Prepare the first `size` points of `line` for shortening."""
    line, weights = state.line, state.space.weights
    measure(line.points, size, weights, line.lengths[0])
    line.counters[ITERATIONS] = line.counters[GAINED] = 0
    line.counters[SIZE] = drop_flat(line.points, size, weights, FLAT * line.lengths[0, size - 1])


@compiled
def _compare_goals(state: PlanningState, key: np.uint64) -> None:
    """Let the path end at another goal if that makes it shorter; see `rejoin`.

    All shortcuts are tried regardless of time, so that the path does not depend on the machine's load.
    """
    line, space, size = state.line, state.space, state.line.counters[SIZE]
    _begin_shortening(state, size)
    shorten(space, line, math.inf, GAIN_TO_COMPARE, key, SHORTCUTS_TO_COMPARE, SHORTCUTS_TO_COMPARE, False)
    size = line.counters[SIZE]
    measure(line.points, size, space.weights, line.lengths[0])
    goals, order, tried = state.ends.goals, state.ends.order, 0
    for k in range(order.size):
        if k != state.found.goal[0]:
            order[tried] = k
            tried += 1
    route = Route(line.points[:size], line.lengths[0][:size])
    gain = GAIN_OF_OTHER * line.lengths[0, size - 1]
    last = shortest_end(space, route, goals, order[:tried], gain, line.rows, line.counters)
    if last >= 0:
        _copy_row(goals[order[0]], line.points[last + 1])
        state.found.goal[0], line.counters[SIZE] = order[0], last + 2


@compiled
def _write_waypoints(state: PlanningState, size: int, waves: int, scale: float) -> None:
    """Write the waypoints of the smoothed path, see `rounded_waypoints`, or of sines; see `sine_waypoints`.

    Args:
        state: Data of the search.
        size: Number of points of the path.
        waves: Number of sines; 0 for the smoothed path.
        scale: Factor of the sines' amplitudes.
    """
    points, segments, standing = state.spline.points, state.spline.segments[0], state.check.standing
    path, lengths = state.line.points[:size], state.line.lengths[0][:size]
    curve = np.empty((segments + 1, state.free.size))
    if waves > 0:
        sine_waypoints(path, lengths, waves, scale, curve)
    else:
        breaks, abscissae = np.empty(segments + 1), np.empty(segments + 3)
        coefficients = np.empty((segments, 4, state.free.size))
        for i in range(segments + 1):
            breaks[i] = lengths[size - 1] * i / segments
        schoenberg_spline(path, lengths, breaks, abscissae, coefficients)
        for i in range(segments):
            _copy_row(coefficients[i, 0], curve[i])
        _copy_row(path[size - 1], curve[segments])
    for i in range(segments + 1):
        _copy_row(standing, points[i])
        for j in range(state.free.size):
            low = state.space.lower[j]
            points[i, state.free[j]] = min(max(curve[i, j], low), low + state.space.extent[j])


@compiled
def _try_spline(state: PlanningState, margins: Floats1, waves: int, scale: float) -> int:
    """Write the spline through waypoints, see `_write_waypoints`, and examine it at margins [m].

    Return DONE if it is clear, LEAVES_LIMITS or NOT_CLEAR.
    """
    spline, segments, size = state.spline, state.spline.segments[0], state.line.counters[SIZE]
    measure(state.line.points, size, state.space.weights, state.line.lengths[0])
    _write_waypoints(state, size, waves, scale)
    points, breaks = spline.points[: segments + 1], spline.breaks[: segments + 1]
    coefficients = spline.coefficients[:segments]
    low, high = state.limits[0], state.limits[1]
    if bounded_cubic_spline(points, low, high, SAME, breaks, coefficients) > LIMIT_TOLERANCE:
        return LEAVES_LIMITS
    check, reach, kept, kept_self = state.check, state.reach, margins[0], margins[1]
    clear = is_clear(check, breaks, coefficients, reach, kept, kept_self, True, state.strictly)
    return DONE if clear else NOT_CLEAR


@compiled
def _round(state: PlanningState) -> int:
    """Search few waypoints whose spline is clear: of sines, then along a uniformly smoothed path."""
    count = state.spline.segments
    if count[0] == FEWEST and state.line.counters[SIZE] > 2:
        for waves, scale in SINES:
            if _try_spline(state, state.relaxed, waves, scale) == DONE:
                return DONE
    while count[0] <= MOST:
        ended = _try_spline(state, state.relaxed, 0, 1.0)
        if ended != NOT_CLEAR:
            return int(ended)
        count[0] *= 2
    return NOT_CLEAR


@compiled
def _is_straight(state: PlanningState) -> bool:
    """Whether the straight way to the nearest goal keeps the path's margins everywhere; write it if so.

    A search would find the same path, and its examination the same curve.  Some states along the way are
    checked first.
    """
    space, line, goal = state.space, state.line, state.ends.order[0]
    if state.spline.segments[0] > MOST:
        return False
    start, end = state.ends.start, state.ends.goals[goal]
    if last_valid_step(space, start, end, _LOOKED_AT, line.counters) < _LOOKED_AT:
        return False
    _copy_row(start, line.points[0])
    _copy_row(end, line.points[1])
    line.counters[SIZE], state.found.goal[0] = 2, goal
    if _try_spline(state, state.margins, 0, 1.0) != DONE:
        return False
    state.trees.counters[STATES], state.trees.counters[CALLS] = line.counters[STATES], line.counters[CALLS]
    return True


@compiled
def _keep_found(state: PlanningState) -> None:
    """Copy the path in `line` to `found`, as the path of the search."""
    line, found = state.line, state.found
    size = found.size[0] = line.counters[SIZE]
    for k in range(size):
        _copy_row(line.points[k], found.points[k])
    measure(line.points, size, state.space.weights, line.lengths[0])
    found.cost[0] = line.lengths[0, size - 1]


@compiled
def _find(state: PlanningState, seconds: float, key: np.uint64, shortcut_key: np.uint64) -> bool:
    """Write the path of a first round of search to `line` and `found`; return whether there is one.

    The search is `rrt_connect`.
    """
    space, trees, line, found, ends = state.space, state.trees, state.line, state.found, state.ends
    set_margins(state.check.moving, state.margins[0], state.margins[1], state.check.radius)
    if state.prefer:
        first = PathEnds(ends.start, ends.goals[:1], ends.order[:1])
        ended = first_round(space, trees, seconds, first, line.points, line.lengths[0], key, SAMPLES_TO_FIRST)
        if ended == FOUND and trees.counters[WAY_POINTS] > 0:
            found.goal[0], line.counters[SIZE] = 0, trees.counters[WAY_POINTS]
            _keep_found(state)
            return True
        for k in range(trees.counters.size):
            trees.counters[k] = trees.counters[k] if k in (STATES, CALLS) else 0
    ended = first_round(space, trees, seconds, ends, line.points, line.lengths[0], key, ROUND)
    if ended != FOUND or trees.counters[WAY_POINTS] == 0:
        return False
    found.goal[0], line.counters[SIZE] = trees.counters[GOAL], trees.counters[WAY_POINTS]
    if state.compare and state.ends.goals.shape[0] > 1:
        _compare_goals(state, shortcut_key)
    _keep_found(state)
    return True


@compiled("int64(PlanningState, int64, float64, uint64, uint64)")
def run(state: PlanningState, stage: int, seconds: float, key: np.uint64, shortcut_key: np.uint64) -> int:
    """Search a path, shorten and smooth it, and examine the curve.

    Args:
        state: Data of the search.
        stage: First stage: SEARCH; SHORTEN, for a path in `line`; SHORTEN_ON, to continue the last call; or
            ROUNDING, for a short path in `line`.
        seconds: Time budget of search and shortcuts [s].
        key: Key of the random stream of the search.
        shortcut_key: Key of the random stream of the shortcuts.

    Returns:
        DONE, with the waypoints in `spline`; SEARCH_ENDED if the search found nothing yet; OUT_OF_TIME or
        TOO_MANY_POINTS while shortening; LEAVES_LIMITS if the spline leaves the position limits; NOT_CLEAR if
        no spline is clear.
    """
    space, line, check, margins = state.space, state.line, state.check, state.margins
    set_margins(check.moving, margins[0], margins[1], check.radius)
    if stage == SEARCH:
        if blocked(check, margins[0], margins[1]):
            return SEARCH_ENDED
        if _is_straight(state):
            _keep_found(state)
            return DONE
        if not _find(state, seconds, key, shortcut_key):
            return SEARCH_ENDED
    if stage <= SHORTEN:
        _begin_shortening(state, line.counters[SIZE])
        skip_ahead(space, line)
        straighten_each(space, line, LEAST_GAIN)
    if stage <= SHORTEN_ON:
        ended = shorten(space, line, seconds, LEAST_GAIN, shortcut_key, SHORTCUTS, PATIENCE, False)
        if ended == TIME_UP:
            return OUT_OF_TIME
        if ended == LINE_FULL:
            return TOO_MANY_POINTS
    return _round(state)


class _Workspace(NamedTuple):
    """Arrays of one call, reused by the next call of the same sizes."""

    trees: Trees
    line: Polyline
    found: PlannerPath
    spline: Spline


_local = threading.local()


@contextmanager
def _workspace(n: int, k: int) -> Iterator[_Workspace]:
    """Provide arrays for n joints of which k move, until the context ends."""
    kept: dict[tuple[int, int], _Workspace] = _local.__dict__.setdefault("kept", {})
    workspace = kept.pop((n, k), None)
    if workspace is None:
        trees = with_room(take_trees(k), _NODES)
        line, count = new_polyline(np.empty((_POINTS, k))), np.zeros((3, 1), np.int64)
        found = PlannerPath(np.empty((_POINTS, k)), count[0], count[1], np.empty(1))
        points, breaks, coefficients = np.empty((MOST + 1, n)), np.empty(MOST + 1), np.empty((MOST, 4, n))
        workspace = _Workspace(trees, line, found, Spline(points, breaks, coefficients, count[2]))
    yield workspace
    kept[n, k] = workspace


class PathSearch:
    """Search of one path up to an examined curve.

    Args:
        problem: The planning problem.
        seed: Seed of all random choices.
        timeout: Time budget of search and shortcuts [s]; shortcuts may take a twentieth more.
        clock: Clock that measures the time and tells when to pause; None to search without pauses.
    """

    def __init__(
        self, problem: PathProblem, seed: int, timeout: float, clock: PausedClock | None = None
    ) -> None:
        self._problem, self._seed, self._timeout, self._clock = problem, seed, timeout, clock
        self._deadline = planners.Deadline(timeout, clock)
        self._keys = stream_key(seed, 0), stream_key(seed, STREAM)

    def searched(self, compare: bool) -> tuple[planners.Result, Way | None]:
        """Return the result of a search, and the examined way; None if no clear spline was found.

        Args:
            compare: Whether the path may end at another goal if that makes it shorter.
        """
        return whole(self.searching(compare))

    def searching(self, compare: bool) -> Slices[tuple[planners.Result, Way | None]]:
        """Search in slices, with pauses; the final value is the result of `searched`."""
        problem = self._problem
        with _workspace(problem.start.size, problem.free.size) as workspace:
            workspace.trees.counters[:] = 0
            status, state = yield from self._run(self._state(workspace, compare), SEARCH)
            if status != SEARCH_ENDED:
                return self._result(state), self._rounded(state, status)
            result = yield from self._elsewhere(state.trees)
        if compare:
            result = compared(problem.search_problem, result, self._seed, self._timeout)
        return result, None if result.path is None else (yield from self.shortening(result.path))

    def along(self, path: planners.Path) -> Way | None:
        """Shorten and smooth a valid path; return None if no clear spline was found."""
        return whole(self.shortening(path))

    def shortening(self, path: planners.Path) -> Slices[Way | None]:
        """Shorten and smooth in slices, with pauses; the final value is the result of `along`."""
        problem, short, stage = self._problem, path, SHORTEN
        if not problem.checks.compiled:
            stage = ROUNDING
            short = planners.shortcut(
                problem.search_problem, path, seed=self._seed, iterations=SHORTCUTS,
                resolution=problem.resolution, least_gain=LEAST_GAIN, timeout=self._timeout,
            )  # fmt: skip
        size = len(short)
        with _workspace(problem.start.size, problem.free.size) as workspace:
            if size >= len(workspace.line.points) // 2:
                points = np.empty((2 * size + _POINTS, path.n))
                workspace = workspace._replace(line=new_polyline(points))
            state = self._state(workspace, False)
            state.line.points[:size], state.line.counters[SIZE] = short.points, size
            status, state = yield from self._run(state, stage)
            return self._rounded(state, status, path)

    def _state(self, workspace: _Workspace, compare: bool) -> PlanningState:
        """Return the initial data of the search."""
        problem, box, goals = self._problem, self._problem.box, self._problem.moving_goals
        check = problem.checks.of_motion(problem.start, problem.free)
        workspace.line.counters[:] = 0
        bounded = math.isfinite(np.vdot(problem.reach, problem.reach))
        workspace.spline.segments[0] = FEWEST if bounded else MOST + 1  # bounds differ by curve
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
        order = np.arange(len(goals))
        prefer = compare and len(goals) > 1 and problem.checks.statics.balance is not None
        if len(goals) > 1 and not prefer:
            apart = (goals - problem.moving_start) * problem.metric.weights
            order = (apart * apart).sum(axis=1).argsort(kind="stable")
        margins, relaxed = np.array(problem.margins), np.array(problem.relaxed_margins)
        return PlanningState(
            space, check, PathEnds(problem.moving_start, goals, order), compare, prefer,
            problem.free, problem.limits, problem.reach, margins, relaxed, problem.strictly, *workspace,
        )  # fmt: skip

    def _run(self, state: PlanningState, stage: int) -> Slices[tuple[int, PlanningState]]:
        """Run to the end through all interruptions; return the status and the data.

        Other motions may use this thread's memory for checks in a pause, so it is prepared again.
        """
        checks, extended = self._problem.checks, False
        while True:
            status = int(checks.run(run, state, stage, self._deadline.time_slice, *self._keys))
            stage = SHORTEN_ON
            if status == OUT_OF_TIME:
                if self._deadline.expired:
                    stage = ROUNDING if extended else SHORTEN_ON
                    self._deadline, extended = planners.Deadline(self._timeout / 20, self._clock), True
                if self._deadline.pauses:
                    yield
                    check = checks.of_motion(self._problem.start, self._problem.free)
                    state = state._replace(check=check, space=state.space._replace(memory=check.moving))
            elif status == TOO_MANY_POINTS:
                line = new_polyline(grown(state.line.points, 2 * len(state.line.points)))
                line.counters[:] = state.line.counters
                state = state._replace(line=line)
            elif status == LEAVES_LIMITS:
                if self._bent(state) is not None:
                    return status, state
                state.spline.segments[0] *= 2
                stage = ROUNDING
            else:
                return status, state

    def _bent(self, state: PlanningState) -> Way | None:
        """Return the curve through waypoints that keeps the position limits, if it is clear."""
        points = state.spline.points[: state.spline.segments[0] + 1].copy()
        return way_through(self._problem, points, self._problem.relaxed_margins)

    def _rounded(self, state: PlanningState, status: int, path: planners.Path | None = None) -> Way | None:
        """Return the examined way, or one that follows the path more closely, or None."""
        points, breaks, coefficients, count = state.spline
        segments = int(count[0])
        if status == DONE:
            spline = breaks[: segments + 1].copy(), coefficients[:segments].copy()
            return Way(points[: segments + 1].copy(), known_path(self._problem.checks.pepper, *spline))
        if status == LEAVES_LIMITS:
            return self._bent(state)
        metric = self._problem.metric
        short = planners.Path.trusted(state.line.points[: state.line.counters[SIZE]].copy(), metric)
        if path is None:
            path = planners.Path.trusted(state.found.points[: state.found.size[0]].copy(), metric)
        return way_near(self._problem, (short, path))

    def _result(self, state: PlanningState) -> planners.Result:
        """Return the result of the search."""
        found = state.found
        path = planners.Path.trusted(found.points[: found.size[0]].copy(), self._problem.metric)
        return planners.Result.of_run(
            planners.Status.SOLVED, state.trees.counters, self._deadline, self._seed, path,
            int(found.goal[0]), cost=float(found.cost[0]),
        )  # fmt: skip

    def _elsewhere(self, trees: Trees) -> Slices[planners.Result]:
        """Continue the search beyond the first round, or begin it without `run`; return its result."""
        problem, deadline = self._problem.search_problem, self._deadline
        if deadline.pauses:
            yield
        if not trees.counters[ITERATIONS]:
            return planners.rrt_connect(problem, seed=self._seed, timeout=max(deadline.left, 1e-3))
        with machine_code_of(problem, deadline, counters=trees.counters) as code:
            search = Search(problem, code, trees, self._seed, None)
            status = yield from search.resuming(deadline)
        return search.ended(status, deadline, self._seed)


def compared(
    problem: planners.Problem, result: planners.Result, seed: int, timeout: float
) -> planners.Result:
    """Return a search's result, with a path to another goal if that is shorter."""
    if result.path is None or len(problem.goals) == 1:
        return result
    short = planners.shortcut(
        problem, result.path, seed=seed, iterations=SHORTCUTS_TO_COMPARE, resolution=problem.spacing,
        least_gain=GAIN_TO_COMPARE, timeout=SHARE_OF_TIME * timeout,
    )  # fmt: skip
    path, goal = planners.rejoin(problem, short, int(result.goal_index or 0), gain=GAIN_OF_OTHER)
    return replace(result, path=path, cost=path.length, goal_index=goal)
