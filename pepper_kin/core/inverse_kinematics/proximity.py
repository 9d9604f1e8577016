"""Distances of near shapes at a configuration, and their gradients, for the local solver.

Shapes are convex cores grown by a radius: boxes, of which segments and points are the flat ones, cylinders,
and hulls of points.  Distances are signed: where two overlap, minus how far these have to part.  They guide
descents; the exact check decides whether something touches.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.collision.layout import BOX, CYLINDER, HULL
from pepper_kin.core.collision.segments import clamp, nearest_on_segments, nearest_to_box
from pepper_kin.core.kinematic_tree import JOINT, compose, place_joints
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.signatures import Floats1, Floats2

SHAPE = 21
"""Numbers of a shape: kind (BOX, CYLINDER or HULL), joint, its pose there (12), half lengths (3), radius,
reach from the center, first vertex, number of vertices."""

PAIR = 4
"""Numbers of a pair: two shapes, a segment first if there is one; how far they shall stay apart [m]; the
distance of their centers from which on they do, squared [m^2]."""

RANGE = 4
"""Numbers of a dependent range: two joints, place in the tables, number of rows; the tables hold positions of
the first joint, then least and greatest positions of the second."""

FULL = 3
"""Numbers of a coordinate of the tree: the joint on which it depends, gain and offset."""

HEAD = 9
"""Numbers at the beginning of a block: joints of the robot, joints of the tree with the universe, shapes,
pairs, ranges, numbers in their tables, vertices, meters for a radian where joints leave a dependent range,
and how far shapes shall stay apart beyond their margins [m]."""

LEAST_ANGLE = 0.005
"""A joint shall keep this from the ends of a dependent range [rad]."""

MEETING = 1e-6
"""Cores nearer than this meet: they are parted along axes of the separating axis theorem [m]."""

ROUNDS, ENOUGH = 24, 0.02
"""Steps towards the nearest points of cores that are no segments or boxes, and which part of the distance may
be left."""


class Surroundings(NamedTuple):
    """The tables of a block; see the constants above for their rows.

    Attributes:
        joints: See `core.kinematic_tree`, shape (njoints, JOINT).
        full: Shape (njoints - 1, FULL).
        above: 1 where a joint is moved by a coordinate of the tree, shape (njoints, njoints - 1).
        shapes: Shape (s, SHAPE).
        pairs: Shape (p, PAIR).
        ranges: Shape (r, RANGE).
        tables: Of the ranges [rad], shape (t,).
        vertices: Of the hulls, in the frames of their cores [m], shape (v, 3).
        q_full: Written: coordinates of the tree [rad or m], shape (njoints - 1,).
        poses: Written: of the joints in the world, shape (njoints, 12).
        axes: Written: of the joints in the world, shape (njoints, 3).
        placed: Written: poses of the cores in the world, shape (s, 12).
        lever: Meters for a radian where joints leave a dependent range.
        apart: How far shapes shall stay apart beyond their margins [m].
    """

    joints: Floats2
    full: Floats2
    above: Floats2
    shapes: Floats2
    pairs: Floats2
    ranges: Floats2
    tables: Floats1
    vertices: Floats2
    q_full: Floats1
    poses: Floats2
    axes: Floats2
    placed: Floats2
    lever: float
    apart: float


@compiled
def _take(memory: int, place: int, rows: int, columns: int) -> Floats2:
    """Return a table of a block."""
    return floats_at(memory + 8 * place, rows * columns).reshape((rows, columns))


def sizes(joints: int, shapes: int, pairs: int, ranges: int, numbers: int, vertices: int) -> list[int]:
    """Return how many doubles each table of a block has, after its head, in order."""
    return [
        JOINT * joints, FULL * (joints - 1), joints * (joints - 1), SHAPE * shapes, PAIR * pairs,
        RANGE * ranges, numbers, 3 * vertices, joints - 1, 12 * joints, 3 * joints, 12 * shapes,
    ]  # fmt: skip


@compiled
def _surroundings(memory: int) -> Surroundings:
    """Return the tables of a block at an address."""
    head = floats_at(memory, HEAD)
    nj, ns, np_, nr, nt, nv = (
        int(head[1]), int(head[2]), int(head[3]), int(head[4]), int(head[5]), int(head[6]),
    )  # fmt: skip
    at = HEAD
    joints = _take(memory, at, nj, JOINT)
    at += JOINT * nj
    full = _take(memory, at, nj - 1, FULL)
    at += FULL * (nj - 1)
    above = _take(memory, at, nj, nj - 1)
    at += nj * (nj - 1)
    shapes = _take(memory, at, ns, SHAPE)
    at += SHAPE * ns
    pairs = _take(memory, at, np_, PAIR)
    at += PAIR * np_
    ranges = _take(memory, at, nr, RANGE)
    at += RANGE * nr
    tables = floats_at(memory + 8 * at, nt)
    at += nt
    vertices = _take(memory, at, nv, 3)
    at += 3 * nv
    q_full = floats_at(memory + 8 * at, nj - 1)
    at += nj - 1
    poses = _take(memory, at, nj, 12)
    at += 12 * nj
    axes = _take(memory, at, nj, 3)
    at += 3 * nj
    return Surroundings(
        joints, full, above, shapes, pairs, ranges, tables, vertices, q_full, poses, axes,
        _take(memory, at, ns, 12), head[7], head[8],
    )  # fmt: skip


@compiled(lean=True)
def _farthest(s: Surroundings, k: int, u: float, v: float, w: float, point: Floats1) -> float:
    """Write the point, shape (3,), of a core that lies farthest along (u, v, w); return (u, v, w) . it.

    The product counts from the core's center.
    """
    shape, pose = s.shapes[k], s.placed[k]
    a = u * pose[3] + v * pose[4] + w * pose[5]
    b = u * pose[6] + v * pose[7] + w * pose[8]
    c = u * pose[9] + v * pose[10] + w * pose[11]
    if shape[0] == HULL:
        first, best = int(shape[19]), 0
        height = -math.inf
        for i in range(first, first + int(shape[20])):
            along = a * s.vertices[i, 0] + b * s.vertices[i, 1] + c * s.vertices[i, 2]
            if along > height:
                height, best = along, i
        x, y, z = s.vertices[best, 0], s.vertices[best, 1], s.vertices[best, 2]
    else:
        # Along a face, any of its points will do: the middle.
        flat = 1e-6 * (abs(u) + abs(v) + abs(w))
        x = shape[14] * (0.0 if abs(a) <= flat else 1.0 if a > 0.0 else -1.0)
        y = shape[15] * (0.0 if abs(b) <= flat else 1.0 if b > 0.0 else -1.0)
        z = shape[16] * (0.0 if abs(c) <= flat else 1.0 if c > 0.0 else -1.0)
        if shape[0] == CYLINDER:
            across = math.sqrt(a * a + b * b)
            x, y = (shape[14] * a / across, shape[14] * b / across) if across > flat else (0.0, 0.0)
    for i in range(3):
        point[i] = pose[i] + x * pose[3 + i] + y * pose[6 + i] + z * pose[9 + i]
    return a * x + b * y + c * z


@compiled(lean=True)
def _part(s: Surroundings, a: int, b: int, p: Floats1, q: Floats1, n: Floats1) -> float:
    """Write the axis that parts two cores best, from b to a, and their points that are deepest along it.

    Of the axes of the separating axis theorem for the boxes around them (Gottschalk, Lin and Manocha,
    OBBTree, 1996), and the line of the centers across the axis of a cylinder.

    Args:
        s: The tables.
        a: One shape.
        b: The other.
        p: Written: the point of the first, shape (3,) [m].
        q: Written: that of the second, shape (3,).
        n: Written: the axis, a unit vector, shape (3,).

    Returns:
        How far the cores are apart along that axis, below zero where they overlap [m].
    """
    first, second, best = s.placed[a], s.placed[b], -math.inf
    x, y, z = first[0] - second[0], first[1] - second[1], first[2] - second[2]
    for k in range(17):
        if k < 3:
            u, v, w = first[3 + 3 * k], first[4 + 3 * k], first[5 + 3 * k]
        elif k < 6:
            u, v, w = second[3 * k - 6], second[3 * k - 5], second[3 * k - 4]
        elif k < 15:
            i, j = 3 + 3 * ((k - 6) // 3), 3 + 3 * ((k - 6) % 3)
            u = first[i + 1] * second[j + 2] - first[i + 2] * second[j + 1]
            v = first[i + 2] * second[j] - first[i] * second[j + 2]
            w = first[i] * second[j + 1] - first[i + 1] * second[j]
        else:
            pose = first if k == 15 else second
            if s.shapes[a if k == 15 else b, 0] != CYLINDER:
                continue
            along = x * pose[9] + y * pose[10] + z * pose[11]
            u, v, w = x - along * pose[9], y - along * pose[10], z - along * pose[11]
        length = math.sqrt(u * u + v * v + w * w)
        if length < 1e-6:
            continue
        length = (1.0 if u * x + v * y + w * z >= 0.0 else -1.0) / length
        u, v, w = u * length, v * length, w * length
        apart = u * x + v * y + w * z - _farthest(s, a, -u, -v, -w, p) - _farthest(s, b, u, v, w, q)
        if apart > best + 1e-9:
            best = apart
            n[0], n[1], n[2] = u, v, w
    _farthest(s, a, -n[0], -n[1], -n[2], p)
    _farthest(s, b, n[0], n[1], n[2], q)
    return best


@compiled(lean=True)
def _approach(s: Surroundings, a: int, b: int, p: Floats1, q: Floats1, n: Floats1, scratch: Floats2) -> float:
    """Write nearly the nearest points of two cores; return their distance, 0 where they seem to meet [m].

    By steps towards the origin in the difference of the two (Gilbert, An iterative procedure for computing
    the minimum of a quadratic form on a convex set, 1966).

    Args:
        s: The tables.
        a: One shape.
        b: The other.
        p: Written: the point of the first, shape (3,) [m].
        q: Written: that of the second, shape (3,).
        n: Written unless they meet: the direction from q to p, a unit vector, shape (3,).
        scratch: Workspace, shape (2, 3).
    """
    for i in range(3):
        p[i], q[i] = s.placed[a, i], s.placed[b, i]
    for _ in range(ROUNDS):
        x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        square = x * x + y * y + z * z
        if square < MEETING:  # a millimeter, squared
            return 0.0
        _farthest(s, a, -x, -y, -z, scratch[0])
        _farthest(s, b, x, y, z, scratch[1])
        u, v, w = scratch[0, 0] - scratch[1, 0], scratch[0, 1] - scratch[1, 1], scratch[0, 2] - scratch[1, 2]
        left = square - (x * u + y * v + z * w)
        if left <= ENOUGH * square:
            break
        u, v, w = x - u, y - v, z - w
        step = min(left / (u * u + v * v + w * w), 1.0)
        for i in range(3):
            p[i] += step * (scratch[0, i] - p[i])
            q[i] += step * (scratch[1, i] - q[i])
    x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    gap = math.sqrt(x * x + y * y + z * z)
    if gap < 1e-3:
        return 0.0
    n[0], n[1], n[2] = x / gap, y / gap, z / gap
    return gap


@compiled(lean=True)
def _is_segment(shape: Floats1) -> bool:
    """Whether the core of a shape, a row of shape (SHAPE,), is a segment or a point."""
    return shape[0] == BOX and shape[14] == 0.0 and shape[15] == 0.0


@compiled(lean=True)
def _measure(s: Surroundings, i: int, j: int, p: Floats1, q: Floats1, n: Floats1, scratch: Floats2) -> float:
    """Write the nearest points of two shapes' cores and the direction from the second to the first.

    Where they overlap, the points are those that are deepest.

    Args:
        s: The tables.
        i: The first shape.
        j: The second.
        p: Written: the point of the first, in the world, shape (3,) [m].
        q: Written: that of the second, shape (3,).
        n: Written: the direction, a unit vector, shape (3,).
        scratch: Workspace, shape (2, 3).

    Returns:
        The signed distance of the shapes [m].
    """
    first, a, second, b = s.shapes[i], s.placed[i], s.shapes[j], s.placed[j]
    radii, gap = first[17] + second[17], 0.0
    if _is_segment(first) and second[0] == BOX:
        if _is_segment(second):
            along, other = nearest_on_segments(a, first[16], b, second[16])
            for k in range(3):
                p[k], q[k] = a[k] + along * a[9 + k], b[k] + other * b[9 + k]
        else:
            along, _ = nearest_to_box(a, first[16], b, second[14:17])
            for k in range(3):
                p[k], q[k] = a[k] + along * a[9 + k], b[k]
            for axis in range(3):
                across = 0.0
                for k in range(3):
                    across += (p[k] - b[k]) * b[3 + 3 * axis + k]
                across = clamp(across, second[14 + axis])
                for k in range(3):
                    q[k] += across * b[3 + 3 * axis + k]
        x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        gap = math.sqrt(x * x + y * y + z * z)
        if gap > MEETING:
            n[0], n[1], n[2] = x / gap, y / gap, z / gap
            return gap - radii
    elif first[0] != BOX or second[0] != BOX:
        gap = _approach(s, i, j, p, q, n, scratch)
        if gap > 0.0:
            return gap - radii
    return _part(s, i, j, p, q, n) - radii


@compiled(lean=True)
def _write_slopes(s: Surroundings, a: int, b: int, p: Floats1, q: Floats1, n: Floats1, row: Floats1) -> None:
    """Add the derivatives of a distance of two bodies by the joints to a row.

    Args:
        s: The tables.
        a: Joint that carries the first, 0 for none.
        b: Joint that carries the second.
        p: Nearest point of the first, shape (3,) [m].
        q: Nearest point of the second, shape (3,).
        n: Unit vector from the second to the first, shape (3,).
        row: Changed, shape (>= n,) [m/rad or 1].
    """
    for j in range(s.above.shape[1]):
        side = s.above[a, j] - s.above[b, j]
        if side == 0.0:
            continue
        u, o = s.axes[j + 1], s.poses[j + 1]
        if s.joints[j + 1, 1] > 0.0:
            slope = n[0] * u[0] + n[1] * u[1] + n[2] * u[2]
        else:
            point = p if side > 0.0 else q
            x, y, z = point[0] - o[0], point[1] - o[1], point[2] - o[2]
            slope = n[0] * (u[1] * z - u[2] * y) + n[1] * (u[2] * x - u[0] * z) + n[2] * (u[0] * y - u[1] * x)
        row[int(s.full[j, 0])] += side * slope * s.full[j, 1]


@compiled(lean=True)
def _range_fault(s: Surroundings, k: int, q: Floats1, row: Floats1) -> float:
    """Return how far one of two joints is off a dependent range, times `lever` [m], or 0; write its slope.

    Of the two ways, with the second joint into the range and with the first to where the range is wider, the
    shorter one counts.

    Args:
        s: The tables.
        k: The range.
        q: Configuration, shape (n,) [rad or m].
        row: Zeros, shape (>= n,); receives the slope of the joint that has to move [m/rad].
    """
    count, place = int(s.ranges[k, 3]), int(s.ranges[k, 2])
    i, j = int(s.ranges[k, 0]), int(s.ranges[k, 1])
    x, y = q[i], q[j]
    rows, low, high = s.tables[place:], s.tables[place + count :], s.tables[place + 2 * count :]
    cell = 0
    while cell + 2 < count and rows[cell + 1] <= x:
        cell += 1
    least, most = max(low[cell], low[cell + 1]) + LEAST_ANGLE, min(high[cell], high[cell + 1]) - LEAST_ANGLE
    if least <= y <= most:
        return 0.0
    best, slope, joint = math.inf, 0.0, j
    if least <= most:
        best, slope = (least - y, 1.0) if y < least else (y - most, -1.0)
    for c in range(count - 1):
        if c == cell:
            continue
        if max(low[c], low[c + 1]) + LEAST_ANGLE <= y <= min(high[c], high[c + 1]) - LEAST_ANGLE:
            way = rows[c] - x if c > cell else x - rows[c + 1]
            if way + LEAST_ANGLE < best:
                best, slope, joint = way + LEAST_ANGLE, 1.0 if c > cell else -1.0, i
    if best == math.inf:
        return 0.0
    row[joint] = slope * s.lever
    return best * s.lever


@compiled(lean=True)
def _turn(s: Surroundings, k: int, turned: Floats1) -> None:
    """Write the axes of a shape, whose center is written, once; `turned`, shape (shapes,), marks it."""
    if turned[k] == 0.0 and s.shapes[k, 1] > 0.0:
        compose(s.poses[int(s.shapes[k, 1])], s.shapes[k, 2:14], s.placed[k])
    turned[k] = 1.0


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def near_rows(configuration: int, result: int, count: int, memory: int) -> int:
    """Write what is nearer at a configuration than it shall be; return the number of rows.

    A row has dd/dq, shape (n,), the shortage (how far two shapes, or two joints, shall part) [m], and the
    shortage less `apart` [m], above zero where they touch or are nearer than their margin.

    Args:
        configuration: Address of q, shape (n,) [rad or m].
        result: Address of the rows, shape (count, n + 2) [m/rad or 1, then m].
        count: Rows at most.
        memory: Address of a block, see HEAD, whose last tables are written.
    """
    s = _surroundings(memory)
    n = int(floats_at(memory, 1)[0])
    q, rows = floats_at(configuration, n), floats_at(result, count * (n + 2)).reshape((count, n + 2))
    for k in range(s.q_full.size):
        s.q_full[k] = q[int(s.full[k, 0])] * s.full[k, 1] + s.full[k, 2]
    place_joints(s.joints, s.q_full, s.poses, s.axes)
    for k in range(s.shapes.shape[0]):
        shape, pose = s.shapes[k], s.poses[int(s.shapes[k, 1])]
        for i in range(3 if shape[1] > 0.0 else 0):
            s.placed[k, i] = (
                pose[i] + shape[2] * pose[3 + i] + shape[3] * pose[6 + i] + shape[4] * pose[9 + i]
            )
    turned = np.zeros(s.shapes.shape[0])
    first, second, normal, scratch, found = np.empty(3), np.empty(3), np.empty(3), np.empty((2, 3)), 0
    for k in range(s.pairs.shape[0]):
        a, b = int(s.pairs[k, 0]), int(s.pairs[k, 1])
        x, y, z = (
            s.placed[a, 0] - s.placed[b, 0],
            s.placed[a, 1] - s.placed[b, 1],
            s.placed[a, 2] - s.placed[b, 2],
        )
        if x * x + y * y + z * z > s.pairs[k, 3]:
            continue
        _turn(s, a, turned)
        _turn(s, b, turned)
        distance = _measure(s, a, b, first, second, normal, scratch)
        shortage = s.pairs[k, 2] - distance
        if shortage <= 0.0 or found == count:
            continue
        rows[found] = 0.0
        _write_slopes(s, int(s.shapes[a, 1]), int(s.shapes[b, 1]), first, second, normal, rows[found])
        rows[found, n], rows[found, n + 1] = shortage, shortage - s.apart
        found += 1
    for k in range(s.ranges.shape[0]):
        if found == count:
            break
        rows[found] = 0.0
        shortage = _range_fault(s, k, q, rows[found])
        if shortage > 0.0:
            rows[found, n], rows[found, n + 1] = shortage, shortage - s.lever * LEAST_ANGLE
            found += 1
    return found


@compiled("void(int64)")
def place_still(memory: int) -> None:
    """Write the poses of the shapes that no joint moves, once for a block."""
    s = _surroundings(memory)
    world = np.zeros(12)
    world[3], world[7], world[11] = 1.0, 1.0, 1.0
    for k in range(s.shapes.shape[0]):
        if s.shapes[k, 1] == 0.0:
            compose(world, s.shapes[k, 2:14], s.placed[k])
