"""Memory of compiled functions: numbers, and the addresses of arrays."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at, words_at
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

MEMORY_SIZE = 48
"""Most numbers of such a memory."""


def memory_of(numbers: list[float], arrays: list[np.ndarray]) -> tuple[Array, list[np.ndarray]]:
    """Return a memory that holds numbers, then address and size of each array, and what it points to.

    Addresses are below 2^53, and so are exact.

    Args:
        numbers: Whatever the function needs.
        arrays: Of float64 or int64, of any shape.

    Returns:
        The memory, shape (MEMORY_SIZE,), and the arrays, contiguous, which have to live as long as it.
    """
    memory, kept = np.zeros(MEMORY_SIZE), [np.ascontiguousarray(array) for array in arrays]
    memory[: len(numbers)] = numbers
    for place, array in enumerate(kept):
        set_array(memory, len(numbers) + 2 * place, array)
    return memory, kept


def set_array(memory: Array, place: int, array: np.ndarray) -> None:
    """Write address and size of an array to a memory.

    Args:
        memory: The memory, shape (MEMORY_SIZE,).
        place: Where the address goes; the size goes behind it.
        array: Of float64 or int64, contiguous, of any shape.
    """
    memory[place : place + 2] = array.ctypes.data, array.size


@compiled
def take(scratch: Floats1, used: Ints1, size: int) -> Floats1:
    """Return the next part of a workspace, and count it as used."""
    begin = used[0]
    used[0] = begin + size
    return scratch[begin : begin + size]


@compiled
def floats_of(memory: Floats1, place: int) -> Floats1:
    """Return the array of float64 whose address is at a place of a memory."""
    return floats_at(int(memory[place]), int(memory[place + 1]))


@compiled
def words_of(memory: Floats1, place: int) -> Ints1:
    """Return the array of int64 whose address is at a place of a memory."""
    return words_at(int(memory[place]), int(memory[place + 1]))


@compiled
def rows_of(memory: Floats1, place: int, columns: int) -> Floats2:
    """Return the array of float64 whose address is at a place of a memory, with so many columns."""
    values = floats_of(memory, place)
    return values.reshape((values.size // columns, columns))
