"""The compiled check of many configurations: joint ranges, spheres, then exact cores for what is in doubt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.core.collision.broad_phase import WORDS, check_world
from pepper_kin.core.collision.gjk import CONTACT, FREE, TIE
from pepper_kin.core.collision.joint_ranges import violations
from pepper_kin.core.collision.layout import (
    BLOCKED,
    CENTER_KERNEL,
    CLASS_ACTIVE,
    CLASS_KERNELS,
    CLASSES,
    DOUBT_CLASSES,
    DOUBT_GROUPS,
    EFFORT,
    FROZEN,
    GRAVITY_KERNEL,
    GROUPS,
    LANES,
    LANES_IN,
    LANES_OUT,
    LANES_WORK,
    NEAR_KERNEL,
    NUMBERS,
    OBJECT_COUNT,
    QUEUE,
    QUEUE_LENGTH,
    ROOM,
    ROWS,
    SECTIONS,
    SELF_MARGIN,
    SINGLE_WORK,
    STATUS,
    TABLE_CELLS,
    TABLE_HEADS,
    TABLES,
    WIDEST,
    Array,
    N,
    section,
    section_bits,
    section_single,
)
from pepper_kin.core.collision.layout import (
    FREE as MOVING,
)
from pepper_kin.core.collision.narrow_phase import settle
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_kernel, floats_at

FIRST_ROOM = 2 * LANES
"""States of an edge that are checked before the rest: edges in collision mostly are so early."""

SIGNS = np.int64(-0x7FFFFFFF80000000)
"""The sign bits of two floats in a word."""

Places = NDArray[np.int64]


@compiled
def gather(memory: Array, queue: Places, first: int, last: int) -> None:
    """Write configurations of a queue into LANES_IN, side by side; the last is repeated to fill all lanes."""
    numbers, rows, lanes = section(memory, NUMBERS), section(memory, ROWS), section_single(memory, LANES_IN)
    n = int(numbers[N])
    for i in range(LANES):
        row = queue[min(first + i, last - 1)]
        q, column = rows[n * row : n * row + n], lanes[i:]
        for k in range(n):
            column[k * LANES] = q[k]
        column[n * LANES] = numbers[SELF_MARGIN]


@compiled
def _all_within(values: Array, widest: float) -> bool:
    """Whether all numbers are within [-widest, widest]; false where one is NaN."""
    beyond = 0
    for i in range(values.size):
        beyond |= not abs(values[i]) <= widest
    return beyond == 0


@compiled
def _start(memory: Array, count: int) -> int:
    """Settle what joint ranges settle; queue the rest.  Returns how many are queued."""
    numbers, rows, queue = section(memory, NUMBERS), section(memory, ROWS), section_bits(memory, QUEUE)
    status, heads = section_bits(memory, STATUS), section(memory, TABLE_HEADS)
    tables, cells = section(memory, TABLES), section(memory, TABLE_CELLS)
    classes, groups = section_bits(memory, DOUBT_CLASSES), section_bits(memory, DOUBT_GROUPS)
    n, kept = int(numbers[N]), 0
    violations(heads, tables, cells, rows, n, status[:count])
    for i in range(count):
        classes[i] = groups[i] = 0
        queue[kept] = i
        kept += 1 - status[i]
    if _all_within(rows[: n * count], WIDEST):
        return kept
    near = 0
    for k in range(kept):
        i = queue[k]
        if _all_within(rows[n * i : n * i + n], WIDEST):
            queue[near] = i
            near += 1
        else:
            status[i] = TIE
    return near


@compiled
def _sort(memory: Array, kept: int) -> None:
    """Compare the robot's parts coarsely; queue the configurations for each class of pairs that is near."""
    numbers, queues, active = (
        section(memory, NUMBERS),
        section_bits(memory, QUEUE),
        section(memory, CLASS_ACTIVE),
    )
    given, found = section_single(memory, LANES_IN), section_single(memory, LANES_OUT)
    lengths, work = section_bits(memory, QUEUE_LENGTH), section(memory, LANES_WORK)
    classes = int(numbers[CLASSES])
    signs = section_bits(memory, LANES_OUT)
    lengths[:] = 0
    if classes == 0:
        return
    for first in range(0, kept, LANES):
        gather(memory, queues, first, kept)
        call_kernel(int(numbers[NEAR_KERNEL]), given.ctypes.data, found.ctypes.data, work.ctypes.data)
        for c in range(classes):
            bound = found[c * LANES : (c + 1) * LANES]
            found_signs = 0
            for k in range(WORDS):
                found_signs |= signs[c * WORDS + k]
            if found_signs & SIGNS == 0 or active[c] == 0.0:
                continue
            length, queue = lengths[c], queues[ROOM * (c + 1) : ROOM * (c + 2)]
            for i in range(min(LANES, kept - first)):
                queue[length] = queues[first + i]
                length += bound[i] < 0
            lengths[c] = length


@compiled
def _check_self(memory: Array) -> None:
    """Compare the robot's spheres with its own cores, class by class, where queued."""
    numbers, status, queues = (
        section(memory, NUMBERS),
        section_bits(memory, STATUS),
        section_bits(memory, QUEUE),
    )
    kernels, lengths = section(memory, CLASS_KERNELS), section_bits(memory, QUEUE_LENGTH)
    given, found = section_single(memory, LANES_IN), section_single(memory, LANES_OUT)
    work, doubt = section(memory, LANES_WORK), section_bits(memory, DOUBT_CLASSES)
    for c in range(int(numbers[CLASSES])):
        queue = queues[ROOM * (c + 1) : ROOM * (c + 2)]
        length = 0
        for i in range(lengths[c]):
            queue[length] = queue[i]
            length += status[queue[i]] == FREE
        for first in range(0, length, LANES):
            gather(memory, queue, first, length)
            call_kernel(int(kernels[c]), given.ctypes.data, found.ctypes.data, work.ctypes.data)
            for i in range(min(LANES, length - first)):
                row = queue[first + i]
                if found[LANES + i] < 0:
                    status[row] = CONTACT
                elif found[i] < 0:
                    doubt[row] |= 1 << min(c, 61)


@compiled
def _check_scene(memory: Array, kept: int) -> None:
    """Compare the robot's spheres with the scene, for what touches nothing yet."""
    numbers, status, queue = (
        section(memory, NUMBERS),
        section_bits(memory, STATUS),
        section_bits(memory, QUEUE),
    )
    given, found = section_single(memory, LANES_IN), section_single(memory, LANES_OUT)
    work, doubt = section(memory, LANES_WORK), section_bits(memory, DOUBT_GROUPS)
    if numbers[OBJECT_COUNT] == 0 or numbers[GROUPS] == 0:
        return
    length = 0
    for i in range(kept):
        if status[queue[i]] == FREE:
            queue[length] = queue[i]
            length += 1
    contact, bits = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    for first in range(0, length, LANES):
        gather(memory, queue, first, length)
        call_kernel(int(numbers[CENTER_KERNEL]), given.ctypes.data, found.ctypes.data, work.ctypes.data)
        check_world(memory, contact, bits)
        for i in range(min(LANES, length - first)):
            row = queue[first + i]
            if contact[i]:
                status[row] = CONTACT
            doubt[row] = bits[i]


@compiled
def _held(memory: Array, row: int) -> bool:
    """Whether the joints can hold a configuration against gravity; true where that is not asked for."""
    numbers, effort = section(memory, NUMBERS), section(memory, EFFORT)
    if numbers[GRAVITY_KERNEL] == 0:
        return True
    n = int(numbers[N])
    q, torque = section(memory, ROWS)[n * row : n * row + n], section(memory, LANES_OUT)
    work = section(memory, SINGLE_WORK)
    call_kernel(int(numbers[GRAVITY_KERNEL]), q.ctypes.data, torque.ctypes.data, work.ctypes.data)
    held = True
    for i in range(n):
        held = held and abs(torque[i]) <= effort[i]
    return held


@compiled("int64(float64[::1], int64)")
def check_rows(memory: Array, count: int) -> int:
    """Write the verdicts on the first `count` configurations into STATUS; returns how many were in doubt."""
    kept = _start(memory, count)
    _sort(memory, kept)
    _check_self(memory)
    _check_scene(memory, kept)
    return int(settle(memory, count))


@compiled("int64(float64[::1], float64[:, ::1], uint8[::1], int64, int64)")
def check_many(memory: Array, q: Array, verdicts: NDArray[np.uint8], begin: int, end: int) -> int:
    """Write the verdicts on rows of q from `begin` to `end`; returns how many spheres left in doubt."""
    n, doubts = q.shape[1], 0
    rows, status = section(memory, ROWS), section_bits(memory, STATUS)
    for first in range(begin, end, ROOM):
        count = min(ROOM, end - first)
        for i in range(count):
            for k in range(n):
                rows[n * i + k] = q[first + i, k]
        doubts += check_rows(memory, count)
        for i in range(count):
            verdicts[first + i] = status[i]
    return doubts


@compiled
def count_valid(memory: Array, a: Array, b: Array, steps: int) -> int:
    """Return how many of the states a + (b - a) j / steps, j = 1 .. steps, come before the first invalid one.

    Args:
        memory: The block; its section FREE tells which joints a and b are, FROZEN where the others stand.
        a: Values of the free joints, shape (k,) [rad or m].
        b: The same at the end.
        steps: Number of states.
    """
    numbers, status = section(memory, NUMBERS), section_bits(memory, STATUS)
    rows, moving, frozen = section(memory, ROWS), section(memory, MOVING), section(memory, FROZEN)
    n, done, room = int(numbers[N]), 0, FIRST_ROOM
    if numbers[BLOCKED] > 0:
        return 0
    while done < steps:
        count = min(room, steps - done)
        for i in range(count):
            q = rows[n * i : n * i + n]
            q[:] = frozen
            j = done + i + 1
            for k in range(moving.size):
                way = b[k] - a[k]
                q[int(moving[k])] = b[k] if j == steps else a[k] + way * j / steps
        check_rows(memory, count)
        for i in range(count):
            if status[i] != FREE or not _held(memory, i):
                return done + i
        done += count
        room = ROOM
    return steps


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def valid_prefix(a: int, b: int, steps: int, memory: int) -> int:
    """Call `count_valid` for those who have addresses only."""
    spans = floats_at(memory, 2 * SECTIONS)
    whole = floats_at(memory, int(spans[2 * SECTIONS - 1]))
    count = int(spans[2 * MOVING + 1] - spans[2 * MOVING])
    return count_valid(whole, floats_at(a, count), floats_at(b, count), steps)
