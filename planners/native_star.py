"""Informed RRT* in machine code; `improve` is what calls it and says how it works."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from .native import seconds_now, uniform
from .native_edge import edge_valid, prefix, steps_of
from .native_sampling import near_path, random_state, within_ellipsoid
from .native_tree import k_nearest, set_lane
from .vectors import FloatArray

# How a call ends.
DONE, TIME_UP, FULL = 0, 1, 2

# Places in `counters`; those of the oracle come first.
STATES, CALLS, STOP, ITERATIONS, SIZE, GOAL, RECORDS, BRANCH, DRAWN = range(9)
COUNTERS = 9

# Rows of `links` and of `costs`.
PARENT, CHILD, NEXT, BEFORE, STACK = range(5)
LINKS = 5
COST, EDGE = 0, 1

MOST_NEIGHBOURS = 128
_HISTORY_STEP = 1e-4  # part of the cost: smaller gains share an entry of the history
_SHORT_CUTS, _NEAR_PATH = 0.1, 0.5  # shares of the iterations
_SHORTER = 1.0 - 1e-12  # factor below which a cost is lower for other reasons than rounding
_SAME = 1e-9  # of the greatest extension: nearer states are one


class Graph(NamedTuple):
    """A tree in arrays with room for m nodes.

    Attributes:
        states: Shape (m, n).
        lanes: Scaled states, shape (m / 8, n, 8).
        links: Parent, first child, next and previous sibling, and room for a stack, shape (5, m); -1: none.
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
    links: np.ndarray
    costs: FloatArray
    goals: FloatArray
    goal_nodes: np.ndarray
    branch: np.ndarray
    near: np.ndarray
    squares: FloatArray
    rows: FloatArray
    room: FloatArray
    counters: np.ndarray


class World(NamedTuple):
    """What edges are checked with.

    Attributes:
        address: Of the validity function.
        memory: Its memory.
        resolution: Greatest step of an edge.
        lower: Shape (n,).
        extent: Shape (n,).
        weights: Shape (n,).
        reach: Greatest length of an extension.
    """

    address: int
    memory: FloatArray
    resolution: float
    lower: FloatArray
    extent: FloatArray
    weights: FloatArray
    reach: float


@njit(nogil=True, cache=True, error_model="numpy")
def distance(a: FloatArray, b: FloatArray, weights: FloatArray) -> float:
    """Return the distance of two states, shapes (n,)."""
    total = 0.0
    for i in range(a.size):
        difference = (b[i] - a[i]) * weights[i]
        total += difference * difference
    return math.sqrt(total)


@njit(nogil=True, cache=True, error_model="numpy")
def _free(world: World, graph: Graph, a: FloatArray, b: FloatArray, length: float) -> bool:
    steps = steps_of(length, world.resolution)
    return edge_valid(world.address, world.memory, a, b, steps, graph.rows, graph.counters)


@njit(nogil=True, cache=True, error_model="numpy")
def _unlink(graph: Graph, node: int) -> None:
    links = graph.links
    before, after = links[BEFORE, node], links[NEXT, node]
    if before >= 0:
        links[NEXT, before] = after
    else:
        links[CHILD, links[PARENT, node]] = after
    if after >= 0:
        links[BEFORE, after] = before


@njit(nogil=True, cache=True, error_model="numpy")
def _link(graph: Graph, node: int, parent: int, length: float) -> None:
    links = graph.links
    first = links[CHILD, parent]
    links[PARENT, node], links[BEFORE, node], links[NEXT, node] = parent, -1, first
    if first >= 0:
        links[BEFORE, first] = node
    links[CHILD, parent] = node
    graph.costs[EDGE, node] = length
    graph.costs[COST, node] = graph.costs[COST, parent] + length


@njit(nogil=True, cache=True, error_model="numpy")
def _relink(graph: Graph, node: int, parent: int, length: float) -> None:
    """Give a node another parent, and lower the costs of all below it."""
    _unlink(graph, node)
    _link(graph, node, parent, length)
    links, costs = graph.links, graph.costs
    links[STACK, 0] = node
    height = 1
    while height > 0:
        height -= 1
        above = links[STACK, height]
        child = links[CHILD, above]
        while child >= 0:
            costs[COST, child] = costs[COST, above] + costs[EDGE, child]
            links[STACK, height] = child
            height += 1
            child = links[NEXT, child]


@njit(nogil=True, cache=True, error_model="numpy")
def _add(world: World, graph: Graph, state: FloatArray, parent: int, length: float) -> int:
    node = graph.counters[SIZE]
    graph.counters[SIZE] += 1
    for i in range(state.size):
        graph.states[node, i] = state[i]
    set_lane(graph.lanes, node, state, world.weights)
    graph.links[PARENT, node] = graph.links[CHILD, node] = -1
    graph.links[NEXT, node] = graph.links[BEFORE, node] = -1
    graph.costs[COST, node] = graph.costs[EDGE, node] = 0.0
    if parent >= 0:
        _link(graph, node, parent, length)
    return node


@njit(nogil=True, cache=True, error_model="numpy")
def _neighbours(world: World, graph: Graph, state: FloatArray) -> int:
    """Find the nodes nearest to a state, nearest first; return how many.

    Their number grows like e (1 + 1/n) log(size), which keeps RRT* asymptotically optimal.
    """
    n, size = state.size, graph.counters[SIZE]
    scaled = graph.rows[2]
    for i in range(n):
        scaled[i] = state[i] * world.weights[i]
    wanted = math.ceil(math.e * (1.0 + 1.0 / n) * math.log(size + 1.0))
    wanted = min(max(wanted, 1), min(size, MOST_NEIGHBOURS))
    return k_nearest(graph.lanes, size, scaled, wanted, graph.near, graph.squares[0], graph.room)


@njit(nogil=True, cache=True, error_model="numpy")
def _join_branch(world: World, graph: Graph, state: FloatArray, count: int) -> int:
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
def _still_to_go(world: World, graph: Graph, state: FloatArray) -> float:
    """Return the distance to the nearest goal."""
    least = math.inf
    for g in range(graph.goals.shape[0]):
        least = min(least, distance(state, graph.goals[g], world.weights))
    return least


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
        if best == known or _free(world, graph, graph.states[graph.near[best]], state, length):
            return best
        through[best] = math.inf
    return -1


@njit(nogil=True, cache=True, error_model="numpy")
def _rewire(world: World, graph: Graph, node: int, count: int) -> None:
    """Lead neighbours through a new node where that is shorter."""
    for k in range(count):
        other, length = graph.near[k], math.sqrt(graph.squares[0, k])
        shorter = graph.costs[COST, node] + length < graph.costs[COST, other] * _SHORTER
        if shorter and _free(world, graph, graph.states[node], graph.states[other], length):
            _relink(graph, other, node, length)


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
        if not _free(world, graph, graph.states[node], graph.goals[g], length):
            continue
        if goal_node < 0:
            graph.goal_nodes[g] = _add(world, graph, graph.goals[g], node, length)
        else:
            _relink(graph, goal_node, node, length)


@njit(nogil=True, cache=True, error_model="numpy")
def _note_best(graph: Graph, best: float) -> float:
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
            node = graph.links[PARENT, node]
        counters[BRANCH] = count
    return least


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
    if shorter and _free(world, graph, graph.states[above], graph.states[node], length):
        _relink(graph, node, above, length)


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
    count = _neighbours(world, graph, sample)
    near, length = graph.near[0], math.sqrt(graph.squares[0, 0])
    for i in range(n):
        new[i] = sample[i]
        if length > world.reach:
            new[i] = graph.states[near, i] + (sample[i] - graph.states[near, i]) * world.reach / length
    if length <= world.reach * _SAME:
        return
    moved = length > world.reach
    length = min(length, world.reach)
    if distance(graph.states[0], new, world.weights) + _still_to_go(world, graph, new) >= best:
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
        count, known = _neighbours(world, graph, new), -1
        for k in range(count):
            if graph.near[k] == near:
                known = k
    count = _join_branch(world, graph, new, count)
    limit = best - _still_to_go(world, graph, new)
    parent = _best_parent(world, graph, new, count, limit, known)
    if parent >= 0 and graph.squares[0, 0] > (world.reach * _SAME) ** 2:
        node = _add(world, graph, new, graph.near[parent], math.sqrt(graph.squares[0, parent]))
        _rewire(world, graph, node, count)
        _try_goals(world, graph, node, best)


@njit(nogil=True, cache=True, error_model="numpy")
def _plant(world: World, graph: Graph, path: FloatArray, goal: int) -> None:
    """Make the first path the first branch of the tree."""
    for k in range(path.shape[0]):
        length = distance(path[k - 1], path[k], world.weights) if k else 0.0
        _add(world, graph, path[k], k - 1, length)
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
    "int64(int64, int64, float64, float64, float64, float64, float64, float64[:, ::1], uint64, int64,"
    " float64[:, ::1], int64, float64[:, ::1], int64[::1], float64[:, ::1], float64[:, :, ::1],"
    " int64[:, ::1], float64[:, ::1], int64[::1], float64[:, ::1], float64[:, ::1], int64[::1],"
    " float64[::1])",
    nogil=True,
    cache=True,
    error_model="numpy",
)
def improve_tree(
    address: int,
    clock: int,
    seconds: float,
    begun: float,
    resolution: float,
    reach: float,
    target: float,
    box: FloatArray,
    key: np.uint64,
    iterations: int,
    path: FloatArray,
    goal: int,
    goals: FloatArray,
    goal_nodes: np.ndarray,
    states: FloatArray,
    lanes: FloatArray,
    links: np.ndarray,
    costs: FloatArray,
    branch: np.ndarray,
    rows: FloatArray,
    history: FloatArray,
    counters: np.ndarray,
    memory: FloatArray,
) -> int:
    """Shorten a path by informed RRT* until it is no longer than a target, or time or iterations run out.

    Args:
        address: Of the validity function.
        clock: Address of `clock_gettime`.
        seconds: Time budget [s].
        begun: Time used before, for the history [s].
        resolution: Greatest step of an edge.
        reach: Greatest length of an extension.
        target: Length at which to stop.
        box: Lower bounds, extents and weights, shape (3, n).
        key: Of the stream of random numbers.
        iterations: Samples in all, those of earlier calls included.
        path: A valid path, shape (k, n): the first branch.
        goal: Which of the goals it ends at.
        goals: Shape (g, n).
        goal_nodes: See `Graph`.
        states: See `Graph`.
        lanes: See `Graph`.
        links: See `Graph`.
        costs: See `Graph`.
        branch: See `Graph`.
        rows: See `Graph`.
        history: Room for times, costs and iterations, shape (h, 3).
        counters: See the places above.
        memory: Of the validity function.

    Returns:
        DONE, TIME_UP, or FULL if there may be no room for the nodes of one more iteration.
    """
    graph = Graph(
        states, lanes, links, costs, goals, goal_nodes, branch, np.empty(MOST_NEIGHBOURS, np.int64),
        np.empty((2, MOST_NEIGHBOURS)), rows, np.empty(8), counters,
    )  # fmt: skip
    world = World(address, memory, resolution, box[0], box[1], box[2], reach)
    place = np.empty(2, np.int64)
    entered = seconds_now(clock, place)
    now = entered
    if counters[SIZE] == 0:
        _plant(world, graph, path, goal)
    best = _note_best(graph, math.inf)
    if counters[RECORDS] == 0:
        _record(graph, history, begun, best)
    while counters[ITERATIONS] < iterations and best > target:
        now = seconds_now(clock, place)
        if counters[STOP] != 0 or now >= entered + seconds:
            return TIME_UP
        if counters[SIZE] + 1 + goals.shape[0] > states.shape[0]:
            return FULL
        counters[ITERATIONS] += 1
        counters[DRAWN] += 1
        if counters[BRANCH] > 2 and uniform(key, counters[DRAWN] - 1) < _SHORT_CUTS:
            _cut_branch(world, graph, key)
        else:
            _draw(world, graph, key, best)
            _step(world, graph, best)
        better = _note_best(graph, best)
        if better < best:
            best = better
            _record(graph, history, begun + seconds_now(clock, place) - entered, best)
    return DONE
