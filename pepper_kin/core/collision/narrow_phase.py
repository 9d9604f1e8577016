"""Exact verdicts on configurations that bounding spheres leave in doubt."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.collision.clouds import (
    POINT_WORKSPACE,
    cloud_verdict,
    clouds_verdict,
    point_in_cloud,
    point_verdict,
)
from pepper_kin.core.collision.gjk import CONTACT, FREE, TIE, ConvexCore, nearer_than, separation
from pepper_kin.core.collision.layout import (
    ALLOWANCES,
    AXES,
    BOX,
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
    NODES,
    OTHER,
    PAIR_FIRST,
    PAIR_WORKSPACE,
    PAIRS,
    Q_FULL,
    ROOT_LISTS,
    ROOTS,
    ROW_CLASSES,
    ROW_GROUPS,
    SOLID_HALF,
    SOLID_PLACES,
    SOLID_POSES,
    SOLIDS,
    STATUS,
    VERTEX_FIRST,
    VERTEX_SINGLES,
    VERTICES,
    address_of,
    head_of,
    scene_of,
    section,
    section_bits,
)
from pepper_kin.core.collision.records import HEAD, NODE, POSE, ROOT, SOLID, VECTORS, between, dot
from pepper_kin.core.collision.segments import segment_to_box, segment_to_segment
from pepper_kin.core.kinematic_tree import JOINT, compose, place_joints
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.lanes import double_at, single_at, word_at
from pepper_kin.kernels.records import SINGLES

TIE_WIDTH = 3e-6
"""Half width of the range around a threshold in which a distance is a TIE [m]: coal's iterations end at
1e-6."""
ROUNDING = 1e-9
"""Upper bound of the rounding error of a distance in double precision [m]."""
PLACE_SIZE = 13
"""Size of a solid of the robot in SOLID_PLACES: its joint, its pose there (center, x, y and z axis)."""
FULL_SIZE = 3
"""Size of a coordinate of the Pinocchio model in FULL: index in q on which it depends, gain and offset."""


@compiled(inline=True, lean=True)
def _core(memory: Array, a: int) -> ConvexCore:
    """Return the core of solid `a` of a block, shape (s,)."""
    solids, firsts = address_of(memory, SOLIDS), address_of(memory, VERTEX_FIRST)
    begin = int(double_at(firsts, a))
    return ConvexCore(
        int(SOLID.kind(solids, a)),
        VECTORS.at(address_of(memory, SOLID_HALF), a),
        POSE.at(address_of(memory, SOLID_POSES), a),
        int(double_at(firsts, a + 1)) - begin,
        VECTORS.at(address_of(memory, VERTICES), begin),
        SINGLES.at(address_of(memory, VERTEX_SINGLES), 3 * begin),
        SOLID.bounding(solids, a),
    )


@compiled(inline=True, lean=True)
def _thin(core: ConvexCore) -> bool:
    """Return whether a core is a segment or a point."""
    x, y, _ = VECTORS.xyz(core.half)
    return core.kind == BOX and x == 0.0 and y == 0.0


@compiled(lean=True)
def _off_box(core: ConvexCore, place: int) -> float:
    """Return the squared distance of a point, given by address, to the box around a core [m^2]."""
    squared, axes = 0.0, POSE.x_axis_at(core.pose)
    x, y, z = between(place, core.pose)
    for i in range(3):
        off = max(abs(dot(x, y, z, VECTORS.xyz(axes, i))) - double_at(core.half, i), 0.0)
        squared += off * off
    return squared


@compiled(inline=True, lean=True)
def _axis_of(memory: Array, slot: int) -> int:
    """Return the address, in a block, shape (s,), of the direction that last separated a pair."""
    return int(VECTORS.at(address_of(memory, AXES), slot % (section(memory, AXES).size // 3)))


@compiled
def ball_meets(node: int, center: int, reach: float) -> bool:
    """Return whether a sphere [m] meets the box of a node; node and center are addresses."""
    low, high, squared = NODE.low_at(node), NODE.high_at(node), 0.0
    for i in range(3):
        x = double_at(center, i)
        off = max(max(single_at(low, i) - x, x - single_at(high, i)), 0.0)
        squared += off * off
    return squared <= reach * reach


@compiled(lean=True)
def _pair(memory: Array, other: Array, a: int, b: int, margin: float, slot: int) -> int:
    """Return the verdict on a solid of one block and a solid of another: FREE, CONTACT or TIE.

    Args:
        memory: The robot's block, shape (s,).
        other: The robot's block, or the scene's, shape (t,).
        a: Solid in `memory`.
        b: Solid in `other`.
        margin: Distance to keep [m].
        slot: Index of the pair in AXES.
    """
    one, two = _core(memory, a), _core(other, b)
    row_a, row_b = SOLID.at(address_of(memory, SOLIDS), a), SOLID.at(address_of(other, SOLIDS), b)
    pad_a, pad_b = SOLID.radius(row_a), SOLID.radius(row_b)
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
    if verdict == CONTACT and (SOLID.filled(row_a) == 0.0 or SOLID.filled(row_b) == 0.0):
        return TIE
    return verdict


@compiled(lean=True)
def _segment_distance(one: ConvexCore, two: ConvexCore) -> float:
    """Return the distance of a segment and a box, which may be a segment too [m]."""
    first, second = one, two
    if not _thin(one):
        first, second = two, one
    long, half = double_at(first.half, 2), floats_at(second.half, 3)
    pose, other = floats_at(first.pose, 12), floats_at(second.pose, 12)
    if half[0] == 0.0 and half[1] == 0.0:
        return float(segment_to_segment(pose, long, other, half[2]))
    return float(segment_to_box(pose, long, other, half))


@compiled
def pair_distance(memory: Array, other: Array, a: int, b: int, least: float) -> float:
    """Return a lower bound of the distance of two solids [m]; exact if one core is a segment, or -inf.

    Args:
        memory: A block, shape (s,).
        other: The same block or another, shape (t,).
        a: Solid in `memory`.
        b: Solid in `other`.
        least: Distance above which the bound need not be exact [m].
    """
    one, two = _core(memory, a), _core(other, b)
    x, y, z = between(one.pose, two.pose)
    rough = math.sqrt(x * x + y * y + z * z) - one.size - two.size
    if rough > max(least, 0.0):
        return rough
    if one.kind != BOX or two.kind != BOX or not (_thin(one) or _thin(two)):
        return -math.inf
    pads = SOLID.radius(address_of(memory, SOLIDS), a) + SOLID.radius(address_of(other, SOLIDS), b)
    distance = _segment_distance(one, two) - pads - ROUNDING
    return float(distance) if distance > 0.0 else -math.inf


@compiled(lean=True)
def _gap_of(memory: Array, k: int, least: float) -> float:
    """Return a lower bound of the distance of pair k of solids of a block, shape (s,), or -inf [m]."""
    pairs, solids = address_of(memory, PAIRS), address_of(memory, SOLIDS)
    a, b = int(double_at(pairs, 2 * k)), int(double_at(pairs, 2 * k + 1))
    bound = pair_distance(memory, memory, a, b, least)
    if bound > 0.0:
        return float(bound)
    pads = SOLID.radius(solids, a) + SOLID.radius(solids, b) + ROUNDING
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
    """Return the verdict on a solid of a group and the whole scene: FREE, CONTACT or TIE.

    Args:
        memory: The robot's block, shape (s,), with poses in SOLID_POSES.
        scene: The scene's block, shape (t,).
        group: Index of the group.
        a: Index of the solid.
        slot: Index in AXES of the solid's pair with the scene's first object.
    """
    lists, roots, nodes = address_of(scene, ROOT_LISTS), address_of(scene, ROOTS), address_of(scene, NODES)
    head, worst, center = head_of(memory), FREE, POSE.at(address_of(memory, SOLID_POSES), a)
    margin = HEAD.margin(head) + section(memory, ALLOWANCES)[HEAD.classes(head) + group]
    reach = SOLID.bounding(address_of(memory, SOLIDS), a) + margin + TIE_WIDTH
    for r in range(word_at(lists, group), word_at(lists, group + 1)):
        n, end = ROOT.first_node(roots, r), ROOT.node_end(roots, r)
        while n < end:
            node = NODE.at(nodes, n)
            if not ball_meets(node, center, reach):
                n = int(NODE.after(node))
                continue
            for o in range(int(NODE.first_object(node)), int(NODE.object_end(node))):
                verdict = _pair(memory, scene, a, o, margin, slot + o)
                if verdict == CONTACT:
                    return CONTACT
                worst = max(worst, verdict)
            n += 1
    return worst


@compiled
def _stays_apart(memory: Array, c: int, q: Array, least: float) -> bool:
    """Return whether a class's stored gap proves that its pairs are farther apart than a distance.

    Args:
        memory: The block, shape (s,).
        c: Index of the class.
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
    """Store and return a lower bound of the distance [m] of a class's pairs at q, shape (n,)."""
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
    """Return FREE, CONTACT, or TIE if a pair is too near the threshold to decide and none is nearer.

    Args:
        memory: The block, shape (s,), with poses in SOLID_POSES.
        classes: Bits of the pair classes in doubt; bit 61 stands for all classes from 61 on.
        groups: Bits of the groups of solids in doubt against the scene; bit 61 stands for all from 61 on.
        q: Configuration, shape (n,) [rad or m].
    """
    head, scene, worst = head_of(memory), scene_of(memory), FREE
    first, pairs, allowances = (
        section(memory, PAIR_FIRST),
        section(memory, PAIRS),
        section(memory, ALLOWANCES),
    )
    for c in range(HEAD.classes(head)):
        margin = HEAD.self_margin(head) + allowances[c]
        if not (classes >> min(c, 61)) & 1 or _keep_gap(memory, c, q) > margin + TIE_WIDTH:
            continue
        for k in range(int(first[c]), int(first[c + 1])):
            verdict = _pair(memory, memory, int(pairs[2 * k]), int(pairs[2 * k + 1]), margin, k)
            if verdict == CONTACT:
                return CONTACT
            worst = max(worst, verdict)
    members, objects = section(memory, GROUP_SOLIDS), section(scene, SOLIDS).size // SOLID.width
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
    """Decide the configurations that bounding spheres leave in doubt; return how many were in doubt.

    The distance of each class's pairs is stored with its configuration: at nearby configurations, the motion
    bounds of the joints prove that the pairs do not collide.

    Verdicts are written into STATUS: FREE, CONTACT, or TIE if a pair is too near the threshold to decide and
    none is nearer.

    Args:
        memory: The block, shape (s,).
        rows: Configurations, one after the other, shape (count n,) [rad or m].
        count: Number of configurations.
        all_free: Whether to stop at the first configuration that is not free.
    """
    status, doubts, head = section_bits(memory, STATUS), 0, head_of(memory)
    classes, groups = section_bits(memory, ROW_CLASSES), section_bits(memory, ROW_GROUPS)
    n, least, allowances = HEAD.joints(head), HEAD.self_margin(head) + TIE_WIDTH, section(memory, ALLOWANCES)
    for i in range(count):
        if status[i] == FREE and (classes[i] > 0 or groups[i] > 0):
            doubts += 1
            q, left = rows[n * i : n * i + n], 0
            for c in range(HEAD.classes(head)):
                bit = 1 << min(c, 61)
                if (classes[i] & bit) != 0 and not _stays_apart(memory, c, q, least + allowances[c]):
                    left |= bit
            if left != 0 or groups[i] != 0:
                place_solids(memory, q)
                status[i] = _verdict(memory, left, groups[i], q)
                if all_free and status[i] != FREE:
                    return doubts
    return doubts


@compiled("int64(float64[::1], int64, int64)")
def pair_verdict(memory: Array, a: int, o: int) -> int:
    """Return the verdict on an object of the scene and a solid of the robot that no joint moves.

    Args:
        memory: The robot's block, shape (s,).
        a: Index of the solid.
        o: Index of the object in the scene's block.
    """
    place_solids(memory, section(memory, FROZEN))
    return int(_pair(memory, scene_of(memory), a, o, HEAD.margin(head_of(memory)), 0))


@compiled("int64(float64[::1], float64[::1], float64[:, ::1], float64, uint8[::1])")
def near_robot(memory: Array, q: Array, points: Array, margin: float, near: NDArray[np.uint8]) -> int:
    """Mark points that are nearer to a robot's solids than a distance, or too near to decide.

    Args:
        memory: The robot's block, shape (s,).
        q: Configuration, shape (n,) [rad or m].
        points: Points in the world, shape (k, 3) [m].
        margin: The distance [m].
        near: Output: 1 for each marked point, else 0, shape (k,).

    Returns:
        The number of marked points.
    """
    scratch, count = address_of(memory, PAIR_WORKSPACE), 0
    axis = POINT_WORKSPACE.axis_at(scratch)
    near[:] = 0
    place_solids(memory, q)
    for a in range(section(memory, SOLIDS).size // SOLID.width):
        row, core = SOLID.at(address_of(memory, SOLIDS), a), _core(memory, a)
        threshold, reach = SOLID.radius(row) + margin, SOLID.bounding(row) + margin + TIE_WIDTH
        for p in range(points.shape[0]):
            place = VECTORS.at(points.ctypes.data, p)
            x, y, z = between(place, core.pose)
            if near[p] == 0 and x * x + y * y + z * z <= reach * reach:
                if core.kind == CLOUD:
                    address = section_bits(memory, CLOUDS)[a]
                    verdict = point_in_cloud(place, core.pose, address, threshold, TIE_WIDTH)
                else:
                    verdict = point_verdict(core, place, threshold, TIE_WIDTH, axis, scratch)
                if verdict != FREE:
                    near[p] = 1
                    count += 1
    return count
