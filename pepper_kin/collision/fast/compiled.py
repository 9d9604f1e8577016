"""Validity of edges as a function at an address, for compiled planners."""

from __future__ import annotations

import ctypes
import threading
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import kernel
from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.fast.prepared import Prepared
from pepper_kin.collision.fast.solids import Array
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.ball_check import BODY_WORDS, CENTERED, GROUP_WORDS, LINK_WORDS, PLACED
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors

_SIGNATURE = ctypes.CFUNCTYPE(
    ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
)


@dataclass(frozen=True, eq=False)
class CompiledValidity:
    """Whether a straight edge is valid, for callers in machine code.

    At `address` is `int64 valid_steps(const double* a, const double* b, int64 steps, double* memory)`.  With
    a and b the values of the k free joints, it looks at `steps` states or a few more, evenly spaced from a,
    which is not among them, to b, which is, and returns `steps` if all are valid and 0 if one is not.
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
    _local: threading.local = field(default_factory=threading.local, repr=False)

    def new_memory(self) -> Array:
        """Return a block of memory for one thread, shape (memory_size,), at a multiple of 64 bytes."""
        return at.aligned_copy(self._block)

    def verdicts(self, q: Array) -> NDArray[np.uint8]:
        """Return for configurations in which only free joints differ: 0 free, 1 contact, 2 too near to tell.

        Args:
            q: Whole configurations, shape (m, n), contiguous [rad or m].
        """
        from pepper_kin.core.collision.check import check_many

        found = np.ones(len(q), np.uint8)
        if not at.section(self._block, at.NUMBERS)[at.BLOCKED]:
            if not hasattr(self._local, "memory"):
                self._local.memory = self.new_memory()
            check_many(self._local.memory, q, found, 0, len(q))
        return found

    def valid_steps(self, a: ArrayLike, b: ArrayLike, steps: int, memory: Array | None = None) -> int:
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
    resting_contact: bool,
    frozen: ArrayLike,
    free: ArrayLike,
    effort_limits: ArrayLike | None,
) -> CompiledValidity:
    """Return the validity of edges of some joints; see `FastChecker.compiled`."""
    from pepper_kin.core.collision.check import check_rows, place_frozen, valid_steps

    pepper = checker.pepper
    n = pepper.n
    q0 = as_joint_vectors(pepper, frozen, "frozen").reshape(n)
    places = _places(free, n)
    memory = prepared.new_memory()
    at.section(memory, at.FROZEN)[:] = q0
    at.section(memory, at.FREE)[: places.size] = places
    at.shorten(memory, at.FREE, places.size)
    heads = at.shorten(memory, at.TABLE_HEADS, 0)  # the ranges of joints are left to each state
    parts = _Parts(memory, prepared, (np.asarray(pepper.full_map) != 0.0)[:, places].any(axis=1))
    parts.keep(moving=False)
    at.section(memory, at.NUMBERS)[at.BLOCKED] = resting_contact or _rests_in_contact(check_rows, memory, q0)
    parts.keep(moving=True)
    at.shorten(memory, at.TABLE_HEADS, heads)
    place_frozen(memory)
    parts.fix()
    kept: tuple[Any, ...] = (valid_steps, prepared.scene)
    if effort_limits is not None:
        limits = np.asarray(effort_limits, dtype=float)
        if limits.shape != (n,) or np.isnan(limits).any():
            raise InvalidValueError("effort_limits", repr(limits)[:80], f"{n} numbers, one per joint")
        gravity = kernel(pepper, "gravity_torque")
        at.section(memory, at.NUMBERS)[at.GRAVITY_KERNEL] = gravity.single_address
        at.section(memory, at.EFFORT)[:] = limits
        kept = (*kept, gravity)
    memory.setflags(write=False)
    return CompiledValidity(int(cast("Any", valid_steps).address), memory.size, places, memory, kept)


class _Parts:
    """What a block compares, which may be limited to what moves, or to what does not.

    Args:
        memory: The block, changed.
        prepared: What it was made from.
        moving: Which coordinates of the Pinocchio model move.
    """

    def __init__(self, memory: Array, prepared: Prepared, moving: NDArray[np.bool_]) -> None:
        self._memory = memory
        carried, solids = prepared.carried & moving, prepared.bodies_of_solids
        self._bodies = at.section_bits(memory, at.BODIES).reshape(-1, BODY_WORDS)
        self._groups = at.section_bits(memory, at.GROUPS).reshape(-1, GROUP_WORDS)
        self._links = at.section_bits(memory, at.LINKS).reshape(-1, LINK_WORDS)
        self._pairs = at.section(memory, at.PAIRS).reshape(-1, 2)
        self._first = at.section(memory, at.PAIR_FIRST)
        self._all = self._links.copy(), self._groups[:, 4].copy(), self._pairs.copy(), self._first.copy()
        self._moved: NDArray[np.bool_] = np.asarray(carried.any(axis=1))
        ends = self._links[:, [0, 2]].T, solids[self._pairs.astype(np.int64)].T
        self._links_move, self._pairs_move = (
            np.asarray((carried[a] ^ carried[b]).any(axis=1)) for a, b in ends
        )

    def keep(self, *, moving: bool) -> None:
        """Compare only pairs that move against one another, or only those that do not."""
        links, checked, pairs, first = self._all
        kept = links[self._links_move == moving]
        self._links[: len(kept)] = kept
        at.section(self._memory, at.NUMBERS)[at.LINK_COUNT] = len(kept)
        self._groups[:, 4] = np.where(self._moved[self._groups[:, 0]] == moving, checked, 0)
        chosen = self._pairs_move == moving
        self._pairs[: int(chosen.sum())] = pairs[chosen]
        self._first[:] = np.concatenate([[0], np.cumsum(chosen)])[first.astype(np.int64)]

    def fix(self) -> None:
        """Leave all bodies that do not move where they have been placed."""
        self._bodies[:, 3] = self._moved
        at.section_bits(self._memory, at.FLAGS)[:] = CENTERED | PLACED


def _rests_in_contact(check_rows: Any, memory: Array, q: Array) -> bool:
    """Return whether what the free joints do not move touches."""
    return bool(check_rows(memory, q, 1) >= 0 and at.section_bits(memory, at.STATUS)[0] != 0)


def _places(free: ArrayLike, n: int) -> NDArray[np.int64]:
    places = np.asarray(free)
    fine = places.ndim == 1 and places.dtype.kind in "iu" and len(set(places.tolist())) == places.size
    if not fine or (places.size and not (places.min() >= 0 and places.max() < n)):
        raise InvalidValueError("free", repr(free)[:80], f"different places of joints, 0 to {n - 1}")
    result = places.astype(np.int64)
    result.setflags(write=False)
    return result
