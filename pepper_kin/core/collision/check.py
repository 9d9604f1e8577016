"""Compiled collision check of configurations: joint ranges, spheres, then exact cores for undecided pairs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.ball_check import (
    ALL,
    Tables,
    check_block,
    place_all,
    tables_of,
)
from pepper_kin.core.collision.gjk import CONTACT, FREE, TIE
from pepper_kin.core.collision.joint_ranges import edge_keeps_ranges, violations
from pepper_kin.core.collision.layout import (
    EDGE_NUMBERS,
    STATES_AT_ONCE,
    WIDEST,
    section,
    section_bits,
    section_single,
)
from pepper_kin.core.collision.narrow_phase import decide_pairs
from pepper_kin.core.collision.records import BODY, HEAD
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_kernel, floats_at, words_at
from pepper_kin.kernels.lanes import (
    LANES,
    double_at,
    load_lanes,
    store_lanes,
    store_single,
    word_at,
)
from pepper_kin.kernels.records import DOUBLES
from pepper_kin.kernels.signatures import Ints1

MOST_BITS = 61
"""Bits for pair classes and for groups; all indices from this one on share a bit."""


@compiled
def _all_within(values: Array, widest: float) -> bool:
    """Return whether all numbers, shape (k,), are within [-widest, widest]; False if one is NaN."""
    beyond = 0
    for i in range(values.size):
        beyond |= not abs(values[i]) <= widest
    return beyond == 0


@compiled
def _start(memory: Array, rows: Array, count: int) -> int:
    """Write the verdicts that joint ranges decide, and queue the other configurations; return their number.

    The configurations have shape (count n,) [rad or m].  One with a value beyond WIDEST is a TIE.
    """
    head, queue = at.head_of(memory), section_bits(memory, at.QUEUE)
    status, heads = section_bits(memory, at.STATUS), section(memory, at.TABLE_HEADS)
    tables, cells = section(memory, at.TABLES), section(memory, at.TABLE_CELLS)
    classes, groups = section_bits(memory, at.ROW_CLASSES), section_bits(memory, at.ROW_GROUPS)
    n, kept = HEAD.joints(head), 0
    violations(heads, tables, cells, HEAD.range_margin(head), rows, n, status[:count])
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
def _take_doubts(memory: Array, t: Tables, first: int, count: int, contact: int) -> int:
    """Note the pair classes and groups that the last block leaves in doubt; return the lanes in doubt.

    Args:
        memory: The block, shape (s,).
        t: The block's tables.
        first: Index in QUEUE of the configuration in the first lane.
        count: Number of configurations.
        contact: Lanes in contact, for which no doubt is noted.
    """
    doubts = 0
    if word_at(t.doubtful) == 0:
        return 0
    queue = section_bits(memory, at.QUEUE)
    classes, groups = section_bits(memory, at.ROW_CLASSES), section_bits(memory, at.ROW_GROUPS)
    for g in range(t.group_count):
        found = word_at(t.group_doubts, g) & ~contact
        doubts |= found
        for i in range(count if found != 0 else 0):
            groups[queue[first + i]] |= ((found >> i) & 1) << min(g, MOST_BITS)
    for c in range(t.class_count):
        found = word_at(t.class_doubts, c) & ~contact
        doubts |= found
        for i in range(count if found != 0 else 0):
            classes[queue[first + i]] |= ((found >> i) & 1) << min(c, MOST_BITS)
    return doubts


@compiled(inline=True, lean=True)
def _gather(places: int, rows: int, n: int, queue: int, count: int) -> None:
    """Write queued configurations lane by lane; the last one is repeated to fill all lanes."""
    for i in range(LANES):
        row = DOUBLES.at(rows, n * word_at(queue, min(i, count - 1)))
        for k in range(n):
            store_single(places, double_at(row, k), LANES * k + i)


@compiled("int64(float64[::1], float64[::1], int64)")
def check_rows(memory: Array, rows: Array, count: int) -> int:
    """Write the verdicts on configurations into STATUS; return the number in doubt after the spheres.

    Args:
        memory: The block, shape (s,).
        rows: Configurations, one after the other, shape (count n,) [rad or m].
        count: Number of configurations, STATES_AT_ONCE at most.
    """
    kept, t, doubts = _start(memory, rows, count), tables_of(memory), 0
    n, status = HEAD.joints(at.head_of(memory)), section_bits(memory, at.STATUS)
    queue, places = section_bits(memory, at.QUEUE), at.address_of(memory, at.COORDINATES)
    for first in range(0, kept, LANES):
        filled = min(LANES, kept - first)
        _gather(places, rows.ctypes.data, n, queue.ctypes.data + 8 * first, filled)
        contact = check_block(t, False)
        if contact != ALL:
            doubts |= _take_doubts(memory, t, first, filled, contact)
        for i in range(filled):
            status[queue[first + i]] = CONTACT if (contact >> i) & 1 else FREE
    if doubts == 0:
        return 0
    return int(decide_pairs(memory, rows, count, False))


@compiled("int64(float64[::1], float64[:, ::1], uint8[::1], int64, int64)")
def check_many(memory: Array, q: Array, verdicts: NDArray[np.uint8], begin: int, end: int) -> int:
    """Write the verdicts on rows of q; return how many of them the spheres leave in doubt.

    Args:
        memory: The block, shape (s,).
        q: Configurations, shape (m, n) [rad or m].
        verdicts: Output: FREE, CONTACT or TIE of each row, shape (m,).
        begin: Index of the first row.
        end: Index after the last row.
    """
    n, doubts, status = q.shape[1], 0, section_bits(memory, at.STATUS)
    flat = q.reshape(-1)
    for first in range(begin, end, STATES_AT_ONCE):
        count = min(STATES_AT_ONCE, end - first)
        doubts += check_rows(memory, flat[n * first : n * (first + count)], count)
        for i in range(count):
            verdicts[first + i] = status[i]
    return doubts


@compiled
def _state(memory: Array, row: int, a: Array, b: Array, fraction: float) -> None:
    """Write the state at a fraction of an edge from a to b, shape (k,) [rad or m], into ROWS."""
    rows, moving, frozen = section(memory, at.ROWS), section(memory, at.FREE), section(memory, at.FROZEN)
    n = frozen.size
    for k in range(n):
        rows[n * row + k] = frozen[k]
    for k in range(moving.size):
        value = b[k] if fraction == 1.0 else a[k] + (b[k] - a[k]) * fraction
        rows[n * row + int(moving[k])] = value


@compiled
def _within_ranges(memory: Array, a: Array, b: Array) -> bool:
    """Return whether all of an edge from a to b, shape (k,) [rad or m], keeps the dependent ranges."""
    heads, tables = section(memory, at.TABLE_HEADS), section(memory, at.TABLES)
    if heads.size == 0:
        return True
    rows, n = section(memory, at.ROWS), section(memory, at.FROZEN).size
    _state(memory, 0, a, b, 0.0)
    _state(memory, 1, a, b, 1.0)
    margin = HEAD.range_margin(at.head_of(memory))
    return edge_keeps_ranges(heads, tables, margin, rows[:n], rows[n : 2 * n])


@compiled
def _decided_free(memory: Array, count: int) -> bool:
    """Return whether the first `count` states in ROWS of a block, shape (s,), are free by the exact check."""
    status = section_bits(memory, at.STATUS)
    for i in range(count):
        status[i] = FREE
    decide_pairs(memory, section(memory, at.ROWS), count, True)
    worst = FREE
    for i in range(count):
        worst = max(worst, status[i])
    return worst == FREE


@compiled
def _queue_doubts(memory: Array, t: Tables, a: Array, b: Array, waiting: int, k: int, blocks: int) -> int:
    """Queue the undecided states of one block of eight states on an edge; return the queue's length.

    Args:
        memory: The block, shape (s,).
        t: The block's tables.
        a: Values of the free joints at the start of the edge, shape (k,) [rad or m].
        b: Values of the free joints at the end of the edge, shape (k,) [rad or m].
        waiting: Length of the queue so far.
        k: Index of the block of eight states, from 0.
        blocks: Number of blocks of eight states on the edge.
    """
    queue = section_bits(memory, at.QUEUE)
    classes, groups = section_bits(memory, at.ROW_CLASSES), section_bits(memory, at.ROW_GROUPS)
    for i in range(LANES):
        queue[waiting + i] = waiting + i
        classes[waiting + i] = groups[waiting + i] = 0
    doubts, found = _take_doubts(memory, t, waiting, LANES, 0), waiting
    for i in range(LANES):
        if (doubts >> i) & 1:
            classes[found], groups[found] = classes[waiting + i], groups[waiting + i]
            _state(memory, found, a, b, (i + 1) / LANES - k / (LANES * blocks))
            found += 1
    return found


@compiled
def _held(memory: Array, a: Array, b: Array, count: int) -> bool:
    """Return whether states of an edge can be held still, with the payload, without tipping over.

    The kernel takes configurations and the masses in LOADS, a batch of as many as it has lanes, and returns
    torques.  If there are EDGES, it also returns the floor's force and moments, which the rows of EDGES
    multiply: a product below zero means that only a pull of the floor could keep the robot from tipping.

    Args:
        memory: The block, shape (s,); ROWS receives the states.
        a: Values of the free joints at the start, shape (k,) [rad or m].
        b: Values of the free joints at the end, shape (k,) [rad or m].
        count: Number of states, a multiple of the kernel's lanes.
    """
    head, rows, scratch = at.head_of(memory), section(memory, at.ROWS), section(memory, at.GRAVITY)
    effort, loads = section(memory, at.EFFORT), section(memory, at.LOADS)
    edges, moving, frozen = section(memory, at.EDGES), section(memory, at.FREE), section(memory, at.FROZEN)
    n, wide, held = HEAD.joints(head), HEAD.gravity_lanes(head), True
    for i in range(n + loads.size):
        for lane in range(wide):
            rows[wide * i + lane] = frozen[i] if i < n else loads[i - n]
    work = scratch[(n + EDGE_NUMBERS) * wide :]
    for first in range(0, count, wide):
        for lane in range(wide):
            share = (first + lane + 1) / count
            for k in range(moving.size):
                value = b[k] if share == 1.0 else a[k] + (b[k] - a[k]) * share
                rows[wide * int(moving[k]) + lane] = value
        call_kernel(HEAD.gravity_kernel(head), rows.ctypes.data, scratch.ctypes.data, work.ctypes.data)
        for i in range(n):
            for lane in range(wide):
                held = held and abs(scratch[wide * i + lane]) <= effort[i]
        for k in range(0, edges.size, EDGE_NUMBERS):
            for lane in range(wide):
                moment = 0.0
                for i in range(EDGE_NUMBERS):
                    moment += edges[k + i] * scratch[wide * (n + i) + lane]
                held = held and moment >= 0.0
        if not held:
            return False
    return True


@compiled
def is_edge_valid(memory: Array, a: Array, b: Array, steps: int) -> bool:
    """Return whether at least `steps` states from a to b, evenly spaced and b among them, are valid.

    Eight states are checked at a time.  The first eight are spread from end to end, the next lie a little
    before them, and so on, since obstacles are mostly wider than the distance between two states.  States
    that the spheres leave in doubt are queued and decided after the others, or when the queue is full.

    Args:
        memory: The block, shape (s,); its section FREE lists the joints of a and b, FROZEN has the positions
            of all joints.
        a: Values of the free joints at the start, shape (k,) [rad or m].
        b: Values of the free joints at the end, shape (k,) [rad or m].
        steps: Number of states, rounded up to a multiple of eight.
    """
    head, t = at.head_of(memory), tables_of(memory)
    blocks, waiting = (steps + LANES - 1) // LANES, 0
    if HEAD.blocked(head) != 0 or not (_all_within(a, WIDEST) and _all_within(b, WIDEST)):
        return False
    if not _within_ranges(memory, a, b):
        return False
    moving, ramp = at.address_of(memory, at.FREE), load_lanes(at.address_of(memory, at.RAMP))
    begin, end = a.ctypes.data, b.ctypes.data
    for block in range(blocks):
        share = ramp - block / (LANES * blocks)
        for j in range(a.size):
            first, k = double_at(begin, j), int(double_at(moving, j))
            store_lanes(t.coordinates, share * (double_at(end, j) - first) + first, k)
        if check_block(t, True) != 0:
            return False
        if word_at(t.doubtful) == 0:
            continue
        if waiting + LANES > STATES_AT_ONCE:
            if not _decided_free(memory, waiting):
                return False
            waiting = 0
        waiting = _queue_doubts(memory, t, a, b, waiting, block, blocks)
    if waiting > 0 and not _decided_free(memory, waiting):
        return False
    return HEAD.gravity_kernel(head) == 0 or _held(memory, a, b, LANES * blocks)


@compiled("void(float64[::1])")
def place_frozen(memory: Array) -> None:
    """Place all bodies of a block, shape (s,), at FROZEN; bodies that no free joint moves stay there."""
    frozen, coordinates = section(memory, at.FROZEN), section_single(memory, at.COORDINATES)
    for k in range(frozen.size):
        for i in range(LANES):
            coordinates[LANES * k + i] = frozen[k]
    place_all(tables_of(memory))


@compiled("void(float64[::1], float64[::1], float64[::1], int64, int64, int64[::1])")
def begin_motion(memory: Array, frozen: Array, effort: Array, gravity: int, lanes: int, moves: Ints1) -> None:
    """Prepare a block for the checks of one motion.

    Args:
        memory: The block, shape (s,).
        frozen: Positions of the joints that do not move, shape (n,) [rad or m].
        effort: Maximum torque or force of each joint while holding still, shape (n,) [N m or N].
        gravity: Address of the kernel's `block` of the holding torques; 0: these are not checked.
        lanes: Number of states that the kernel takes at a time, eight or a divisor of eight.
        moves: 1 for each body that the motion moves, else 0; the world last, shape (bodies,).
    """
    stands, limits, gaps = section(memory, at.FROZEN), section(memory, at.EFFORT), section(memory, at.GAPS)
    for k in range(frozen.size):
        stands[k] = frozen[k]
    for k in range(limits.size):
        limits[k] = effort[k]
    for c in range(gaps.size):
        gaps[c] = -np.inf
    head = at.head_of(memory)
    HEAD.set_gravity_kernel(head, gravity)
    HEAD.set_gravity_lanes(head, lanes)
    bodies, last = at.address_of(memory, at.BODIES), moves.size - 1
    for b in range(last):
        BODY.set_moves(bodies, 1, b)
    place_frozen(memory)
    for b in range(last + 1):
        BODY.set_moves(bodies, moves[b], b)


@compiled("void(float64[::1], float64, float64, float64)")
def set_margins(memory: Array, margin: float, self_margin: float, radius: float) -> None:
    """Write the margins into a block, and set its allowances to zero.

    Args:
        memory: The block, shape (s,); an empty block, used when coal checks every state, stays empty.
        margin: Margin to the scene [m].
        self_margin: Margin between two parts of the robot [m].
        radius: Approximate distance from their joint at which adjacent bodies touch: converts `self_margin`
            to an angle [m].
    """
    if memory.size == 0:
        return
    head = at.head_of(memory)
    HEAD.set_margin(head, margin)
    HEAD.set_self_margin(head, self_margin)
    HEAD.set_range_margin(head, self_margin / radius)
    section(memory, at.ALLOWANCES)[:] = 0.0


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def row_verdicts(memory: int, rows: int, count: int, answers: int) -> int:
    """Write the verdicts on configurations given by address; return the number in doubt, see `check_rows`.

    Args:
        memory: Address of the block.
        rows: Address of the configurations, one after the other, shape (count n,) [rad or m].
        count: Number of configurations, STATES_AT_ONCE at most.
        answers: Address that receives FREE, CONTACT or TIE of each as an integer, shape (count,).
    """
    spans = floats_at(memory, at.SIZE + 1)
    whole, found = floats_at(memory, int(spans[at.SIZE])), words_at(answers, count)
    n = HEAD.joints(at.head_of(whole))
    doubts = check_rows(whole, floats_at(rows, n * count), count)
    status = section_bits(whole, at.STATUS)
    for i in range(count):
        found[i] = status[i]
    return doubts


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def valid_steps(a: int, b: int, steps: int, memory: int) -> int:
    """Return `steps` if `is_edge_valid`, else 0; `a`, `b` and `memory` are addresses."""
    spans = floats_at(memory, at.SIZE + 1)
    whole = floats_at(memory, int(spans[at.SIZE]))
    count = int(spans[2 * at.FREE + 1] - spans[2 * at.FREE])
    return steps if is_edge_valid(whole, floats_at(a, count), floats_at(b, count), steps) else 0
