"""Validity of edges as a function at an address, for compiled planners."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import kernel
from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.fast.prepared import Prepared
from pepper_kin.collision.fast.solids import Array
from pepper_kin.core.collision import layout as at
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors

_SIGNATURE = ctypes.CFUNCTYPE(
    ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
)


@dataclass(frozen=True, eq=False)
class CompiledValidity:
    """How far a straight edge is valid, for callers in machine code.

    At `address` is `int64 valid_prefix(const double* a, const double* b, int64 steps, double* memory)`.  With
    a and b the values of the k free joints, it looks at the states a + (b - a) j / steps, j = 1 .. steps (the
    last is b to the bit) and returns how many come before the first that is not valid: `steps` if all are.
    `memory` is a block of `memory_size` doubles from `new_memory`, one for each thread; the function needs
    neither the interpreter nor its lock.  A state that is too near to contact for certainty (3e-6 m) is not
    valid, and a mesh that is not convex counts as its convex hull.

    Attributes:
        address: Address of the function, valid while this object lives.
        memory_size: Doubles in a block of memory.
        free: Places of the free joints, shape (k,).
    """

    address: int
    memory_size: int
    free: NDArray[np.int64]
    _block: Array = field(repr=False)
    _kept: tuple[Any, ...] = field(repr=False)

    def new_memory(self) -> Array:
        """Return a block of memory for one thread, shape (memory_size,), at a multiple of 64 bytes."""
        return at.aligned_copy(self._block)

    def valid_prefix(self, a: ArrayLike, b: ArrayLike, steps: int, memory: Array | None = None) -> int:
        """Call the function from Python.

        Args:
            a: Values of the free joints, shape (k,) [rad or m].
            b: The same at the end of the edge.
            steps: Number of states, at least 1.
            memory: A block; None for a new one.

        Raises:
            InvalidValueError: for vectors of wrong length, NaN, or fewer than 1 step.
        """
        if steps < 1:
            raise InvalidValueError("steps", steps, "at least 1")
        k = (self.free.size,)
        start, stop = (np.ascontiguousarray(as_finite(x, name, k)) for x, name in ((a, "a"), (b, "b")))
        block = self.new_memory() if memory is None else memory
        pointers = [x.ctypes.data for x in (start, stop, block)]
        return int(_SIGNATURE(self.address)(pointers[0], pointers[1], steps, pointers[2]))


def compile_validity(
    checker: CollisionChecker,
    prepared: Prepared,
    block: Array,
    resting_contact: bool,
    frozen: ArrayLike,
    free: ArrayLike,
    effort_limits: ArrayLike | None,
) -> CompiledValidity:
    """Return the validity of edges of some joints; see `FastChecker.compiled`.  `block` is not changed."""
    from pepper_kin.core.collision.check import check_rows, valid_prefix

    pepper, structure = checker.pepper, prepared.structure
    n, classes = pepper.n, len(structure.classes)
    q0 = as_joint_vectors(pepper, frozen, "frozen").reshape(n)
    places = _places(free, n)
    moves = np.asarray(prepared.moved_by[:, places].any(axis=1))
    compared = structure.compared.T
    memory = at.aligned_copy(block)
    at.section(memory, at.FROZEN)[:] = q0
    at.section(memory, at.FREE)[: places.size] = places
    at.shorten(memory, at.FREE, places.size)

    def compare(which: NDArray[np.bool_]) -> None:
        at.section(memory, at.CLASS_ACTIVE)[:] = which[:classes]
        at.section(memory, at.GROUP_OBJECTS)[:] = (compared & which[classes:]).ravel()

    compare(~moves)
    heads = at.shorten(memory, at.TABLE_HEADS, 0)  # the ranges of joints are left to each state
    at.section(memory, at.ROWS)[:n] = q0
    numbers = at.section(memory, at.NUMBERS)
    numbers[at.BLOCKED] = float(resting_contact or _rests_in_contact(check_rows, memory))
    at.shorten(memory, at.TABLE_HEADS, heads)
    compare(moves)
    kept: tuple[Any, ...] = (*prepared.kernels, valid_prefix)
    if effort_limits is not None:
        limits = np.asarray(effort_limits, dtype=float)
        if limits.shape != (n,) or np.isnan(limits).any():
            raise InvalidValueError("effort_limits", repr(limits)[:80], f"{n} numbers, one per joint")
        gravity = kernel(pepper, "gravity_torque")
        numbers[at.GRAVITY_KERNEL] = gravity.single_address
        at.section(memory, at.EFFORT)[:] = limits
        kept = (*kept, gravity)
    memory.setflags(write=False)
    return CompiledValidity(int(cast("Any", valid_prefix).address), memory.size, places, memory, kept)


def _rests_in_contact(check_rows: Any, memory: Array) -> bool:
    """Return whether what the free joints do not move touches."""
    return bool(check_rows(memory, 1) >= 0 and at.section_bits(memory, at.STATUS)[0] != 0)


def _places(free: ArrayLike, n: int) -> NDArray[np.int64]:
    places = np.asarray(free)
    fine = places.ndim == 1 and places.dtype.kind in "iu" and len(set(places.tolist())) == places.size
    if not fine or (places.size and not (places.min() >= 0 and places.max() < n)):
        raise InvalidValueError("free", repr(free)[:80], f"different places of joints, 0 to {n - 1}")
    result = places.astype(np.int64)
    result.setflags(write=False)
    return result
