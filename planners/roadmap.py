"""Probabilistic roadmap of one world, for many queries."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.core.clock import seconds_now
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1, Ints2, Singles3

from .deadline import Deadline, load_code
from .motion_validator import machine_code_of
from .path import Path
from .problem import Problem
from .result import Result, Status
from .sampling import random_state, stream_key
from .search_space import (
    CALLS,
    ITERATIONS,
    STATES,
    STOP,
    SearchSpace,
    distance,
    distance_to_nearest,
    edge_valid,
    last_valid_step,
    space_of,
    step_count,
)
from .tree import ABREAST, grown, k_nearest, neighbor_count, set_lane, whole_blocks
from .vectors import (
    BoolArray,
    FloatArray,
    finite_points,
    finite_vector,
    real_numbers,
    require_inside,
    seed_number,
    whole_number,
)

_FEWEST_NODES, _GROWTH = 128, 1.5  # minimum number of nodes, and growth factor, while there is no path
_FIRST_NODES, _EDGES_PER_NODE = 512, 24  # initial capacity of nodes, and edges per node
_MOST_NEIGHBORS = 64  # maximum number of neighbors to which a new node is joined
_SAME = 1e-9  # distance below which two states are one node, relative to the box's diagonal
_STREAM = 3

# Statuses of a call.
DONE, TIME_UP, FULL, NO_PATH = range(4)

# Indices into `counters`, after the indices common to all planners.
DRAWN, NODES, EDGES, QUERY, REACHED = range(ITERATIONS + 1, ITERATIONS + 6)
_COUNTERS = REACHED + 1

# Rows of `nodes`: first arc, arc from the parent, last query that closed the node, last query to the node.
HEAD, FROM, CLOSED, IS_GOAL = range(4)
_NODE_ROWS = 4

# Rows of `arcs`; arc 2 e + 1 is arc 2 e, of edge e, backwards.
TARGET, NEXT = 0, 1

UNKNOWN, VALID, INVALID = range(3)


class RoadmapGraph(NamedTuple):
    """A graph in arrays with space for m nodes and k edges.

    Attributes:
        states: States of the nodes, shape (m, n).
        lanes: Scaled states, shape (m / 16, n, 16).
        nodes: Integers of the nodes, see the rows above, shape (4, m).
        costs: Length of the path from the start [length unit of the metric], shape (m,).
        arcs: Integers of the arcs, see the rows above, shape (2, 2 k).
        lengths: Lengths of the edges [length unit of the metric], shape (k,).
        findings: UNKNOWN, VALID or INVALID for each edge, shape (k,).
        keys: Keys of the heap: minimum length of a path through an arc, shape (2 k + 2,).
        heap: Arcs, shape (2 k + 2,).
        rows: Scratch space, shape (3, n).
        counters: Counters, see the indices above.
    """

    states: Floats2
    lanes: Singles3
    nodes: Ints2
    costs: Floats1
    arcs: Ints2
    lengths: Floats1
    findings: Ints1
    keys: Floats1
    heap: Ints1
    rows: Floats2
    counters: Ints1


class Roadmap:
    """A graph of valid states whose edges are checked when a query first needs them.

    Nodes are uniform samples of the box; each is joined to its nearest neighbors.  A query makes its ends
    nodes and searches the shortest path by A*, which checks an edge when it needs it first and keeps the
    result.  While there is no path, nodes are added.  So the first query in a world costs about as much as a
    search by `rrt_connect`, and later queries less and less; and paths approach the shortest ones as the
    roadmap grows.

    A roadmap belongs to one world: once validity changes, make a new one.  Several threads must not use it
    at once.  The same queries in the same order give the same results, unless time runs out.

    Source: L. E. Kavraki et al., Probabilistic roadmaps for path planning in high-dimensional configuration
    spaces, IEEE Trans. Robotics and Automation 12(4), 1996; R. Bohlin and L. E. Kavraki, Path planning using
    lazy PRM, ICRA 2000; number of neighbors: S. Karaman and E. Frazzoli, 2011.

    Attributes:
        problem: The world: box, metric and validity; its start and goals are the default of a query.
        seed: Seed of the samples.
    """

    def __init__(self, problem: Problem, *, seed: int = 0, resolution: float | None = None) -> None:
        """Make an empty roadmap.

        Args:
            problem: The world.
            seed: Seed of the samples.
            resolution: Maximum distance between checked states of an edge [length unit of the metric]; the
                problem's if omitted.

        Raises:
            InvalidValueError: The seed or the resolution is not allowed.
        """
        load_code(scatter, connect)
        self.problem, self.seed = problem, seed_number(seed)
        self._resolution = problem.validator(resolution=resolution).resolution
        self._key = stream_key(self.seed, _STREAM)
        self._graph = _new_graph(problem.n)

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return int(self._graph.counters[NODES])

    @property
    def edges(self) -> int:
        """Number of edges that are not known to be invalid."""
        return self._edges(UNKNOWN) + self._edges(VALID)

    @property
    def edges_checked(self) -> int:
        """Number of edges that have been checked."""
        return self._edges(INVALID) + self._edges(VALID)

    def grow(self, nodes: int, *, timeout: float = 1.0) -> int:
        """Add nodes, for shorter paths or for quicker queries later.

        Args:
            nodes: Number of nodes.
            timeout: Time budget [s].

        Returns:
            Number of nodes that were added before time ran out.

        Raises:
            InvalidValueError: An argument is not allowed.
        """
        deadline, before = Deadline(timeout), self.nodes
        self._scatter(before + whole_number("nodes", nodes), deadline)
        return self.nodes - before

    def solve(
        self,
        start: ArrayLike | None = None,
        goals: ArrayLike | None = None,
        *,
        timeout: float = 1.0,
        max_nodes: int = 100_000,
    ) -> Result:
        """Find a path.

        Args:
            start: Start state, shape (n,); the problem's if omitted.
            goals: Goal states, shape (k, n) or (n,), any one of which is to be reached; the problem's if
                omitted.
            timeout: Time budget [s].
            max_nodes: Maximum number of nodes to which the roadmap may grow.

        Returns:
            The result, whose path is the shortest one on the roadmap; without a path its status says why.

        Raises:
            InvalidValueError: A state has the wrong shape, is not finite or outside the box, or there is no
                goal.
        """
        deadline, counters = Deadline(timeout), self._graph.counters
        max_nodes = whole_number("max_nodes", max_nodes)
        begin, ends = self._start(start), self._goals(goals)
        before = counters.copy()
        first = self._valid(np.concatenate((begin[None, :], ends)))
        usable = np.flatnonzero(first[1:])
        path, goal = None, None
        if not (first[0] and usable.size):
            status = Status.GOAL_INVALID if first[0] else Status.START_INVALID
        else:
            places = np.full(1 + usable.size, -1, dtype=np.int64)
            status = self._search(begin.copy(), ends[usable], places, deadline, max_nodes)
            if status is Status.SOLVED:
                points, reached = self._path()
                path = Path.trusted(points, self.problem.metric)
                goal = int(usable[int(np.argmax(places[1:] == reached))])
        spent = counters - before
        return Result.of_run(status, spent, deadline, self.seed, path, goal, iterations=int(spent[NODES]))

    def _search(
        self, start: FloatArray, goals: FloatArray, ends: np.ndarray, deadline: Deadline, max_nodes: int
    ) -> Status:
        """Search and grow in turn until there is a path, or time or nodes run out.

        Args:
            start: A valid state, shape (n,).
            goals: Valid states, shape (g, n).
            ends: Nodes of start and goals, shape (1 + g,); -1 until they are nodes.
            deadline: Time budget.
            max_nodes: Maximum number of nodes.
        """
        while True:
            ended = self._connect(start, goals, ends, deadline)
            if ended == DONE:
                return Status.SOLVED
            if ended == TIME_UP:
                return Status.NO_PATH_IN_TIME
            if self.nodes >= max_nodes:
                return Status.OUT_OF_ITERATIONS
            wanted = min(max(int(self.nodes * _GROWTH), self.nodes + _FEWEST_NODES), max_nodes)
            if self._scatter(wanted, deadline) == TIME_UP:
                return Status.NO_PATH_IN_TIME

    def _start(self, start: ArrayLike | None) -> FloatArray:
        """Return a query's start, checked, shape (n,); the problem's for None.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity, or a state outside the box.
        """
        problem = self.problem
        if start is None:
            return problem.start
        state = finite_vector("start", start, problem.n, problem.labels)
        require_inside("start", state, problem.lower, problem.upper, problem.labels)
        return state

    def _goals(self, goals: ArrayLike | None) -> FloatArray:
        """Return a query's goals, shape (g, n), of states of shape (g, n) or (n,); the problem's for None.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity, a state outside the box, or no goal states.
        """
        problem = self.problem
        if goals is None:
            if len(problem.goals) == 0:
                raise InvalidValueError("goals", "a sampler", "goal states: a roadmap does not draw goals")
            return problem.goals
        table = real_numbers("goals", goals)
        states = finite_points("goals", np.atleast_2d(table), problem.n, problem.labels)
        for k, state in enumerate(states):
            require_inside(f"goals[{k}]", state, problem.lower, problem.upper, problem.labels)
        return states

    def _scatter(self, wanted: int, deadline: Deadline) -> int:
        """Add valid samples until there are `wanted` nodes; return the status of the last call."""
        counters = self._graph.counters
        with machine_code_of(self.problem, Deadline(), None, counters) as code:
            space = space_of(self.problem, code, self._resolution)
            while True:
                ended = scatter(space, self._graph, deadline.time_slice, self._key, wanted)
                if ended == TIME_UP and not (deadline.expired or counters[STOP]):
                    continue
                if ended != FULL:
                    return ended
                self._graph = _with_capacity(
                    self._graph, 2 * len(self._graph.states), 2 * len(self._graph.lengths)
                )

    def _connect(self, start: FloatArray, goals: FloatArray, ends: np.ndarray, deadline: Deadline) -> int:
        """Find the shortest path between valid ends; return the status of the last call.

        Args:
            start: A valid state, shape (n,).
            goals: Valid states, shape (g, n).
            ends: Nodes of start and goals, shape (1 + g,); entries of -1 are made nodes and written.
            deadline: Time budget.
        """
        counters = self._graph.counters
        try:
            with machine_code_of(self.problem, Deadline(), self._resolution, counters) as code:
                space = space_of(self.problem, code, self._resolution)
                while True:
                    ended = connect(space, self._graph, deadline.left, start, goals, ends)
                    if ended != FULL:
                        return ended
                    new = len(ends)
                    self._graph = _with_capacity(
                        self._graph,
                        2 * len(self._graph.states) + new,
                        2 * len(self._graph.lengths) + new * (_MOST_NEIGHBORS + 1),
                    )
        except BaseException:  # edges that a failing checker refused are not known to be invalid
            self._graph.findings[self._graph.findings == INVALID] = UNKNOWN
            raise

    def _valid(self, states: FloatArray) -> BoolArray:
        """Return which states, shape (m, n), are valid."""
        answers = self.problem.validator().states_valid(states)
        self._graph.counters[STATES] += len(states)
        self._graph.counters[CALLS] += 1
        return answers

    def _path(self) -> tuple[FloatArray, int]:
        """Return the waypoints of the path, shape (k, n), and the node of its goal."""
        reached = int(self._graph.counters[REACHED])
        nodes = [reached]
        while (arc := int(self._graph.nodes[FROM, nodes[-1]])) >= 0:
            nodes.append(int(self._graph.arcs[TARGET, arc ^ 1]))
        return self._graph.states[nodes[::-1]], reached

    def _edges(self, finding: int) -> int:
        """Return the number of edges with a finding: UNKNOWN, VALID or INVALID."""
        return int(np.count_nonzero(self._graph.findings[: self._graph.counters[EDGES]] == finding))


def _new_graph(n: int) -> RoadmapGraph:
    """Return an empty roadmap."""
    graph = RoadmapGraph(
        states=np.empty((0, n)),
        lanes=np.empty((0, n, ABREAST), np.float32),
        nodes=np.empty((_NODE_ROWS, 0), dtype=np.int64),
        costs=np.empty(0),
        arcs=np.empty((2, 0), dtype=np.int64),
        lengths=np.empty(0),
        findings=np.empty(0, dtype=np.int64),
        keys=np.empty(0),
        heap=np.empty(0, dtype=np.int64),
        rows=np.empty((3, n)),
        counters=np.zeros(_COUNTERS, dtype=np.int64),
    )
    return _with_capacity(graph, _FIRST_NODES, _FIRST_NODES * _EDGES_PER_NODE)


def _with_capacity(graph: RoadmapGraph, nodes: int, edges: int) -> RoadmapGraph:
    """Return a roadmap with space for some nodes and edges."""
    nodes = whole_blocks(nodes)
    return graph._replace(
        states=grown(graph.states, nodes),
        lanes=grown(graph.lanes, nodes // ABREAST),
        nodes=grown(graph.nodes, nodes, axis=1),
        costs=grown(graph.costs, nodes),
        arcs=grown(graph.arcs, 2 * edges, axis=1),
        lengths=grown(graph.lengths, edges),
        findings=grown(graph.findings, edges),
        keys=np.empty(2 * edges + 2),
        heap=np.empty(2 * edges + 2, dtype=np.int64),
    )


@compiled
def _join(graph: RoadmapGraph, first: int, second: int, length: float) -> None:
    """Add an edge between two nodes."""
    edge = graph.counters[EDGES]
    graph.counters[EDGES] += 1
    graph.lengths[edge], graph.findings[edge] = length, UNKNOWN
    for way in range(2):
        source, target, arc = (first, second, 2 * edge) if way == 0 else (second, first, 2 * edge + 1)
        graph.arcs[TARGET, arc] = target
        graph.arcs[NEXT, arc] = graph.nodes[HEAD, source]
        graph.nodes[HEAD, source] = arc


@compiled
def _are_joined(graph: RoadmapGraph, first: int, second: int) -> bool:
    """Return whether an edge joins two nodes, or they are the same."""
    arc = graph.nodes[HEAD, first]
    while arc >= 0 and graph.arcs[TARGET, arc] != second:
        arc = graph.arcs[NEXT, arc]
    return arc >= 0 or first == second


@compiled
def _add(graph: RoadmapGraph, state: FloatArray, weights: FloatArray, tolerance: float) -> int:
    """Add a node joined to its nearest neighbors, or find a node of the same state; return its index."""
    n, size = state.size, graph.counters[NODES]
    near, squares, count = np.empty(_MOST_NEIGHBORS, np.int64), np.empty(_MOST_NEIGHBORS), 0
    if size > 0:
        scaled, spare = np.empty(n, np.float32), np.empty(ABREAST, np.float32)
        for i in range(n):
            scaled[i] = state[i] * weights[i]
        wanted = neighbor_count(n, size, _MOST_NEIGHBORS)
        count = k_nearest(graph.lanes, size, scaled, wanted, near, squares, spare)
        if distance(graph.states[near[0]], state, weights) <= tolerance:
            return near[0]
    graph.counters[NODES] += 1
    for i in range(n):
        graph.states[size, i] = state[i]
    set_lane(graph.lanes, size, state, weights)
    graph.nodes[HEAD, size] = graph.nodes[FROM, size] = -1
    graph.nodes[CLOSED, size] = graph.nodes[IS_GOAL, size] = -1
    for k in range(count):
        _join(graph, near[k], size, distance(graph.states[near[k]], state, weights))
    return size


@compiled
def _push(graph: RoadmapGraph, size: int, key: float, arc: int) -> int:
    """Push an arc onto the binary min-heap; return the heap's new size."""
    place = size
    while place > 0 and graph.keys[(place - 1) // 2] > key:
        above = (place - 1) // 2
        graph.keys[place], graph.heap[place] = graph.keys[above], graph.heap[above]
        place = above
    graph.keys[place], graph.heap[place] = key, arc
    return size + 1


@compiled
def _pop(graph: RoadmapGraph, size: int) -> int:
    """Remove the first entry of the heap, which is to be read before; return the heap's new size."""
    size -= 1
    key, arc = graph.keys[size], graph.heap[size]
    place = 0
    while 2 * place + 1 < size:
        below = 2 * place + 1
        if below + 1 < size and graph.keys[below + 1] < graph.keys[below]:
            below += 1
        if graph.keys[below] >= key:
            break
        graph.keys[place], graph.heap[place] = graph.keys[below], graph.heap[below]
        place = below
    graph.keys[place], graph.heap[place] = key, arc
    return size


@compiled
def _close(
    graph: RoadmapGraph, node: int, arc: int, cost: float, goals: FloatArray, weights: FloatArray, size: int
) -> int:
    """Fix the cost of a node and push the arcs that leave it onto the heap; return the heap's size."""
    query = graph.counters[QUERY]
    graph.nodes[CLOSED, node], graph.nodes[FROM, node], graph.costs[node] = query, arc, cost
    leaving = graph.nodes[HEAD, node]
    while leaving >= 0:
        target = graph.arcs[TARGET, leaving]
        if graph.findings[leaving // 2] != INVALID and graph.nodes[CLOSED, target] != query:
            ahead = distance_to_nearest(graph.states[target], goals, weights)
            size = _push(graph, size, cost + graph.lengths[leaving // 2] + ahead, leaving)
        leaving = graph.arcs[NEXT, leaving]
    return size


@compiled
def _tolerance(space: SearchSpace) -> float:
    """Return the distance below which two states are one node [length unit of the metric]."""
    return _SAME * distance(space.lower, space.lower + space.extent, space.weights)


@compiled("int64(SearchSpace, RoadmapGraph, float64, uint64, int64)")
def scatter(space: SearchSpace, graph: RoadmapGraph, seconds: float, key: np.uint64, wanted: int) -> int:
    """Add valid samples of the box until there are as many nodes as wanted.

    Args:
        space: Box, metric and validity.
        graph: The roadmap.
        seconds: Time budget [s].
        key: Key of the stream of random numbers.
        wanted: Number of nodes.

    Returns:
        DONE, TIME_UP, or FULL if there may be no space for one more.
    """
    counters, sample, place = graph.counters, graph.rows[2], np.empty(2, np.int64)
    end, tolerance = seconds_now(space.clock, place) + seconds, _tolerance(space)
    while counters[NODES] < wanted:
        if counters[STOP] != 0 or seconds_now(space.clock, place) >= end:
            return TIME_UP
        if counters[NODES] >= graph.states.shape[0] or counters[EDGES] + _MOST_NEIGHBORS > graph.lengths.size:
            return FULL
        counters[DRAWN] += random_state(space, key, counters[DRAWN], sample)
        if last_valid_step(space, sample, sample, 1, counters) == 1:
            _add(graph, sample, space.weights, tolerance)
    return DONE


@compiled
def _add_ends(
    space: SearchSpace, graph: RoadmapGraph, start: FloatArray, goals: FloatArray, ends: np.ndarray
) -> bool:
    """Make start and goals joined nodes; return False if the arrays may be too small.

    Args:
        space: The box and its metric.
        graph: The graph.
        start: A valid state, shape (n,).
        goals: Valid states, shape (g, n).
        ends: Nodes of start and goals, written, shape (1 + g,).
    """
    counters, new, tolerance = graph.counters, 1 + goals.shape[0], _tolerance(space)
    edges = counters[EDGES] + new * (_MOST_NEIGHBORS + 1)
    if counters[NODES] + new > graph.states.shape[0] or edges > graph.lengths.size:
        return False
    ends[0] = _add(graph, start, space.weights, tolerance)
    for g in range(goals.shape[0]):
        ends[1 + g] = _add(graph, goals[g], space.weights, tolerance)
        if not _are_joined(graph, ends[0], ends[1 + g]):
            _join(graph, ends[0], ends[1 + g], distance(start, goals[g], space.weights))
    return True


@compiled
def _can_be_taken(space: SearchSpace, graph: RoadmapGraph, source: int, target: int, edge: int) -> bool:
    """Return whether an edge is valid, and check it if that is unknown."""
    if graph.findings[edge] == UNKNOWN:
        a, b = graph.states[source], graph.states[target]
        steps = step_count(graph.lengths[edge], space.resolution)
        free = edge_valid(space, a, b, steps, graph.rows, graph.counters, False)
        graph.findings[edge] = VALID if free else INVALID
    return graph.findings[edge] == VALID


@compiled("int64(SearchSpace, RoadmapGraph, float64, float64[::1], float64[:, ::1], int64[::1])")
def connect(
    space: SearchSpace,
    graph: RoadmapGraph,
    seconds: float,
    start: FloatArray,
    goals: FloatArray,
    ends: np.ndarray,
) -> int:
    """Find the shortest path from start to one of the goals on the roadmap; edges are checked when needed.

    Args:
        space: Box, metric and validity.
        graph: The roadmap.
        seconds: Time budget [s].
        start: A valid state, shape (n,).
        goals: Valid states, shape (g, n).
        ends: Nodes of start and goals, shape (1 + g,); if it begins with -1, they are made nodes first.

    Returns:
        DONE (the goal's node is counters[REACHED]), TIME_UP, FULL or NO_PATH.
    """
    place = np.empty(2, np.int64)
    end = seconds_now(space.clock, place) + seconds
    if ends[0] < 0 and not _add_ends(space, graph, start, goals, ends):
        return FULL
    counters, nodes, arcs = graph.counters, graph.nodes, graph.arcs
    counters[QUERY] += 1
    query = counters[QUERY]
    for g in range(goals.shape[0]):
        nodes[IS_GOAL, ends[1 + g]] = query
    counters[REACHED] = ends[0]
    size = _close(graph, ends[0], -1, 0.0, goals, space.weights, 0)
    while nodes[IS_GOAL, counters[REACHED]] != query:
        if size == 0:
            return NO_PATH
        if counters[STOP] != 0 or seconds_now(space.clock, place) >= end:
            return TIME_UP
        arc = graph.heap[0]
        size = _pop(graph, size)
        node, source, edge = arcs[TARGET, arc], arcs[TARGET, arc ^ 1], arc // 2
        if nodes[CLOSED, node] != query and _can_be_taken(space, graph, source, node, edge):
            cost = graph.costs[source] + graph.lengths[edge]
            size = _close(graph, node, arc, cost, goals, space.weights, size)
            counters[REACHED] = node
    return DONE
