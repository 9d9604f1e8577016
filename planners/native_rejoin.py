"""Other goals at the end of a path, in machine code; `rejoin` is what calls it and says how it works."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, types

from .native_edge import edge_valid, steps_of
from .native_world import INDICES, MATRIX, VECTOR, WORLD, World, distance
from .vectors import FloatArray


@njit(
    types.int64(WORLD, MATRIX, VECTOR, MATRIX, INDICES, types.float64, MATRIX, INDICES),
    nogil=True,
    cache=True,
    error_model="numpy",
)
def shortest_end(
    world: World,
    points: FloatArray,
    lengths: FloatArray,
    goals: FloatArray,
    order: np.ndarray,
    gain: float,
    rows: FloatArray,
    counters: np.ndarray,
) -> int:
    """Return the way-point from which a straight edge to some goal makes the shortest path; -1 for none.

    Args:
        world: Box, metric and oracle.
        points: Way-points, shape (k, n).
        lengths: Arc length at each, shape (k,).
        goals: Other goals, shape (m, n).
        order: The goals that are tried, first to last; order[0] becomes the one that is met.
        gain: What has to be saved [length unit of the metric].
        rows: Room, shape (2, n).
        counters: See `native_edge.prefix`.
    """
    best, found, met = lengths[-1] - gain, -1, -1
    for k in range(points.shape[0] - 1):
        for place in range(order.size):
            goal = goals[order[place]]
            way = distance(points[k], goal, world.weights)
            if not (lengths[k] + way < best and way < math.inf):
                continue
            steps = steps_of(way, world.resolution)
            if edge_valid(world.address, world.memory, points[k], goal, steps, rows, counters, True):
                best, found, met = lengths[k] + way, k, order[place]
    if found >= 0:
        order[0] = met
    return found
