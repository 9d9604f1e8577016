"""RRT-Connect in machine code, seen from Python: room for the trees, goals, and the way back."""

from __future__ import annotations

import numpy as np

from . import native_connect as native
from .compiled_validity import CompiledValidity
from .deadline import Deadline
from .found import Found
from .goal_source import BETWEEN_DRAWS, GoalSource
from .native import CLOCK, stream_key
from .native_tree import LANES
from .problem import Problem
from .result import Status
from .vectors import FloatArray

_FIRST_CAPACITY = 512
_ENDS = {
    native.START_INVALID: Status.START_INVALID,
    native.TIME_UP: Status.NO_PATH_IN_TIME,
    native.GOING_ON: Status.OUT_OF_ITERATIONS,
}


class Trees:
    """The two trees of a search, in arrays that grow."""

    def __init__(self, problem: Problem, oracle: CompiledValidity, seed: int, step: float) -> None:
        """Make empty trees.

        Args:
            problem: What is planned.
            oracle: Its validity in machine code.
            seed: Seed of the samples.
            step: Distance of neighbouring nodes on a long extension [length unit of the metric].
        """
        n = problem.n
        self._oracle, self._memory = oracle, oracle.fresh_memory()
        self._resolution = problem.spacing
        self._stride = max(1, int(step / self._resolution))
        self._diagonal = problem.diagonal
        self._start = problem.start.copy()
        self._box = box_of(problem)
        self._key = stream_key(seed, 0)
        self._rows = np.empty((native.ROWS, n))
        self.counters = np.zeros(native.COUNTERS, dtype=np.int64)
        self.states = np.empty((2, 0, n))
        self.parents = np.empty((2, 0), dtype=np.int64)
        self._lanes = np.empty((2, 0, n, LANES))
        self._reserve(_FIRST_CAPACITY)

    def plant(self, goals: FloatArray, first: int, deadline: Deadline) -> int:
        """Make valid ends the roots and try the straight edges; return how it ended."""
        nodes = int(self.counters[native.GOAL_SIZE]) + len(goals)
        if nodes > self.states.shape[1]:
            self._reserve(max(nodes, 2 * self.states.shape[1]))
        order = np.zeros(len(goals), dtype=np.int64)
        if len(goals) > 1:
            weighted = (goals - self._start) * self._box[native.WEIGHTS]
            order = np.argsort((weighted * weighted).sum(axis=1), kind="stable")
        return native.plant(
            self._oracle.address, CLOCK, deadline.left, self._resolution, self._box, self._start,
            goals, order, first, self.states, self._lanes, self.parents, self.counters, self._rows,
            self._memory,
        )  # fmt: skip

    def grow(self, iterations: int, deadline: Deadline) -> int:
        """Grow both trees up to a number of iterations in all; return how it ended."""
        while True:
            ended = native.grow(
                self._oracle.address, CLOCK, deadline.piece, self._resolution, self._stride, self._box,
                self._key, iterations, self.states, self._lanes, self.parents, self.counters, self._rows,
                self._memory,
            )  # fmt: skip
            if ended == native.TIME_UP and not deadline.expired:
                continue
            if ended != native.FULL:
                return ended
            spare = int(self._diagonal / self._resolution) // self._stride + 4
            self._reserve(2 * self.states.shape[1] + spare)

    def found(self) -> Found:
        """Return the path along which the trees have met."""
        counters = self.counters.tolist()
        to_start, _ = self._branch(0, counters[native.START_NODE])
        to_goal, goal = self._branch(1, counters[native.GOAL_NODE])
        if not counters[native.DIRECT]:  # the state where the trees meet is in both
            to_goal = to_goal[1:]
        points = np.concatenate((self.states[0, to_start[::-1]], self.states[1, to_goal]))
        return Found(
            Status.SOLVED,
            points,
            goal,
            counters[native.ITERATIONS],
            counters[native.STATES],
            counters[native.CALLS],
        )

    def ended(self, status: Status) -> Found:
        """Return how the search ended."""
        states, calls, iterations = self.counters[:3].tolist()
        return Found(status, None, None, iterations, states, calls)

    def _branch(self, side: int, node: int) -> tuple[list[int], int]:
        nodes, parent_of = [], self.parents[side].item
        while node >= 0:
            nodes.append(node)
            node = parent_of(node)
        return nodes, -1 - node

    def _reserve(self, capacity: int) -> None:
        """Make room for a number of nodes in each tree."""
        capacity = -(-capacity // LANES) * LANES
        old, n = self.states.shape[1], self._box.shape[1]
        states, parents = np.empty((2, capacity, n)), np.empty((2, capacity), dtype=np.int64)
        lanes = np.empty((2, capacity // LANES, n, LANES))
        if old:
            states[:, :old], parents[:, :old], lanes[:, : old // LANES] = (
                self.states,
                self.parents,
                self._lanes,
            )
        self.states, self.parents, self._lanes = states, parents, lanes


def box_of(problem: Problem) -> FloatArray:
    """Return lower bounds, extents and weights, shape (3, n)."""
    box = np.empty((3, problem.n))
    box[native.LOWER] = problem.lower
    box[native.EXTENT] = problem.upper - problem.lower
    box[native.WEIGHTS] = problem.metric.weights
    return box


def search_compiled(
    problem: Problem,
    oracle: CompiledValidity,
    deadline: Deadline,
    seed: int,
    max_iterations: int,
    step: float,
) -> Found:
    """Run RRT-Connect in machine code; see `rrt_connect` for the method and the arguments."""
    source = GoalSource(problem, seed)
    trees = Trees(problem, oracle, seed, step)
    ended = trees.plant(problem.goals.copy(), 0, deadline)
    if source.endless and ended == native.GOING_ON:
        ended = _grow_while_drawing(trees, source, deadline, max_iterations)
    elif ended == native.GOING_ON and trees.counters[native.GOAL_SIZE] == 0:
        return trees.ended(Status.GOAL_INVALID)
    elif ended == native.GOING_ON:
        ended = trees.grow(max_iterations, deadline)
    if ended == native.FOUND:
        return trees.found()
    if trees.counters[native.GOAL_SIZE] == 0 and ended != native.START_INVALID:
        return trees.ended(Status.NO_GOAL if source.endless else Status.NO_PATH_IN_TIME)
    return trees.ended(_ENDS[ended])


def _grow_while_drawing(trees: Trees, source: GoalSource, deadline: Deadline, max_iterations: int) -> int:
    """Alternate between a draw of a goal and growth."""
    iterations, pause, idle = 0, BETWEEN_DRAWS, 0
    while True:
        first = source.count
        goal = source.draw()
        if goal is not None:
            ended = trees.plant(np.array(goal), first, deadline)
            if ended != native.GOING_ON:
                return ended
        if trees.counters[native.GOAL_SIZE] == 0:
            idle += 1
            if deadline.expired or idle >= max_iterations:
                return native.TIME_UP if deadline.expired else native.GOING_ON
            continue
        iterations = min(iterations + pause, max_iterations)
        pause *= 2
        ended = trees.grow(iterations, deadline)
        if ended != native.GOING_ON or iterations == max_iterations:
            return ended
