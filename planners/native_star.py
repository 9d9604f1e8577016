"""Informed RRT* in machine code; `improve` is what calls it and says how it works."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, types

from .native import seconds_now, uniform
from .native_edge import prefix, steps_of
from .native_graph import (
    BRANCH,
    COST,
    DRAWN,
    GRAPH,
    ITERATIONS,
    RECORDS,
    SIZE,
    Graph,
    add_node,
    join_branch,
    move,
    neighbours,
    note_best,
)
from .native_sampling import near_path, random_state, within_ellipsoid
from .native_world import MATRIX, STOP, WORLD, World, distance, distance_to_nearest, is_free
from .vectors import FloatArray

# How a call ends.
DONE, TIME_UP, FULL = 0, 1, 2

_HISTORY_STEP = 1e-4  # part of the cost: smaller gains share an entry of the history
_SHORT_CUTS, _NEAR_PATH = 0.1, 0.5  # shares of the iterations
_SHORTER = 1.0 - 1e-12  # factor below which a cost is lower for other reasons than rounding
_SAME = 1e-9  # of the greatest extension: nearer states are one


@njit(nogil=True, cache=True, error_model="numpy")
def _best_parent(world: World, graph: Graph, state: FloatArray, count: int, limit: float, known: int) -> int:
    """Return the place among the neighbours of the best parent that can be reached; -1 if there is none.

    `limit` is a cost at which a node is of no use, `known` the place of a neighbour whose edge is valid (-1:
    none is known).
    """
    through = graph.squares[1]
    for k in range(count):
        through[k] = graph.costs[COST, graph.near[k]] + math.sqrt(graph.squares[0, k])
    for _ in range(count):
        best = 0
        for k in range(1, count):
            if through[k] < through[best]:
                best = k
        if through[best] >= limit:
            return -1
        length = math.sqrt(graph.squares[0, best])
        if best == known or is_free(
            world, graph.states[graph.near[best]], state, length, graph.rows, graph.counters
        ):
            return best
        through[best] = math.inf
    return -1


@njit(nogil=True, cache=True, error_model="numpy")
def _rewire(world: World, graph: Graph, node: int, count: int) -> None:
    """Lead neighbours through a new node where that is shorter."""
    for k in range(count):
        other, length = graph.near[k], math.sqrt(graph.squares[0, k])
        shorter = graph.costs[COST, node] + length < graph.costs[COST, other] * _SHORTER
        if shorter and is_free(
            world, graph.states[node], graph.states[other], length, graph.rows, graph.counters
        ):
            move(graph, other, node, length)


@njit(nogil=True, cache=True, error_model="numpy")
def _try_goals(world: World, graph: Graph, node: int, best: float) -> None:
    """Reach for each goal straight from a new node where that is shorter."""
    for g in range(graph.goals.shape[0]):
        length = distance(graph.states[node], graph.goals[g], world.weights)
        cost, goal_node = graph.costs[COST, node] + length, graph.goal_nodes[g]
        if goal_node >= 0:
            best = min(best, graph.costs[COST, goal_node])
        if goal_node == node or cost >= best:
            continue
        if not is_free(world, graph.states[node], graph.goals[g], length, graph.rows, graph.counters):
            continue
        if goal_node < 0:
            graph.goal_nodes[g] = add_node(world, graph, graph.goals[g], node, length)
        else:
            move(graph, goal_node, node, length)


@njit(nogil=True, cache=True, error_model="numpy")
def _cut_branch(world: World, graph: Graph, key: np.uint64) -> None:
    """Lead a node of the best path straight to one of its ancestors, if that is valid and shorter."""
    count = graph.counters[BRANCH]
    lower = int(uniform(key, graph.counters[DRAWN]) * (count - 2))
    upper = lower + 2 + int(uniform(key, graph.counters[DRAWN] + 1) * (count - lower - 2))
    graph.counters[DRAWN] += 2
    node, above = graph.branch[lower], graph.branch[min(upper, count - 1)]
    length = distance(graph.states[node], graph.states[above], world.weights)
    shorter = graph.costs[COST, above] + length < graph.costs[COST, node] * _SHORTER
    if shorter and is_free(
        world, graph.states[above], graph.states[node], length, graph.rows, graph.counters
    ):
        move(graph, node, above, length)


@njit(nogil=True, cache=True, error_model="numpy")
def _draw(world: World, graph: Graph, key: np.uint64, best: float) -> None:
    """Write a sample into rows[3]: near the best path, or anywhere where it may shorten the path."""
    counters, sample = graph.counters, graph.rows[3]
    place = counters[DRAWN]
    counters[DRAWN] += 1
    if best < math.inf and uniform(key, place) < _NEAR_PATH:
        edge = 1 + int(uniform(key, place + 1) * (counters[BRANCH] - 1))
        a, b = graph.states[graph.branch[edge - 1]], graph.states[graph.branch[edge]]
        counters[DRAWN] += 1
        counters[DRAWN] += near_path(
            key, counters[DRAWN], a, b, best, world.lower, world.extent, world.weights, sample
        )
        return
    for _ in range(8 if best < math.inf else 0):
        goal = graph.goals[int(uniform(key, counters[DRAWN]) * graph.goals.shape[0])]
        inside = within_ellipsoid(
            key, counters[DRAWN] + 1, graph.states[0], goal, best, world.lower, world.extent, world.weights,
            graph.rows[4], sample,
        )  # fmt: skip
        counters[DRAWN] += 2 * sample.size + 4
        if inside:
            return
    counters[DRAWN] += random_state(key, counters[DRAWN], world.lower, world.extent, sample)


@njit(nogil=True, cache=True, error_model="numpy")
def _step(world: World, graph: Graph, best: float) -> None:
    """Grow the tree towards the sample in rows[3] by one node, and rewire around it."""
    sample, new = graph.rows[3], graph.rows[5]
    n = sample.size
    count = neighbours(world, graph, sample)
    near, length = graph.near[0], math.sqrt(graph.squares[0, 0])
    for i in range(n):
        new[i] = sample[i]
        if length > world.reach:
            new[i] = graph.states[near, i] + (sample[i] - graph.states[near, i]) * world.reach / length
    if length <= world.reach * _SAME:
        return
    moved = length > world.reach
    length = min(length, world.reach)
    if (
        distance(graph.states[0], new, world.weights) + distance_to_nearest(new, graph.goals, world.weights)
        >= best
    ):
        return
    steps = steps_of(length, world.resolution)
    last = prefix(world.address, world.memory, graph.states[near], new, steps, graph.counters)
    if last == 0:
        return
    if last < steps:
        moved = True
        for i in range(n):
            new[i] = graph.states[near, i] + (new[i] - graph.states[near, i]) * last / steps
    known = 0
    if moved:
        count, known = neighbours(world, graph, new), -1
        for k in range(count):
            if graph.near[k] == near:
                known = k
    count = join_branch(world, graph, new, count)
    limit = best - distance_to_nearest(new, graph.goals, world.weights)
    parent = _best_parent(world, graph, new, count, limit, known)
    if parent >= 0 and graph.squares[0, 0] > (world.reach * _SAME) ** 2:
        node = add_node(world, graph, new, graph.near[parent], math.sqrt(graph.squares[0, parent]))
        _rewire(world, graph, node, count)
        _try_goals(world, graph, node, best)


@njit(nogil=True, cache=True, error_model="numpy")
def _plant(world: World, graph: Graph, path: FloatArray, goal: int) -> None:
    """Make the first path the first branch of the tree."""
    for k in range(path.shape[0]):
        length = distance(path[k - 1], path[k], world.weights) if k else 0.0
        add_node(world, graph, path[k], k - 1, length)
    graph.goal_nodes[goal] = path.shape[0] - 1


@njit(nogil=True, cache=True, error_model="numpy")
def _record(graph: Graph, history: FloatArray, seconds: float, cost: float) -> None:
    """Note a better path; small gains, and all when the list is full, renew its last entry."""
    count = graph.counters[RECORDS]
    complete = count < 2 or history[count - 1, 1] < history[count - 2, 1] * (1.0 - _HISTORY_STEP)
    if complete and count < history.shape[0]:
        count += 1
    graph.counters[RECORDS] = count
    history[count - 1, 0] = seconds
    history[count - 1, 1] = cost
    history[count - 1, 2] = graph.counters[ITERATIONS]


@njit(
    types.int64(
        WORLD, GRAPH, types.int64, types.float64, types.float64, types.float64, types.uint64, types.int64,
        MATRIX, types.int64, MATRIX,
    ),
    nogil=True,
    cache=True,
    error_model="numpy",
)  # fmt: skip
def improve_tree(
    world: World,
    graph: Graph,
    clock: int,
    seconds: float,
    begun: float,
    target: float,
    key: np.uint64,
    iterations: int,
    path: FloatArray,
    goal: int,
    history: FloatArray,
) -> int:
    """Shorten a path by informed RRT* until it is no longer than a target, or time or iterations run out.

    Args:
        world: Box, metric and oracle.
        graph: The tree; empty at first.
        clock: Address of `clock_gettime`.
        seconds: Time budget [s].
        begun: Time used before, for the history [s].
        target: Length at which to stop.
        key: Of the stream of random numbers.
        iterations: Samples in all, those of earlier calls included.
        path: A valid path, shape (k, n): the first branch.
        goal: Which of the goals it ends at.
        history: Room for times, costs and iterations, shape (h, 3).

    Returns:
        DONE, TIME_UP, or FULL if there may be no room for the nodes of one more iteration.
    """
    counters, place = graph.counters, np.empty(2, np.int64)
    entered = seconds_now(clock, place)
    if counters[SIZE] == 0:
        _plant(world, graph, path, goal)
    best = note_best(graph, math.inf)
    if counters[RECORDS] == 0:
        _record(graph, history, begun, best)
    while counters[ITERATIONS] < iterations and best > target:
        if counters[STOP] != 0 or seconds_now(clock, place) >= entered + seconds:
            return TIME_UP
        if counters[SIZE] + 1 + graph.goals.shape[0] > graph.states.shape[0]:
            return FULL
        counters[ITERATIONS] += 1
        counters[DRAWN] += 1
        if counters[BRANCH] > 2 and uniform(key, counters[DRAWN] - 1) < _SHORT_CUTS:
            _cut_branch(world, graph, key)
        else:
            _draw(world, graph, key, best)
            _step(world, graph, best)
        better = note_best(graph, best)
        if better < best:
            best = better
            _record(graph, history, begun + seconds_now(clock, place) - entered, best)
    return DONE
