"""RRT-Connect in machine code; `rrt_connect` is what calls it.

Numba keeps the machine code beside this file and renews it when this file changes, but not when only the
files change whose functions are inlined here: after work on `native*.py`, remove `__pycache__`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .native import seconds_now, uniform
from .native_edge import edge_valid, prefix, steps_of
from .native_tree import nearest, set_lane
from .vectors import FloatArray

# How a call ends.
GOING_ON, FOUND, TIME_UP, FULL, START_INVALID = 0, 1, 2, 3, 4

# Places in `counters`; those of the oracle come first, see `native_edge.prefix`.
STATES, CALLS, ITERATIONS, START_SIZE, GOAL_SIZE, GROWING, START_NODE, GOAL_NODE, DIRECT = range(9)
COUNTERS = 9

# Rows of `box` and of `rows`.
LOWER, EXTENT, WEIGHTS = 0, 1, 2
SAMPLE, ORIGIN, TARGET, SCALED, SHIFTED = 0, 1, 2, 3, 4  # the last one is two rows
ROWS = 6

_CLOCK_EVERY = 64  # goals


@njit(nogil=True, cache=True, error_model="numpy")
def _distance(a: FloatArray, b: FloatArray, weights: FloatArray) -> float:
    total = 0.0
    for i in range(a.size):
        difference = (b[i] - a[i]) * weights[i]
        total += difference * difference
    return math.sqrt(total)


@njit(nogil=True, cache=True, error_model="numpy")
def _add(
    side: int,
    parent: int,
    state: FloatArray,
    weights: FloatArray,
    states: FloatArray,
    lanes: FloatArray,
    parents: np.ndarray,
    counters: np.ndarray,
) -> int:
    """Add a node to a tree, of the start (0) or of the goals (1); return its number."""
    node = counters[START_SIZE + side]
    counters[START_SIZE + side] += 1
    for i in range(state.size):
        states[side, node, i] = state[i]
    set_lane(lanes[side], node, state, weights)
    parents[side, node] = parent
    return node


@njit(nogil=True, cache=True, error_model="numpy")
def _extend(
    side: int,
    target: FloatArray,
    address: int,
    memory: FloatArray,
    weights: FloatArray,
    resolution: float,
    stride: int,
    states: FloatArray,
    lanes: FloatArray,
    parents: np.ndarray,
    counters: np.ndarray,
    rows: FloatArray,
    room: FloatArray,
) -> tuple[int, bool]:
    """Grow a tree straight towards a target as far as valid; return the last node or -1, and if it got there.

    Nodes are set every `stride` steps on the way.
    """
    n = target.size
    for i in range(n):
        rows[SCALED, i] = target[i] * weights[i]
    near = nearest(lanes[side], counters[START_SIZE + side], rows[SCALED], room)
    origin = states[side, near]
    steps = steps_of(_distance(origin, target, weights), resolution)
    last = prefix(address, memory, origin, target, steps, counters)
    if last == 0:
        return -1, False
    node, done = near, 0
    while done < last:
        done = min(done + stride, last)
        for i in range(n):
            rows[ORIGIN, i] = origin[i] + (target[i] - origin[i]) * done / steps
            if done == steps:
                rows[ORIGIN, i] = target[i]
        node = _add(side, node, rows[ORIGIN], weights, states, lanes, parents, counters)
    return node, last == steps


@njit(
    "int64(int64, int64, float64, float64, float64[:, ::1], float64[::1], float64[:, ::1], int64[::1], int64,"
    " float64[:, :, ::1], float64[:, :, :, ::1], int64[:, ::1], int64[::1], float64[:, ::1], float64[::1])",
    nogil=True,
    cache=True,
    error_model="numpy",
)
def plant(
    address: int,
    clock: int,
    seconds: float,
    resolution: float,
    box: FloatArray,
    start: FloatArray,
    goals: FloatArray,
    order: np.ndarray,
    first: int,
    states: FloatArray,
    lanes: FloatArray,
    parents: np.ndarray,
    counters: np.ndarray,
    rows: FloatArray,
    memory: FloatArray,
) -> int:
    """Make valid ends the roots of the trees, and try the straight edges between them.

    Args:
        address: Of the validity function.
        clock: Address of `clock_gettime`.
        seconds: Time budget [s].
        resolution: Greatest step of an edge.
        box: Lower bounds, extents and weights, shape (3, n).
        start: Shape (n,).
        goals: Shape (k, n).
        order: Goals in the order in which they are tried, shape (k,).
        first: Number of the first goal: the parent of a root says which goal it is, -1 - number.
        states: Room for the nodes of both trees, shape (2, m, n).
        lanes: Room for their scaled states, shape (2, m / 8, n, 8).
        parents: Room for their parents, shape (2, m).
        counters: See the places above.
        rows: Room, shape (6, n).
        memory: Of the validity function.

    Returns:
        FOUND (a straight edge; its goal is counters[DIRECT]), GOING_ON, TIME_UP or START_INVALID.
    """
    place = np.empty(2, np.int64)
    end = seconds_now(clock, place) + seconds
    weights = box[WEIGHTS]
    if counters[START_SIZE] == 0:
        if prefix(address, memory, start, start, 1, counters) == 0:
            return START_INVALID
        _add(0, -1, start, weights, states, lanes, parents, counters)
    old = counters[GOAL_SIZE]
    for j in range(order.size):
        if j % _CLOCK_EVERY == 0 and seconds_now(clock, place) >= end:
            return TIME_UP
        goal = goals[order[j]]
        if prefix(address, memory, goal, goal, 1, counters) == 1:
            _add(1, -1 - first - order[j], goal, weights, states, lanes, parents, counters)
    for node in range(old, counters[GOAL_SIZE]):
        goal = states[1, node]
        steps = steps_of(_distance(start, goal, weights), resolution)
        if edge_valid(address, memory, start, goal, steps, rows[SHIFTED:], counters):
            counters[START_NODE], counters[GOAL_NODE] = 0, node
            counters[DIRECT] = 1
            return FOUND
        if seconds_now(clock, place) >= end:
            return TIME_UP
    return GOING_ON


@njit(
    "int64(int64, int64, float64, float64, int64, float64[:, ::1], uint64, int64,"
    " float64[:, :, ::1], float64[:, :, :, ::1], int64[:, ::1], int64[::1], float64[:, ::1], float64[::1])",
    nogil=True,
    cache=True,
    error_model="numpy",
)
def grow(
    address: int,
    clock: int,
    seconds: float,
    resolution: float,
    stride: int,
    box: FloatArray,
    key: np.uint64,
    iterations: int,
    states: FloatArray,
    lanes: FloatArray,
    parents: np.ndarray,
    counters: np.ndarray,
    rows: FloatArray,
    memory: FloatArray,
) -> int:
    """Grow both trees until they meet; see `rrt_connect` for the method and `plant` for most arguments.

    `stride` is the number of steps between neighbouring nodes of a long extension, `key` that of the stream
    of random numbers, `iterations` the number of samples in all, those of earlier calls included.

    Returns:
        FOUND (the trees meet at counters[START_NODE] and counters[GOAL_NODE]), GOING_ON if the iterations are
        used up, TIME_UP, or FULL if there may be no room for the nodes of one more iteration.
    """
    place = np.empty(2, np.int64)
    room = np.empty(8)
    end = seconds_now(clock, place) + seconds
    weights, n = box[WEIGHTS], box.shape[1]
    longest = _distance(box[LOWER], box[LOWER] + box[EXTENT], weights)
    spare = steps_of(longest, resolution) // stride + 2
    while counters[ITERATIONS] < iterations:
        if seconds_now(clock, place) >= end:
            return TIME_UP
        if max(counters[START_SIZE], counters[GOAL_SIZE]) + spare > states.shape[1]:
            return FULL
        for i in range(n):
            rows[SAMPLE, i] = box[LOWER, i] + uniform(key, counters[ITERATIONS] * n + i) * box[EXTENT, i]
        counters[ITERATIONS] += 1
        side = counters[GROWING]
        new, _ = _extend(
            side, rows[SAMPLE], address, memory, weights, resolution, stride,
            states, lanes, parents, counters, rows, room,
        )  # fmt: skip
        if new >= 0:
            for i in range(n):
                rows[TARGET, i] = states[side, new, i]
            meeting, reached = _extend(
                1 - side, rows[TARGET], address, memory, weights, resolution, stride,
                states, lanes, parents, counters, rows, room,
            )  # fmt: skip
            if reached:
                counters[START_NODE + side], counters[GOAL_NODE - side] = new, meeting
                return FOUND
        counters[GROWING] = 1 - side
    return GOING_ON
