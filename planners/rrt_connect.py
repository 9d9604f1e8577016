"""Bidirectional RRT-Connect for one or several goals."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .deadline import Deadline
from .oracle import MAX_BATCH, Oracle
from .path import Path
from .problem import Problem
from .result import Result, Status
from .tree import Tree
from .vectors import FloatArray, positive_number, whole_number

_SAMPLES_AT_ONCE = 256
_STEP = 0.1  # of the diagonal: spacing of nodes on a long extension


class _Found(NamedTuple):
    status: Status
    points: FloatArray | None = None
    goal_index: int | None = None
    iterations: int = 0


class _Extension(NamedTuple):
    node: int  # -1: not a single step was possible
    reached: bool


def rrt_connect(
    problem: Problem,
    *,
    seed: int = 0,
    timeout: float = 5.0,
    max_iterations: int = 1_000_000,
    step: float | None = None,
) -> Result:
    """Search a path with two trees that grow towards samples and towards each other.

    One tree grows from the start, one from all valid goals at once.  In turn, a tree is extended from its
    node nearest to a uniform sample straight towards it, as far as the edge is valid, and the other tree is
    extended towards the new node; if it gets there, the path is found.  Both extensions are greedy
    ("connect"), so that one call of the oracle checks many steps.  Before any of this, the straight edges
    from the start to the goals are tried, nearest goal first.

    Source: J. J. Kuffner and S. M. LaValle, RRT-Connect: an efficient approach to single-query path planning,
    ICRA 2000.

    The path is valid at the problem's resolution (see `Oracle` for what that promises), is in no way short,
    and its length is not bounded: pass it to `shortcut`.  The planner cannot prove that there is no path.

    Args:
        problem: What to plan.
        seed: Seed of the samples; the same seed gives the same result unless time runs out.
        timeout: Time budget [s]; overrun by one batch of at most 256 states at most.
        max_iterations: Greatest number of samples.
        step: Distance of neighbouring nodes on a long extension [length unit of the metric]; a tenth of the
            box's diagonal if omitted.

    Returns:
        The result; without a path its status tells why.

    Raises:
        InvalidValueError: An option is not allowed, or the oracle answers in a wrong shape.
    """
    deadline = Deadline(timeout)
    seed, max_iterations = whole_number("seed", seed), whole_number("max_iterations", max_iterations)
    step = _STEP * problem.diagonal if step is None else positive_number("step", step)
    oracle = problem.counting_oracle(deadline)
    found = _search(problem, oracle, deadline, seed, max_iterations, step)
    path = None if found.points is None else Path(found.points, problem.weights)
    return Result(
        status=found.status,
        path=path,
        goal_index=found.goal_index,
        cost=math.inf if path is None else path.length,
        iterations=found.iterations,
        states_checked=oracle.states,
        oracle_calls=oracle.calls,
        time=deadline.elapsed,
        seed=seed,
    )


def _search(
    problem: Problem, oracle: Oracle, deadline: Deadline, seed: int, max_iterations: int, step: float
) -> _Found:
    if not oracle.states_valid(problem.start[None, :])[0]:
        return _Found(Status.START_INVALID)
    goals = _valid_goals(problem, oracle, deadline)
    if goals is None:
        return _Found(Status.NO_PATH_IN_TIME)
    if goals.size == 0:
        return _Found(Status.GOAL_INVALID)
    goals = goals[np.argsort(problem.metric.distance(problem.start, problem.goals[goals]), kind="stable")]
    for goal in goals:
        if oracle.edge_valid(problem.start, problem.goals[goal]):
            return _Found(Status.SOLVED, np.stack((problem.start, problem.goals[goal])), int(goal))
    return _grow_trees(problem, oracle, deadline, goals, _samples(problem, seed, max_iterations), step)


def _valid_goals(problem: Problem, oracle: Oracle, deadline: Deadline) -> np.ndarray | None:
    """Return the indices of the valid goals; None if time ran out before all were checked."""
    valid = []
    for first in range(0, len(problem.goals), MAX_BATCH):
        if deadline.expired:
            return None
        valid.append(oracle.states_valid(problem.goals[first : first + MAX_BATCH]))
    return np.flatnonzero(np.concatenate(valid))


def _samples(problem: Problem, seed: int, count: int) -> Iterator[FloatArray]:
    rng = np.random.default_rng(seed)
    extent = problem.upper - problem.lower
    for first in range(0, count, _SAMPLES_AT_ONCE):
        block = problem.lower + rng.random((_SAMPLES_AT_ONCE, problem.n)) * extent
        yield from block[: count - first]


def _grow_trees(
    problem: Problem,
    oracle: Oracle,
    deadline: Deadline,
    goals: np.ndarray,
    samples: Iterator[FloatArray],
    step: float,
) -> _Found:
    start_tree = Tree(problem.start[None, :], problem.metric)
    goal_tree = Tree(problem.goals[goals], problem.metric)
    growing, other = start_tree, goal_tree
    iterations = 0
    for sample in samples:
        if deadline.expired:
            return _Found(Status.NO_PATH_IN_TIME, iterations=iterations)
        iterations += 1
        new = _extend(growing, oracle, sample, step)
        if new.node >= 0:
            meeting = _extend(other, oracle, growing.state(new.node), step)
            if meeting.reached:
                in_start, in_goal = new.node, meeting.node
                if growing is goal_tree:
                    in_start, in_goal = in_goal, in_start
                to_start, to_goal = start_tree.branch(in_start), goal_tree.branch(in_goal)
                halves = start_tree.states(to_start), goal_tree.states(to_goal)[-2::-1]
                goal = int(goals[to_goal[0]])
                return _Found(Status.SOLVED, np.concatenate(halves), goal, iterations)
        growing, other = other, growing
    return _Found(Status.OUT_OF_ITERATIONS, iterations=iterations)


def _extend(tree: Tree, oracle: Oracle, target: FloatArray, step: float) -> _Extension:
    """Grow a tree straight towards a target as far as valid; nodes are set every `step` on the way."""
    near = tree.nearest(target)
    origin = tree.state(near)
    advance = oracle.advance(origin, target)
    last = advance.valid_steps
    if last == 0:
        return _Extension(-1, False)
    stride = max(1, int(step / oracle.resolution))
    chosen = np.append(np.arange(stride, last, stride), last)
    states = origin + (chosen / advance.steps)[:, None] * (target - origin)
    if advance.reached:
        states[-1] = target
    return _Extension(tree.add_chain(near, states), advance.reached)
