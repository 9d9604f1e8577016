"""CBiRRT: a bidirectional RRT on a constraint manifold."""

from __future__ import annotations

import math
from contextlib import ExitStack
from types import TracebackType
from typing import NamedTuple

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1

from .constraint_manifold import (
    INNER,
    ConstraintManifold,
    OnSurface,
    Surface,
    edges_hold,
    extend,
    measure_rows,
    project_rows,
)
from .deadline import Deadline, load_code
from .frontier import spread
from .motion_validator import machine_code_of
from .path import Path
from .problem import Problem
from .result import Result, Status
from .sampling import random_state, stream_key
from .search_space import STOP, SearchSpace, distance, last_valid_step, space_of
from .tree import LANES, grown, nearest, set_lane, whole_blocks
from .vectors import BoolArray, FloatArray, seed_number, whole_number

_ON_MANIFOLD = 1.0 + 1e-9
_FIRST_CAPACITY = 512
_MOST_STEPS = 20_000  # of a walk
_LONGEST = 4.0  # of the diagonal: length of a walk of whole steps
_SHUT_IN_SAMPLES, _SHUT_IN_NODES, _SHUT_IN_RATE = 1000, 10, 0.002  # from, below, or below, for each sample

# How growth ends.
_GOING_ON, _FOUND, _TIME_UP, _FULL = range(4)

# Places in `counters`, after those of the validity function.
_ITERATIONS, _START_NODE, _GOAL_NODE = range(STOP + 1, STOP + 4)

# Rows of `rows`.
_SAMPLE, _SCALED, _CURRENT, _TARGET = range(4)


class Tree(NamedTuple):
    """A forest of states with space for m nodes, each of which but the roots has a parent added before it.

    Attributes:
        states: Shape (m, n).
        lanes: Scaled states, shape (m / 8, n, 8).
        parents: Shape (m,); -1 of a root.
        size: Number of nodes, shape (1,).
    """

    states: Floats2
    lanes: Floats3
    parents: Ints1
    size: Ints1


class Workspace(NamedTuple):
    """Where walks are written, and what is counted.

    Attributes:
        chain: States of a walk, which it has at most, shape (k, n).
        rows: Shape (4, n).
        squares: Eight numbers.
        counters: See the places above.
    """

    chain: Floats2
    rows: Floats2
    squares: Floats1
    counters: Ints1


def cbirrt(
    problem: Problem,
    manifold: ConstraintManifold,
    *,
    seed: int = 0,
    timeout: float = 5.0,
    max_iterations: int = 1_000_000,
) -> Result:
    """Search a path all of whose states meet constraints.

    As `rrt_connect`, but trees grow along the manifold: in straight steps towards a sample, no longer than
    the problem's resolution, each moved back onto the manifold by a projection.  A step that the projection
    moves by more than its own length, or whose middle leaves the tolerance, is tried again with half the
    length.
    First of all the walk from the start straight to each goal is tried.

    Source: D. Berenson, S. Srinivasa, D. Ferguson and J. Kuffner, Manipulation planning on constraint
    manifolds, ICRA 2009 (CBiRRT), and J. J. Kuffner and S. M. LaValle, RRT-Connect, ICRA 2000.

    It runs as machine code.  A residual function or a validity checker that is a Python callable is called
    back from there, state by state.

    Args:
        problem: What to plan; with goals, not with a sampler of them.
        manifold: The constraints.
        seed: Seed of the samples; the same seed gives the same result, however loaded the machine is, unless
            time runs out.
        timeout: Time budget [s]; overrun by one step and its check.
        max_iterations: Greatest number of samples.

    Returns:
        The result.  Neighboring way-points of its path are no further apart than the resolution; they meet
        the constraints to half the tolerances (start and goal to the whole), and so do the middles between
        them to the whole.  `residual` is the largest error found, as a multiple of its tolerance: of the
        way-points, or of an end that is off the manifold.

    Raises:
        InvalidValueError: An option is not allowed, the manifold has another number of coordinates, or a
            function answers in a wrong shape.
    """
    load_code(grow, walk, measure_rows)
    require_fit(problem, manifold)
    if problem.goal_sampler is not None:
        raise InvalidValueError("goals", "a sampler", "goal states, for a path on a manifold")
    seed, max_iterations = seed_number(seed), whole_number("max_iterations", max_iterations)
    deadline = Deadline(timeout)
    off, residual = _off_manifold(problem, manifold)
    found, counters = _Candidate(off or Status.SOLVED), np.zeros(_GOAL_NODE + 1, dtype=np.int64)
    if off is None:
        with Explorer(problem, manifold, deadline, counters) as explorer:
            found = _search(problem, manifold, explorer, seed, max_iterations)
    path = None if found.points is None else Path.trusted(found.points, problem.metric)
    if path is not None:
        residual = manifold.worst(path.points)
    states, calls = counters[:STOP].tolist()
    return Result(
        status=found.status,
        path=path,
        goal_index=found.goal_index,
        cost=math.inf if path is None else path.length,
        iterations=int(counters[_ITERATIONS]),
        states_checked=states,
        validity_calls=calls,
        time=deadline.elapsed,
        seed=seed,
        tree_sizes=found.sizes,
        frontier=found.frontier,
        residual=residual,
    )


def require_fit(problem: Problem, manifold: ConstraintManifold) -> None:
    """Refuse a manifold of another number of coordinates than the problem's.

    Raises:
        InvalidValueError: It has another number.
    """
    if not isinstance(manifold, ConstraintManifold) or manifold.n != problem.n:
        got = f"{manifold.n} coordinates" if isinstance(manifold, ConstraintManifold) else repr(manifold)[:80]
        raise InvalidValueError(
            "manifold", got, f"a ConstraintManifold of {problem.n} coordinates, as the problem"
        )


def _off_manifold(problem: Problem, manifold: ConstraintManifold) -> tuple[Status | None, float]:
    """Return whether an end is off the manifold, and its error as a multiple of its tolerance."""
    start = manifold.worst(problem.start[None])
    if start > _ON_MANIFOLD:
        return Status.START_OFF_MANIFOLD, start
    goals = (manifold.errors(problem.goals) / manifold.tolerances).max(axis=1)
    if goals.min() > _ON_MANIFOLD:
        return Status.GOAL_OFF_MANIFOLD, float(goals.min())
    return None, math.nan


class _Candidate(NamedTuple):
    """The end of a search; points, shape (k, n), and the goal are None unless it is solved.

    Where trees have grown in vain, their sizes and some nodes of the smaller one are returned.
    """

    status: Status
    points: FloatArray | None = None
    goal_index: int | None = None
    sizes: tuple[int, int] | None = None
    frontier: FloatArray | None = None


def _search(
    problem: Problem, manifold: ConstraintManifold, explorer: Explorer, seed: int, most: int
) -> _Candidate:
    """Search until there is a path, or samples or time run out."""
    if not explorer.valid(problem.start):
        return _Candidate(explorer.late or Status.START_INVALID)
    on = (manifold.errors(problem.goals) <= _ON_MANIFOLD * manifold.tolerances).all(axis=1)
    goals = np.array([k for k in np.flatnonzero(on) if explorer.valid(problem.goals[k])], dtype=np.int64)
    if goals.size == 0:
        return _Candidate(explorer.late or Status.GOAL_INVALID)
    distances = problem.metric.distance(problem.start, problem.goals[goals])
    goals = goals[np.argsort(distances, kind="stable")]
    first = np.empty((0, problem.n))
    for k, goal in enumerate(goals):
        states, reached = explorer.walk(problem.start, problem.goals[goal], exact=True)
        if reached:
            return _Candidate(Status.SOLVED, np.concatenate((problem.start[None], states)), int(goal))
        first = states if k == 0 else first
    weights = problem.metric.weights
    chain = np.concatenate((problem.start[None], first))
    trees = (
        _planted(chain, np.arange(-1, len(chain) - 1), weights),
        _planted(problem.goals[goals], np.full(goals.size, -1), weights),
    )
    ended, workspace, deadline, key = _FULL, explorer.workspace, explorer.deadline, stream_key(seed, 0)
    while ended == _FULL or (ended == _TIME_UP and not explorer.stopped):
        if ended == _FULL:
            trees = (
                _with_capacity(trees[0], len(workspace.chain)),
                _with_capacity(trees[1], len(workspace.chain)),
            )
        seconds = np.array([deadline.time_slice, deadline.left])
        ended = grow(explorer.space, explorer.surface, *trees, workspace, seconds, key, most)
    if ended != _FOUND:
        return _failed(trees, int(workspace.counters[_ITERATIONS]), ended == _TIME_UP)
    to_start = _branch(trees[0], workspace.counters[_START_NODE])
    to_goal = _branch(trees[1], workspace.counters[_GOAL_NODE])
    halves = trees[0].states[to_start[::-1]], trees[1].states[to_goal[1:]]
    return _Candidate(Status.SOLVED, np.concatenate(halves), int(goals[to_goal[-1]]))


def _failed(trees: tuple[Tree, Tree], samples: int, late: bool) -> _Candidate:
    """Return how a search ended that found nothing; an end whose tree hardly grew is shut in."""
    start, goal = int(trees[0].size[0]), int(trees[1].size[0])
    small = trees[0] if start <= goal else trees[1]
    status = Status.NO_PATH_IN_TIME if late else Status.OUT_OF_ITERATIONS
    if samples >= _SHUT_IN_SAMPLES and min(start, goal) < max(_SHUT_IN_NODES, _SHUT_IN_RATE * samples):
        status = Status.START_SHUT_IN if start <= goal else Status.GOAL_SHUT_IN
    return _Candidate(status, sizes=(start, goal), frontier=spread(small.states[: small.size[0]]))


def _planted(states: FloatArray, parents: np.ndarray, weights: FloatArray) -> Tree:
    """Return a tree of states, shape (k, n), and their parents, shape (k,)."""
    count, n = states.shape
    capacity = whole_blocks(max(_FIRST_CAPACITY, count))
    tree = Tree(
        grown(states, capacity),
        np.empty((capacity // LANES, n, LANES)),
        grown(parents.astype(np.int64), capacity),
        np.array([count], dtype=np.int64),
    )
    for node in range(count):
        set_lane(tree.lanes, node, tree.states[node], weights)
    return tree


def _with_capacity(tree: Tree, spare: int) -> Tree:
    """Return a tree that has space for some more nodes."""
    if int(tree.size[0]) + spare <= len(tree.states):
        return tree
    capacity = whole_blocks(2 * len(tree.states) + spare)
    states, lanes = grown(tree.states, capacity), grown(tree.lanes, capacity // LANES)
    return Tree(states, lanes, grown(tree.parents, capacity), tree.size)


def _branch(tree: Tree, node: int) -> list[int]:
    """Return the nodes from a node to its root, both included."""
    nodes = []
    while node >= 0:
        nodes.append(int(node))
        node = tree.parents[node]
    return nodes


@compiled(
    "Tuple(int64, boolean)"
    "(SearchSpace, Surface, Workspace, float64, float64[::1], float64[::1], boolean, float64)"
)
def walk(
    space: SearchSpace,
    surface: Surface,
    workspace: Workspace,
    seconds: float,
    origin: Floats1,
    target: Floats1,
    exact: bool,
    longest: float,
) -> tuple[int, bool]:
    """Walk towards a target as far as the manifold leads nearer and states are valid.

    Args:
        space: Box, metric and validity.
        surface: The manifold.
        workspace: The states after `origin` are written to its chain.
        seconds: Time budget [s].
        origin: A valid state on the manifold, shape (n,).
        target: Any state, shape (n,).
        exact: Whether the target is on the manifold and is to be met.
        longest: Length at which the walk is given up [length unit of the metric].

    Returns:
        Number of states written, and whether the target was met.
    """
    place, counters, chain, current = (
        np.empty(2, np.int64),
        workspace.counters,
        workspace.chain,
        workspace.rows[_CURRENT],
    )
    n, count, walked, end = origin.size, 0, 0.0, seconds_now(space.clock, place) + seconds
    for i in range(n):
        current[i] = origin[i]
    while count < chain.shape[0] and surface.stop[0] == 0 and counters[STOP] == 0:
        if seconds_now(space.clock, place) >= end:
            break
        got = extend(surface, current, target, space.resolution, exact, chain[count : count + 1])
        if got == 0 or got == -1:
            break
        if last_valid_step(space, chain[count], chain[count], 1, counters) == 0:
            break
        walked += distance(current, chain[count], space.weights)
        same = exact
        for i in range(n):
            current[i] = chain[count, i]
            same = same and current[i] == target[i]
        count += 1
        if same:
            return count, True
        if got < 0 or walked > longest:
            break
    return count, False


@compiled
def _extend(
    space: SearchSpace,
    surface: Surface,
    tree: Tree,
    workspace: Workspace,
    seconds: float,
    target: Floats1,
    exact: bool,
) -> tuple[int, bool]:
    """Grow a tree from its node nearest to a target; return the last new node, or -1, and if it got there."""
    n = target.size
    for i in range(n):
        workspace.rows[_SCALED, i] = target[i] * space.weights[i]
    node = nearest(tree.lanes, tree.size[0], workspace.rows[_SCALED], workspace.squares)
    origin = tree.states[node]
    count, reached = walk(space, surface, workspace, seconds, origin, target, exact, math.inf)
    for k in range(count):
        new = tree.size[0]
        for i in range(n):
            tree.states[new, i] = workspace.chain[k, i]
        set_lane(tree.lanes, new, workspace.chain[k], space.weights)
        tree.parents[new], tree.size[0] = node, new + 1
        node = new
    return (node if count > 0 else -1), reached


@compiled("int64(SearchSpace, Surface, Tree, Tree, Workspace, float64[::1], uint64, int64)")
def grow(
    space: SearchSpace,
    surface: Surface,
    start: Tree,
    goal: Tree,
    workspace: Workspace,
    seconds: Floats1,
    key: np.uint64,
    iterations: int,
) -> int:
    """Grow both trees until they meet; see `cbirrt` for the method.

    Args:
        space: Box, metric and validity.
        surface: The manifold.
        start: The tree of the start, which grows in even iterations.
        goal: That of the goals.
        workspace: Its counters hold the iterations, and the nodes at which the trees have met.
        seconds: Time after which no iteration begins, and time after which walks end too, shape (2,) [s]: a
            walk cut by the first would make the trees depend on the machine's load.
        key: Of the stream of random numbers.
        iterations: Number of samples in all, those of earlier calls included.

    Returns:
        _FOUND, _GOING_ON if the iterations are used up, _TIME_UP, or _FULL if there may be no space for the
        nodes of one more iteration.
    """
    place, counters, n = np.empty(2, np.int64), workspace.counters, space.lower.size
    begin = seconds_now(space.clock, place)
    while counters[_ITERATIONS] < iterations:
        spent = seconds_now(space.clock, place) - begin
        if spent >= min(seconds[0], seconds[1]) or counters[STOP] != 0 or surface.stop[0] != 0:
            return _TIME_UP
        spare = min(start.lanes.shape[0] * LANES - start.size[0], goal.lanes.shape[0] * LANES - goal.size[0])
        if spare < workspace.chain.shape[0]:
            return _FULL
        random_state(space, key, counters[_ITERATIONS] * n, workspace.rows[_SAMPLE])
        first = counters[_ITERATIONS] % 2 == 0
        counters[_ITERATIONS] += 1
        growing, other = (start, goal) if first else (goal, start)
        left = seconds[1] - spent
        new, _ = _extend(space, surface, growing, workspace, left, workspace.rows[_SAMPLE], False)
        if new < 0:
            continue
        for i in range(n):
            workspace.rows[_TARGET, i] = growing.states[new, i]
        left = seconds[1] - (seconds_now(space.clock, place) - begin)
        meeting, reached = _extend(space, surface, other, workspace, left, workspace.rows[_TARGET], True)
        if reached:
            counters[_START_NODE], counters[_GOAL_NODE] = (new, meeting) if first else (meeting, new)
            return _FOUND
    return _GOING_ON


@compiled("boolean(SearchSpace, float64[:, ::1], float64, int64[::1])")
def points_valid(space: SearchSpace, points: Floats2, seconds: float, counters: Ints1) -> bool:
    """Return whether points, shape (k, n), are valid, all of which must have been looked at in time [s]."""
    place = np.empty(2, np.int64)
    end = seconds_now(space.clock, place) + seconds
    for k in range(points.shape[0]):
        if counters[STOP] != 0 or seconds_now(space.clock, place) >= end:
            return False
        if last_valid_step(space, points[k], points[k], 1, counters) == 0:
            return False
    return True


class Explorer:
    """Walks on a manifold and asks about every state on the way; used in a `with` block."""

    def __init__(
        self,
        problem: Problem,
        manifold: ConstraintManifold,
        deadline: Deadline,
        counters: Ints1 | None = None,
    ) -> None:
        """Begin a run.

        Args:
            problem: Box, metric, validity and resolution.
            manifold: The manifold.
            deadline: Time budget.
            counters: Where to count, see `Workspace`.
        """
        n, resolution = problem.n, problem.spacing
        steps = min(int(_LONGEST * problem.diagonal / resolution) + 1, _MOST_STEPS)
        counters = np.zeros(_GOAL_NODE + 1, dtype=np.int64) if counters is None else counters
        self.workspace = Workspace(np.empty((steps, n)), np.empty((4, n)), np.empty(LANES), counters)
        self.deadline, self.resolution = deadline, resolution
        self._problem, self._contexts = problem, ExitStack()
        self._surface = OnSurface(manifold, problem.lower, problem.upper, problem.metric.weights)

    def __enter__(self) -> Explorer:
        """Allocate the arrays of machine code."""
        code = machine_code_of(self._problem, self.deadline, counters=self.workspace.counters)
        self.space = space_of(self._problem, self._contexts.enter_context(code), self.resolution)
        self.surface = self._contexts.enter_context(self._surface)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Raise what a function in Python raised."""
        self._contexts.__exit__(kind, error, traceback)

    @property
    def stopped(self) -> bool:
        """Whether time has run out, or a function in Python has failed."""
        return bool(self.deadline.expired or self.surface.stop[0] or self.workspace.counters[STOP])

    @property
    def late(self) -> Status | None:
        """NO_PATH_IN_TIME where a checker in Python was not asked any more, else None."""
        return Status.NO_PATH_IN_TIME if self.workspace.counters[STOP] else None

    def valid(self, state: FloatArray) -> bool:
        """Return whether a state, shape (n,), is valid."""
        state = np.array(state)
        return bool(last_valid_step(self.space, state, state, 1, self.workspace.counters))

    def walk(
        self, origin: FloatArray, target: FloatArray, *, exact: bool, longest: float = np.inf
    ) -> tuple[FloatArray, bool]:
        """Walk as the function `walk` does.

        Returns:
            The states after `origin`, shape (m, n), and whether the target was met.
        """
        place, aim, left = np.array(origin), np.array(target), self.deadline.left
        count, met = walk(self.space, self.surface, self.workspace, left, place, aim, exact, longest)
        return self.workspace.chain[:count].copy(), met

    def project(self, states: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return states, shape (m, n), moved onto the manifold, and which are there, shape (m,)."""
        moved, done = np.array(states, order="C"), np.zeros(len(states), dtype=np.bool_)
        project_rows(self.surface, moved, INNER, done)
        return moved, done

    def polyline_holds(self, points: FloatArray) -> bool:
        """Return whether edges of a polyline are short and meet the constraints, and points are valid.

        Args:
            points: Shape (k, n).
        """
        spans = np.diff(self._problem.metric.arc_lengths(points))
        if spans.max(initial=0.0) > self.resolution or not edges_hold(self.surface, points):
            return False
        return bool(points_valid(self.space, points, self.deadline.left, self.workspace.counters))
