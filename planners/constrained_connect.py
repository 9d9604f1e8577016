"""Bidirectional RRT on a manifold."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.exceptions import InvalidValueError

from .deadline import Deadline
from .found import Found
from .manifold import Manifold
from .path import Path
from .problem import Problem
from .result import Result, Status
from .tree import Tree
from .vectors import FloatArray, whole_number

if TYPE_CHECKING:
    from .explorer import Explorer

_ON_MANIFOLD = 1.0 + 1e-9
_SAMPLES_AT_ONCE = 256


def constrained_connect(
    problem: Problem,
    manifold: Manifold,
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
    from .explorer import Explorer  # loads machine code, which is not the search's time

    require_fit(problem, manifold)
    if problem.goal_sampler is not None:
        raise InvalidValueError("goals", "a sampler", "goal states, for a path on a manifold")
    seed, max_iterations = whole_number("seed", seed), whole_number("max_iterations", max_iterations)
    deadline = Deadline(timeout)
    off, residual = _off_manifold(problem, manifold)
    found, states, calls = Found(off or Status.SOLVED), 0, 0
    if off is None:
        with Explorer(problem, manifold, deadline) as explorer:
            found = _Search(problem, manifold, explorer, deadline).run(seed, max_iterations)
        states, calls = explorer.oracle.states, explorer.oracle.calls
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
        oracle_calls=calls,
        time=deadline.elapsed,
        seed=seed,
        residual=residual,
    )


def require_fit(problem: Problem, manifold: Manifold) -> None:
    """Refuse a manifold of another number of coordinates than the problem's.

    Raises:
        InvalidValueError: It has another number.
    """
    if not isinstance(manifold, Manifold) or manifold.n != problem.n:
        got = f"{manifold.n} coordinates" if isinstance(manifold, Manifold) else repr(manifold)[:80]
        raise InvalidValueError("manifold", got, f"a Manifold of {problem.n} coordinates, as the problem")


def _off_manifold(problem: Problem, manifold: Manifold) -> tuple[Status | None, float]:
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

    def __init__(self, problem: Problem, manifold: Manifold, explorer: Explorer, deadline: Deadline) -> None:
        self._problem, self._manifold = problem, manifold
        self._explorer, self._deadline = explorer, deadline

    def run(self, seed: int, max_iterations: int) -> Found:
        """Search until there is a path, or samples or time run out."""
        problem, oracle = self._problem, self._explorer.oracle
        if not oracle.states_valid(problem.start[None])[0]:
            return Found(Status.START_INVALID)
        on = (self._manifold.errors(problem.goals) <= _ON_MANIFOLD * self._manifold.tolerances).all(axis=1)
        candidates = np.flatnonzero(on)
        candidates = candidates[oracle.states_valid(problem.goals[candidates])]
        if candidates.size == 0:
            return Found(Status.GOAL_INVALID)
        distances = problem.metric.distance(problem.start, problem.goals[candidates])
        candidates = candidates[np.argsort(distances, kind="stable")]
        trees = (
            Tree(problem.start[None], problem.metric),
            Tree(problem.goals[candidates], problem.metric),
        )
        for k, goal in enumerate(candidates):
            states, reached = self._explorer.walk(problem.start, problem.goals[goal], exact=True)
            if reached:
                points = np.concatenate((problem.start[None], states))
                return Found(Status.SOLVED, points, int(goal))
            if k == 0 and len(states):
                trees[0].add_chain(0, states)
        return self._grow(trees, candidates, seed, max_iterations)

    def _grow(self, trees: tuple[Tree, Tree], goals: np.ndarray, seed: int, most: int) -> Found:
        problem, rng = self._problem, np.random.default_rng(seed)
        extent, block = problem.upper - problem.lower, np.empty((0, problem.n))
        for iteration in range(most):
            if self._deadline.expired:
                return Found(Status.NO_PATH_IN_TIME, iterations=iteration)
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
                return Found(Status.SOLVED, np.concatenate(halves), goal, iteration + 1)
        return Found(Status.OUT_OF_ITERATIONS, iterations=most)

    def _extend(self, tree: Tree, target: FloatArray, *, exact: bool) -> tuple[int, bool]:
        """Grow a tree from its node nearest to a target; return the last new node, or -1."""
        near = tree.nearest(target)
        states, reached = self._explorer.walk(tree.state(near), target, exact=exact)
        return (tree.add_chain(near, states) if len(states) else -1), reached
