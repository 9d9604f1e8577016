"""What compiled planners that build graphs check edges with."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, types

from .native_edge import edge_valid, steps_of
from .vectors import FloatArray

STATES, CALLS, STOP = 0, 1, 2
"""The first places of a planner's counters; see `native_edge.edge_valid`."""

VECTOR, MATRIX, BLOCKS = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
INDICES, TABLE = types.int64[::1], types.int64[:, ::1]


class World(NamedTuple):
    """The box, the metric and the oracle of a problem.

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


WORLD = types.NamedTuple((types.int64, VECTOR, types.float64, VECTOR, VECTOR, VECTOR, types.float64), World)
"""Numba's type of a world."""


@njit(nogil=True, cache=True, error_model="numpy")
def distance(a: FloatArray, b: FloatArray, weights: FloatArray) -> float:
    """Return the distance of two states, shapes (n,)."""
    total = 0.0
    for i in range(a.size):
        difference = (b[i] - a[i]) * weights[i]
        total += difference * difference
    return math.sqrt(total)


@njit(nogil=True, cache=True, error_model="numpy")
def is_free(
    world: World, a: FloatArray, b: FloatArray, length: float, rows: FloatArray, counters: np.ndarray
) -> bool:
    """Return whether an edge of a length is valid; see `native_edge.edge_valid`."""
    steps = steps_of(length, world.resolution)
    return edge_valid(world.address, world.memory, a, b, steps, rows, counters)


@njit(nogil=True, cache=True, error_model="numpy")
def distance_to_nearest(state: FloatArray, goals: FloatArray, weights: FloatArray) -> float:
    """Return the distance of a state, shape (n,), from the nearest of some others, shape (k, n)."""
    least = math.inf
    for g in range(goals.shape[0]):
        least = min(least, distance(state, goals[g], weights))
    return least


@njit(nogil=True, cache=True, error_model="numpy")
def wanted_neighbours(n: int, size: int, most: int) -> int:
    """Return e (1 + 1/n) log(size + 1), rounded up, which is enough for asymptotic optimality.

    Source: S. Karaman and E. Frazzoli, Sampling-based algorithms for optimal motion planning, Int. J. of
    Robotics Research 30(7), 2011.
    """
    wanted = math.ceil(math.e * (1.0 + 1.0 / n) * math.log(size + 1.0))
    return min(max(wanted, 1), min(size, most))
