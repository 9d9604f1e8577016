"""CBiRRT: a bidirectional RRT on a constraint manifold."""

from __future__ import annotations

import math
from types import TracebackType
from typing import NamedTuple

import numpy as np

from pepper_kin.exceptions import InvalidValueError

from .constraint_manifold import (
    INNER,
    ConstraintManifold,
    OnSurface,
    edges_hold,
    extend,
    measure_rows,
    project_rows,
)
from .deadline import Deadline, load_code
from .metric import Metric
from .motion_validator import MAX_BATCH, CompiledMotionValidator, MotionValidator
from .path import Path
from .problem import Problem
from .result import Result, Status
from .tree import LANES, grown, nearest, set_lane, whole_blocks
from .vectors import BoolArray, FloatArray, whole_number

_ON_MANIFOLD = 1.0 + 1e-9
_SAMPLES_AT_ONCE = 256
_FIRST_CAPACITY = 512
_FIRST_PIECE = 8
_GROWTH = 4
_LONGEST_PIECE = 64
_MOST_STEPS = 100_000


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

    Projection and steps are machine code, whether the residual function is or not.

    Args:
        problem: What to plan; with goals, not with a sampler of them.
        manifold: The constraints.
        seed: Seed of the samples; the same seed gives the same result unless time runs out.
        timeout: Time budget [s]; overrun by one walk of at most 64 steps and their check.
        max_iterations: Greatest number of samples.

    Returns:
        The result.  Neighbouring way-points of its path are no further apart than the resolution; they meet
        the constraints to half the tolerances (start and goal to the whole), and so do the middles between
        them to the whole.  `residual` is the largest error found, as a multiple of its tolerance: of the
        way-points, or of an end that is off the manifold.

    Raises:
        InvalidValueError: An option is not allowed, the manifold has another number of coordinates, or a
            function answers in a wrong shape.
    """
    load_code(extend, project_rows, measure_rows, nearest, set_lane)
    require_fit(problem, manifold)
    if problem.goal_sampler is not None:
        raise InvalidValueError("goals", "a sampler", "goal states, for a path on a manifold")
    seed, max_iterations = whole_number("seed", seed), whole_number("max_iterations", max_iterations)
    deadline = Deadline(timeout)
    off, residual = _off_manifold(problem, manifold)
    found, states, calls = _Found(off or Status.SOLVED), 0, 0
    if off is None:
        with Explorer(problem, manifold, deadline) as explorer:
            found = _Search(problem, manifold, explorer, deadline).run(seed, max_iterations)
        states, calls = explorer.validator.states, explorer.validator.calls
    path = None if found.points is None else Path.trusted(found.points, problem.metric)
    if path is not None:
        residual = manifold.worst(path.points)
    return Result(
        status=found.status,
        path=path,
        goal_index=found.goal_index,
        cost=math.inf if path is None else path.length,
        iterations=found.iterations,
        states_checked=states,
        validity_calls=calls,
        time=deadline.elapsed,
        seed=seed,
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


class _Search:
    """One run."""

    def __init__(
        self, problem: Problem, manifold: ConstraintManifold, explorer: Explorer, deadline: Deadline
    ) -> None:
        self._problem, self._manifold = problem, manifold
        self._explorer, self._deadline = explorer, deadline

    def run(self, seed: int, max_iterations: int) -> _Found:
        """Search until there is a path, or samples or time run out."""
        problem, validator = self._problem, self._explorer.validator
        if not validator.states_valid(problem.start[None])[0]:
            return _Found(Status.START_INVALID)
        on = (self._manifold.errors(problem.goals) <= _ON_MANIFOLD * self._manifold.tolerances).all(axis=1)
        candidates = np.flatnonzero(on)
        candidates = candidates[validator.states_valid(problem.goals[candidates])]
        if candidates.size == 0:
            return _Found(Status.GOAL_INVALID)
        distances = problem.metric.distance(problem.start, problem.goals[candidates])
        candidates = candidates[np.argsort(distances, kind="stable")]
        trees = (
            _Tree(problem.start[None], problem.metric),
            _Tree(problem.goals[candidates], problem.metric),
        )
        for k, goal in enumerate(candidates):
            states, reached = self._explorer.walk(problem.start, problem.goals[goal], exact=True)
            if reached:
                points = np.concatenate((problem.start[None], states))
                return _Found(Status.SOLVED, points, int(goal))
            if k == 0 and len(states):
                trees[0].add_chain(0, states)
        return self._grow(trees, candidates, seed, max_iterations)

    def _grow(self, trees: tuple[_Tree, _Tree], goals: np.ndarray, seed: int, most: int) -> _Found:
        problem, rng = self._problem, np.random.default_rng(seed)
        extent, block = problem.upper - problem.lower, np.empty((0, problem.n))
        for iteration in range(most):
            if self._deadline.expired:
                return _Found(Status.NO_PATH_IN_TIME, iterations=iteration)
            if iteration % _SAMPLES_AT_ONCE == 0:
                block = problem.lower + rng.random((_SAMPLES_AT_ONCE, problem.n)) * extent
            side = iteration % 2
            growing, other = trees[side], trees[1 - side]
            new, _ = self._extend(growing, block[iteration % _SAMPLES_AT_ONCE], exact=False)
            if new < 0:
                continue
            meeting, reached = self._extend(other, growing.state(new), exact=True)
            if reached:
                ends = (new, meeting) if side == 0 else (meeting, new)
                to_start, to_goal = trees[0].branch(ends[0]), trees[1].branch(ends[1])
                halves = trees[0].states(to_start), trees[1].states(to_goal)[-2::-1]
                goal = int(goals[to_goal[0]])
                return _Found(Status.SOLVED, np.concatenate(halves), goal, iteration + 1)
        return _Found(Status.OUT_OF_ITERATIONS, iterations=most)

    def _extend(self, tree: _Tree, target: FloatArray, *, exact: bool) -> tuple[int, bool]:
        """Grow a tree from its node nearest to a target; return the last new node, or -1."""
        near = tree.nearest(target)
        states, reached = self._explorer.walk(tree.state(near), target, exact=exact)
        return (tree.add_chain(near, states) if len(states) else -1), reached


class _Found(NamedTuple):
    """The end of a search; points, shape (k, n), and the goal are None unless it is solved."""

    status: Status
    points: FloatArray | None = None
    goal_index: int | None = None
    iterations: int = 0


class _Tree:
    """A forest of states: each node but the roots has a parent that was added before it.

    Attributes:
        size: Number of nodes.
    """

    def __init__(self, roots: FloatArray, metric: Metric) -> None:
        n = roots.shape[1]
        self.size, self._weights, self._room = 0, metric.weights, np.empty(LANES)
        self._states, self._lanes = np.empty((0, n)), np.empty((0, n, LANES))
        self._parents: list[int] = []
        for root in roots:
            self._append(-1, root)

    def state(self, node: int) -> FloatArray:
        """Return the state of a node, shape (n,)."""
        return self._states[node]

    def nearest(self, query: FloatArray) -> int:
        """Return the node nearest to a state, shape (n,)."""
        return int(nearest(self._lanes, self.size, query * self._weights, self._room))

    def add_chain(self, parent: int, states: FloatArray) -> int:
        """Add states, shape (m, n), one after the other, the first below the parent; return the last node."""
        for state in states:
            parent = self._append(parent, state)
        return parent

    def branch(self, node: int) -> list[int]:
        """Return the nodes from a root to a node, both included."""
        nodes = [node]
        while (node := self._parents[node]) >= 0:
            nodes.append(node)
        return nodes[::-1]

    def states(self, nodes: list[int]) -> FloatArray:
        """Return the states of some nodes, shape (m, n)."""
        return self._states[nodes]

    def _append(self, parent: int, state: FloatArray) -> int:
        if self.size == len(self._states):
            capacity = whole_blocks(max(_FIRST_CAPACITY, 2 * self.size))
            self._states = grown(self._states, capacity)
            self._lanes = grown(self._lanes, capacity // LANES)
        self._states[self.size] = state
        set_lane(self._lanes, self.size, self._states[self.size], self._weights)
        self._parents.append(parent)
        self.size += 1
        return self.size - 1


class Explorer:
    """Walks on a manifold and asks about every state on the way; used in a `with` block."""

    def __init__(
        self,
        problem: Problem,
        manifold: ConstraintManifold,
        deadline: Deadline,
        resolution: float | None = None,
    ) -> None:
        """Begin a run.

        Args:
            problem: Box, metric, validity and resolution.
            manifold: The manifold.
            deadline: Time budget.
            resolution: Another resolution than the problem's [length unit of the metric].
        """
        validator = problem.validator(deadline, resolution)
        if isinstance(problem.validity, CompiledMotionValidator):
            checker = problem.validity.with_kept_memory()
            validator = MotionValidator(checker, problem.metric, validator.resolution, deadline)
        self.validator = validator
        self._deadline = deadline
        self._weights = problem.metric.weights
        self._context = OnSurface(manifold, problem.lower, problem.upper, self._weights)

    def __enter__(self) -> Explorer:
        """Make room for machine code."""
        self.surface = self._context.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Raise what a residual function in Python raised."""
        self._context.__exit__(kind, error, traceback)

    def walk(
        self, origin: FloatArray, target: FloatArray, *, exact: bool, longest: float = np.inf
    ) -> tuple[FloatArray, bool]:
        """Walk towards a target as far as the manifold leads nearer and states are valid.

        Args:
            origin: A valid state on the manifold, shape (n,).
            target: Any state, shape (n,).
            exact: Whether the target is on the manifold and is to be met.
            longest: Length at which the walk is given up [length unit of the metric].

        Returns:
            The states after `origin`, shape (m, n), and whether the target was met.
        """
        pieces, size, current, walked, steps = [np.empty((0, origin.size))], _FIRST_PIECE, origin, 0.0, 0
        target = np.array(target)
        while not self._deadline.expired and steps < _MOST_STEPS and not self.surface.stop[0]:
            chain = np.empty((size, origin.size))
            count = extend(self.surface, np.array(current), target, self.validator.resolution, exact, chain)
            ended, count = count < 0, (-count - 1 if count < 0 else count)
            if count == 0:
                break
            valid = self.validator.states_valid(chain[:count])
            kept = count if valid.all() else int(np.argmin(valid))
            pieces.append(chain[:kept])
            steps += kept
            if kept < count:
                break
            walked += float(self.validator.metric.arc_lengths(np.vstack((current, chain[:kept])))[-1])
            current = chain[kept - 1]
            if exact and np.array_equal(current, target):
                return np.concatenate(pieces), True
            if ended or walked > longest:
                break
            size = min(size * _GROWTH, _LONGEST_PIECE)
        return np.concatenate(pieces), False

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
        spans = np.diff(self.validator.metric.arc_lengths(points))
        if spans.max(initial=0.0) > self.validator.resolution or not edges_hold(self.surface, points):
            return False
        for first in range(0, len(points), MAX_BATCH):
            if (
                self._deadline.expired
                or not self.validator.states_valid(points[first : first + MAX_BATCH]).all()
            ):
                return False
        return True
