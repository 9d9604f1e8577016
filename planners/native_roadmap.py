"""A roadmap in machine code; `Roadmap` is what calls it and says how it works."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, types

from .native import seconds_now
from .native_edge import prefix
from .native_sampling import random_state
from .native_tree import k_nearest, set_lane
from .native_world import (
    BLOCKS,
    INDICES,
    MATRIX,
    STOP,
    TABLE,
    VECTOR,
    WORLD,
    World,
    distance,
    distance_to_nearest,
    is_free,
    wanted_neighbours,
)
from .vectors import FloatArray

# How a call ends.
DONE, TIME_UP, FULL, NO_PATH = 0, 1, 2, 3

# Places in `counters`; those of the oracle come first.
DRAWN, NODES, EDGES, QUERY, REACHED = range(3, 8)
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


CHART = types.NamedTuple(
    (MATRIX, BLOCKS, TABLE, VECTOR, TABLE, VECTOR, INDICES, VECTOR, INDICES, MATRIX, INDICES), Map
)
"""Numba's type of a roadmap."""


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
    """Add a node joined to its nearest neighbours, or find the one that is there already; return it."""
    n, size = state.size, chart.counters[NODES]
    near, squares, room = np.empty(MOST_NEIGHBOURS, np.int64), np.empty(MOST_NEIGHBOURS), np.empty(8)
    count = 0
    if size > 0:
        for i in range(n):
            chart.rows[2, i] = state[i] * weights[i]
        wanted = wanted_neighbours(n, size, MOST_NEIGHBOURS)
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
            ahead = distance_to_nearest(chart.states[target], goals, weights)
            size = _push(chart, size, cost + chart.lengths[leaving // 2] + ahead, leaving)
        leaving = chart.arcs[NEXT, leaving]
    return size


@njit(nogil=True, cache=True, error_model="numpy")
def _tolerance(world: World) -> float:
    """Return the square of a distance below which states are one."""
    return _SAME * distance(world.lower, world.lower + world.extent, world.weights) ** 2


@njit(
    types.int64(WORLD, CHART, types.int64, types.float64, types.uint64, types.int64),
    nogil=True,
    cache=True,
    error_model="numpy",
)
def scatter(world: World, chart: Map, clock: int, seconds: float, key: np.uint64, wanted: int) -> int:
    """Add valid samples of the box until there are as many nodes as wanted.

    Args:
        world: Box, metric and oracle.
        chart: The roadmap.
        clock: Address of `clock_gettime`.
        seconds: Time budget [s].
        key: Of the stream of random numbers.
        wanted: Number of nodes.

    Returns:
        DONE, TIME_UP, or FULL if there may be no room for one more.
    """
    counters, sample, place = chart.counters, chart.rows[3], np.empty(2, np.int64)
    end, tolerance = seconds_now(clock, place) + seconds, _tolerance(world)
    while counters[NODES] < wanted:
        if counters[STOP] != 0 or seconds_now(clock, place) >= end:
            return TIME_UP
        if counters[NODES] >= chart.states.shape[0] or counters[EDGES] + MOST_NEIGHBOURS > chart.lengths.size:
            return FULL
        counters[DRAWN] += random_state(key, counters[DRAWN], world.lower, world.extent, sample)
        if prefix(world.address, world.memory, sample, sample, 1, counters) == 1:
            _add(chart, sample, world.weights, tolerance)
    return DONE


@njit(nogil=True, cache=True, error_model="numpy")
def _add_ends(world: World, chart: Map, start: FloatArray, goals: FloatArray, ends: np.ndarray) -> bool:
    """Make start and goals nodes that are joined; False if there may be no room."""
    counters, new, tolerance = chart.counters, 1 + goals.shape[0], _tolerance(world)
    edges = counters[EDGES] + new * (MOST_NEIGHBOURS + 1)
    if counters[NODES] + new > chart.states.shape[0] or edges > chart.lengths.size:
        return False
    ends[0] = _add(chart, start, world.weights, tolerance)
    for g in range(goals.shape[0]):
        ends[1 + g] = _add(chart, goals[g], world.weights, tolerance)
        if not _are_joined(chart, ends[0], ends[1 + g]):
            _join(chart, ends[0], ends[1 + g], distance(start, goals[g], world.weights))
    return True


@njit(nogil=True, cache=True, error_model="numpy")
def _can_be_taken(world: World, chart: Map, source: int, target: int, edge: int) -> bool:
    """Return whether an edge is valid, finding it out if that is not known."""
    if chart.findings[edge] == UNKNOWN:
        a, b = chart.states[source], chart.states[target]
        free = is_free(world, a, b, chart.lengths[edge], chart.rows, chart.counters)
        chart.findings[edge] = VALID if free else INVALID
    return chart.findings[edge] == VALID


@njit(
    types.int64(WORLD, CHART, types.int64, types.float64, VECTOR, MATRIX, INDICES),
    nogil=True,
    cache=True,
    error_model="numpy",
)
def connect(
    world: World,
    chart: Map,
    clock: int,
    seconds: float,
    start: FloatArray,
    goals: FloatArray,
    ends: np.ndarray,
) -> int:
    """Find the shortest path from start to one of the goals on the roadmap, checking edges on the way.

    Args:
        world: Box, metric and oracle.
        chart: The roadmap.
        clock: Address of `clock_gettime`.
        seconds: Time budget [s].
        start: A valid state, shape (n,).
        goals: Valid states, shape (g, n).
        ends: Nodes of start and goals, shape (1 + g,); if it begins with -1, they are made nodes first.

    Returns:
        DONE (the goal's node is counters[REACHED]), TIME_UP, FULL or NO_PATH.
    """
    place = np.empty(2, np.int64)
    end = seconds_now(clock, place) + seconds
    if ends[0] < 0 and not _add_ends(world, chart, start, goals, ends):
        return FULL
    counters, nodes, arcs = chart.counters, chart.nodes, chart.arcs
    counters[QUERY] += 1
    query = counters[QUERY]
    for g in range(goals.shape[0]):
        nodes[IS_GOAL, ends[1 + g]] = query
    counters[REACHED] = ends[0]
    size = _close(chart, ends[0], -1, 0.0, goals, world.weights, 0)
    while nodes[IS_GOAL, counters[REACHED]] != query:
        if size == 0:
            return NO_PATH
        if counters[STOP] != 0 or seconds_now(clock, place) >= end:
            return TIME_UP
        arc = chart.heap[0]
        size = _pop(chart, size)
        node, source, edge = arcs[TARGET, arc], arcs[TARGET, arc ^ 1], arc // 2
        if nodes[CLOSED, node] != query and _can_be_taken(world, chart, source, node, edge):
            cost = chart.costs[source] + chart.lengths[edge]
            size = _close(chart, node, arc, cost, goals, world.weights, size)
            counters[REACHED] = node
    return DONE
