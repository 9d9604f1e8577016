"""The tree of an improvement in machine code: arrays, and who is whose parent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, types

from .native_tree import k_nearest, set_lane
from .native_world import BLOCKS, INDICES, MATRIX, TABLE, VECTOR, World, distance, wanted_neighbours
from .vectors import FloatArray

# Places in `counters`; those of the oracle come first.
ITERATIONS, SIZE, GOAL, RECORDS, BRANCH, DRAWN = range(3, 9)
COUNTERS = 9

# Rows of `family` and of `costs`.
PARENT, CHILD, NEXT, BEFORE, STACK = range(5)
FAMILY = 5
COST, EDGE = 0, 1

MOST_NEIGHBOURS = 128


class Graph(NamedTuple):
    """A tree in arrays with room for m nodes.

    Attributes:
        states: Shape (m, n).
        lanes: Scaled states, shape (m / 8, n, 8).
        family: Parent, first child, next and previous sibling, and room for a stack, shape (5, m); -1: none.
        costs: Length from the start and of the edge to the parent, shape (2, m).
        goals: Shape (k, n).
        goal_nodes: Node of each goal, -1 if it is not in the tree, shape (k,).
        branch: Nodes of the best path, goal first; counters[BRANCH] of them, shape (m,).
        near: Indices of neighbours, shape (MOST_NEIGHBOURS,).
        squares: Squares of their distances, then costs through them, shape (2, MOST_NEIGHBOURS).
        rows: Room, shape (8, n).
        room: Eight numbers.
        counters: See the places above.
    """

    states: FloatArray
    lanes: FloatArray
    family: np.ndarray
    costs: FloatArray
    goals: FloatArray
    goal_nodes: np.ndarray
    branch: np.ndarray
    near: np.ndarray
    squares: FloatArray
    rows: FloatArray
    room: FloatArray
    counters: np.ndarray


GRAPH = types.NamedTuple(
    (MATRIX, BLOCKS, TABLE, MATRIX, MATRIX, INDICES, INDICES, INDICES, MATRIX, MATRIX, VECTOR, INDICES), Graph
)
"""Numba's type of a graph."""


@njit(nogil=True, cache=True, error_model="numpy")
def _part(graph: Graph, node: int) -> None:
    family = graph.family
    before, after = family[BEFORE, node], family[NEXT, node]
    if before >= 0:
        family[NEXT, before] = after
    else:
        family[CHILD, family[PARENT, node]] = after
    if after >= 0:
        family[BEFORE, after] = before


@njit(nogil=True, cache=True, error_model="numpy")
def _adopt(graph: Graph, node: int, parent: int, length: float) -> None:
    family = graph.family
    first = family[CHILD, parent]
    family[PARENT, node], family[BEFORE, node], family[NEXT, node] = parent, -1, first
    if first >= 0:
        family[BEFORE, first] = node
    family[CHILD, parent] = node
    graph.costs[EDGE, node] = length
    graph.costs[COST, node] = graph.costs[COST, parent] + length


@njit(nogil=True, cache=True, error_model="numpy")
def move(graph: Graph, node: int, parent: int, length: float) -> None:
    """Give a node another parent, and lower the costs of all below it."""
    _part(graph, node)
    _adopt(graph, node, parent, length)
    family, costs = graph.family, graph.costs
    family[STACK, 0] = node
    height = 1
    while height > 0:
        height -= 1
        above = family[STACK, height]
        child = family[CHILD, above]
        while child >= 0:
            costs[COST, child] = costs[COST, above] + costs[EDGE, child]
            family[STACK, height] = child
            height += 1
            child = family[NEXT, child]


@njit(nogil=True, cache=True, error_model="numpy")
def add_node(world: World, graph: Graph, state: FloatArray, parent: int, length: float) -> int:
    """Add a state as a node below a parent (-1: none), on an edge of a length; return its number."""
    node = graph.counters[SIZE]
    graph.counters[SIZE] += 1
    for i in range(state.size):
        graph.states[node, i] = state[i]
    set_lane(graph.lanes, node, state, world.weights)
    graph.family[PARENT, node] = graph.family[CHILD, node] = -1
    graph.family[NEXT, node] = graph.family[BEFORE, node] = -1
    graph.costs[COST, node] = graph.costs[EDGE, node] = 0.0
    if parent >= 0:
        _adopt(graph, node, parent, length)
    return node


@njit(nogil=True, cache=True, error_model="numpy")
def neighbours(world: World, graph: Graph, state: FloatArray) -> int:
    """Find the nodes nearest to a state, nearest first; return how many."""
    n, size = state.size, graph.counters[SIZE]
    scaled = graph.rows[2]
    for i in range(n):
        scaled[i] = state[i] * world.weights[i]
    wanted = wanted_neighbours(n, size, MOST_NEIGHBOURS)
    return k_nearest(graph.lanes, size, scaled, wanted, graph.near, graph.squares[0], graph.room)


@njit(nogil=True, cache=True, error_model="numpy")
def join_branch(world: World, graph: Graph, state: FloatArray, count: int) -> int:
    """Add the nodes of the best path to a state's neighbours; return how many there are then.

    Near the best path samples are so dense that its own nodes are not among the nearest.
    """
    nearest = count
    for j in range(graph.counters[BRANCH]):
        node, known = graph.branch[j], False
        for k in range(nearest):
            known = known or graph.near[k] == node
        if not known and count < MOST_NEIGHBOURS:
            graph.near[count] = node
            graph.squares[0, count] = distance(state, graph.states[node], world.weights) ** 2
            count += 1
    return count


@njit(nogil=True, cache=True, error_model="numpy")
def note_best(graph: Graph, best: float) -> float:
    """Return the cost of the best goal, and renew the list of its branch if it is better than before."""
    least, counters = best, graph.counters
    for g in range(graph.goal_nodes.size):
        if graph.goal_nodes[g] >= 0 and graph.costs[COST, graph.goal_nodes[g]] < least:
            least, counters[GOAL] = graph.costs[COST, graph.goal_nodes[g]], g
    if least < best:
        count, node = 0, graph.goal_nodes[counters[GOAL]]
        while node >= 0:
            graph.branch[count] = node
            count += 1
            node = graph.family[PARENT, node]
        counters[BRANCH] = count
    return least
