"""A roadmap in machine code; `Roadmap` is what calls it and says how it works."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from .native import seconds_now, uniform
from .native_edge import edge_valid, prefix, steps_of
from .native_tree import k_nearest, set_lane
from .vectors import FloatArray

# How a call ends.
DONE, TIME_UP, FULL, NO_PATH = 0, 1, 2, 3

# Places in `counters`; those of the oracle come first.
STATES, CALLS, STOP, DRAWN, NODES, EDGES, QUERY, REACHED = range(8)
COUNTERS = 8

# Rows of `nodes`: first arc, arc from the parent, last query that closed it, last query that has it as goal.
HEAD, FROM, CLOSED, IS_GOAL = range(4)
NODE_ROWS = 4

# Rows of `arcs`; arc 2 e + 1 is arc 2 e, of edge e, backwards.
TARGET, NEXT = 0, 1

UNKNOWN, VALID, INVALID = 0, 1, 2

MOST_NEIGHBOURS = 64
_SAME = 1e-18  # of a square of the box's diagonal


class Map(NamedTuple):
    """A graph in arrays with room for m nodes and k edges.

    Attributes:
        states: Shape (m, n).
        lanes: Scaled states, shape (m / 8, n, 8).
        nodes: See the rows above, shape (4, m).
        costs: Length from the start, shape (m,).
        arcs: See the rows above, shape (2, 2 k).
        lengths: Of edges, shape (k,).
        findings: What is known of edges, shape (k,).
        keys: Of the heap: the least length of a path through an arc, shape (2 k + 2,).
        heap: Arcs, shape (2 k + 2,).
        rows: Room, shape (4, n).
        counters: See the places above.
    """

    states: FloatArray
    lanes: FloatArray
    nodes: np.ndarray
    costs: FloatArray
    arcs: np.ndarray
    lengths: FloatArray
    findings: np.ndarray
    keys: FloatArray
    heap: np.ndarray
    rows: FloatArray
    counters: np.ndarray


@njit(nogil=True, cache=True, error_model="numpy")
def _distance(a: FloatArray, b: FloatArray, weights: FloatArray) -> float:
    total = 0.0
    for i in range(a.size):
        difference = (b[i] - a[i]) * weights[i]
        total += difference * difference
    return math.sqrt(total)


@njit(nogil=True, cache=True, error_model="numpy")
def _join(chart: Map, first: int, second: int, length: float) -> None:
    """Add an edge."""
    edge = chart.counters[EDGES]
    chart.counters[EDGES] += 1
    chart.lengths[edge], chart.findings[edge] = length, UNKNOWN
    for way in range(2):
        source, target, arc = (first, second, 2 * edge) if way == 0 else (second, first, 2 * edge + 1)
        chart.arcs[TARGET, arc] = target
        chart.arcs[NEXT, arc] = chart.nodes[HEAD, source]
        chart.nodes[HEAD, source] = arc


@njit(nogil=True, cache=True, error_model="numpy")
def _are_joined(chart: Map, first: int, second: int) -> bool:
    arc = chart.nodes[HEAD, first]
    while arc >= 0 and chart.arcs[TARGET, arc] != second:
        arc = chart.arcs[NEXT, arc]
    return arc >= 0 or first == second


@njit(nogil=True, cache=True, error_model="numpy")
def _add(chart: Map, state: FloatArray, weights: FloatArray, tolerance: float) -> int:
    """Add a node joined to its nearest neighbours, or find the one that is there already; return it.

    Their number grows like e (1 + 1/n) log(size), which keeps the roadmap asymptotically optimal.
    """
    n, size = state.size, chart.counters[NODES]
    near, squares, room = np.empty(MOST_NEIGHBOURS, np.int64), np.empty(MOST_NEIGHBOURS), np.empty(8)
    count = 0
    if size > 0:
        for i in range(n):
            chart.rows[2, i] = state[i] * weights[i]
        wanted = math.ceil(math.e * (1.0 + 1.0 / n) * math.log(size + 1.0))
        wanted = min(max(wanted, 1), min(size, MOST_NEIGHBOURS))
        count = k_nearest(chart.lanes, size, chart.rows[2], wanted, near, squares, room)
        if squares[0] <= tolerance:
            return near[0]
    chart.counters[NODES] += 1
    for i in range(n):
        chart.states[size, i] = state[i]
    set_lane(chart.lanes, size, state, weights)
    chart.nodes[HEAD, size] = chart.nodes[FROM, size] = -1
    chart.nodes[CLOSED, size] = chart.nodes[IS_GOAL, size] = -1
    for k in range(count):
        _join(chart, near[k], size, math.sqrt(squares[k]))
    return size


@njit(nogil=True, cache=True, error_model="numpy")
def _push(chart: Map, size: int, key: float, arc: int) -> int:
    place = size
    while place > 0 and chart.keys[(place - 1) // 2] > key:
        above = (place - 1) // 2
        chart.keys[place], chart.heap[place] = chart.keys[above], chart.heap[above]
        place = above
    chart.keys[place], chart.heap[place] = key, arc
    return size + 1


@njit(nogil=True, cache=True, error_model="numpy")
def _pop(chart: Map, size: int) -> int:
    """Take the first entry off a heap; return its new size.  The entry is to be read before."""
    size -= 1
    key, arc = chart.keys[size], chart.heap[size]
    place = 0
    while 2 * place + 1 < size:
        below = 2 * place + 1
        if below + 1 < size and chart.keys[below + 1] < chart.keys[below]:
            below += 1
        if chart.keys[below] >= key:
            break
        chart.keys[place], chart.heap[place] = chart.keys[below], chart.heap[below]
        place = below
    chart.keys[place], chart.heap[place] = key, arc
    return size


@njit(nogil=True, cache=True, error_model="numpy")
def _close(
    chart: Map, node: int, arc: int, cost: float, goals: FloatArray, weights: FloatArray, size: int
) -> int:
    """Settle the cost of a node and put the arcs that leave it on the heap; return the heap's size."""
    query = chart.counters[QUERY]
    chart.nodes[CLOSED, node], chart.nodes[FROM, node], chart.costs[node] = query, arc, cost
    leaving = chart.nodes[HEAD, node]
    while leaving >= 0:
        target = chart.arcs[TARGET, leaving]
        if chart.findings[leaving // 2] != INVALID and chart.nodes[CLOSED, target] != query:
            ahead = math.inf
            for g in range(goals.shape[0]):
                ahead = min(ahead, _distance(chart.states[target], goals[g], weights))
            size = _push(chart, size, cost + chart.lengths[leaving // 2] + ahead, leaving)
        leaving = chart.arcs[NEXT, leaving]
    return size


_MAP = (
    "float64[:, ::1], float64[:, :, ::1], int64[:, ::1], float64[::1], int64[:, ::1], float64[::1],"
    " int64[::1], float64[::1], int64[::1], float64[:, ::1], int64[::1], float64[::1])"
)


@njit(
    f"int64(int64, int64, float64, float64[:, ::1], uint64, int64, {_MAP}",
    nogil=True,
    cache=True,
    error_model="numpy",
)
def scatter(
    address: int,
    clock: int,
    seconds: float,
    box: FloatArray,
    key: np.uint64,
    wanted: int,
    states: FloatArray,
    lanes: FloatArray,
    nodes: np.ndarray,
    costs: FloatArray,
    arcs: np.ndarray,
    lengths: FloatArray,
    findings: np.ndarray,
    keys: FloatArray,
    heap: np.ndarray,
    rows: FloatArray,
    counters: np.ndarray,
    memory: FloatArray,
) -> int:
    """Add valid samples of the box until there are as many nodes as wanted.

    Returns:
        DONE, TIME_UP, or FULL if there may be no room for one more.
    """
    chart = Map(states, lanes, nodes, costs, arcs, lengths, findings, keys, heap, rows, counters)
    lower, extent, weights = box[0], box[1], box[2]
    place, sample, n = np.empty(2, np.int64), rows[3], box.shape[1]
    end = seconds_now(clock, place) + seconds
    tolerance = _SAME * _distance(lower, lower + extent, weights) ** 2
    while counters[NODES] < wanted:
        if counters[STOP] != 0 or seconds_now(clock, place) >= end:
            return TIME_UP
        if counters[NODES] >= states.shape[0] or counters[EDGES] + MOST_NEIGHBOURS > lengths.size:
            return FULL
        for i in range(n):
            sample[i] = lower[i] + uniform(key, counters[DRAWN] + i) * extent[i]
        counters[DRAWN] += n
        if prefix(address, memory, sample, sample, 1, counters) == 1:
            _add(chart, sample, weights, tolerance)
    return DONE


@njit(
    "int64(int64, int64, float64, float64, float64[:, ::1], float64[::1], float64[:, ::1], int64[::1], "
    + _MAP,
    nogil=True,
    cache=True,
    error_model="numpy",
)
def connect(
    address: int,
    clock: int,
    seconds: float,
    resolution: float,
    box: FloatArray,
    start: FloatArray,
    goals: FloatArray,
    ends: np.ndarray,
    states: FloatArray,
    lanes: FloatArray,
    nodes: np.ndarray,
    costs: FloatArray,
    arcs: np.ndarray,
    lengths: FloatArray,
    findings: np.ndarray,
    keys: FloatArray,
    heap: np.ndarray,
    rows: FloatArray,
    counters: np.ndarray,
    memory: FloatArray,
) -> int:
    """Find the shortest path from start to one of the goals on the roadmap, checking edges on the way.

    All of the ends are valid.  `ends` is room for the nodes of start and goals, shape (1 + g,); if it begins
    with -1, they are made nodes, joined to each other and to their neighbours.

    Returns:
        DONE (the goal's node is counters[REACHED]), TIME_UP, FULL or NO_PATH.
    """
    chart = Map(states, lanes, nodes, costs, arcs, lengths, findings, keys, heap, rows, counters)
    lower, extent, weights = box[0], box[1], box[2]
    place = np.empty(2, np.int64)
    end = seconds_now(clock, place) + seconds
    if ends[0] < 0:
        new = 1 + goals.shape[0]
        if (
            counters[NODES] + new > states.shape[0]
            or counters[EDGES] + new * (MOST_NEIGHBOURS + 1) > lengths.size
        ):
            return FULL
        tolerance = _SAME * _distance(lower, lower + extent, weights) ** 2
        ends[0] = _add(chart, start, weights, tolerance)
        for g in range(goals.shape[0]):
            ends[1 + g] = _add(chart, goals[g], weights, tolerance)
            if not _are_joined(chart, ends[0], ends[1 + g]):
                _join(chart, ends[0], ends[1 + g], _distance(start, goals[g], weights))
    counters[QUERY] += 1
    query = counters[QUERY]
    for g in range(goals.shape[0]):
        nodes[IS_GOAL, ends[1 + g]] = query
    counters[REACHED] = ends[0]
    size = _close(chart, ends[0], -1, 0.0, goals, weights, 0)
    while nodes[IS_GOAL, counters[REACHED]] != query:
        if size == 0:
            return NO_PATH
        if counters[STOP] != 0 or seconds_now(clock, place) >= end:
            return TIME_UP
        arc = heap[0]
        size = _pop(chart, size)
        node, source, edge = arcs[TARGET, arc], arcs[TARGET, arc ^ 1], arc // 2
        if nodes[CLOSED, node] == query or findings[edge] == INVALID:
            continue
        if findings[edge] == UNKNOWN:
            steps = steps_of(lengths[edge], resolution)
            free = edge_valid(address, memory, states[source], states[node], steps, rows, counters)
            findings[edge] = VALID if free else INVALID
            if not free:
                continue
        size = _close(chart, node, arc, costs[source] + lengths[edge], goals, weights, size)
        counters[REACHED] = node
    return DONE
