"""A validity function that is machine code."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pepper_kin.exceptions import InvalidValueError

from .vectors import BoolArray, FloatArray


def _no_memory() -> FloatArray:
    return np.zeros(1)


@dataclass(frozen=True, eq=False)
class CompiledValidity:
    """An oracle that compiled planners call by its address, without Python.

    At the address is a C function

        int64_t valid_prefix(const double *a, const double *b, int64_t steps, double *memory)

    which tests the states ``a + (b - a) j / steps`` for j = 1 .. steps (the last one is exactly b; a itself
    is not tested) and returns how many of them, counted from the first, are valid: `steps` if all are, and
    otherwise any number such that all those counted are valid, and 0 if the first is not.  It must not keep
    the addresses, and must give the same answer for the same arguments.  Several threads may call it at once,
    each with its own memory.

    The value is also a callable over a batch of states, like every other oracle (see `StateValidity`).

    Attributes:
        address: Address of the function.
        n: Number of coordinates of a state.
        new_memory: Returns fresh memory for one thread: a C-contiguous float64 array of one or more entries.
        keep_alive: What must live as long as the address is used (the library, the scene's tables); held here
            and not used otherwise.
    """

    address: int
    n: int
    new_memory: Callable[[], FloatArray] = field(default=_no_memory)
    keep_alive: object = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            InvalidValueError: The address is no address, or there is no coordinate.
        """
        object.__setattr__(self, "address", _at_least_one("address", self.address))
        object.__setattr__(self, "n", _at_least_one("n", self.n))
        if not callable(self.new_memory):
            raise InvalidValueError("new_memory", self.new_memory, "a callable that returns a float64 array")

    def fresh_memory(self) -> FloatArray:
        """Return new memory, checked.

        Raises:
            InvalidValueError: `new_memory` returned something else than a C-contiguous float64 vector.
        """
        memory = self.new_memory()
        if (
            not isinstance(memory, np.ndarray)
            or memory.dtype != np.float64
            or memory.ndim != 1
            or memory.size == 0
            or not (memory.flags.c_contiguous and memory.flags.writeable)
        ):
            raise InvalidValueError("memory", type(memory), "a writeable float64 array of shape (m,), m >= 1")
        return memory

    def __call__(self, states: FloatArray, /) -> BoolArray:
        """Return which states, shape (m, n), are valid; shape (m,).

        Raises:
            InvalidValueError: The states have another number of coordinates.
        """
        from .native_edge import check_states

        batch = np.array(states, dtype=np.float64, order="C")
        if batch.ndim != 2 or batch.shape[1] != self.n:
            raise InvalidValueError("states", f"shape {batch.shape}", f"shape (m, {self.n})")
        answers = np.empty(len(batch), dtype=np.bool_)
        check_states(self.address, self.fresh_memory(), batch, answers)
        return answers


def _at_least_one(quantity: str, value: int) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        number = 0
    if number < 1:
        raise InvalidValueError(quantity, value, "an integer of 1 or more")
    return number
