"""Memory layout of compiled collision checks: blocks of doubles with sections of constants and workspace.

A robot's block has workspace and exists once per thread; a scene's block is only read, and the robot's block
holds its address.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.collision.records import HEAD
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at

STATES_AT_ONCE = 64
"""Maximum number of configurations that are checked together."""
WIDEST = 16.0
"""Angle or distance [rad or m] beyond which single precision is not trusted: the configuration is a tie."""

ALIGNMENT = 8
"""Sections start at multiples of this number of doubles: 64 bytes, a vector register."""

(
    NUMBERS,
    TABLE_HEADS,
    TABLES,
    TABLE_CELLS,
    BODIES,
    FRAMES,
    GROUPS,
    PARTS,
    BALLS,
    OBJECTS,
    BOXES,
    NODES,
    ROOTS,
    ROOT_LISTS,
    CLOUDS,
    CLOUD_WORKSPACE,
    LINKS,
    LINK_PARTS,
    SIDES,
    RANGES,
    CORES,
    JOINTS,
    FULL,
    SOLIDS,
    SOLID_PLACES,
    SOLID_HALF,
    VERTEX_FIRST,
    VERTICES,
    VERTEX_SINGLES,
    PAIR_FIRST,
    PAIRS,
    GROUP_SOLIDS,
    FROZEN,
    FREE,
    EFFORT,
    PLACED_AT,
    PARTS_AT,
    COORDINATES,
    POSES,
    CENTERS,
    PLACED,
    CLASS_DOUBTS,
    GROUP_DOUBTS,
    DOUBTFUL,
    ORDER,
    RAMP,
    ROWS,
    STATUS,
    QUEUE,
    ROW_CLASSES,
    ROW_GROUPS,
    Q_FULL,
    JOINT_POSES,
    JOINT_AXES,
    SOLID_POSES,
    AXES,
    GRAVITY,
    LEVERS,
    ALLOWANCES,
    GAPS,
    GAP_STATES,
    PAIR_WORKSPACE,
    LOADS,
    EDGES,
    PLACING,
) = range(65)
"""Sections, in order; `prepared.py`, `body_tables.py` and `scene_block.py` of `collision/fast` describe them.

NUMBERS is a HEAD.

PLACED_AT counts for each body how often it was placed, and has the count at which the coarse balls of its
parts were; PARTS_AT has for each part the counts at which its balls, and its cores, were.

LEVERS has a row for each class of pairs, then for each group, of how far joints move these; ALLOWANCES what
each of them keeps besides the margins [m]."""
SECTIONS = 65
SIZE = 2 * SECTIONS
"""Index of the size of the block, after the starts and ends of its sections."""

EDGE_NUMBERS = 3
"""Size of an edge that the robot could tip over: factors of the floor's force along z, and of its moments
about x and y."""

BOX, CYLINDER, HULL, OTHER, CLOUD = 0, 1, 2, 3, 4
"""Kinds of cores.  A box may be flat: a segment is the core of a capsule, a point the core of a sphere."""


@compiled
def section(memory: Array, which: int) -> Array:
    """Return a section of a block, shape (s,), as a view of doubles, shape (k,)."""
    return memory[int(memory[2 * which]) : int(memory[2 * which + 1])]


@compiled
def section_single(memory: Array, which: int) -> NDArray[np.float32]:
    """Return a section of a block, shape (s,), as a view of single-precision floats, shape (2 k,)."""
    return memory[int(memory[2 * which]) : int(memory[2 * which + 1])].view(np.float32)


@compiled
def scene_of(memory: Array) -> Array:
    """Return the scene's block, shape (t,), to which a robot's block, shape (s,), refers."""
    head = head_of(memory)
    return floats_at(HEAD.scene(head), HEAD.scene_size(head))


@compiled(inline=True)
def address_of(memory: Array, which: int) -> int:
    """Return the address of a section of a block, shape (s,)."""
    return int(memory.ctypes.data) + 8 * int(memory[2 * which])


@compiled(inline=True)
def head_of(memory: Array) -> int:
    """Return the address of the HEAD of a block, shape (s,)."""
    return address_of(memory, NUMBERS)


@compiled
def section_bits(memory: Array, which: int) -> NDArray[np.int64]:
    """Return a section of a block, shape (s,), as a view of integers, shape (k,)."""
    return memory[int(memory[2 * which]) : int(memory[2 * which + 1])].view(np.int64)


def blank(sizes: dict[int, int]) -> Array:
    """Return a block of zeros, shape (s,), aligned to 64 bytes; sections without a size are empty.

    It starts with the start and end of each section, then its own size.
    """
    lengths = np.zeros(SECTIONS, np.int64)
    lengths[list(sizes)] = list(sizes.values())
    ends = np.cumsum((lengths + ALIGNMENT - 1) & -ALIGNMENT) + _round_up(SIZE + 1)
    block = aligned(int(ends[-1]))
    block[:] = 0.0
    block[2:SIZE:2] = ends[:-1]
    block[0] = _round_up(SIZE + 1)
    block[1:SIZE:2] = block[:SIZE:2] + lengths
    block[SIZE] = ends[-1]
    return block


def pack(sections: dict[int, Array]) -> Array:
    """Return a block, shape (s,), whose sections hold copies of arrays of any shape; see `blank`."""
    block = blank({which: values.size for which, values in sections.items()})
    for which, values in sections.items():
        section(block, which)[:] = values.ravel()
    return block


def shorten(memory: Array, which: int, size: int) -> int:
    """Set the size of a section of a block, shape (s,), to at most its size; return the previous size."""
    begin, end = int(memory[2 * which]), int(memory[2 * which + 1])
    memory[2 * which + 1] = begin + size
    return end - begin


def extended(block: Array, sections: dict[int, Array]) -> Array:
    """Return a copy of a block, shape (s,), with some sections replaced, by arrays of any shape."""
    place, added = block.size, []
    spans = block[: 2 * SECTIONS].copy()
    for which, values in sections.items():
        spans[2 * which : 2 * which + 2] = place, place + values.size
        added.append(np.concatenate([values.ravel(), np.zeros(_round_up(values.size) - values.size)]))
        place += added[-1].size
    longer = np.concatenate([block, *added])
    longer[: SIZE + 1] = *spans, place
    return longer


def aligned(size: int) -> Array:
    """Return an uninitialized array of doubles, shape (size,), aligned to 64 bytes."""
    memory = np.empty(size + ALIGNMENT)
    first = (-memory.ctypes.data // 8) % ALIGNMENT
    return memory[first : first + size]


def aligned_copy(block: Array) -> Array:
    """Return a copy of a block, shape (s,), aligned to 64 bytes."""
    copy = aligned(block.size)
    copy[:] = block
    return copy


def _round_up(size: int) -> int:
    """Return the next multiple of ALIGNMENT."""
    return -(-size // ALIGNMENT) * ALIGNMENT
