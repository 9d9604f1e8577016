"""The exact verdicts on configurations that spheres leave in doubt."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.collision.ball_check import NODE_SINGLES, ROOT_WORDS
from pepper_kin.core.collision.clouds import (
    POINT_WORKSPACE_SIZE,
    cloud_verdict,
    clouds_verdict,
    point_in_cloud,
    point_verdict,
)
from pepper_kin.core.collision.gjk import CONTACT, FREE, TIE, ConvexCore, nearer_than, separation
from pepper_kin.core.collision.layout import (
    AXES,
    BOX,
    CLASS_COUNT,
    CLOUD,
    CLOUDS,
    FROZEN,
    FULL,
    GAP_STATES,
    GAPS,
    GROUP_SOLIDS,
    JOINT_AXES,
    JOINT_POSES,
    JOINTS,
    LEVERS,
    MARGIN,
    NODES,
    NUMBERS,
    OTHER,
    PAIR_FIRST,
    PAIR_WORKSPACE,
    PAIRS,
    Q_FULL,
    ROOT_LISTS,
    ROOTS,
    ROW_CLASSES,
    ROW_GROUPS,
    SELF_MARGIN,
    SOLID_HALF,
    SOLID_PLACES,
    SOLID_POSES,
    SOLIDS,
    STATUS,
    VERTEX_FIRST,
    VERTEX_SINGLES,
    VERTICES,
    N,
    address_of,
    scene_of,
    section,
    section_bits,
    section_single,
)
from pepper_kin.core.collision.segments import segment_to_box, segment_to_segment
from pepper_kin.core.kinematic_tree import JOINT, compose, place_joints
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.lanes import double_at

TIE_WIDTH = 3e-6
"""Distances within this of the threshold are ties: coal's own iterations end at 1e-6 [m]."""
ROUNDING = 1e-9
"""More than double precision loses in a distance [m]."""
SOLID_SIZE = 4
"""Numbers of a solid in SOLIDS: kind, radius, bounding radius, whether it is filled."""
PLACE_SIZE = 13
"""Numbers of a solid of the robot in SOLID_PLACES: its joint, its pose there (center, x, y and z axis)."""
FULL_SIZE = 3
"""Numbers of a coordinate of the Pinocchio model in FULL: the one of q on which it depends, gain and
offset."""


@compiled(inline=True, lean=True)
def _core(memory: Array, a: int) -> ConvexCore:
    """Return the core of a solid of a block, shape (s,)."""
    row, first = address_of(memory, SOLIDS) + 8 * SOLID_SIZE * a, address_of(memory, VERTEX_FIRST) + 8 * a
    begin = int(double_at(first))
    return ConvexCore(
        int(double_at(row)),
        address_of(memory, SOLID_HALF) + 24 * a,
        address_of(memory, SOLID_POSES) + 96 * a,
        int(double_at(first + 8)) - begin,
        address_of(memory, VERTICES) + 24 * begin,
        address_of(memory, VERTEX_SINGLES) + 12 * begin,
        double_at(row + 16),
    )


@compiled(inline=True, lean=True)
def _thin(core: ConvexCore) -> bool:
    """Whether a core is a segment or a point."""
    return core.kind == BOX and double_at(core.half) == 0.0 and double_at(core.half + 8) == 0.0


@compiled(lean=True)
def _off_box(core: ConvexCore, place: int) -> float:
    """Return the squared distance of a point, at an address, to the box around a core [m^2]."""
    pose, half, squared = core.pose, core.half, 0.0
    x, y, z = (
        double_at(place) - double_at(pose),
        double_at(place + 8) - double_at(pose + 8),
        double_at(place + 16) - double_at(pose + 16),
    )
    for i in range(3):
        axis = pose + 24 * (i + 1)
        along = x * double_at(axis) + y * double_at(axis + 8) + z * double_at(axis + 16)
        off = max(abs(along) - double_at(half + 8 * i), 0.0)
        squared += off * off
    return squared


@compiled(inline=True, lean=True)
def _axis_of(memory: Array, slot: int) -> int:
    """Return the address, in a block, shape (s,), of the direction that parted a pair last."""
    return address_of(memory, AXES) + 24 * (slot % (section(memory, AXES).size // 3))


@compiled
def ball_meets(node: NDArray[np.float32], center: Array, reach: float) -> bool:
    """Whether a ball at a center, shape (3,), meets the box of a node, shape (NODE_SINGLES,) [m]."""
    squared = 0.0
    for i in range(3):
        off = max(max(node[i] - center[i], center[i] - node[3 + i]), 0.0)
        squared += off * off
    return squared <= reach * reach


@compiled(lean=True)
def _pair(memory: Array, other: Array, a: int, b: int, margin: float, slot: int) -> int:
    """Return the verdict on a solid of a block and one of another: FREE, CONTACT or TIE.

    Args:
        memory: The robot's block, shape (s,).
        other: The same, or the scene's, shape (t,).
        a: A solid of the first.
        b: A solid of the second.
        margin: Distance to keep [m].
        slot: Place of the pair in AXES.
    """
    one, two = _core(memory, a), _core(other, b)
    row_a, row_b = (
        address_of(memory, SOLIDS) + 8 * SOLID_SIZE * a,
        address_of(other, SOLIDS) + 8 * SOLID_SIZE * b,
    )
    pad_a, pad_b = double_at(row_a + 8), double_at(row_b + 8)
    reach_a, reach_b = one.size + pad_b + margin + TIE_WIDTH, two.size + pad_a + margin + TIE_WIDTH
    if _off_box(two, one.pose) > reach_a * reach_a or _off_box(one, two.pose) > reach_b * reach_b:
        return FREE
    if one.kind == OTHER or two.kind == OTHER:
        return TIE
    threshold, axis = pad_a + pad_b + margin, _axis_of(memory, slot)
    verdict, scratch = TIE, address_of(memory, PAIR_WORKSPACE)
    if one.kind == CLOUD or two.kind == CLOUD:
        first, second = section_bits(memory, CLOUDS), section_bits(other, CLOUDS)
        if one.kind == CLOUD and two.kind == CLOUD:
            verdict = clouds_verdict(one.pose, first[a], two.pose, second[b], threshold, TIE_WIDTH, scratch)
        elif one.kind == CLOUD:
            verdict = cloud_verdict(two, first[a], one.pose, reach_b, threshold, TIE_WIDTH, scratch)
        else:
            verdict = cloud_verdict(one, second[b], two.pose, reach_a, threshold, TIE_WIDTH, scratch)
    elif (_thin(one) and two.kind == BOX) or (_thin(two) and one.kind == BOX):
        distance = _segment_distance(one, two)
        if abs(distance - threshold) > TIE_WIDTH:
            verdict = CONTACT if distance < threshold else FREE
    else:
        verdict = nearer_than(one, two, threshold, TIE_WIDTH, axis, scratch)
    if verdict == CONTACT and (double_at(row_a + 24) == 0.0 or double_at(row_b + 24) == 0.0):
        return TIE
    return verdict


@compiled(lean=True)
def _segment_distance(one: ConvexCore, two: ConvexCore) -> float:
    """Return the distance of a segment and a box, which may be one too [m]."""
    first, second = one, two
    if not _thin(one):
        first, second = two, one
    long, half = double_at(first.half + 16), floats_at(second.half, 3)
    pose, other = floats_at(first.pose, 12), floats_at(second.pose, 12)
    if half[0] == 0.0 and half[1] == 0.0:
        return float(segment_to_segment(pose, long, other, half[2]))
    return float(segment_to_box(pose, long, other, half))


@compiled
def pair_distance(memory: Array, other: Array, a: int, b: int, least: float) -> float:
    """Return a lower bound of the distance of two solids [m]: exact where one core is a segment, or -inf.

    Args:
        memory: A block, shape (s,).
        other: Another, shape (t,), or the same.
        a: A solid of the first.
        b: A solid of the second.
        least: Distances above this need not be exact [m].
    """
    one, two = _core(memory, a), _core(other, b)
    x = double_at(one.pose) - double_at(two.pose)
    y = double_at(one.pose + 8) - double_at(two.pose + 8)
    z = double_at(one.pose + 16) - double_at(two.pose + 16)
    rough = math.sqrt(x * x + y * y + z * z) - one.size - two.size
    if rough > max(least, 0.0):
        return rough
    if one.kind != BOX or two.kind != BOX or not (_thin(one) or _thin(two)):
        return -math.inf
    pads = section(memory, SOLIDS)[SOLID_SIZE * a + 1] + section(other, SOLIDS)[SOLID_SIZE * b + 1]
    distance = _segment_distance(one, two) - pads - ROUNDING
    return float(distance) if distance > 0.0 else -math.inf


@compiled(lean=True)
def _gap_of(memory: Array, k: int, least: float) -> float:
    """Return a lower bound of the distance of pair k of solids of a block, shape (s,), or -inf [m]."""
    pair = address_of(memory, PAIRS) + 16 * k
    a, b = int(double_at(pair)), int(double_at(pair + 8))
    bound = pair_distance(memory, memory, a, b, least)
    if bound > 0.0:
        return float(bound)
    solids = section(memory, SOLIDS)
    pads = solids[SOLID_SIZE * a + 1] + solids[SOLID_SIZE * b + 1] + ROUNDING
    return float(separation(_core(memory, a), _core(memory, b), _axis_of(memory, k)) - pads)


@compiled
def place_solids(memory: Array, q: Array) -> None:
    """Write the world poses of a block's solids at a configuration q, shape (n,), into SOLID_POSES."""
    full, q_full = section(memory, FULL), section(memory, Q_FULL)
    places, poses = section(memory, SOLID_PLACES), section(memory, SOLID_POSES)
    joints = section(memory, JOINTS).reshape((-1, JOINT))
    frames, axes = (
        section(memory, JOINT_POSES).reshape((-1, 12)),
        section(memory, JOINT_AXES).reshape((-1, 3)),
    )
    for k in range(q_full.size):
        q_full[k] = q[int(full[FULL_SIZE * k])] * full[FULL_SIZE * k + 1] + full[FULL_SIZE * k + 2]
    place_joints(joints, q_full, frames, axes)
    for k in range(places.size // PLACE_SIZE):
        place = places[PLACE_SIZE * k : PLACE_SIZE * (k + 1)]
        compose(frames[int(place[0])], place[1:], poses[12 * k : 12 * k + 12])


@compiled
def _scene_verdict(memory: Array, scene: Array, group: int, a: int, slot: int) -> int:
    """Return the verdict on a solid of a group and the scene, whose pairs are in AXES from `slot` on.

    Args:
        memory: The robot's block, shape (s,), with poses in SOLID_POSES.
        scene: The scene's, shape (t,).
        group: The group.
        a: The solid.
        slot: Place in AXES of its pair with the scene's first object.
    """
    lists, roots = section_bits(scene, ROOT_LISTS), section_bits(scene, ROOTS)
    nodes, margin, worst = section_single(scene, NODES), section(memory, NUMBERS)[MARGIN], FREE
    center = section(memory, SOLID_POSES)[12 * a : 12 * a + 3]
    reach = section(memory, SOLIDS)[SOLID_SIZE * a + 2] + margin + TIE_WIDTH
    for r in range(lists[group], lists[group + 1]):
        n, end = roots[ROOT_WORDS * r], roots[ROOT_WORDS * r + 1]
        while n < end:
            node = nodes[NODE_SINGLES * n : NODE_SINGLES * (n + 1)]
            if not ball_meets(node, center, reach):
                n = int(node[6])
                continue
            for o in range(int(node[7]), int(node[8])):
                verdict = _pair(memory, scene, a, o, margin, slot + o)
                if verdict == CONTACT:
                    return CONTACT
                worst = max(worst, verdict)
            n += 1
    return worst


@compiled
def _stays_apart(memory: Array, c: int, q: Array, least: float) -> bool:
    """Whether the pairs of a class were so far apart lately that they are still farther than a distance.

    Args:
        memory: The block, shape (s,).
        c: The class.
        q: Configuration, shape (n,) [rad or m].
        least: The distance [m].
    """
    motion_bounds, states = section(memory, LEVERS), section(memory, GAP_STATES)
    gap = section(memory, GAPS)[c]
    for j in range(q.size):
        if q[j] != states[q.size * c + j]:
            gap -= motion_bounds[q.size * c + j] * abs(q[j] - states[q.size * c + j])
    return bool(gap > least)


@compiled
def _keep_gap(memory: Array, c: int, q: Array) -> float:
    """Keep and return a lower bound of the distance [m] of a class's pairs at a configuration, shape (n,)."""
    first, states = section(memory, PAIR_FIRST), section(memory, GAP_STATES)
    gap = math.inf
    for k in range(int(first[c]), int(first[c + 1])):
        if gap > 0.0:
            gap = min(gap, _gap_of(memory, k, gap))
    section(memory, GAPS)[c] = gap
    for j in range(q.size):
        states[q.size * c + j] = q[j]
    return gap


@compiled
def _verdict(memory: Array, classes: int, groups: int, q: Array) -> int:
    """Return FREE, CONTACT, or TIE where some pair is too near to the threshold to decide, none nearer.

    Args:
        memory: The block, shape (s,), with poses in SOLID_POSES.
        classes: Bits of the classes of pairs in doubt; bit 61 stands for all from there on.
        groups: Bits of the groups of solids in doubt about the scene; the same.
        q: The configuration, shape (n,) [rad or m].
    """
    numbers, scene, worst = section(memory, NUMBERS), scene_of(memory), FREE
    first, pairs, margin = section(memory, PAIR_FIRST), section(memory, PAIRS), numbers[SELF_MARGIN]
    for c in range(int(numbers[CLASS_COUNT])):
        if not (classes >> min(c, 61)) & 1 or _keep_gap(memory, c, q) > margin + TIE_WIDTH:
            continue
        for k in range(int(first[c]), int(first[c + 1])):
            verdict = _pair(memory, memory, int(pairs[2 * k]), int(pairs[2 * k + 1]), margin, k)
            if verdict == CONTACT:
                return CONTACT
            worst = max(worst, verdict)
    members, objects = section(memory, GROUP_SOLIDS), section(scene, SOLIDS).size // SOLID_SIZE
    for k in range(members.size // 2):
        group = int(members[2 * k])
        if (groups >> min(group, 61)) & 1:
            slot = pairs.size // 2 + k * objects
            verdict = _scene_verdict(memory, scene, group, int(members[2 * k + 1]), slot)
            if verdict == CONTACT:
                return CONTACT
            worst = max(worst, verdict)
    return worst


@compiled
def decide_pairs(memory: Array, rows: Array, count: int, all_free: bool) -> int:
    """Decide those of some configurations that balls leave in doubt.

    How far the pairs of a class are apart is kept, and with it the configuration: at others nearby, the
    proven bounds of how far joints move solids show that they do not touch.

    Their verdicts are written into STATUS: FREE, CONTACT, or TIE where some pair is too near to the threshold
    to decide and none is nearer.  Returns how many were in doubt.

    Args:
        memory: The block, shape (s,).
        rows: Configurations, one after the other, shape (count n,) [rad or m].
        count: How many.
        all_free: Whether the first that is not free ends it.
    """
    status, doubts, numbers = section_bits(memory, STATUS), 0, section(memory, NUMBERS)
    classes, groups = section_bits(memory, ROW_CLASSES), section_bits(memory, ROW_GROUPS)
    n, least = int(numbers[N]), numbers[SELF_MARGIN] + TIE_WIDTH
    for i in range(count):
        if status[i] == FREE and (classes[i] > 0 or groups[i] > 0):
            doubts += 1
            q, left = rows[n * i : n * i + n], 0
            for c in range(int(numbers[CLASS_COUNT])):
                bit = 1 << min(c, 61)
                if (classes[i] & bit) != 0 and not _stays_apart(memory, c, q, least):
                    left |= bit
            if left != 0 or groups[i] != 0:
                place_solids(memory, q)
                status[i] = _verdict(memory, left, groups[i], q)
                if all_free and status[i] != FREE:
                    return doubts
    return doubts


@compiled("int64(float64[::1], int64, int64)")
def pair_verdict(memory: Array, a: int, o: int) -> int:
    """Return the verdict on a solid of the robot that no joint moves and an object of the scene.

    Args:
        memory: The robot's block, shape (s,).
        a: The solid.
        o: The object's place in the scene's block.
    """
    place_solids(memory, section(memory, FROZEN))
    return int(_pair(memory, scene_of(memory), a, o, section(memory, NUMBERS)[MARGIN], 0))


@compiled("int64(float64[::1], float64[::1], float64[:, ::1], float64, uint8[::1])")
def near_robot(memory: Array, q: Array, points: Array, margin: float, near: NDArray[np.uint8]) -> int:
    """Mark points that are nearer to a robot's solids than a distance, or too near to it to decide.

    Args:
        memory: The robot's block, shape (s,).
        q: Configuration, shape (n,) [rad or m].
        points: Points in the world, shape (k, 3) [m].
        margin: The distance [m].
        near: Written, 1 for each point that is marked, else 0, shape (k,).

    Returns:
        How many are marked.
    """
    solids, poses, count = section(memory, SOLIDS), section(memory, SOLID_POSES), 0
    scratch = address_of(memory, PAIR_WORKSPACE)
    axis = scratch + 8 * (POINT_WORKSPACE_SIZE - 3)
    near[:] = 0
    place_solids(memory, q)
    for a in range(solids.size // SOLID_SIZE):
        row, pose = solids[SOLID_SIZE * a : SOLID_SIZE * (a + 1)], poses[12 * a : 12 * a + 12]
        core = _core(memory, a)
        threshold, reach = row[1] + margin, row[2] + margin + TIE_WIDTH
        for p in range(points.shape[0]):
            x, y, z = points[p, 0] - pose[0], points[p, 1] - pose[1], points[p, 2] - pose[2]
            if near[p] == 0 and x * x + y * y + z * z <= reach * reach:
                place = points.ctypes.data + 24 * p
                if core.kind == CLOUD:
                    address = section_bits(memory, CLOUDS)[a]
                    verdict = point_in_cloud(place, core.pose, address, threshold, TIE_WIDTH)
                else:
                    verdict = point_verdict(core, place, threshold, TIE_WIDTH, axis, scratch)
                if verdict != FREE:
                    near[p] = 1
                    count += 1
    return count
