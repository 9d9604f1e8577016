"""The two trees of a search, and nearest neighbors by a linear scan, sixteen nodes at a time.

The scan is in single precision: among nodes at nearly the same distance, any may be returned.
"""

from __future__ import annotations

import math
import threading
from typing import NamedTuple

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.lanes import (
    LANES,
    lane_minimum,
    lanes_below,
    least_lane,
    load_lanes,
    lowest_bit,
    single_at,
    spread,
    store_lanes,
)
from pepper_kin.kernels.signatures import (
    Floats1,
    Floats2,
    Floats3,
    Ints1,
    Ints2,
    Singles1,
    Singles3,
    Singles4,
)

from .search_space import ITERATIONS, SearchSpace
from .vectors import FloatArray

ABREAST = 2 * LANES
"""Number of nodes of a block, whose scaled states are stored coordinate by coordinate."""
FAR, FURTHEST = 1e18, 1e36
"""Scaled coordinate of unused entries of a block, and an upper bound on squared distances of nodes."""

_FIRST_CAPACITY, _MOST_KEPT = 512, 16_384  # nodes of a tree: initial capacity, maximum kept for reuse

# Statuses of growth.
GOING_ON, FOUND, TIME_UP, FULL = range(4)

# Indices into `counters`, after the indices common to all planners; a search's own begin at OWN_COUNTERS.
START_SIZE, GOAL_SIZE, START_NODE, GOAL_NODE, BY_EDGE, OWN_COUNTERS = range(ITERATIONS + 1, ITERATIONS + 7)
_COUNTERS = OWN_COUNTERS + 10

# Rows of `rows`; a search has its own from OWN_ROWS on.
SAMPLE, TARGET, OWN_ROWS = range(3)
_ROWS = OWN_ROWS + 3


class Trees(NamedTuple):
    """The tree of the start (0) and the tree of the goals (1), in arrays with space for m nodes each.

    Attributes:
        states: States of the nodes, shape (2, m, n).
        lanes: Scaled states, shape (2, m / 16, n, 16).
        parents: Parents of the nodes; -1 minus the goal's index for a root, shape (2, m).
        values: Two numbers per node, specific to the search, shape (2, 2, m).
        numbers: Three numbers specific to the search, shape (3,).
        rows: Workspace, shape (5, n); see the rows above.
        scaled: Scaled state whose neighbors are searched, shape (n,).
        squares: Workspace of the search for neighbors, shape (16,).
        counters: Counters, see the indices above.  The path leads over START_NODE and GOAL_NODE, which are
            the same state unless they are joined BY_EDGE.
    """

    states: Floats3
    lanes: Singles4
    parents: Ints2
    values: Floats3
    numbers: Floats1
    rows: Floats2
    scaled: Singles1
    squares: Singles1
    counters: Ints1


class _Left(threading.local):
    """Trees of each thread that are kept for reuse, by the number of coordinates."""

    def __init__(self) -> None:
        self.trees: dict[int, Trees] = {}


_left = _Left()


def take_trees(n: int) -> Trees:
    """Return trees of states of n coordinates, without nodes; memory left by this thread is reused.

    Counters are 0 and numbers infinite.
    """
    kept: Trees | None = _left.trees.pop(n, None)
    if kept is not None:
        kept.counters.fill(0)
        kept.numbers.fill(math.inf)
        return kept
    return Trees(
        states=np.empty((2, _FIRST_CAPACITY, n)),
        lanes=np.empty((2, _FIRST_CAPACITY // ABREAST, n, ABREAST), np.float32),
        parents=np.empty((2, _FIRST_CAPACITY), dtype=np.int64),
        values=np.empty((2, 2, _FIRST_CAPACITY)),
        numbers=np.full(3, math.inf),
        rows=np.empty((_ROWS, n)),
        scaled=np.empty(n, np.float32),
        squares=np.empty(ABREAST, np.float32),
        counters=np.zeros(_COUNTERS, dtype=np.int64),
    )


def leave_trees(trees: Trees) -> None:
    """Keep the memory of trees for a later search of this thread."""
    if trees.states.shape[1] <= _MOST_KEPT:
        _left.trees[trees.states.shape[2]] = trees


def with_room(trees: Trees, spare: int) -> Trees:
    """Return trees with space for `spare` more nodes each: the same, or a copy of at least twice the size."""
    capacity = trees.states.shape[1]
    wanted = max(trees.counters[START_SIZE : GOAL_SIZE + 1].tolist()) + spare
    if wanted <= capacity:
        return trees
    capacity = whole_blocks(max(wanted, 2 * capacity))
    return trees._replace(
        states=grown(trees.states, capacity, axis=1),
        lanes=grown(trees.lanes, capacity // ABREAST, axis=1),
        parents=grown(trees.parents, capacity, axis=1),
        values=grown(trees.values, capacity, axis=2),
    )


@compiled(lean=True)
def room(trees: Trees) -> int:
    """Return the number of nodes that can still be added to each tree."""
    return trees.states.shape[1] - max(trees.counters[START_SIZE], trees.counters[GOAL_SIZE])


@compiled("int64(SearchSpace, Trees, int64, int64, float64[::1])", lean=True)
def add_node(space: SearchSpace, trees: Trees, side: int, parent: int, state: Floats1) -> int:
    """Add a node to a tree, which has space for it; return its index.

    Args:
        space: Supplies the metric.
        trees: The trees.
        side: Index of the tree.
        parent: Index of the node's parent; -1 minus the goal's index for a root.
        state: State of the node, shape (n,).
    """
    node = trees.counters[START_SIZE + side]
    trees.counters[START_SIZE + side] += 1
    for i in range(state.size):
        trees.states[side, node, i] = state[i]
    set_lane(trees.lanes[side], node, state, space.weights)
    trees.parents[side, node] = parent
    return node


@compiled(lean=True)
def scale(space: SearchSpace, trees: Trees, state: FloatArray) -> None:
    """Write a scaled state into `scaled`."""
    for i in range(state.size):
        trees.scaled[i] = state[i] * space.weights[i]


@compiled(lean=True)
def nearest_node(space: SearchSpace, trees: Trees, side: int, state: FloatArray) -> int:
    """Return the node of a tree nearest to a state; the first one at equal distance."""
    scale(space, trees, state)
    return nearest(trees.lanes[side], trees.counters[START_SIZE + side], trees.scaled, trees.squares)


@compiled("int64(Trees)", lean=True)
def way_point_count(trees: Trees) -> int:
    """Return the number of waypoints of the path along which the trees have met."""
    count = 0
    for side in range(2):
        node = trees.counters[START_NODE + side]
        while node >= 0:
            count += 1
            node = trees.parents[side, node]
    return count - (1 - trees.counters[BY_EDGE])


@compiled("int64(Trees, float64[:, ::1])", lean=True)
def trace(trees: Trees, points: Floats2) -> int:
    """Write the waypoints of the path along which the trees have met; return the index of its goal.

    Args:
        trees: The trees.
        points: Waypoints from the start to the goal, written, shape (`way_point_count`, n).
    """
    parents, states = trees.parents, trees.states
    here, node, goal = 0, trees.counters[START_NODE], trees.counters[GOAL_NODE]
    while parents[0, node] >= 0:
        here, node = here + 1, parents[0, node]
    first = here + 1
    node = trees.counters[START_NODE]
    while node >= 0:
        for i in range(points.shape[1]):
            points[here, i] = states[0, node, i]
        here, node = here - 1, parents[0, node]
    if trees.counters[BY_EDGE] == 0:
        goal = parents[1, goal]
    while goal >= 0:
        for i in range(points.shape[1]):
            points[first, i] = states[1, goal, i]
        first, goal = first + 1, parents[1, goal]
    return -1 - goal


def traced(trees: Trees) -> tuple[FloatArray, int]:
    """Return the waypoints of the path along which the trees have met, shape (k, n), and its goal."""
    points = np.empty((way_point_count(trees), trees.states.shape[2]))
    return points, trace(trees, points)


@compiled("void(float32[:, :, ::1], int64, float64[::1], float64[::1])", lean=True)
def set_lane(lanes: Singles3, node: int, state: Floats1, weights: Floats1) -> None:
    """Write the scaled state of a new node; for the first node of a block, the other entries become FAR."""
    if node % ABREAST == 0:
        for i in range(state.size):
            for lane in range(1, ABREAST):
                lanes[node // ABREAST, i, lane] = FAR
    for i in range(state.size):
        lanes[node // ABREAST, i, node % ABREAST] = state[i] * weights[i]


@compiled(inline=True, lean=True)
def _nearer(block: int, query: int, n: int, limit: float, squares: int) -> int:
    """Return a bit mask of the nodes of a block whose squared distance is below a limit.

    Args:
        block: Address of the scaled states of sixteen nodes, shape (n, 16).
        query: Address of a scaled state, shape (n,).
        n: Number of coordinates.
        limit: Limit of the squared distance.
        squares: Address that receives the squared distances, shape (16,), if any is below the limit.
    """
    first, second = spread(0.0), spread(0.0)
    for i in range(n):
        x = single_at(query, i)
        u, v = load_lanes(block, 2 * i) - x, load_lanes(block, 2 * i + 1) - x
        first, second = first + u * u, second + v * v
    bound = spread(limit)
    met = lanes_below(first, bound) | lanes_below(second, bound) << LANES
    if met != 0:
        store_lanes(squares, first)
        store_lanes(squares, second, 1)
    return met


@compiled("int64(float32[:, :, ::1], int64, float32[::1], float32[::1])", lean=True)
def nearest(lanes: Singles3, size: int, query: Singles1, spare: Singles1) -> int:
    """Return the node nearest to a scaled state; the first one at equal distance.

    Args:
        lanes: Scaled states, shape (blocks, n, 16); unused entries of the last block are FAR.
        size: Number of nodes.
        query: Scaled state, shape (n,).
        spare: Scratch space, shape (16,); the first entry receives the squared distance.
    """
    best, found, n = np.float32(FURTHEST), 0, query.size
    base, stride, asked, place = lanes.ctypes.data, 4 * ABREAST * n, query.ctypes.data, spare.ctypes.data
    for block in range((size + ABREAST - 1) // ABREAST):
        if _nearer(base + block * stride, asked, n, best, place) != 0:
            first, second = load_lanes(place), load_lanes(place, 1)
            best = least_lane(lane_minimum(first, second))
            least = spread(best)
            further = lanes_below(least, first) | lanes_below(least, second) << LANES
            found = block * ABREAST + lowest_bit(~further)
    spare[0] = best
    return found


@compiled("int64(float32[:, :, ::1], float64[::1], int64, float32[::1], float64, float32[::1])", lean=True)
def nearest_within(
    lanes: Singles3, costs: Floats1, size: int, query: Singles1, bound: float, spare: Singles1
) -> int:
    """Return the nearest node through which a scaled state is reached at a bounded cost.

    Args:
        lanes: Scaled states, shape (blocks, n, 16); unused entries of the last block are FAR.
        costs: Cost of each node, shape (m,).
        size: Number of nodes.
        query: Scaled state, shape (n,).
        bound: Maximum sum of a node's cost and its distance.
        spare: Scratch space, shape (16,); the first entry receives the squared distance.

    Returns:
        The node, the first one at equal distance; -1 for none.
    """
    best, found, n = np.float32(FURTHEST), -1, query.size
    base, stride, asked, place = lanes.ctypes.data, 4 * ABREAST * n, query.ctypes.data, spare.ctypes.data
    for block in range((size + ABREAST - 1) // ABREAST):
        met = _nearer(base + block * stride, asked, n, best, place)
        while met != 0:
            lane = lowest_bit(met)
            if spare[lane] < best and costs[block * ABREAST + lane] + math.sqrt(spare[lane]) <= bound:
                best, found = spare[lane], block * ABREAST + lane
            met &= met - 1
    spare[0] = best
    return found


@compiled(
    "int64(float32[:, :, ::1], int64, float32[::1], int64, int64[::1], float64[::1], float32[::1])", lean=True
)
def k_nearest(
    lanes: Singles3, size: int, query: Singles1, wanted: int, found: Ints1, squares: Floats1, spare: Singles1
) -> int:
    """Write the nodes nearest to a scaled state and the squares of their distances, nearest first.

    Args:
        lanes: Scaled states, shape (blocks, n, 16); unused entries of the last block are FAR.
        size: Number of nodes.
        query: Scaled state, shape (n,).
        wanted: Number k of nodes, 1 or more.
        found: Nearest nodes, written, shape (k,).
        squares: Squares of their distances, in single precision, written, shape (k,).
        spare: Scratch space, shape (16,).

    Returns:
        Number of nodes written: `wanted`, or all.
    """
    n, count, limit = query.size, 0, np.float32(FURTHEST)
    base, stride, asked, place = lanes.ctypes.data, 4 * ABREAST * n, query.ctypes.data, spare.ctypes.data
    for block in range((size + ABREAST - 1) // ABREAST):
        met = _nearer(base + block * stride, asked, n, limit, place)
        while met != 0:
            lane = lowest_bit(met)
            square, met = spare[lane], met & (met - 1)
            if square >= limit:
                continue
            k = count if count < wanted else wanted - 1
            while k > 0 and squares[k - 1] > square:
                squares[k], found[k] = squares[k - 1], found[k - 1]
                k -= 1
            squares[k], found[k] = square, block * ABREAST + lane
            count = min(count + 1, wanted)
            if count == wanted:
                limit = np.float32(squares[wanted - 1])
    return count


@compiled(lean=True)
def neighbor_count(n: int, size: int, most: int) -> int:
    """Return e (1 + 1/n) log(size + 1), rounded up, which is enough for asymptotic optimality.

    Source: S. Karaman and E. Frazzoli, Sampling-based algorithms for optimal motion planning, Int. J. of
    Robotics Research 30(7), 2011.
    """
    wanted = math.ceil(math.e * (1.0 + 1.0 / n) * math.log(size + 1.0))
    return min(max(wanted, 1), min(size, most))


def grown(array: np.ndarray, size: int, axis: int = 0) -> np.ndarray:
    """Return a copy of an array of any shape with space for more entries along an axis.

    Args:
        array: The array.
        size: New length along the axis; the further entries are not set.
        axis: The axis.
    """
    shape = list(array.shape)
    shape[axis] = size
    longer = np.empty(tuple(shape), dtype=array.dtype)
    kept = (slice(None),) * axis + (slice(array.shape[axis]),)
    longer[kept] = array
    return longer


def whole_blocks(capacity: int) -> int:
    """Return a number of nodes rounded up to whole blocks of `ABREAST`."""
    return -(-capacity // ABREAST) * ABREAST
