"""Informed RRT* in machine code, seen from Python."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import compiled_connect, compiled_shortcut, native_graph, native_star  # noqa: F401  (loaded here, before any time budget begins)
from .callback import machine_code_of
from .compiled_world import world_of
from .deadline import Deadline
from .native import CLOCK, stream_key
from .native_tree import LANES
from .native_world import STOP
from .problem import Problem
from .result import Improvement
from .vectors import FloatArray

REACH = 0.2
"""Greatest length of an extension, as a part of the box's diagonal."""

MOST_NODES = 200_000
"""At which the improvement ends: the time of an iteration grows with the number of nodes."""

_STREAM = 2
_FIRST_CAPACITY = 1024
_RECORDS = 2048


class Improved(NamedTuple):
    """What an improvement came to.

    Attributes:
        points: Way-points, shape (k, n).
        goal: Place of the goal among those given.
        iterations: Samples drawn.
        states: States that the oracle was asked about.
        calls: Calls of the oracle.
        history: Better and better paths, the first one included.
    """

    points: FloatArray
    goal: int
    iterations: int
    states: int
    calls: int
    history: tuple[Improvement, ...]


class _Room:
    """The arrays of a tree, which grow."""

    def __init__(self, n: int, goals: int, capacity: int) -> None:
        self.capacity = 0
        self.states, self.lanes = np.empty((0, n)), np.empty((0, n, LANES))
        self.family, self.costs = np.empty((native_graph.FAMILY, 0), dtype=np.int64), np.empty((2, 0))
        self.branch = np.empty(0, dtype=np.int64)
        self.goal_nodes = np.full(goals, -1, dtype=np.int64)
        self._rows, self.history = np.empty((6, n)), np.empty((_RECORDS, 3))
        self._near = np.empty(native_graph.MOST_NEIGHBOURS, dtype=np.int64)
        self._squares, self._eight = np.empty((2, native_graph.MOST_NEIGHBOURS)), np.empty(LANES)
        self.counters = np.zeros(native_graph.COUNTERS, dtype=np.int64)
        self.reserve(capacity)

    def reserve(self, capacity: int) -> None:
        """Make room for a number of nodes."""
        capacity = -(-capacity // LANES) * LANES
        old, n = self.capacity, self.states.shape[1]
        states, lanes = np.empty((capacity, n)), np.empty((capacity // LANES, n, LANES))
        family, costs = np.empty((native_graph.FAMILY, capacity), dtype=np.int64), np.empty((2, capacity))
        branch = np.empty(capacity, dtype=np.int64)
        states[:old], lanes[: old // LANES], branch[:old] = self.states, self.lanes, self.branch
        family[:, :old], costs[:, :old] = self.family, self.costs
        self.states, self.lanes, self.family, self.costs, self.branch = states, lanes, family, costs, branch
        self.capacity = capacity

    def graph(self, goals: FloatArray) -> native_graph.Graph:
        """Return the arrays as the machine code takes them."""
        return native_graph.Graph(
            self.states, self.lanes, self.family, self.costs, goals, self.goal_nodes, self.branch, self._near,
            self._squares, self._rows, self._eight, self.counters,
        )  # fmt: skip

    def path(self, goals: FloatArray) -> tuple[FloatArray, int]:
        """Return the best path and its goal."""
        goal = int(self.counters[native_graph.GOAL])
        nodes = []
        node = int(self.goal_nodes[goal])
        while node >= 0:
            nodes.append(node)
            node = int(self.family[native_graph.PARENT, node])
        points = self.states[nodes[::-1]]
        points[-1] = goals[goal]
        return points, goal


def improve_compiled(
    problem: Problem,
    points: FloatArray,
    goals: FloatArray,
    goal: int,
    deadline: Deadline,
    seed: int,
    iterations: int,
    target: float,
    resolution: float,
) -> Improved:
    """Improve a path that ends at one of some goals; see `improve` for the method and the arguments."""
    room = _Room(problem.n, len(goals), max(_FIRST_CAPACITY, len(points) + len(goals) + LANES))
    key = stream_key(seed, _STREAM)
    with machine_code_of(problem, deadline, resolution, room.counters) as oracle:
        world = world_of(problem, oracle, resolution, REACH * problem.diagonal)
        while True:
            ended = native_star.improve_tree(
                world, room.graph(goals), CLOCK, deadline.piece, deadline.elapsed, target, key, iterations,
                points, goal, room.history,
            )  # fmt: skip
            if ended == native_star.FULL and room.capacity < MOST_NODES:
                room.reserve(2 * room.capacity)
            elif ended != native_star.TIME_UP or deadline.expired or room.counters[STOP]:
                break
    path, reached = room.path(goals)
    states, calls, _, drawn = room.counters[:4].tolist()
    records = room.history[: room.counters[native_graph.RECORDS]].tolist()
    history = tuple(Improvement(time, cost, int(iteration)) for time, cost, iteration in records)
    return Improved(path, reached, drawn, states, calls, history)
