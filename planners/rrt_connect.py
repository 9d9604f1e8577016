"""Bidirectional RRT-Connect for one or several goals."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Floats4, Ints1, Ints2

from .deadline import Deadline, load_code
from .frontier import spread
from .motion_validator import CompiledMotionValidator, machine_code_of
from .path import Path
from .problem import BETWEEN_DRAWS, GoalSource, Problem
from .result import Result, Status
from .sampling import random_state, stream_key, uniform, within_ellipsoid
from .search_space import STOP, SearchSpace, distance, edge_valid, last_valid_step, space_of, step_count
from .tree import LANES, grown, nearest, nearest_within, set_lane, whole_blocks
from .vectors import FloatArray, positive_number, whole_number

_STEP = 0.1  # of the diagonal: longest extension
_UNEVEN = 1.0  # relative difference of the trees' sizes from which only the smaller one grows
_ROUND = 16_384  # samples of the shortest round
_FIRST_RADIUS, _LEAST_RADIUS, _RADIUS_CHANGE = 0.36, 0.07, 1e-4  # of a node's domain, in diagonals
_FIRST_CAPACITY = 128
_CLOCK_EVERY = 64  # goals or samples
_SHUT_IN_SAMPLES, _SHUT_IN_RATE, _SHUT_IN_EXTENT = 1000, 0.002, 0.25  # from, below, or below (in diagonals)
_WIDTH, _NEAR_ROUND, _SMALL = 2.0, 1024, 0.5  # straight lines, samples (both double), of the diagonal
_TRIES = 8  # to draw a sample that is of use inside the box

# How a call ends.
GOING_ON, FOUND, TIME_UP, FULL, START_INVALID = range(5)

# Places in `counters`, after those of the validity function.
ITERATIONS, START_SIZE, GOAL_SIZE, GROWING, START_NODE, GOAL_NODE, DIRECT, DRAWN = range(STOP + 1, STOP + 9)
TRIED, GREW = DRAWN + 1, DRAWN + 3  # samples and extensions, of each tree
_COUNTERS = GREW + 2

# Rows of `rows`; the last one is two.
SAMPLE, ORIGIN, TARGET, SCALED, SHIFTED = range(5)
_ROWS = 6


class Trees(NamedTuple):
    """The tree of the start (0) and that of the goals (1), in arrays with room for m nodes each.

    Attributes:
        states: Shape (2, m, n).
        lanes: Scaled states, shape (2, m / 8, n, 8).
        parents: Parents; of a root -1 less the number of its goal, shape (2, m).
        radii: Distances of samples up to which nodes are extended [length unit of the metric], shape (2, m).
        costs: Lengths of the ways from the nodes to their roots [length unit of the metric], shape (2, m).
        rows: Room, shape (6, n).
        room: Eight numbers.
        counters: See the places above.
        bound: Length that a path has to be below; infinite if any will do.
        within: Length of the paths through the samples that are drawn; infinite for all of the space's box,
            which holds all paths below the bound anyway.
    """

    states: Floats3
    lanes: Floats4
    parents: Ints2
    radii: Floats2
    costs: Floats2
    rows: Floats2
    room: Floats1
    counters: Ints1
    bound: float
    within: float


def rrt_connect(
    problem: Problem,
    *,
    seed: int = 0,
    timeout: float = 5.0,
    max_iterations: int = 100_000_000,
    step: float | None = None,
) -> Result:
    """Search a path with two trees that grow towards samples and towards each other.

    One tree grows from the start, one from all valid goals at once.  A tree is extended from its node nearest
    to a uniform sample towards it, by no more than `step`; if all of that is valid, it goes on from there to
    the nearest node of the other tree in equal parts, as far as they are valid.  If it gets there, the path
    is found.  The trees take turns until one has twice the nodes of the other; then the smaller one grows
    alone, since what shuts it in is what the search must find a way through.  A node from which an extension
    failed is taken for samples in a ball around it only.  Such searches mostly find a path soon or go on for
    very long; so they begin anew, with other samples, after rounds of 1, 1, 2, 1, 1, 2, 4, 1, 1, 2, ... times
    16,384 samples.  Where the box is far wider than start and goals are apart, as with a base that drives,
    shorter rounds before these draw samples near the ends only, each from twice as far as the one before.
    Before any of this, the straight edges from the start to the goals are tried, nearest goal first.

    Sources: J. J. Kuffner and S. M. LaValle, RRT-Connect: an efficient approach to single-query path
    planning, ICRA 2000; J. J. Kuffner and S. M. LaValle, An efficient approach to path planning using
    balanced bidirectional RRT search, CMU-RI-TR-05-34, 2005; A. Yershova, L. Jaillet, T. Simeon and S. M.
    LaValle, Dynamic-domain RRTs, ICRA 2005, with radii that adapt as in L. Jaillet, A. Yershova, S. M.
    LaValle and T. Simeon, Adaptive tuning of the sampling domain for dynamic-domain RRTs, IROS 2005; M.
    Luby, A. Sinclair and D. Zuckerman, Optimal speedup of Las Vegas algorithms, Information Processing
    Letters 47, 1993, for the rounds.

    The path is valid at the problem's resolution (see `MotionValidator` for what that promises), is in no way
    short, and its length is not bounded: pass it to `shortcut`.  The planner cannot prove that there is no
    path; but where one tree hardly grows, the status says that this end is shut in.

    It runs as machine code.  A validity checker that is a Python callable is called back from there, which
    gives the same result, later.

    If goals are drawn by a sampler, it is called until one is valid, and then again after pauses of 32, 64,
    128, ... iterations.

    Args:
        problem: What to plan.
        seed: Seed of the samples; the same seed gives the same result unless time runs out.
        timeout: Time budget [s]; overrun by one edge, by one batch of at most 256 states of a Python checker,
            or by one call of a sampler of goals.
        max_iterations: Greatest number of samples.
        step: Greatest length of an extension [length unit of the metric]; a tenth of the box's diagonal if
            omitted.

    Returns:
        The result; without a path its status tells why.

    Raises:
        InvalidValueError: An option is not allowed, or the checker answers in a wrong shape.
    """
    load_code(plant, grow)
    deadline = Deadline(timeout)
    seed, max_iterations = whole_number("seed", seed), whole_number("max_iterations", max_iterations)
    step = None if step is None else positive_number("step", step)
    counters = new_counters()
    with machine_code_of(problem, deadline, counters=counters) as code:
        search = Search(problem, code, counters, seed, step)
        status = search.run(GoalSource(problem, seed), deadline, max_iterations)
    if status is not Status.SOLVED:
        return search.result(status, deadline, seed)
    points, goal = search.path()
    return search.result(status, deadline, seed, Path.trusted(points, problem.metric), goal)


def new_counters() -> Ints1:
    """Return the counters of a search that begins."""
    return np.zeros(_COUNTERS, dtype=np.int64)


def luby(k: int) -> int:
    """Return the k-th number, from 1, of the sequence 1, 1, 2, 1, 1, 2, 4, ..."""
    while (k + 1) & k:
        k -= (1 << (k.bit_length() - 1)) - 1
    return (k + 1) >> 1


class Search:
    """One run: the arrays of the trees, which grow, the goals, and the way back."""

    def __init__(
        self, problem: Problem, code: CompiledMotionValidator, counters: Ints1, seed: int, step: float | None
    ) -> None:
        n = problem.n
        self._problem, self._key = problem, stream_key(seed, 0)
        self._round, self._round_end, self._width, self._step = 0, 0, _WIDTH, step
        self._sizes, self._extents = [0, 0], [0.0, 0.0]  # the largest of the trees of all rounds
        self._space = space_of(
            problem, code, problem.spacing, _STEP * problem.diagonal if step is None else step
        )
        self._trees = Trees(
            states=np.empty((2, 0, n)),
            lanes=np.empty((2, 0, n, LANES)),
            parents=np.empty((2, 0), dtype=np.int64),
            radii=np.empty((2, 0)),
            costs=np.empty((2, 0)),
            rows=np.empty((_ROWS, n)),
            room=np.empty(LANES),
            counters=counters,
            bound=math.inf,
            within=math.inf,
        )
        self._reserve(_FIRST_CAPACITY)

    def run(self, source: GoalSource, deadline: Deadline, max_iterations: int) -> Status:
        """Search until there is a path, or samples or time run out."""
        counters = self._trees.counters
        ended = self.plant(self._problem.goals.copy(), 0, deadline)
        if ended == GOING_ON and source.endless:
            self._width = math.inf  # goals may be drawn anywhere
            ended = self._grow_while_drawing(source, deadline, max_iterations)
        elif ended == GOING_ON and counters[GOAL_SIZE] == 0:
            return Status.GOAL_INVALID
        elif ended == GOING_ON:
            ended = self.grow(max_iterations, deadline)
        if ended == FOUND:
            return Status.SOLVED
        if ended == START_INVALID:
            return Status.START_INVALID
        if counters[GOAL_SIZE] == 0:
            return Status.NO_GOAL if source.endless else Status.NO_PATH_IN_TIME
        if self._is_shut_in():
            return Status.GOAL_SHUT_IN if self._stuck_side() else Status.START_SHUT_IN
        return Status.NO_PATH_IN_TIME if ended == TIME_UP else Status.OUT_OF_ITERATIONS

    def plant(self, goals: FloatArray, first: int, deadline: Deadline) -> int:
        """Make valid ends the roots and try the straight edges; return how it ended."""
        nodes, capacity = int(self._trees.counters[GOAL_SIZE]) + len(goals), self._trees.states.shape[1]
        if nodes > capacity:
            self._reserve(max(nodes, 2 * capacity))
        order = np.zeros(len(goals), dtype=np.int64)
        start = self._problem.start.copy()
        if len(goals) > 1:
            order = np.argsort(self._problem.metric.distance(start, goals), kind="stable")
        return plant(self._space, self._trees, deadline.left, start, goals, order, first)

    def grow(self, iterations: int, deadline: Deadline) -> int:
        """Grow both trees up to a number of iterations in all; return how it ended."""
        if self._round_end == 0:
            self._next_round()
        trees = self._trees
        while True:
            until = min(iterations, self._round_end)
            ended = grow(self._space, trees, deadline.time_slice, self._key, until)
            if ended == TIME_UP and not (deadline.expired or trees.counters[STOP]):
                continue
            if ended == GOING_ON and until < iterations:
                self._note_trees()
                self._next_round()
                trees = self._trees
                continue
            if ended != FULL:
                return ended
            spare = int(self._problem.diagonal / self._space.reach) + 4
            self._reserve(2 * trees.states.shape[1] + spare)
            trees = self._trees

    @property
    def samples(self) -> int:
        """Number of samples so far."""
        return int(self._trees.counters[ITERATIONS])

    @property
    def found_straight(self) -> bool:
        """Whether the path that was found is a straight edge."""
        return bool(self._trees.counters[DIRECT])

    def begin(self, deadline: Deadline) -> bool:
        """Make valid ends the roots and try the straight edges; return whether both trees have a root."""
        self.plant(self._problem.goals.copy(), 0, deadline)
        return bool(self._trees.counters[START_SIZE : GOAL_SIZE + 1].all())

    def straight_length(self) -> float:
        """Return the length of the straight line from the start to the nearest goal that is a root."""
        return float(self._problem.metric.distance(self._problem.start, self._roots()).min())

    def _roots(self) -> FloatArray:
        """Return the valid goals, shape (k, n); all of them where none is known to be."""
        trees, size = self._trees, int(self._trees.counters[GOAL_SIZE])
        return trees.states[1, :size][trees.parents[1, :size] < 0] if size else self._problem.goals

    def _next_round(self) -> None:
        """Begin the next round: short ones near the ends first, then those of the whole box."""
        trees, region = self._trees, np.array([self._problem.lower, self._problem.upper])
        if trees.counters[ITERATIONS]:
            self._forget_nodes()
        near = self._width < math.inf and narrow(self._space, trees, self._width, 0.0, region)
        if near and self._problem.metric.distance(*region) < _SMALL * self._problem.diagonal:
            self._draw_from(region)
            self._round_end = self.samples + _NEAR_ROUND * int(self._width / _WIDTH)
            self._width *= 2.0
            return
        if self._width not in (math.inf, _WIDTH):
            self._draw_from(np.array([self._problem.lower, self._problem.upper]))
        self._width, self._round = math.inf, self._round + 1
        self._round_end = self.samples + _ROUND * luby(self._round)

    def is_valid(self, points: FloatArray) -> bool:
        """Whether all edges of a path are valid, each by itself."""
        space, counters = self._space, self._trees.counters
        lengths = self._problem.metric.distance(points[:-1], points[1:])
        counts = np.maximum(np.ceil(lengths / space.resolution), 1.0).astype(int).tolist()
        return all(
            last_valid_step(space, a, b, steps, counters) == steps
            for a, b, steps in zip(points[:-1], points[1:], counts, strict=True)
        )

    def below(self, bound: float, iterations: int, deadline: Deadline) -> bool:
        """Search anew for a path shorter than a bound, with so many samples; return whether there is one."""
        self._forget_nodes()
        region = np.array([self._problem.lower, self._problem.upper])
        narrow(self._space, self._trees, 0.0, bound, region)
        self._draw_from(region)
        within = bound if self._is_smaller_than_box(bound) else math.inf
        self._trees = self._trees._replace(bound=bound, within=within)
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
        states, calls = trees.counters[:STOP].tolist()
        if path is None and trees.counters[START_SIZE : GOAL_SIZE + 1].all():
            self._note_trees()
            side = self._stuck_side()
            nodes = trees.states[side, : trees.counters[START_SIZE + side]]
            more |= {"tree_sizes": tuple(self._sizes), "frontier": spread(nodes)}
        return Result(
            status=status,
            path=path,
            goal_index=goal,
            cost=math.inf if path is None else path.length,
            iterations=self.samples,
            states_checked=states,
            validity_calls=calls,
            time=deadline.elapsed,
            seed=seed,
            **more,
        )

    def _stuck_side(self) -> int:
        """Return the tree that its samples extended less often: 0 of the start, 1 of the goals."""
        tried, grew = (self._trees.counters[place : place + 2] for place in (TRIED, GREW))
        rates = (grew + 1.0) / (tried + 1.0)
        return int(rates[1] < rates[0])

    def _is_shut_in(self) -> bool:
        """Whether hardly any sample extended the stuck tree, or it never got far."""
        self._note_trees()
        side, counters = self._stuck_side(), self._trees.counters
        tried, grew = int(counters[TRIED + side]), int(counters[GREW + side])
        narrow = self._extents[side] < _SHUT_IN_EXTENT * self._problem.diagonal
        return tried >= _SHUT_IN_SAMPLES and (grew < _SHUT_IN_RATE * tried or narrow)

    def _note_trees(self) -> None:
        """Keep the sizes and extents of the trees if they are the largest so far."""
        trees, metric = self._trees, self._problem.metric
        for side in range(2):
            states = trees.states[side, : trees.counters[START_SIZE + side]]
            self._sizes[side] = max(self._sizes[side], len(states))
            extent = float(metric.distance(states.min(axis=0), states.max(axis=0)))
            self._extents[side] = max(self._extents[side], extent)

    def _forget_nodes(self) -> None:
        """Forget all nodes but the roots."""
        trees = self._trees
        trees.counters[DIRECT] = 0
        for side in range(2):
            size = int(trees.counters[START_SIZE + side])
            roots = np.flatnonzero(trees.parents[side, :size] < 0)
            kept, places = trees.states[side, roots], np.arange(roots.size)
            trees.counters[START_SIZE + side] = roots.size
            trees.states[side, places], trees.parents[side, places] = kept, trees.parents[side, roots]
            trees.radii[side, places], trees.costs[side, places] = math.inf, 0.0
            trees.lanes[side, : roots.size // LANES + 1] = math.inf
            trees.lanes[side, places // LANES, :, places % LANES] = kept * self._space.weights

    def _draw_from(self, region: FloatArray) -> None:
        """Draw samples from a part of the box, given by its lower and upper bounds, shape (2, n)."""
        reach = self._step
        if reach is None:
            reach = _STEP * float(self._problem.metric.distance(region[0], region[1]))
        self._space = self._space._replace(lower=region[0], extent=region[1] - region[0], reach=reach)

    def _is_smaller_than_box(self, bound: float) -> bool:
        """Whether the states through which paths are below a bound fill less room than the space's box."""
        if bound == math.inf:
            return False
        problem, n = self._problem, self._problem.n
        apart = self.straight_length()
        across = math.sqrt(max(bound * bound - apart * apart, 1e-300))
        ball = 0.5 * n * math.log(math.pi) - math.lgamma(0.5 * n + 1.0)
        inside = ball + math.log(0.5 * bound) + (n - 1) * math.log(0.5 * across)
        extent = self._space.extent * problem.metric.weights
        return inside < float(np.log(np.maximum(extent, 1e-300)).sum())

    def path(self) -> tuple[FloatArray, int]:
        """Return the way-points of the path along which the trees have met, and its goal."""
        counters, states = self._trees.counters.tolist(), self._trees.states
        to_start, _ = self._branch(0, counters[START_NODE])
        to_goal, goal = self._branch(1, counters[GOAL_NODE])
        if not counters[DIRECT]:  # the state where the trees meet is in both
            to_goal = to_goal[1:]
        return np.concatenate((states[0, to_start[::-1]], states[1, to_goal])), goal

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

    def _branch(self, side: int, node: int) -> tuple[list[int], int]:
        nodes, parent_of = [], self._trees.parents[side].item
        while node >= 0:
            nodes.append(node)
            node = parent_of(node)
        return nodes, -1 - node

    def _reserve(self, capacity: int) -> None:
        """Make room for a number of nodes in each tree."""
        capacity, trees = whole_blocks(capacity), self._trees
        self._trees = trees._replace(
            states=grown(trees.states, capacity, axis=1),
            lanes=grown(trees.lanes, capacity // LANES, axis=1),
            parents=grown(trees.parents, capacity, axis=1),
            radii=grown(trees.radii, capacity, axis=1),
            costs=grown(trees.costs, capacity, axis=1),
        )


@compiled
def _add(space: SearchSpace, trees: Trees, side: int, parent: int, state: FloatArray) -> int:
    """Add a node to a tree; return its number."""
    node = trees.counters[START_SIZE + side]
    trees.counters[START_SIZE + side] += 1
    for i in range(state.size):
        trees.states[side, node, i] = state[i]
    set_lane(trees.lanes[side], node, state, space.weights)
    trees.parents[side, node] = parent
    trees.radii[side, node] = math.inf
    cost = 0.0
    if parent >= 0:
        cost = trees.costs[side, parent] + distance(trees.states[side, parent], state, space.weights)
    trees.costs[side, node] = cost
    return node


@compiled
def _nearest(space: SearchSpace, trees: Trees, side: int, state: FloatArray, bound: float) -> int:
    """Return the node of a tree nearest to a state of those that lead there below a cost; -1 for none."""
    scaled, size = trees.rows[SCALED], trees.counters[START_SIZE + side]
    for i in range(state.size):
        scaled[i] = state[i] * space.weights[i]
    if bound < math.inf:
        return nearest_within(trees.lanes[side], trees.costs[side], size, scaled, bound, trees.room)
    return nearest(trees.lanes[side], size, scaled, trees.room)


@compiled
def _from_root(space: SearchSpace, trees: Trees, side: int, state: FloatArray) -> float:
    """Return the distance of a state from the nearest root of a tree."""
    least, node, parents = math.inf, 0, trees.parents[side]
    while node < trees.counters[START_SIZE + side] and parents[node] < 0:
        least = min(least, distance(trees.states[side, node], state, space.weights))
        node += 1
    return least


@compiled
def _draw(space: SearchSpace, trees: Trees, key: np.uint64) -> None:
    """Write a sample into rows[SAMPLE]: of the box, or of it where a path through it may be short enough."""
    counters, sample, within = trees.counters, trees.rows[SAMPLE], trees.within
    n = sample.size
    if within < math.inf:
        roots = 0
        while roots < counters[GOAL_SIZE] and trees.parents[1, roots] < 0:
            roots += 1
        for _ in range(_TRIES):
            goal = trees.states[1, int(uniform(key, counters[DRAWN]) * roots)]
            start, room = trees.states[0, 0], trees.rows[ORIGIN]
            inside = within_ellipsoid(space, key, counters[DRAWN] + 1, start, goal, within, room, sample)
            counters[DRAWN] += 2 * n + 2
            if inside:
                return
    counters[DRAWN] += random_state(space, key, counters[DRAWN], sample)


@compiled
def _extend(
    space: SearchSpace, trees: Trees, side: int, sample: FloatArray, diagonal: float, key: np.uint64
) -> int:
    """Extend a tree from its node nearest to a sample towards it; return the new node or -1.

    Where paths have to be short, it is the nearest of the nodes that lead to the sample at a cost drawn
    between the least that is possible and the greatest that is of use.
    """
    n, state, counters = sample.size, trees.rows[TARGET], trees.counters
    allowed = math.inf
    if trees.bound < math.inf:
        before, after = _from_root(space, trees, side, sample), _from_root(space, trees, 1 - side, sample)
        if before + after >= trees.bound:
            return -1
        allowed = before + (trees.bound - before - after) * uniform(key, counters[DRAWN])
        counters[DRAWN] += 1
    near = _nearest(space, trees, side, sample, allowed)
    if near < 0:
        return -1
    origin, radii, reach = trees.states[side, near], trees.radii[side], space.reach
    apart = distance(origin, sample, space.weights)
    if radii[near] < apart:
        return -1
    share = 1.0 if apart < reach else reach / apart
    for i in range(n):
        state[i] = origin[i] + (sample[i] - origin[i]) * share
    steps = step_count(apart * share, space.resolution)
    if last_valid_step(space, origin, state, steps, counters) < steps:
        if radii[near] == math.inf:
            radii[near] = _FIRST_RADIUS * diagonal
        else:
            radii[near] = max(radii[near] * (1.0 - _RADIUS_CHANGE), _LEAST_RADIUS * diagonal)
        return -1
    radii[near] *= 1.0 + _RADIUS_CHANGE
    if trees.bound < math.inf:
        near = _better_parent(space, trees, side, near, key)
    return _add(space, trees, side, near, state)


@compiled
def _better_parent(space: SearchSpace, trees: Trees, side: int, near: int, key: np.uint64) -> int:
    """Return a node from which the state in rows[TARGET] is reached at lower cost, or the one given."""
    state, counters = trees.rows[TARGET], trees.counters
    least = _from_root(space, trees, side, state)
    cost = trees.costs[side, near] + distance(trees.states[side, near], state, space.weights)
    while True:
        allowed = least + (cost - least) * uniform(key, counters[DRAWN])
        counters[DRAWN] += 1
        other = _nearest(space, trees, side, state, allowed)
        if other < 0 or other == near:
            return near
        origin = trees.states[side, other]
        apart = distance(origin, state, space.weights)
        if trees.costs[side, other] + apart >= cost:
            return near
        steps = step_count(apart, space.resolution)
        if last_valid_step(space, origin, state, steps, counters) < steps:
            return near
        near, cost = other, trees.costs[side, other] + apart


@compiled
def _connect(space: SearchSpace, trees: Trees, side: int, node: int) -> tuple[int, int]:
    """Extend a tree from a node to the nearest of the other one; return both where they meet, or -1.

    Where paths have to be short, it is the nearest that makes one.
    """
    counters, state = trees.counters, trees.rows[ORIGIN]
    allowed = trees.bound - trees.costs[side, node]
    goal = _nearest(space, trees, 1 - side, trees.states[side, node], allowed)
    if goal < 0:
        return -1, -1
    target, origin = trees.states[1 - side, goal], trees.states[side, node]
    apart = distance(origin, target, space.weights)
    parts = step_count(apart, space.reach)
    steps = step_count(apart / parts, space.resolution)
    for k in range(1, parts + 1):
        for i in range(state.size):
            state[i] = target[i] if k == parts else origin[i] + (target[i] - origin[i]) * k / parts
        if last_valid_step(space, trees.states[side, node], state, steps, counters) < steps:
            return -1, -1
        node = _add(space, trees, side, node, state)
    return node, goal


@compiled("boolean(SearchSpace, Trees, float64, float64, float64[:, ::1])")
def narrow(space: SearchSpace, trees: Trees, width: float, length: float, region: Floats2) -> bool:
    """Cut off parts of a box through which no path to any root leads that is below a length.

    Args:
        space: Supplies the metric.
        trees: The trees, with their roots.
        width: The length in straight lines to the nearest root; 0: it is given.
        length: The length [length unit of the metric].
        region: Lower and upper bounds, shape (2, n).

    Returns:
        Whether anything was cut off.
    """
    start, weights, roots, cut = trees.states[0, 0], space.weights, 0, False
    if width > 0.0:
        length = width * _from_root(space, trees, 1, start)
    while roots < trees.counters[GOAL_SIZE] and trees.parents[1, roots] < 0:
        roots += 1
    for i in range(start.size):
        low, high = math.inf, -math.inf
        for g in range(roots):
            goal = trees.states[1, g]
            apart, way = distance(start, goal, weights), 0.5 * (goal[i] - start[i])
            across = math.sqrt(max(0.25 * (length * length - apart * apart), 0.0)) / weights[i]
            half = math.sqrt(across * across + way * way)
            low, high = min(low, start[i] + way - half), max(high, start[i] + way + half)
        if low > region[0, i]:
            region[0, i], cut = low, True
        if high < region[1, i]:
            region[1, i], cut = high, True
    return cut


@compiled("int64(SearchSpace, Trees, float64, float64[::1], float64[:, ::1], int64[::1], int64)")
def plant(
    space: SearchSpace,
    trees: Trees,
    seconds: float,
    start: Floats1,
    goals: Floats2,
    order: Ints1,
    first: int,
) -> int:
    """Make valid ends the roots of the trees, and try the straight edges between them.

    Args:
        space: Box, metric and validity.
        trees: The trees.
        seconds: Time budget [s].
        start: Shape (n,).
        goals: Shape (k, n).
        order: Goals in the order in which they are tried, shape (k,).
        first: Number of the first goal.

    Returns:
        FOUND (a straight edge; counters[DIRECT] is set), GOING_ON, TIME_UP or START_INVALID.
    """
    place, counters = np.empty(2, np.int64), trees.counters
    end = seconds_now(space.clock, place) + seconds
    if counters[START_SIZE] == 0:
        if last_valid_step(space, start, start, 1, counters) == 0:
            return TIME_UP if counters[STOP] != 0 else START_INVALID
        _add(space, trees, 0, -1, start)
    old = counters[GOAL_SIZE]
    for j in range(order.size):
        if counters[STOP] != 0 or (j % _CLOCK_EVERY == 0 and seconds_now(space.clock, place) >= end):
            return TIME_UP
        goal = goals[order[j]]
        if last_valid_step(space, goal, goal, 1, counters) == 1:
            _add(space, trees, 1, -1 - first - order[j], goal)
    for node in range(old, counters[GOAL_SIZE]):
        goal = trees.states[1, node]
        steps = step_count(distance(start, goal, space.weights), space.resolution)
        if edge_valid(space, start, goal, steps, trees.rows[SHIFTED:], counters, False):
            counters[START_NODE], counters[GOAL_NODE] = 0, node
            counters[DIRECT] = 1
            return FOUND
        if counters[STOP] != 0 or seconds_now(space.clock, place) >= end:
            return TIME_UP
    return TIME_UP if counters[STOP] != 0 else GOING_ON


@compiled("int64(SearchSpace, Trees, float64, uint64, int64)")
def grow(space: SearchSpace, trees: Trees, seconds: float, key: np.uint64, iterations: int) -> int:
    """Grow both trees until they meet; see `rrt_connect` for the method.

    Args:
        space: Box, metric and validity.
        trees: The trees.
        seconds: Time budget [s].
        key: Of the stream of random numbers.
        iterations: Number of samples in all, those of earlier calls included.

    Returns:
        FOUND (the trees meet at counters[START_NODE] and counters[GOAL_NODE]), GOING_ON if the iterations are
        used up, TIME_UP, or FULL if there may be no room for the nodes of one more iteration.
    """
    place, counters, rows = np.empty(2, np.int64), trees.counters, trees.rows
    end = seconds_now(space.clock, place) + seconds
    diagonal = distance(space.lower, space.lower + space.extent, space.weights)
    spare = step_count(diagonal, space.reach) + 2
    while counters[ITERATIONS] < iterations:
        late = counters[ITERATIONS] % _CLOCK_EVERY == 0 and seconds_now(space.clock, place) >= end
        if late or counters[STOP] != 0:
            return TIME_UP
        if max(counters[START_SIZE], counters[GOAL_SIZE]) + spare > trees.states.shape[1]:
            return FULL
        side = counters[GROWING]
        own, other = counters[START_SIZE + side], counters[GOAL_SIZE - side]
        if abs(own - other) < _UNEVEN * own:
            side = counters[GROWING] = 1 - side
        _draw(space, trees, key)
        counters[ITERATIONS] += 1
        new = _extend(space, trees, side, rows[SAMPLE], diagonal, key)
        counters[TRIED + side] += 1
        if new >= 0:
            counters[GREW + side] += 1
            meeting, goal = _connect(space, trees, side, new)
            if meeting >= 0:
                counters[START_NODE + side], counters[GOAL_NODE - side] = meeting, goal
                return FOUND
    return GOING_ON
