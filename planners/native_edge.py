"""Compiled checks of states and edges through the address of a validity function."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .native import call_valid_prefix
from .vectors import FloatArray

_FIRST_STEPS = 8  # of an edge that is checked coarsely first


@njit(nogil=True, cache=True, error_model="numpy")
def steps_of(length: float, resolution: float) -> int:
    """Return the number of steps of an edge, none longer than the resolution; at least one."""
    return max(1, math.ceil(length / resolution))


@njit(nogil=True, cache=True, error_model="numpy")
def prefix(
    address: int, memory: FloatArray, a: FloatArray, b: FloatArray, steps: int, counters: np.ndarray
) -> int:
    """Return how many of the states a + (b - a) j / steps, j = 1 .. steps, are valid from the first on.

    Args:
        address: Of the validity function, see `CompiledValidity`.
        memory: Its memory.
        a: Start of the edge, shape (n,).
        b: End of the edge, shape (n,).
        steps: Number of states.
        counters: Its first entry counts states, its second one calls; the third one, of planners that serve
            Python oracles too, is a sign to stop (see `Callback`).
    """
    count = call_valid_prefix(address, a.ctypes.data, b.ctypes.data, steps, memory.ctypes.data)
    counters[0] += min(count + 1, steps)
    counters[1] += 1
    return count


@njit(nogil=True, cache=True, error_model="numpy")
def edge_valid(
    address: int,
    memory: FloatArray,
    a: FloatArray,
    b: FloatArray,
    steps: int,
    rows: FloatArray,
    counters: np.ndarray,
    with_start: bool = False,
) -> bool:
    """Return whether all states of an edge but its start are valid: coarsely first, then halfway between.

    The number of steps is rounded up to a multiple of a power of two; no state is checked twice.

    Args:
        address: Of the validity function.
        memory: Its memory.
        a: Start of the edge, shape (n,), taken to be valid unless `with_start`.
        b: End of the edge, shape (n,).
        steps: Least number of states.
        rows: Room, shape (2, n); a and b must not lie in it.
        counters: See `prefix`.
        with_start: Whether the start is checked too, up to its rounding, together with the first states.
    """
    doublings = 0
    while (steps >> doublings) > _FIRST_STEPS:
        doublings += 1
    count = (steps + (1 << doublings) - 1) >> doublings
    if with_start:
        for i in range(a.size):
            rows[0, i] = a[i] - (b[i] - a[i]) / count
        if prefix(address, memory, rows[0], b, count + 1, counters) <= count:
            return False
    elif prefix(address, memory, a, b, count, counters) < count:
        return False
    for _ in range(doublings):
        back = 0.5 / count
        for i in range(a.size):
            shift = back * (b[i] - a[i])
            rows[0, i] = a[i] - shift
            rows[1, i] = b[i] - shift
        if prefix(address, memory, rows[0], rows[1], count, counters) < count:
            return False
        count *= 2
    return True


@njit("void(int64, float64[::1], float64[:, ::1], boolean[::1])", nogil=True, cache=True, error_model="numpy")
def check_states(address: int, memory: FloatArray, states: FloatArray, answers: np.ndarray) -> None:
    """Write which states, shape (m, n), are valid into `answers`, shape (m,)."""
    for j in range(states.shape[0]):
        place = states[j].ctypes.data
        answers[j] = call_valid_prefix(address, place, place, 1, memory.ctypes.data) == 1
