"""One block of doubles with all that compiled checking needs: sections of constants and of room."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pepper_kin.kernels.compiled_function import compiled

Array: TypeAlias = NDArray[np.float64]

ROOM = 64
"""Configurations that go through the stages together."""
WIDEST = 16.0
"""Beyond this angle or distance [rad or m] single precision is not trusted: such a configuration is a tie."""

ALIGNMENT = 8
"""Sections begin at multiples of this many doubles: 64 bytes, a vector register."""

(
    NUMBERS,
    TABLE_HEADS,
    TABLES,
    TABLE_CELLS,
    BODIES,
    FRAMES,
    GROUPS,
    BALLS,
    OBJECT_LISTS,
    OBJECTS,
    LINKS,
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
    PAIR_FIRST,
    PAIRS,
    GROUP_SOLIDS,
    GROUP_OBJECTS,
    FROZEN,
    FREE,
    EFFORT,
    FLAGS,
    COORDINATES,
    POSES,
    CENTERS,
    PLACED,
    CLASS_DOUBTS,
    GROUP_DOUBTS,
    DOUBTFUL,
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
) = range(48)
"""Sections, in order; `collision/fast/prepared.py` says what is in each."""
SECTIONS = 48

BOX, CYLINDER, HULL, OTHER = 0, 1, 2, 3
"""Kinds of cores.  A box may be flat: a segment is the core of a capsule, a point that of a sphere."""

(
    N,
    CLASS_COUNT,
    GROUP_COUNT,
    BODY_COUNT,
    LINK_COUNT,
    OBJECT_COUNT,
    SELF_MARGIN,
    MARGIN,
    GRAVITY_KERNEL,
    BLOCKED,
) = range(10)
"""Places in the section NUMBERS."""
NUMBERS_SIZE = 10


@compiled
def section(memory: Array, which: int) -> Array:
    """Return a section of the block as doubles."""
    return memory[int(memory[2 * which]) : int(memory[2 * which + 1])]


@compiled
def section_single(memory: Array, which: int) -> NDArray[np.float32]:
    """Return a section of the block as floats."""
    return memory[int(memory[2 * which]) : int(memory[2 * which + 1])].view(np.float32)


@compiled(inline=True)
def address_of(memory: Array, which: int) -> int:
    """Return the address of a section."""
    return int(memory.ctypes.data) + 8 * int(memory[2 * which])


@compiled
def section_bits(memory: Array, which: int) -> NDArray[np.int64]:
    """Return a section of the block as integers."""
    return memory[int(memory[2 * which]) : int(memory[2 * which + 1])].view(np.int64)


def pack(sections: dict[int, Array]) -> Array:
    """Return a block with these sections; the rest is empty.

    Its first numbers are the beginning and end of each section.
    """
    place = _round_up(2 * SECTIONS)
    spans = np.zeros(2 * SECTIONS)
    for which in range(SECTIONS):
        size = sections[which].size if which in sections else 0
        spans[2 * which : 2 * which + 2] = place, place + size
        place += _round_up(size)
    block = np.zeros(place)
    block[: 2 * SECTIONS] = spans
    for which, values in sections.items():
        first, last = int(spans[2 * which]), int(spans[2 * which + 1])
        block[first:last] = np.ravel(values)
    return block


def shorten(memory: Array, which: int, size: int) -> int:
    """Change the size of a section to no more than it was made with; returns the size that it had."""
    begin, end = int(memory[2 * which]), int(memory[2 * which + 1])
    memory[2 * which + 1] = begin + size
    return end - begin


def aligned_copy(block: Array) -> Array:
    """Return a copy whose first number is at a multiple of 64 bytes."""
    room = np.empty(block.size + ALIGNMENT)
    first = (-room.ctypes.data // 8) % ALIGNMENT
    copy = room[first : first + block.size]
    copy[:] = block
    return copy


def _round_up(size: int) -> int:
    return -(-size // ALIGNMENT) * ALIGNMENT
