"""CBiRRT: a bidirectional RRT on a constraint manifold."""

from __future__ import annotations

import math
from contextlib import ExitStack
from typing import NamedTuple

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

from .constraint_manifold import (
    INNER,
    BoxedManifold,
    ConstraintManifold,
    OnSurface,
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
from .search_space import ITERATIONS, STOP, SearchSpace, distance, last_valid_step, space_of
from .tree import (
    FOUND,
    FULL,
    GOAL_NODE,
    GOAL_SIZE,
    GOING_ON,
    SAMPLE,
    START_NODE,
    TARGET,
    TIME_UP,
    Trees,
    add_node,
    leave_trees,
    nearest_node,
    room,
    take_trees,
    trace,
    traced,
    with_room,
)
from .vectors import BoolArray, FloatArray, seed_number, whole_number

_ON_MANIFOLD = 1.0 + 1e-9
_MOST_STEPS = 20_000  # maximum number of steps of a walk
_LONGEST = 4.0  # length of a walk of whole steps, relative to the box's diagonal
# A tree is shut in if it has drawn at least so many samples, and has fewer nodes, or fewer nodes per sample.
_SHUT_IN_SAMPLES, _SHUT_IN_NODES, _SHUT_IN_RATE = 1000, 10, 0.002


class WalkWorkspace(NamedTuple):
    """Memory for walks, and counters.

    Attributes:
        chain: States of a walk, at most k, shape (k, n).
        current: Current state of the walk, shape (n,).
        counters: Counters, see `search_space.last_valid_step`; the counters of the trees if there are any.
    """

    chain: Floats2
    current: Floats1
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

    Two trees grow as in `rrt_connect`, but along the manifold: in straight steps towards a sample, no longer
    than the problem's resolution, each moved back onto the manifold by a projection.  A step that the
    projection moves by more than its own length, or whose middle leaves the tolerance, is tried again with
    half the length.  The first attempt is the walk from the start straight to each goal.

    Source: D. Berenson, S. Srinivasa, D. Ferguson and J. Kuffner, Manipulation planning on constraint
    manifolds, ICRA 2009 (CBiRRT), and J. J. Kuffner and S. M. LaValle, RRT-Connect, ICRA 2000.

    It runs as machine code.  A residual function or a validity checker that is a Python callable is called
    back from there, state by state.

    Args:
        problem: The problem; with goals, not with a sampler of goals.
        manifold: The constraints.
        seed: Seed of the samples; the same seed gives the same result, however loaded the machine is, unless
            time runs out.
        timeout: Time budget [s]; overrun by one step and its check.
        max_iterations: Maximum number of samples.

    Returns:
        The result.  Neighboring waypoints of its path are no further apart than the resolution; they meet
        the constraints to half the tolerances (start and goal to the whole tolerances), and the midpoints
        between them to the whole tolerances.  `residual` is the maximum error of the waypoints, or of an end
        that is off the manifold, as a multiple of its tolerance.

    Raises:
        InvalidValueError: An option is not allowed, the manifold has another number of coordinates, or a
            function answers in a wrong shape.
    """
    load_code(grow, walk, measure_rows, trace)
    require_fit(problem, manifold)
    if problem.goal_sampler is not None:
        raise InvalidValueError("goals", "a sampler", "goal states, for a path on a manifold")
    seed, max_iterations = seed_number(seed), whole_number("max_iterations", max_iterations)
    deadline = Deadline(timeout)
    off, residual = _off_manifold(problem, manifold)
    found, trees = _Candidate(off or Status.SOLVED), take_trees(problem.n)
    if off is None:
        with Explorer(problem, manifold, deadline, trees.counters) as explorer:
            found = _search(problem, manifold, explorer, trees, seed, max_iterations)
    path = None if found.points is None else Path.trusted(found.points, problem.metric)
    if path is not None:
        residual = manifold.worst(path.points)
    leave_trees(trees)
    return Result.of_run(
        found.status, trees.counters, deadline, seed, path, found.goal_index, tree_sizes=found.sizes,
        frontier=found.frontier, residual=residual,
    )  # fmt: skip


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
    """Return the status if an end is off the manifold, else None, and its error relative to the tolerance."""
    start = manifold.worst(problem.start[None])
    if start > _ON_MANIFOLD:
        return Status.START_OFF_MANIFOLD, start
    goals = (manifold.errors(problem.goals) / manifold.tolerances).max(axis=1)
    if goals.min() > _ON_MANIFOLD:
        return Status.GOAL_OFF_MANIFOLD, float(goals.min())
    return None, math.nan


class _Candidate(NamedTuple):
    """Result of a search; points, shape (k, n), and the goal are None unless it is solved.

    If trees have grown without a path, it holds their sizes and some nodes of the smaller one.
    """

    status: Status
    points: FloatArray | None = None
    goal_index: int | None = None
    sizes: tuple[int, int] | None = None
    frontier: FloatArray | None = None


def _search(
    problem: Problem, manifold: ConstraintManifold, explorer: Explorer, trees: Trees, seed: int, most: int
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
    space, chain = explorer.space, explorer.workspace.chain
    trees = with_room(trees, max(len(first) + 1, goals.size))
    add_chain(space, trees, 0, add_node(space, trees, 0, -1, problem.start), first)
    for k in goals:
        add_node(space, trees, 1, -1 - int(k), problem.goals[k])
    ended, deadline, key = FULL, explorer.deadline, stream_key(seed, 0)
    while ended == FULL or (ended == TIME_UP and not explorer.stopped):
        trees = with_room(trees, len(chain)) if ended == FULL else trees
        seconds = np.array([deadline.time_slice, deadline.left])
        ended = grow(space, explorer.surface, trees, explorer.workspace, seconds, key, most)
    return _Candidate(Status.SOLVED, *traced(trees)) if ended == FOUND else _failed(trees, ended == TIME_UP)


def _failed(trees: Trees, late: bool) -> _Candidate:
    """Return the candidate of a search without a path; an end whose tree hardly grew is shut in."""
    samples, start, goal = trees.counters[ITERATIONS : GOAL_SIZE + 1].tolist()
    small = 0 if start <= goal else 1
    status = Status.NO_PATH_IN_TIME if late else Status.OUT_OF_ITERATIONS
    if samples >= _SHUT_IN_SAMPLES and min(start, goal) < max(_SHUT_IN_NODES, _SHUT_IN_RATE * samples):
        status = Status.GOAL_SHUT_IN if small else Status.START_SHUT_IN
    nodes = trees.states[small, : min(start, goal)]
    return _Candidate(status, sizes=(start, goal), frontier=spread(nodes))


@compiled(
    "Tuple(int64, boolean)"
    "(SearchSpace, BoxedManifold, WalkWorkspace, float64, float64[::1], float64[::1], boolean, float64)"
)
def walk(
    space: SearchSpace,
    surface: BoxedManifold,
    workspace: WalkWorkspace,
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
        longest: Length at which the walk is abandoned [length unit of the metric].

    Returns:
        Number of states written, and whether the target was met.
    """
    chain, current, counters = workspace
    place = np.empty(2, np.int64)
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


@compiled("int64(SearchSpace, Trees, int64, int64, float64[:, ::1])")
def add_chain(space: SearchSpace, trees: Trees, side: int, node: int, chain: Floats2) -> int:
    """Add states, shape (k, n), behind a node of a tree, each the parent of the next; return the last one."""
    for k in range(chain.shape[0]):
        node = add_node(space, trees, side, node, chain[k])
    return node


@compiled
def _extend(
    space: SearchSpace,
    surface: BoxedManifold,
    trees: Trees,
    side: int,
    workspace: WalkWorkspace,
    seconds: float,
    target: Floats1,
    exact: bool,
) -> tuple[int, bool]:
    """Grow a tree from its node nearest to a target; return its last new node, or -1, and success."""
    node = nearest_node(space, trees, side, target)
    origin = trees.states[side, node]
    count, reached = walk(space, surface, workspace, seconds, origin, target, exact, math.inf)
    last = add_chain(space, trees, side, node, workspace.chain[:count])
    return (last if count > 0 else -1), reached


@compiled("int64(SearchSpace, BoxedManifold, Trees, WalkWorkspace, float64[::1], uint64, int64)")
def grow(
    space: SearchSpace,
    surface: BoxedManifold,
    trees: Trees,
    workspace: WalkWorkspace,
    seconds: Floats1,
    key: np.uint64,
    iterations: int,
) -> int:
    """Grow both trees until they meet; see `cbirrt` for the method.

    Args:
        space: Box, metric and validity.
        surface: The manifold.
        trees: The trees; the tree of the start grows in even iterations.
        workspace: Memory of the walks.
        seconds: Time after which no iteration begins, and time after which walks end too, shape (2,) [s]: a
            walk cut by the first time would make the trees depend on the machine's load.
        key: Key of the stream of random numbers.
        iterations: Number of samples in all, earlier calls included.

    Returns:
        FOUND, GOING_ON if the iterations are used up, TIME_UP, or FULL if there may be no space for the nodes
        of one more iteration.
    """
    place, counters, rows, n = np.empty(2, np.int64), trees.counters, trees.rows, space.lower.size
    begin = seconds_now(space.clock, place)
    while counters[ITERATIONS] < iterations:
        spent = seconds_now(space.clock, place) - begin
        if spent >= min(seconds[0], seconds[1]) or counters[STOP] != 0 or surface.stop[0] != 0:
            return TIME_UP
        if room(trees) < workspace.chain.shape[0]:
            return FULL
        random_state(space, key, counters[ITERATIONS] * n, rows[SAMPLE])
        side = counters[ITERATIONS] % 2
        counters[ITERATIONS] += 1
        left = seconds[1] - spent
        new, _ = _extend(space, surface, trees, side, workspace, left, rows[SAMPLE], False)
        if new < 0:
            continue
        for i in range(n):
            rows[TARGET, i] = trees.states[side, new, i]
        left = seconds[1] - (seconds_now(space.clock, place) - begin)
        meeting, reached = _extend(space, surface, trees, 1 - side, workspace, left, rows[TARGET], True)
        if reached:
            counters[START_NODE + side], counters[GOAL_NODE - side] = new, meeting
            return FOUND
    return GOING_ON


@compiled("boolean(SearchSpace, float64[:, ::1], float64, int64[::1])")
def points_valid(space: SearchSpace, points: Floats2, seconds: float, counters: Ints1) -> bool:
    """Return whether points, shape (k, n), are all valid and were all checked within a time [s]."""
    place = np.empty(2, np.int64)
    end = seconds_now(space.clock, place) + seconds
    for k in range(points.shape[0]):
        if counters[STOP] != 0 or seconds_now(space.clock, place) >= end:
            return False
        if last_valid_step(space, points[k], points[k], 1, counters) == 0:
            return False
    return True


class Explorer:
    """Walks on a manifold and checks every state on the way; used in a `with` block."""

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
            counters: Counters, see `WalkWorkspace`; new ones if omitted.
        """
        n, resolution = problem.n, problem.spacing
        steps = min(int(_LONGEST * problem.diagonal / resolution) + 1, _MOST_STEPS)
        counters = np.zeros(STOP + 1, dtype=np.int64) if counters is None else counters
        self.workspace = WalkWorkspace(np.empty((steps, n)), np.empty(n), counters)
        self.deadline, self.resolution = deadline, resolution
        self._problem, self._contexts = problem, ExitStack()
        self._surface = OnSurface(manifold, problem.lower, problem.upper, problem.metric.weights)

    def __enter__(self) -> Explorer:
        """Allocate the arrays of machine code."""
        code = machine_code_of(self._problem, self.deadline, counters=self.workspace.counters)
        self.space = space_of(self._problem, self._contexts.enter_context(code), self.resolution)
        self.surface = self._contexts.enter_context(self._surface)
        return self

    def __exit__(self, *_: object) -> None:
        """Raise the exception that a Python function raised."""
        self._contexts.close()

    @property
    def stopped(self) -> bool:
        """Whether time has run out, or a Python function has failed."""
        return bool(self.deadline.expired or self.surface.stop[0] or self.workspace.counters[STOP])

    @property
    def late(self) -> Status | None:
        """NO_PATH_IN_TIME if a Python checker was no longer called, else None."""
        return Status.NO_PATH_IN_TIME if self.workspace.counters[STOP] else None

    def valid(self, state: FloatArray) -> bool:
        """Return whether a state, shape (n,), is valid."""
        state = np.array(state)
        return bool(last_valid_step(self.space, state, state, 1, self.workspace.counters))

    def walk(
        self, origin: FloatArray, target: FloatArray, *, exact: bool, longest: float = np.inf
    ) -> tuple[FloatArray, bool]:
        """Walk along the manifold towards a target, see `walk`.

        Returns:
            The states after `origin`, shape (m, n), and whether the target was met.
        """
        place, aim, left = np.array(origin), np.array(target), self.deadline.left
        count, met = walk(self.space, self.surface, self.workspace, left, place, aim, exact, longest)
        return self.workspace.chain[:count].copy(), met

    def project(self, states: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return states, shape (m, n), moved onto the manifold, and which are on it, shape (m,)."""
        moved, done = np.array(states, order="C"), np.zeros(len(states), dtype=np.bool_)
        project_rows(self.surface, moved, INNER, done)
        return moved, done

    def polyline_holds(self, points: FloatArray) -> bool:
        """Return whether edges of a polyline are short and meet the constraints, and points are valid.

        Args:
            points: Waypoints, shape (k, n).
        """
        spans = np.diff(self._problem.metric.arc_lengths(points))
        if spans.max(initial=0.0) > self.resolution or not edges_hold(self.surface, points):
            return False
        return bool(points_valid(self.space, points, self.deadline.left, self.workspace.counters))
