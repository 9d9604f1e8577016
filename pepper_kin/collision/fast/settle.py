"""The exact verdict on one configuration that spheres leave in doubt."""

from __future__ import annotations

import math

from numba import njit

from pepper_kin.collision.fast.exact import segment_to_box, segment_to_segment
from pepper_kin.collision.fast.gjk import CONTACT, FREE, TIE, nearer_than
from pepper_kin.collision.fast.layout import (
    CLASSES,
    GROUP_OBJECTS,
    GROUP_SOLIDS,
    GROUPS,
    MARGIN,
    NUMBERS,
    OBJECT_COUNT,
    PAIR_FIRST,
    PAIRS,
    POSE_KERNEL,
    POSES,
    ROWS,
    SELF_MARGIN,
    SINGLE_WORK,
    SOLID_HALF,
    SOLIDS,
    VERTEX_FIRST,
    VERTICES,
    N,
    section,
)
from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.collision.fast.solids import BOX, OTHER, Array
from pepper_kin.kernels.native import call_kernel

TIE_WIDTH = 3e-6
"""Distances within this of the threshold are ties: coal's own iterations end at 1e-6 [m]."""
ROUNDING = 1e-9
"""More than double precision loses in a distance [m]."""
SOLID_SIZE = 4
"""Numbers of a solid in SOLIDS: kind, radius, bounding radius, whether it is filled."""


@njit("int64(float64[::1], float64[::1], float64[::1], int64, int64, float64)", **OPTIONS)
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
        of_a = corners[int(first[a]) : int(first[a + 1])]
        of_b = corners[int(first[b]) : int(first[b + 1])]
        verdict = nearer_than(
            row_a[0], half_a, pose_a, of_a, row_b[0], half_b, pose_b, of_b, threshold, TIE_WIDTH
        )
    if verdict == CONTACT and (row_a[3] == 0.0 or row_b[3] == 0.0):
        return TIE
    return verdict


@njit("float64(float64[::1], float64[::1], float64[::1], int64, int64, float64)", **OPTIONS)
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


@njit("int64(float64[::1], int64, int64, int64)", **OPTIONS)
def settle(memory: Array, row: int, classes: int, groups: int) -> int:
    """Return FREE, CONTACT, or TIE where some pair is too near to the threshold to tell and none is nearer.

    Args:
        memory: The block.
        row: Number of the configuration in ROWS.
        classes: Bits of the classes of pairs in doubt; bit 61 stands for all from there on.
        groups: Bits of the groups of solids in doubt about the scene; the same.
    """
    numbers, solids, poses = section(memory, NUMBERS), section(memory, SOLIDS), section(memory, POSES)
    n = int(numbers[N])
    q = section(memory, ROWS)[n * row : n * row + n]
    work = section(memory, SINGLE_WORK)
    call_kernel(int(numbers[POSE_KERNEL]), q.ctypes.data, poses.ctypes.data, work.ctypes.data)
    worst = FREE
    first, pairs = section(memory, PAIR_FIRST), section(memory, PAIRS)
    for c in range(int(numbers[CLASSES])):
        if not (classes >> min(c, 61)) & 1:
            continue
        for k in range(int(first[c]), int(first[c + 1])):
            verdict = _pair(
                memory, solids, poses, int(pairs[2 * k]), int(pairs[2 * k + 1]), numbers[SELF_MARGIN]
            )
            if verdict == CONTACT:
                return CONTACT
            worst = max(worst, verdict)
    members = section(memory, GROUP_SOLIDS)
    compared, count_groups = section(memory, GROUP_OBJECTS), int(numbers[GROUPS])
    count = int(numbers[OBJECT_COUNT])
    begin = solids.size // SOLID_SIZE - count
    for k in range(members.size // 2):
        if not (groups >> min(int(members[2 * k]), 61)) & 1:
            continue
        for o in range(count):
            if compared[o * count_groups + int(members[2 * k])] == 0.0:
                continue
            b = begin + o
            verdict = _pair(memory, solids, poses, int(members[2 * k + 1]), b, numbers[MARGIN])
            if verdict == CONTACT:
                return CONTACT
            worst = max(worst, verdict)
    return worst
