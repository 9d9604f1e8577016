"""A roadmap in machine code, seen from Python."""

from __future__ import annotations

import numpy as np

from . import native_roadmap as native
from .callback import machine_code_of
from .compiled_world import world_of
from .deadline import Deadline
from .native import CLOCK, stream_key
from .native_tree import LANES
from .native_world import CALLS, STATES, STOP
from .problem import Problem
from .vectors import BoolArray, FloatArray

_STREAM = 3
_FIRST_NODES, _EDGES_PER_NODE = 512, 24


class Chart:
    """The arrays of a roadmap, which grow, and what is done with them.

    Attributes:
        counters: See `native_roadmap`.
    """

    def __init__(self, problem: Problem, seed: int, resolution: float) -> None:
        """Make an empty roadmap.

        Args:
            problem: Supplies the box, the metric and the oracle.
            seed: Seed of the samples.
            resolution: Greatest distance between checked states of an edge [length unit of the metric].
        """
        n = problem.n
        self._problem, self._resolution = problem, resolution
        self._key = stream_key(seed, _STREAM)
        self._states, self._lanes = np.empty((0, n)), np.empty((0, n, LANES))
        self._nodes, self._costs = np.empty((native.NODE_ROWS, 0), dtype=np.int64), np.empty(0)
        self._arcs, self._lengths = np.empty((2, 0), dtype=np.int64), np.empty(0)
        self._findings = np.empty(0, dtype=np.int64)
        self._rows = np.empty((4, n))
        self.counters = np.zeros(native.COUNTERS, dtype=np.int64)
        self._reserve(_FIRST_NODES, _FIRST_NODES * _EDGES_PER_NODE)

    def scatter(self, wanted: int, deadline: Deadline) -> int:
        """Add valid samples until there are as many nodes as wanted; return how it ended."""
        with machine_code_of(self._problem, Deadline(), None, self.counters) as oracle:
            world = world_of(self._problem, oracle, self._resolution)
            while True:
                ended = native.scatter(world, self._map(), CLOCK, deadline.piece, self._key, wanted)
                if ended == native.TIME_UP and not (deadline.expired or self.counters[STOP]):
                    continue
                if ended != native.FULL:
                    return ended
                self._reserve(2 * len(self._states), 2 * len(self._lengths))

    def connect(self, start: FloatArray, goals: FloatArray, ends: np.ndarray, deadline: Deadline) -> int:
        """Find the shortest path between valid ends; return how it ended."""
        try:
            with machine_code_of(self._problem, Deadline(), self._resolution, self.counters) as oracle:
                world = world_of(self._problem, oracle, self._resolution)
                while True:
                    ended = native.connect(world, self._map(), CLOCK, deadline.left, start, goals, ends)
                    if ended != native.FULL:
                        return ended
                    new = len(ends)
                    self._reserve(
                        2 * len(self._states) + new,
                        2 * len(self._lengths) + new * (native.MOST_NEIGHBOURS + 1),
                    )
        except BaseException:  # what an oracle refused while it failed is not known to be invalid
            self._findings[self._findings == native.INVALID] = native.UNKNOWN
            raise

    def valid(self, states: FloatArray) -> BoolArray:
        """Return which states, shape (m, n), are valid."""
        answers = self._problem.counting_oracle().states_valid(states)
        self.counters[STATES] += len(states)
        self.counters[CALLS] += 1
        return answers

    def path(self) -> tuple[FloatArray, int]:
        """Return the way-points of the path that was found, and the node of its goal."""
        reached = int(self.counters[native.REACHED])
        nodes = [reached]
        while (arc := int(self._nodes[native.FROM, nodes[-1]])) >= 0:
            nodes.append(int(self._arcs[native.TARGET, arc ^ 1]))
        return self._states[nodes[::-1]], reached

    def edges(self, finding: int) -> int:
        """Return the number of edges of which this is known."""
        return int(np.count_nonzero(self._findings[: self.counters[native.EDGES]] == finding))

    def _map(self) -> native.Map:
        return native.Map(
            self._states, self._lanes, self._nodes, self._costs, self._arcs, self._lengths, self._findings,
            self._keys, self._heap, self._rows, self.counters,
        )  # fmt: skip

    def _reserve(self, nodes: int, edges: int) -> None:
        """Make room for some nodes and edges."""
        nodes = -(-nodes // LANES) * LANES
        self._states, self._costs = _longer(self._states, nodes, 0), _longer(self._costs, nodes, 0)
        self._lanes, self._nodes = _longer(self._lanes, nodes // LANES, 0), _longer(self._nodes, nodes, 1)
        self._arcs, self._lengths = _longer(self._arcs, 2 * edges, 1), _longer(self._lengths, edges, 0)
        self._findings = _longer(self._findings, edges, 0)
        self._keys, self._heap = np.empty(2 * edges + 2), np.empty(2 * edges + 2, dtype=np.int64)


def _longer(array: np.ndarray, size: int, axis: int) -> np.ndarray:
    shape = list(array.shape)
    shape[axis] = size
    longer = np.empty(tuple(shape), dtype=array.dtype)
    kept = (slice(None),) * axis + (slice(array.shape[axis]),)
    longer[kept] = array
    return longer
