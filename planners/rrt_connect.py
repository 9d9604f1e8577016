"""Bidirectional RRT-Connect for one or several goals."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np

from pepper_kin.kernels.signatures import Ints1

from .deadline import Deadline, Slices, load_code, whole
from .frontier import spread
from .motion_validator import CompiledMotionValidator, machine_code_of
from .path import Path
from .problem import BETWEEN_DRAWS, GoalSource, Problem
from .result import Result, Status
from .sampling import luby, stream_key
from .search_space import ITERATIONS, STOP, last_valid_step, space_of
from .tree import (
    ABREAST,
    BY_EDGE,
    FAR,
    FOUND,
    FULL,
    GOAL_SIZE,
    GOING_ON,
    START_SIZE,
    TIME_UP,
    Trees,
    leave_trees,
    take_trees,
    with_room,
)
from .tree_growth import (
    BOUND,
    COST,
    GOAL,
    GREW,
    RADIUS,
    ROUND,
    SMALL,
    START_INVALID,
    TRIED,
    WAY_POINTS,
    WIDTH,
    WITHIN,
    PathEnds,
    diagonal_of,
    first_round,
    grow,
    narrow,
    plant,
    write_path,
)
from .vectors import FloatArray, positive_number, seed_number, whole_number

LONGEST_STEP = 0.1  # maximum length of an extension relative to the box's diagonal
# A tree is shut in if it has tried at least so many samples, and grew at a lower rate per sample or to a
# smaller extent in diagonals.
_SHUT_IN_SAMPLES, _SHUT_IN_RATE, _SHUT_IN_EXTENT = 1000, 0.002, 0.25
_MOST_SAMPLES = 100_000_000
_NEAR_ROUND = 1024  # samples of a round in the region that is `WIDTH` straight lines wide; both double
_FIRST = np.zeros(1, dtype=np.int64)  # order of a single goal
_FIRST_POINTS = 256  # number of waypoints in the workspace of a first round


def rrt_connect(
    problem: Problem,
    *,
    seed: int = 0,
    timeout: float = 5.0,
    max_iterations: int = _MOST_SAMPLES,
    step: float | None = None,
) -> Result:
    """Search a path with two trees that grow towards samples and towards each other.

    First, the straight edges from the start to the goals are tried, nearest goal first.  Then one tree grows
    from the start and one from all valid goals at once.  A tree is extended from its node nearest to a
    uniform sample towards the sample, by no more than `step`; if that edge is valid, the tree goes on to the
    nearest node of the other tree in equal parts, as far as they are valid.  If it reaches that node, the
    path is found.  The trees take turns until one has twice the nodes of the other; then the smaller one
    grows alone, since the search must find a way out of it.  A node from which an extension failed is used
    only for samples in a ball around it.  RRT-Connect mostly finds a path soon or runs for very long; so it
    restarts, with other samples, after rounds of 1, 1, 2, 1, 1, 2, 4, 1, 1, 2, ... times 16,384 samples.  If
    the box is far wider than the distance of start and goals, as with a base that drives, shorter rounds come
    first that draw samples near the ends only, each from twice as far as the round before.

    Sources: J. J. Kuffner and S. M. LaValle, RRT-Connect: an efficient approach to single-query path
    planning, ICRA 2000; J. J. Kuffner and S. M. LaValle, An efficient approach to path planning using
    balanced bidirectional RRT search, CMU-RI-TR-05-34, 2005; A. Yershova, L. Jaillet, T. Simeon and S. M.
    LaValle, Dynamic-domain RRTs, ICRA 2005, with radii that adapt as in L. Jaillet, A. Yershova, S. M.
    LaValle and T. Simeon, Adaptive tuning of the sampling domain for dynamic-domain RRTs, IROS 2005; M.
    Luby, A. Sinclair and D. Zuckerman, Optimal speedup of Las Vegas algorithms, Information Processing
    Letters 47, 1993, for the rounds.

    The path is valid at the problem's resolution (see `MotionValidator` for what that guarantees), but not
    short, and its length is not bounded: pass it to `shortcut`.  The planner cannot prove that there is no
    path; but if one tree hardly grows, the status says that this end is shut in.

    It runs as machine code.  A validity checker that is a Python callable is called back from there, which
    gives the same result, later.

    If goals are drawn by a sampler, it is called until one is valid, and then again after pauses of 32, 64,
    128, ... iterations.

    Args:
        problem: The problem.
        seed: Seed of the samples; the same seed gives the same result unless time runs out.
        timeout: Time budget [s]; overrun by one edge, by one batch of at most 256 states of a Python checker,
            or by one call of a sampler of goals.
        max_iterations: Maximum number of samples.
        step: Maximum length of an extension [length unit of the metric]; a tenth of the box's diagonal if
            omitted.

    Returns:
        The result; without a path its status says why.

    Raises:
        InvalidValueError: An option is not allowed, or the checker answers in a wrong shape.
    """
    load_code(first_round)
    deadline = Deadline(timeout)
    seed, max_iterations = seed_number(seed), whole_number("max_iterations", max_iterations)
    step = None if step is None else positive_number("step", step)
    trees = take_trees(problem.n)
    with machine_code_of(problem, deadline, counters=trees.counters) as code:
        search = Search(problem, code, trees, seed, step)
        status = search.run(deadline, max_iterations)
    result = search.ended(status, deadline, seed)
    search.end()
    return result


class Search:
    """One run of the search: arrays of the trees, goals, and the path."""

    def __init__(
        self, problem: Problem, code: CompiledMotionValidator, trees: Trees, seed: int, step: float | None
    ) -> None:
        self._problem, self._seed, self._key, self._trees = problem, seed, stream_key(seed, 0), trees
        self._round, self._round_end, self._width, self._step = 0, 0, WIDTH, step
        self._sizes, self._extents = [0, 0], [0.0, 0.0]  # maxima over the trees of all rounds
        self._space = space_of(
            problem, code, problem.spacing, LONGEST_STEP * problem.diagonal if step is None else step
        )

    def run(self, deadline: Deadline, max_iterations: int) -> Status:
        """Search until there is a path, or samples or time run out."""
        if self._problem.goal_sampler is not None:
            source = GoalSource(self._problem, self._seed)
            ended = self.plant(self._problem.goals, 0, deadline)
            if ended == GOING_ON:
                self._width = math.inf  # goals may be drawn anywhere
                ended = self._grow_while_drawing(source, deadline, max_iterations)
            return self._status(ended, True)
        ended = self._first_round(deadline, max_iterations)
        if ended == FOUND:
            return Status.SOLVED
        counters = self._trees.counters
        slice_over = ended == TIME_UP and not (deadline.expired or counters[STOP])
        if ended in (GOING_ON, FULL) or slice_over:
            if counters[GOAL_SIZE] == 0:
                return Status.GOAL_INVALID
            if counters[ITERATIONS]:
                return self.resumed(deadline, max_iterations)
            ended = self.grow(max_iterations, deadline)
        return self._status(ended, False)

    def _first_round(self, deadline: Deadline, max_iterations: int) -> int:
        """Plant both trees and grow them within one call of machine code."""
        problem, left = self._problem, deadline.left
        ends = PathEnds(problem.start, problem.goals, self._make_space(problem.goals))
        ended: int = first_round.native(
            self._space, self._trees, left, ends, *_workspace(problem.n), self._key, max_iterations
        )
        return ended

    def resumed(self, deadline: Deadline, max_iterations: int = _MOST_SAMPLES) -> Status:
        """Continue with trees that `first_round` has planted and grown; return the status."""
        return whole(self.resuming(deadline, max_iterations))

    def resuming(self, deadline: Deadline, max_iterations: int = _MOST_SAMPLES) -> Slices[Status]:
        """Continue with trees that `first_round` has planted and grown, with pauses; return the status."""
        self._round, self._round_end, self._width = 1, ROUND, math.inf
        return self._status((yield from self.growing(max_iterations, deadline)), False)

    def _status(self, ended: int, endless: bool) -> Status:
        """Return the status of a run; without a valid goal it is NO_GOAL if `endless`."""
        if ended == FOUND:
            return Status.SOLVED
        if ended == START_INVALID:
            return Status.START_INVALID
        if self._trees.counters[GOAL_SIZE] == 0:
            return Status.NO_GOAL if endless else Status.NO_PATH_IN_TIME
        if self._is_shut_in():
            return Status.GOAL_SHUT_IN if self._stuck_side() else Status.START_SHUT_IN
        return Status.NO_PATH_IN_TIME if ended == TIME_UP else Status.OUT_OF_ITERATIONS

    def plant(self, goals: FloatArray, first: int, deadline: Deadline) -> int:
        """Make valid ends the roots and try the straight edges; return the status of `plant`."""
        order, start = self._make_space(goals), self._problem.start
        return plant(self._space, self._trees, deadline.left, start, goals, order, first)

    def _make_space(self, goals: FloatArray) -> Ints1:
        """Make the tree of the goals large enough for them; return the order in which they are tried."""
        self._trees = with_room(self._trees, len(goals))
        if len(goals) == 1:
            return _FIRST
        apart = self._problem.metric.distance(self._problem.start, goals)
        return np.argsort(apart, kind="stable")

    def grow(self, iterations: int, deadline: Deadline) -> int:
        """Grow both trees up to a number of iterations in all; return the status of `grow`."""
        return whole(self.growing(iterations, deadline))

    def growing(self, iterations: int, deadline: Deadline) -> Slices[int]:
        """Grow both trees up to a number of iterations in all, with pauses; return the status of `grow`."""
        if self._round_end == 0:
            self._next_round()
        trees = self._trees
        while True:
            until = min(iterations, self._round_end)
            ended = grow(self._space, trees, deadline.time_slice, self._key, until)
            if ended == TIME_UP and not (deadline.expired or trees.counters[STOP]):
                if deadline.pauses:
                    yield
                continue
            if ended == GOING_ON and until < iterations:
                self._note_trees()
                self._next_round()
                trees = self._trees
                continue
            if ended != FULL:
                return int(ended)
            spare = int(self._problem.diagonal / self._space.reach) + 4
            trees = self._trees = with_room(trees, spare)

    @property
    def samples(self) -> int:
        """Number of samples so far."""
        return int(self._trees.counters[ITERATIONS])

    @property
    def found_straight(self) -> bool:
        """Whether the path is a straight edge."""
        return bool(self._trees.counters[BY_EDGE])

    def begin(self, deadline: Deadline) -> bool:
        """Make valid ends the roots and try the straight edges; return whether both trees have a root."""
        self.plant(self._problem.goals, 0, deadline)
        return bool(self._trees.counters[START_SIZE : GOAL_SIZE + 1].all())

    def straight_length(self) -> float:
        """Return the length of the straight line from the start to the nearest goal that is a root."""
        return float(self._problem.metric.distance(self._problem.start, self._roots()).min())

    def _roots(self) -> FloatArray:
        """Return the valid goals, shape (k, n); all goals if none is known to be valid."""
        trees, size = self._trees, int(self._trees.counters[GOAL_SIZE])
        return trees.states[1, :size][trees.parents[1, :size] < 0] if size else self._problem.goals

    def _next_round(self) -> None:
        """Begin the next round: first short rounds near the ends, then rounds in the whole box."""
        trees, region = self._trees, np.array([self._problem.lower, self._problem.upper])
        if trees.counters[ITERATIONS]:
            self._forget_nodes()
        near = self._width < math.inf and narrow(self._space, trees, self._width, 0.0, region)
        if near and diagonal_of(region, self._space.weights) < SMALL * self._problem.diagonal:
            self._draw_from(region)
            self._round_end = self.samples + _NEAR_ROUND * int(self._width / WIDTH)
            self._width *= 2.0
            return
        if self._width not in (math.inf, WIDTH):
            self._draw_from(np.array([self._problem.lower, self._problem.upper]))
        self._width, self._round = math.inf, self._round + 1
        self._round_end = self.samples + ROUND * luby(self._round)

    def is_valid(self, points: FloatArray) -> bool:
        """Return whether all edges of a path are valid, each checked separately."""
        space, counters = self._space, self._trees.counters
        lengths = self._problem.metric.distance(points[:-1], points[1:])
        counts = np.maximum(np.ceil(lengths / space.resolution), 1.0).astype(int).tolist()
        return all(
            last_valid_step(space, a, b, steps, counters) == steps
            for a, b, steps in zip(points[:-1], points[1:], counts, strict=True)
        )

    def below(self, bound: float, iterations: int, deadline: Deadline, inside: float = math.inf) -> bool:
        """Search again for a path below a length; return whether there is one.

        Args:
            bound: Upper bound on the path's length [length unit of the metric].
            iterations: Number of samples.
            deadline: Time budget.
            inside: Length of the paths through whose states samples are drawn [length unit of the metric].
        """
        self._forget_nodes()
        region = np.array([self._problem.lower, self._problem.upper])
        inside = min(bound, inside)
        narrow(self._space, self._trees, 0.0, inside, region)
        self._draw_from(region)
        within = inside if self._is_smaller_than_box(inside) else math.inf
        self._trees.numbers[BOUND], self._trees.numbers[WITHIN] = bound, within
        self._round_end = until = self.samples + iterations
        return self.grow(until, deadline) == FOUND

    def result(
        self,
        status: Status,
        deadline: Deadline,
        seed: int,
        path: Path | None = None,
        goal: int | None = None,
        **more: Any,
    ) -> Result:
        """Return the result of a run; `more` are its other fields."""
        trees = self._trees
        if path is None and trees.counters[START_SIZE : GOAL_SIZE + 1].all():
            self._note_trees()
            side = self._stuck_side()
            nodes = trees.states[side, : trees.counters[START_SIZE + side]]
            more |= {"tree_sizes": tuple(self._sizes), "frontier": spread(nodes)}
        return Result.of_run(status, trees.counters, deadline, seed, path, goal, **more)

    def ended(self, status: Status, deadline: Deadline, seed: int) -> Result:
        """Return the result of a run that is over."""
        found = self.path() if status is Status.SOLVED else ()
        return self.result(status, deadline, seed, *found)

    def _stuck_side(self) -> int:
        """Return the tree that its samples extended less often: 0 for the start's, 1 for the goals'."""
        tried, grew = (self._trees.counters[place : place + 2] for place in (TRIED, GREW))
        rates = (grew + 1.0) / (tried + 1.0)
        return int(rates[1] < rates[0])

    def _is_shut_in(self) -> bool:
        """Return whether hardly any sample extended the stuck tree, or its extent stayed small."""
        self._note_trees()
        side, counters = self._stuck_side(), self._trees.counters
        tried, grew = int(counters[TRIED + side]), int(counters[GREW + side])
        narrow = self._extents[side] < _SHUT_IN_EXTENT * self._problem.diagonal
        return tried >= _SHUT_IN_SAMPLES and (grew < _SHUT_IN_RATE * tried or narrow)

    def _note_trees(self) -> None:
        """Update the maximum sizes and extents of the trees."""
        trees, metric = self._trees, self._problem.metric
        for side in range(2):
            states = trees.states[side, : trees.counters[START_SIZE + side]]
            self._sizes[side] = max(self._sizes[side], len(states))
            extent = float(metric.distance(states.min(axis=0), states.max(axis=0)))
            self._extents[side] = max(self._extents[side], extent)

    def _forget_nodes(self) -> None:
        """Forget all nodes but the roots."""
        trees = self._trees
        trees.counters[BY_EDGE] = trees.counters[WAY_POINTS] = 0
        for side in range(2):
            size = int(trees.counters[START_SIZE + side])
            roots = np.flatnonzero(trees.parents[side, :size] < 0)
            kept, places = trees.states[side, roots], np.arange(roots.size)
            trees.counters[START_SIZE + side] = roots.size
            trees.states[side, places], trees.parents[side, places] = kept, trees.parents[side, roots]
            trees.values[RADIUS, side, places], trees.values[COST, side, places] = math.inf, 0.0
            trees.lanes[side, : roots.size // ABREAST + 1] = FAR
            trees.lanes[side, places // ABREAST, :, places % ABREAST] = kept * self._space.weights

    def _draw_from(self, region: FloatArray) -> None:
        """Draw samples from a part of the box, given by its lower and upper bounds, shape (2, n)."""
        reach = self._step
        if reach is None:
            reach = LONGEST_STEP * diagonal_of(region, self._space.weights)
        self._space = self._space._replace(lower=region[0], extent=region[1] - region[0], reach=reach)

    def _is_smaller_than_box(self, bound: float) -> bool:
        """Return whether the states on paths below a bound fill less than the space's box."""
        if bound == math.inf:
            return False
        problem, n = self._problem, self._problem.n
        apart = self.straight_length()
        across = math.sqrt(max(bound * bound - apart * apart, 1e-300))
        ball = 0.5 * n * math.log(math.pi) - math.lgamma(0.5 * n + 1.0)
        inside = ball + math.log(0.5 * bound) + (n - 1) * math.log(0.5 * across)
        extent = self._space.extent * problem.metric.weights
        return inside < float(np.log(np.maximum(extent, 1e-300)).sum())

    def path(self) -> tuple[Path, int]:
        """Return the path along which the trees have met, and the index of its goal."""
        trees, (points, lengths) = self._trees, _workspace(self._problem.n)
        count = int(trees.counters[WAY_POINTS]) or write_path(self._space, trees, points, lengths)
        if count > len(lengths):
            points, lengths = np.empty((count, self._problem.n)), np.empty(count)
            write_path(self._space, trees, points, lengths)
        path = Path.trusted(points[:count].copy(), self._problem.metric, lengths[:count].copy())
        return path, int(trees.counters[GOAL])

    def end(self) -> None:
        """Release the memory of the trees to other searches; the search must not be used afterwards."""
        leave_trees(self._trees)

    def _grow_while_drawing(self, source: GoalSource, deadline: Deadline, max_iterations: int) -> int:
        """Alternate between a draw of a goal and growth."""
        iterations, pause, idle = 0, BETWEEN_DRAWS, 0
        counters = self._trees.counters
        while True:
            first = source.count
            goal = source.draw()
            if goal is not None:
                ended = self.plant(np.array(goal), first, deadline)
                if ended != GOING_ON:
                    return ended
            if counters[GOAL_SIZE] == 0:
                idle += 1
                if deadline.expired or idle >= max_iterations:
                    return TIME_UP if deadline.expired else GOING_ON
                continue
            iterations = min(iterations + pause, max_iterations)
            pause *= 2
            ended = self.grow(iterations, deadline)
            if ended != GOING_ON or iterations == max_iterations:
                return ended


class _FirstRoundWorkspaces(threading.local):
    """Arrays of each thread for waypoints of n coordinates and for lengths, by n."""

    def __init__(self) -> None:
        self.of: dict[int, tuple[FloatArray, FloatArray]] = {}


_workspaces = _FirstRoundWorkspaces()


def _workspace(n: int) -> tuple[FloatArray, FloatArray]:
    """Return this thread's arrays for the waypoints of a first round, and for their arc lengths."""
    arrays = _workspaces.of.get(n)
    if arrays is None:
        arrays = _workspaces.of[n] = np.empty((_FIRST_POINTS, n)), np.empty(_FIRST_POINTS)
    return arrays
