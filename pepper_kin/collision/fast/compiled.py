"""Validity of edges as a function that compiled planners call by address."""

from __future__ import annotations

import ctypes
import threading
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.batch import kernel
from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.fast.placing import NUMBERS, SHARE, placing_kernel
from pepper_kin.collision.fast.prepared import Limited, Prepared
from pepper_kin.collision.fast.resting import resting_contact
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.check import begin_motion, check_many, check_rows, valid_steps
from pepper_kin.core.collision.gjk import FREE, TIE
from pepper_kin.core.collision.layout import EDGE_NUMBERS
from pepper_kin.core.collision.records import GROUP, HEAD, LINK
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels import Kernel
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors

MOST_LIMITED = 32
"""Maximum number of choices of free joints for which a robot's blocks are cached."""
_SIGNATURE = ctypes.CFUNCTYPE(
    ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
)


@dataclass(frozen=True, eq=False)
class StaticLoads:
    """Static loads of a posture on the joints and the floor, for compiled checks of edges.

    Attributes:
        kernel: Kernel from a configuration and the masses, one vector, to the holding torques, shape (n,),
            and, if there are edges, the floor's force along z and its moments about x and y.
        masses: Masses of the payload [kg], shape (m,).
        edges: Factors of the floor's force and moments for each edge that the robot could tip over; no sum of
            the products may be negative, shape (k, 3).
    """

    kernel: Kernel
    masses: Array = field(default_factory=lambda: np.empty(0))
    edges: Array = field(default_factory=lambda: np.empty((0, EDGE_NUMBERS)))

    @cached_property
    def kind(self) -> tuple[int, int, int]:
        """Kernel and lengths, which loads must have in common to share blocks."""
        return self.kernel.block_address, self.masses.size, len(self.edges)

    def sections(self, effort_limits: Array) -> dict[int, Array]:
        """Return the sections of a block that hold these loads, and effort limits, shape (n,)."""
        scratch = np.zeros((effort_limits.size + EDGE_NUMBERS) * self.kernel.lanes + self.kernel.work_size)
        return {at.EFFORT: effort_limits, at.LOADS: self.masses, at.EDGES: self.edges, at.GRAVITY: scratch}


@dataclass(frozen=True, eq=False)
class CompiledValidity:
    """Check of the validity of straight edges, for callers in machine code.

    At `address` is `int64 valid_steps(const double* a, const double* b, int64 steps, double* memory)`.  With
    a and b the values of the k free joints, it checks `steps` states or a few more, evenly spaced from a,
    which is excluded, to b, which is included, and returns `steps` if all are valid and 0 if one is not.
    `memory` is a block of `memory_size` doubles from `new_memory`, one for each thread; the function needs
    neither the interpreter nor its lock.  A state that is too near to contact to decide (3e-6 m) is not
    valid, and a nonconvex mesh counts as its convex hull.

    Attributes:
        address: Address of the function, valid while this object lives.
        free: Indices of the free joints, shape (k,).
        frozen: Positions of the other joints, as a complete configuration, shape (n,).
        effort: Maximum effort of each joint while holding still, shape (n,) [N m or N].
        margins: Margins to the scene and between two parts of the robot [m].
        loads: Loads to hold and to balance; None if they are not checked.
    """

    address: int
    free: NDArray[np.int64]
    frozen: Array
    effort: Array
    margins: tuple[float, float]
    loads: StaticLoads | None
    _limited: Limited = field(repr=False)
    _prepared: Prepared = field(repr=False)
    _exact: CollisionChecker | None = field(repr=False)
    _local: threading.local = field(default_factory=threading.local, repr=False)

    @property
    def memory_size(self) -> int:
        """Number of doubles in a block of memory."""
        return self._whole().size

    def new_memory(self) -> Array:
        """Return a block of memory for one thread, shape (memory_size,), aligned to 64 bytes."""
        memory = at.aligned_copy(self._whole())
        self._begin(memory)
        return self._named(memory)

    def at(self, margin: float, self_margin: float) -> CompiledValidity:
        """Return the validity at other margins, to the scene and between two parts of the robot [m]."""
        made = object.__new__(CompiledValidity)
        made.__dict__.update(self.__dict__, margins=(margin, self_margin))
        made.__dict__.pop("blocked", None)
        return made

    @cached_property
    def blocked(self) -> bool:
        """Whether a body that the free joints do not move is nearer than the margins.

        Where machine code leaves a TIE, coal decides on all of `frozen`.
        """
        if resting_contact(self._prepared, self.margins[0]):
            return True
        still = self._prepared.named(self.blocks()[0], self.margins)
        check_rows(still, self.frozen, 1)
        verdict = int(at.section_bits(still, at.STATUS)[0])
        if verdict == TIE and self._exact is not None:
            return bool(self._exact.with_margins(*self.margins).in_collision(self.frozen))
        return verdict != FREE

    def verdicts(self, q: Array) -> NDArray[np.uint8]:
        """Return 0 free, 1 contact, 2 undecided for configurations in which only free joints differ.

        Args:
            q: Complete configurations, shape (m, n), contiguous [rad or m].
        """
        found = np.ones(len(q), np.uint8)
        if not self.blocked:
            check_many(self._named(self.blocks()[1]), q, found, 0, len(q))
        return found

    def memory(self) -> Array:
        """Return the block of this thread, set to these margins; other margins overwrite it."""
        local = self._local
        try:
            return self._named(local.memory)
        except AttributeError:
            local.memory = self.new_memory()
        return np.asarray(local.memory)

    def blocks(self) -> tuple[Array, Array]:
        """Return this thread's blocks of bodies that stand still and of bodies that move, at any margins.

        All motions of the same joints share them, so that nothing is copied: they are valid for this motion
        until another one is requested.  They are for machine code that does not call Python.
        """
        local, kind = self._limited.local, None if self.loads is None else self.loads.kind
        try:
            ready: bool = local.kind == kind
        except AttributeError:
            ready = False
        if not ready:
            local.blocks = at.aligned_copy(self._limited.still), at.aligned_copy(self._whole())
            local.kind, local.motion = kind, None
        blocks: tuple[Array, Array] = local.blocks
        if local.motion is not self._local:
            self._prepared.named(blocks[0], self.margins)
            self._begin(blocks[1])
            local.motion = self._local
        return blocks

    def _whole(self) -> Array:
        """Return a block with sections for the loads."""
        moving, held = self._limited.moving, self._limited.held
        if self.loads is None:
            return moving
        kind = self.loads.kind
        if kind not in held:
            held[kind] = at.extended(moving, self.loads.sections(self.effort))
        return held[kind]

    def _begin(self, memory: Array) -> None:
        """Prepare a block, shape (memory_size,), for this motion."""
        self._prepared.named(memory, self.margins)
        gravity, lanes = 0, 1
        if self.loads is not None:
            loads, lanes = self.loads.kernel, self.loads.kernel.lanes
            n, scratch = self.frozen.size, at.section(memory, at.GRAVITY).size
            gravity = loads.address_of(
                "block",
                inputs=n + self.loads.masses.size,
                outputs=n + EDGE_NUMBERS,
                work=scratch - (n + EDGE_NUMBERS) * lanes,
            )
            if self.loads.masses.size:
                at.section(memory, at.LOADS)[:] = self.loads.masses
            if self.loads.edges.size:
                at.section(memory, at.EDGES)[:] = self.loads.edges.ravel()
        begin_motion(memory, self.frozen, self.effort, gravity, lanes, self._limited.moves)

    def _named(self, memory: Array) -> Array:
        """Write the scene, margins and `blocked` into a block, shape (memory_size,); return it."""
        HEAD.set_blocked(at.head_of(memory), self.blocked)
        return self._prepared.named(memory, self.margins)

    def valid_steps(self, a: ArrayLike, b: ArrayLike, steps: int, memory: Array | None = None) -> int:
        """Call the function from Python.

        Args:
            a: Values of the free joints, shape (k,) [rad or m].
            b: Values of the free joints at the end of the edge, shape (k,) [rad or m].
            steps: Number of states, at least 1.
            memory: A block of memory; None for a new one.

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
    pepper: PepperModel,
    prepared: Prepared,
    frozen: ArrayLike,
    free: ArrayLike,
    effort_limits: ArrayLike | None,
    loads: StaticLoads | None,
    exact: CollisionChecker,
) -> CompiledValidity:
    """Return the validity of edges of some joints; see `FastChecker.compiled`.

    Args:
        pepper: The robot.
        prepared: Data of compiled checks.
        frozen: Complete configuration [rad or m], shape (n,).
        free: Indices of the joints that move, shape (k,).
        effort_limits: Maximum effort of each joint while holding still [N m or N], shape (n,); None for none.
        loads: Payload, and edges that the robot must not tip over; None for the robot's own weight.
        exact: Coal's checker of the same robot and scene.
    """
    n = pepper.n
    q0 = np.array(as_joint_vectors(pepper, frozen, "frozen").reshape(n))
    places = _places(free, n)
    limits, asked = np.full(n, np.inf), None
    if effort_limits is not None:
        limits = np.array(effort_limits, dtype=float)
        if limits.shape != (n,) or np.isnan(limits).any():
            raise InvalidValueError("effort_limits", repr(limits), f"{n} numbers, one per joint")
        asked = StaticLoads(kernel(pepper, "gravity_torque")) if loads is None else loads
    return trusted_validity(pepper, prepared, q0, places, limits, asked, exact)


def trusted_validity(
    pepper: PepperModel,
    prepared: Prepared,
    frozen: Array,
    free: NDArray[np.int64],
    effort: Array,
    loads: StaticLoads | None,
    exact: CollisionChecker,
) -> CompiledValidity:
    """Return the result of `compile_validity` for valid arguments that do not change.

    Args:
        pepper: The robot.
        prepared: Data of compiled checks.
        frozen: Complete configuration [rad or m], shape (n,).
        free: Indices of the joints that move, shape (k,).
        effort: Maximum effort of each joint while holding still [N m or N], shape (n,).
        loads: Loads to hold and to balance; None if they are not checked.
        exact: Coal's checker of the same robot and scene.
    """
    address, limited = int(cast("Any", valid_steps).address), _limited(pepper, prepared, free)
    # If all joints move, no body stands still, and a validity cached for a robot must not refer to the robot.
    asked = exact if free.size < pepper.n else None
    return CompiledValidity(address, free, frozen, effort, prepared.margins, loads, limited, prepared, asked)


def _limited(pepper: PepperModel, prepared: Prepared, places: NDArray[np.int64]) -> Limited:
    """Return the blocks for motions of the joints with given indices, shape (k,), cached."""
    key = places.tobytes()
    found = prepared.limited.get(key)
    if found is None:
        block = prepared.block.copy()
        at.section(block, at.FREE)[: places.size] = places
        at.shorten(block, at.FREE, places.size)
        moving = (np.asarray(pepper.full_map) != 0.0)[:, places].any(axis=1)
        carried = prepared.carried & moving
        still = _comparing(block, prepared, carried, moving=False)
        at.shorten(still, at.TABLE_HEADS, 0)  # joint ranges are checked with each state
        moves = carried.any(axis=1).astype(np.int64)
        compared, kernel = _comparing(block, prepared, carried, moving=True), None
        if moves[:-1].mean() >= SHARE:
            kernel = placing_kernel(pepper)
            compared = _placed_by(kernel, compared, pepper.n, moves.size - 1)
        found = Limited(still, compared, moves, kernel)
        if len(prepared.limited) >= MOST_LIMITED:
            prepared.limited.clear()
        prepared.limited[key] = found
    return found


def _placed_by(kernel: Kernel, block: Array, n: int, bodies: int) -> Array:
    """Return a copy of a block, shape (s,), of n joints, in which a kernel places the bodies."""
    longer = at.extended(block, {at.PLACING: np.zeros(-(-kernel.work_size // 2))})
    address = kernel.address_of("block", inputs=n, outputs=NUMBERS * bodies, work=kernel.work_size)
    HEAD.set_placing_kernel(at.head_of(longer), address)
    return longer


def _comparing(block: Array, prepared: Prepared, carried: NDArray[np.bool_], *, moving: bool) -> Array:
    """Return a block that compares only pairs that move against one another, or only those that do not.

    Args:
        block: The robot's block, shape (s,).
        prepared: Data of compiled checks.
        carried: Whether a moving coordinate carries a body, the world last, shape (bodies, nv).
        moving: Whether the moving pairs are kept, or the others.
    """
    kept = block.copy()
    links = at.section_bits(block, at.LINKS).reshape(-1, LINK.width)
    pairs, first = at.section(block, at.PAIRS).reshape(-1, 2), at.section(block, at.PAIR_FIRST)
    groups = at.section_bits(kept, at.GROUPS).reshape(-1, GROUP.width)
    ends = (
        links[:, [LINK.columns.covered, LINK.columns.exact]].T,
        prepared.bodies_of_solids[pairs.astype(np.int64)].T,
    )
    chosen = [(carried[a] ^ carried[b]).any(axis=1) == moving for a, b in ends]
    count = int(chosen[0].sum())
    at.section_bits(kept, at.LINKS).reshape(-1, LINK.width)[:count] = links[chosen[0]]
    HEAD.set_links(at.head_of(kept), count)
    moves: NDArray[np.bool_] = np.asarray(carried.any(axis=1))
    groups[moves[groups[:, GROUP.columns.body]] != moving, GROUP.columns.checked] = 0
    at.section(kept, at.PAIRS).reshape(-1, 2)[: int(chosen[1].sum())] = pairs[chosen[1]]
    at.section(kept, at.PAIR_FIRST)[:] = np.concatenate([[0], np.cumsum(chosen[1])])[first.astype(np.int64)]
    return kept


def _places(free: ArrayLike, n: int) -> NDArray[np.int64]:
    """Return indices of joints, shape (k,), as integers, after a check that they differ and exist."""
    places = np.asarray(free)
    fine = places.ndim == 1 and places.dtype.kind in "iu" and len(set(places.tolist())) == places.size
    if not fine or (places.size and not (places.min() >= 0 and places.max() < n)):
        raise InvalidValueError("free", repr(free), f"different places of joints, 0 to {n - 1}")
    result = places.astype(np.int64)
    result.setflags(write=False)
    return result
