"""Nodes of planners: nearest neighbors by a linear scan, eight nodes at a time."""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import eight_square_distances
from pepper_kin.kernels.signatures import Floats1, Floats3, Ints1

LANES = 8
"""Nodes whose scaled states lie side by side."""


@compiled("void(float64[:, :, ::1], int64, float64[::1], float64[::1])", lean=True)
def set_lane(lanes: Floats3, node: int, state: Floats1, weights: Floats1) -> None:
    """Write the scaled state of a new node; the rest of its lanes, if it is the first, is infinitely far."""
    if node % LANES == 0:
        for i in range(state.size):
            for lane in range(1, LANES):
                lanes[node // LANES, i, lane] = math.inf
    for i in range(state.size):
        lanes[node // LANES, i, node % LANES] = state[i] * weights[i]


@compiled("int64(float64[:, :, ::1], int64, float64[::1], float64[::1])", lean=True)
def nearest(lanes: Floats3, size: int, query: Floats1, spare: Floats1) -> int:
    """Return the node nearest to a scaled state; the first of equally near ones.

    Args:
        lanes: Scaled states, shape (blocks, n, 8); those of the last block that are no nodes are infinite.
        size: Number of nodes.
        query: Scaled state, shape (n,).
        spare: Eight numbers.
    """
    best, found, n = math.inf, 0, query.size
    base, stride, asked, place = lanes.ctypes.data, 8 * LANES * n, query.ctypes.data, spare.ctypes.data
    for block in range((size + LANES - 1) // LANES):
        if eight_square_distances(base + block * stride, asked, n, place) < best:
            for lane in range(LANES):
                if spare[lane] < best:
                    best, found = spare[lane], block * LANES + lane
    return found


@compiled("int64(float64[:, :, ::1], float64[::1], int64, float64[::1], float64, float64[::1])", lean=True)
def nearest_within(
    lanes: Floats3, costs: Floats1, size: int, query: Floats1, bound: float, spare: Floats1
) -> int:
    """Return the node nearest to a scaled state of those through which it is reached at a bounded cost.

    Args:
        lanes: Scaled states, shape (blocks, n, 8); those of the last block that are no nodes are infinite.
        costs: Cost of each node, shape (m,).
        size: Number of nodes.
        query: Scaled state, shape (n,).
        bound: Greatest sum of a node's cost and its distance.
        spare: Eight numbers.

    Returns:
        The node, the first of equally near ones; -1 if there is none.
    """
    best, found, n = math.inf, -1, query.size
    base, stride, asked, place = lanes.ctypes.data, 8 * LANES * n, query.ctypes.data, spare.ctypes.data
    for block in range((size + LANES - 1) // LANES):
        if eight_square_distances(base + block * stride, asked, n, place) < best:
            for lane in range(LANES):
                if spare[lane] < best and costs[block * LANES + lane] + math.sqrt(spare[lane]) <= bound:
                    best, found = spare[lane], block * LANES + lane
    return found


@compiled(
    "int64(float64[:, :, ::1], int64, float64[::1], int64, int64[::1], float64[::1], float64[::1])", lean=True
)
def k_nearest(
    lanes: Floats3, size: int, query: Floats1, wanted: int, found: Ints1, squares: Floats1, spare: Floats1
) -> int:
    """Write the nodes nearest to a scaled state and the squares of their distances, nearest first.

    Args:
        lanes: Scaled states, shape (blocks, n, 8).
        size: Number of nodes.
        query: Scaled state, shape (n,).
        wanted: How many are wanted, 1 or more.
        found: Space for them.
        squares: Space for the squares of their distances.
        spare: Eight numbers.

    Returns:
        How many were found: `wanted`, or all.
    """
    n, count, limit = query.size, 0, math.inf
    base, stride, asked, place = lanes.ctypes.data, 8 * LANES * n, query.ctypes.data, spare.ctypes.data
    for block in range((size + LANES - 1) // LANES):
        if eight_square_distances(base + block * stride, asked, n, place) >= limit:
            continue
        for lane in range(LANES):
            square = spare[lane]
            if square >= limit or block * LANES + lane >= size:
                continue
            k = count if count < wanted else wanted - 1
            while k > 0 and squares[k - 1] > square:
                squares[k], found[k] = squares[k - 1], found[k - 1]
                k -= 1
            squares[k], found[k] = square, block * LANES + lane
            count = min(count + 1, wanted)
            if count == wanted:
                limit = squares[wanted - 1]
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
        size: Its new length along the axis; the further entries are not set.
        axis: The axis.
    """
    shape = list(array.shape)
    shape[axis] = size
    longer = np.empty(tuple(shape), dtype=array.dtype)
    kept = (slice(None),) * axis + (slice(array.shape[axis]),)
    longer[kept] = array
    return longer


def whole_blocks(capacity: int) -> int:
    """Return a number of nodes rounded up to a multiple of eight."""
    return -(-capacity // LANES) * LANES
