"""The exact verdicts on configurations that spheres leave in doubt."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pepper_kin.core.collision.gjk import CONTACT, FREE, TIE, ConvexCore, nearer_than
from pepper_kin.core.collision.layout import (
    BOX,
    CLASSES,
    DOUBT_CLASSES,
    DOUBT_GROUPS,
    GROUP_OBJECTS,
    GROUP_SOLIDS,
    GROUPS,
    LANES_IN,
    LANES_OUT,
    LANES_WORK,
    MARGIN,
    NUMBERS,
    OBJECT_COUNT,
    OTHER,
    PAIR_FIRST,
    PAIRS,
    POSE_LANES,
    POSE_LANES_KERNEL,
    POSES,
    ROWS,
    SELF_MARGIN,
    SOLID_HALF,
    SOLIDS,
    STATUS,
    VERTEX_FIRST,
    VERTICES,
    Array,
    N,
    section,
    section_bits,
)
from pepper_kin.core.collision.segments import segment_to_box, segment_to_segment
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_kernel

TIE_WIDTH = 3e-6
"""Distances within this of the threshold are ties: coal's own iterations end at 1e-6 [m]."""
ROUNDING = 1e-9
"""More than double precision loses in a distance [m]."""
SOLID_SIZE = 4
"""Numbers of a solid in SOLIDS: kind, radius, bounding radius, whether it is filled."""


@compiled
def _pair(memory: Array, solids: Array, poses: Array, a: int, b: int, margin: float) -> int:
    """Return the verdict on two solids of the section SOLIDS."""
    pose_a, pose_b = poses[12 * a : 12 * a + 12], poses[12 * b : 12 * b + 12]
    row_a, row_b = (
        solids[SOLID_SIZE * a : SOLID_SIZE * (a + 1)],
        solids[SOLID_SIZE * b : SOLID_SIZE * (b + 1)],
    )
    x, y, z = pose_a[0] - pose_b[0], pose_a[1] - pose_b[1], pose_a[2] - pose_b[2]
    reach = row_a[2] + row_b[2] + margin + TIE_WIDTH
    if x * x + y * y + z * z > reach * reach:
        return FREE
    if row_a[0] == OTHER or row_b[0] == OTHER:
        return TIE
    halves = section(memory, SOLID_HALF)
    half_a, half_b = halves[3 * a : 3 * a + 3], halves[3 * b : 3 * b + 3]
    threshold = row_a[1] + row_b[1] + margin
    thin_a = row_a[0] == BOX and half_a[0] == 0.0 and half_a[1] == 0.0
    thin_b = row_b[0] == BOX and half_b[0] == 0.0 and half_b[1] == 0.0
    verdict = TIE
    if (thin_a and row_b[0] == BOX) or (thin_b and row_a[0] == BOX):
        if thin_a and thin_b:
            distance = segment_to_segment(pose_a, half_a[2], pose_b, half_b[2])
        elif thin_a:
            distance = segment_to_box(pose_a, half_a[2], pose_b, half_b)
        else:
            distance = segment_to_box(pose_b, half_b[2], pose_a, half_a)
        if abs(distance - threshold) > TIE_WIDTH:
            verdict = CONTACT if distance < threshold else FREE
    else:
        first, vertices = section(memory, VERTEX_FIRST), section(memory, VERTICES)
        corners = vertices.reshape((-1, 3))
        core_a = ConvexCore(row_a[0], half_a, pose_a, corners[int(first[a]) : int(first[a + 1])])
        core_b = ConvexCore(row_b[0], half_b, pose_b, corners[int(first[b]) : int(first[b + 1])])
        verdict = nearer_than(core_a, core_b, threshold, TIE_WIDTH)
    if verdict == CONTACT and (row_a[3] == 0.0 or row_b[3] == 0.0):
        return TIE
    return verdict


@compiled
def pair_distance(memory: Array, solids: Array, poses: Array, a: int, b: int, least: float) -> float:
    """Return a lower bound of the distance of two solids [m]: exact where one core is a segment, or -inf.

    Args:
        memory: The block.
        solids: Its section SOLIDS.
        poses: Its section POSES.
        a: A solid.
        b: Another.
        least: Distances above this need not be known.
    """
    pose_a, pose_b = poses[12 * a : 12 * a + 12], poses[12 * b : 12 * b + 12]
    row_a, row_b = (
        solids[SOLID_SIZE * a : SOLID_SIZE * (a + 1)],
        solids[SOLID_SIZE * b : SOLID_SIZE * (b + 1)],
    )
    x, y, z = pose_a[0] - pose_b[0], pose_a[1] - pose_b[1], pose_a[2] - pose_b[2]
    rough = math.sqrt(x * x + y * y + z * z) - row_a[2] - row_b[2]
    if rough > max(least, 0.0):
        return rough
    if row_a[0] != BOX or row_b[0] != BOX:
        return -math.inf
    halves = section(memory, SOLID_HALF)
    half_a, half_b = halves[3 * a : 3 * a + 3], halves[3 * b : 3 * b + 3]
    thin_a, thin_b = half_a[0] == 0.0 and half_a[1] == 0.0, half_b[0] == 0.0 and half_b[1] == 0.0
    if thin_a and thin_b:
        distance = segment_to_segment(pose_a, half_a[2], pose_b, half_b[2])
    elif thin_a:
        distance = segment_to_box(pose_a, half_a[2], pose_b, half_b)
    elif thin_b:
        distance = segment_to_box(pose_b, half_b[2], pose_a, half_a)
    else:
        return -math.inf
    distance -= row_a[1] + row_b[1] + ROUNDING
    return distance if distance > 0.0 else -math.inf


@compiled
def _pose(memory: Array, rows: NDArray[np.int64], count: int) -> None:
    """Write poses of the solids at up to POSE_LANES configurations into LANES_OUT, side by side."""
    numbers, given, found = section(memory, NUMBERS), section(memory, LANES_IN), section(memory, LANES_OUT)
    n, q, work = int(numbers[N]), section(memory, ROWS), section(memory, LANES_WORK)
    for lane in range(POSE_LANES):
        first = n * rows[min(lane, count - 1)]
        for k in range(n):
            given[k * POSE_LANES + lane] = q[first + k]
    call_kernel(int(numbers[POSE_LANES_KERNEL]), given.ctypes.data, found.ctypes.data, work.ctypes.data)


@compiled
def _may_touch(
    solids: Array, poses: Array, found: Array, lane: int, a: int, b: int, count: int, margin: float
) -> bool:
    """Whether the bounding balls of a solid of the robot and another come nearer than a margin.

    Where they do, the poses of both in this lane are copied to where `_pair` looks for them.
    """
    reach = solids[SOLID_SIZE * a + 2] + solids[SOLID_SIZE * b + 2] + margin + TIE_WIDTH
    square = 0.0
    for i in range(3):
        there = found[(12 * b + i) * POSE_LANES + lane] if b < count else poses[12 * b + i]
        apart = found[(12 * a + i) * POSE_LANES + lane] - there
        square += apart * apart
    if square > reach * reach:
        return False
    for i in range(12):
        poses[12 * a + i] = found[(12 * a + i) * POSE_LANES + lane]
        if b < count:
            poses[12 * b + i] = found[(12 * b + i) * POSE_LANES + lane]
    return True


@compiled
def _verdict(memory: Array, lane: int, classes: int, groups: int) -> int:
    """Return FREE, CONTACT, or TIE where some pair is too near to the threshold to tell and none is nearer.

    Args:
        memory: The block, with poses in LANES_OUT.
        lane: Which of them.
        classes: Bits of the classes of pairs in doubt; bit 61 stands for all from there on.
        groups: Bits of the groups of solids in doubt about the scene; the same.
    """
    numbers, solids, poses = section(memory, NUMBERS), section(memory, SOLIDS), section(memory, POSES)
    found, worst = section(memory, LANES_OUT), FREE
    objects, count_groups = int(numbers[OBJECT_COUNT]), int(numbers[GROUPS])
    count = solids.size // SOLID_SIZE - objects
    first, pairs, margin = section(memory, PAIR_FIRST), section(memory, PAIRS), numbers[SELF_MARGIN]
    for c in range(int(numbers[CLASSES])):
        if not (classes >> min(c, 61)) & 1:
            continue
        for k in range(int(first[c]), int(first[c + 1])):
            a, b = int(pairs[2 * k]), int(pairs[2 * k + 1])
            if _may_touch(solids, poses, found, lane, a, b, count, margin):
                verdict = _pair(memory, solids, poses, a, b, margin)
                if verdict == CONTACT:
                    return CONTACT
                worst = max(worst, verdict)
    members, compared = section(memory, GROUP_SOLIDS), section(memory, GROUP_OBJECTS)
    margin = numbers[MARGIN]
    for k in range(members.size // 2):
        group, a = int(members[2 * k]), int(members[2 * k + 1])
        if not (groups >> min(group, 61)) & 1:
            continue
        for o in range(objects):
            if compared[o * count_groups + group] == 0.0:
                continue
            if _may_touch(solids, poses, found, lane, a, count + o, count, margin):
                verdict = _pair(memory, solids, poses, a, count + o, margin)
                if verdict == CONTACT:
                    return CONTACT
                worst = max(worst, verdict)
    return worst


@compiled
def settle(memory: Array, count: int) -> int:
    """Settle those of the first `count` configurations in ROWS that spheres leave in doubt.

    Their verdicts are written into STATUS: FREE, CONTACT, or TIE where some pair is too near to the threshold
    to tell and none is nearer.  Returns how many were in doubt.
    """
    status, rows = section_bits(memory, STATUS), np.empty(POSE_LANES, np.int64)
    classes, groups = section_bits(memory, DOUBT_CLASSES), section_bits(memory, DOUBT_GROUPS)
    doubts = waiting = 0
    for i in range(count):
        if status[i] == FREE and (classes[i] > 0 or groups[i] > 0):
            rows[waiting] = i
            waiting += 1
            doubts += 1
        if waiting == POSE_LANES or (waiting > 0 and i == count - 1):
            _pose(memory, rows, waiting)
            for lane in range(waiting):
                row = rows[lane]
                status[row] = _verdict(memory, lane, classes[row], groups[row])
            waiting = 0
    return doubts
