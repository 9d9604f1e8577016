"""Bidirectional RRT-Connect for one or several goals."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .compiled_validity import CompiledValidity
from .deadline import Deadline
from .found import Found
from .goal_source import BETWEEN_DRAWS, GoalSource
from .oracle import MAX_BATCH, Oracle
from .path import Path
from .problem import Problem
from .result import Result, Status
from .tree import Tree
from .vectors import FloatArray, positive_number, whole_number

_SAMPLES_AT_ONCE = 256
_STEP = 0.1  # of the diagonal: spacing of nodes on a long extension


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

    If the problem's oracle is machine code (`CompiledValidity`), so is the whole search; loading it takes a
    moment, once, which is not counted as time of the search.

    If goals are drawn by a sampler, it is called until one is valid, and then again after pauses of 32, 64,
    128, ... iterations.

    Args:
        problem: What to plan.
        seed: Seed of the samples; the same seed gives the same result unless time runs out.
        timeout: Time budget [s]; overrun by one batch of at most 256 states, one edge of a compiled search,
            or one call of a sampler of goals.
        max_iterations: Greatest number of samples.
        step: Distance of neighbouring nodes on a long extension [length unit of the metric]; a tenth of the
            box's diagonal if omitted.

    Returns:
        The result; without a path its status tells why.

    Raises:
        InvalidValueError: An option is not allowed, or the oracle answers in a wrong shape.
    """
    code = problem.oracle if isinstance(problem.oracle, CompiledValidity) else None
    if code is not None:
        from .compiled_connect import search_compiled  # loads machine code, which is not the search's time
    deadline = Deadline(timeout)
    seed, max_iterations = whole_number("seed", seed), whole_number("max_iterations", max_iterations)
    step = _STEP * problem.diagonal if step is None else positive_number("step", step)
    if code is not None:
        found = search_compiled(problem, code, deadline, seed, max_iterations, step)
    else:
        found = _search(problem, deadline, seed, max_iterations, step)
    path = None if found.points is None else Path.trusted(found.points, problem.metric)
    return Result(
        status=found.status,
        path=path,
        goal_index=found.goal_index,
        cost=math.inf if path is None else path.length,
        iterations=found.iterations,
        states_checked=found.states,
        oracle_calls=found.calls,
        time=deadline.elapsed,
        seed=seed,
    )


def _search(problem: Problem, deadline: Deadline, seed: int, max_iterations: int, step: float) -> Found:
    oracle = problem.counting_oracle(deadline)
    found = _Search(problem, oracle, deadline, seed, step).run(max_iterations)
    return found._replace(states=oracle.states, calls=oracle.calls)


class _Search:
    """One run in Python; the compiled counterpart is in `compiled_connect`."""

    def __init__(self, problem: Problem, oracle: Oracle, deadline: Deadline, seed: int, step: float) -> None:
        self._problem, self._oracle, self._deadline, self._step = problem, oracle, deadline, step
        self._seed = seed
        self._source = GoalSource(problem, seed)
        self._start_tree = Tree(problem.start[None, :], problem.metric)
        self._goal_tree: Tree | None = None
        self._goals: dict[int, int] = {}  # number of the goal by the node that is its root

    def run(self, max_iterations: int) -> Found:
        """Search until there is a path, or samples or time run out."""
        problem, source = self._problem, self._source
        if not self._oracle.states_valid(problem.start[None, :])[0]:
            return Found(Status.START_INVALID)
        ended = self._plant(problem.goals, 0)
        if ended is None and self._goal_tree is None and not source.endless:
            return Found(Status.GOAL_INVALID)
        attempts = 0
        while ended is None and self._goal_tree is None:
            ended = self._draw()
            attempts += 1
            if self._goal_tree is None and (self._deadline.expired or attempts >= max_iterations):
                return Found(Status.NO_GOAL)
        return ended or self._grow(max_iterations)

    def _draw(self) -> Found | None:
        first = self._source.count
        goal = self._source.draw()
        return None if goal is None else self._plant(goal, first)

    def _plant(self, goals: FloatArray, first: int) -> Found | None:
        """Make valid goals roots and try the straight edges, nearest goal first; None if neither ends it."""
        start = self._problem.start
        valid = self._valid(goals)
        if valid is None:
            return Found(Status.NO_PATH_IN_TIME)
        if valid.size == 0:
            return None
        valid = valid[np.argsort(self._problem.metric.distance(start, goals[valid]), kind="stable")]
        roots = goals[valid]
        if self._goal_tree is None:
            self._goal_tree, node = Tree(roots, self._problem.metric), 0
        else:
            node = self._goal_tree.size
            self._goal_tree.add_roots(roots)
        for k, goal in enumerate(valid):
            self._goals[node + k] = first + int(goal)
            if self._oracle.edge_valid(start, goals[goal]):
                return Found(Status.SOLVED, np.stack((start, goals[goal])), first + int(goal))
        return None

    def _valid(self, goals: FloatArray) -> np.ndarray | None:
        """Return the indices of the valid goals; None if time ran out before all were checked."""
        valid = [np.empty(0, dtype=bool)]
        for first in range(0, len(goals), MAX_BATCH):
            if self._deadline.expired:
                return None
            valid.append(self._oracle.states_valid(goals[first : first + MAX_BATCH]))
        return np.flatnonzero(np.concatenate(valid))

    def _grow(self, max_iterations: int) -> Found:
        start_tree, goal_tree = self._start_tree, self._goal_tree
        assert goal_tree is not None
        growing, other = start_tree, goal_tree
        iterations, pause, next_draw = 0, BETWEEN_DRAWS, BETWEEN_DRAWS
        for sample in _samples(self._problem, self._seed, max_iterations):
            if self._deadline.expired:
                return Found(Status.NO_PATH_IN_TIME, iterations=iterations)
            if self._source.endless and iterations == next_draw:
                pause *= 2
                next_draw += pause
                if (ended := self._draw()) is not None:
                    return ended._replace(iterations=iterations)
            iterations += 1
            new = _extend(growing, self._oracle, sample, self._step)
            if new.node >= 0:
                meeting = _extend(other, self._oracle, growing.state(new.node), self._step)
                if meeting.reached:
                    in_start, in_goal = new.node, meeting.node
                    if growing is goal_tree:
                        in_start, in_goal = in_goal, in_start
                    to_start, to_goal = start_tree.branch(in_start), goal_tree.branch(in_goal)
                    halves = start_tree.states(to_start), goal_tree.states(to_goal)[-2::-1]
                    goal = self._goals[to_goal[0]]
                    return Found(Status.SOLVED, np.concatenate(halves), goal, iterations)
            growing, other = other, growing
        return Found(Status.OUT_OF_ITERATIONS, iterations=iterations)


def _samples(problem: Problem, seed: int, count: int) -> Iterator[FloatArray]:
    rng = np.random.default_rng(seed)
    extent = problem.upper - problem.lower
    for first in range(0, count, _SAMPLES_AT_ONCE):
        block = problem.lower + rng.random((_SAMPLES_AT_ONCE, problem.n)) * extent
        yield from block[: count - first]


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
