"""What is near at a configuration: distances of shapes and how the joints change them, for descents.

Shapes are segments grown by a radius, boxes and half-spaces; what is none of these stands as the box around
it.  Distances are signed: where two overlap, they tell how far these have to part.  They guide descents;
whether something touches is for the exact check to tell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.collision.segments import clamp, nearest_on_segments, nearest_to_box
from pepper_kin.core.kinematic_tree import JOINT, compose, place_joints
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.signatures import Floats1, Floats2

SEGMENT, BLOCK, PLANE = 0, 1, 2
"""Kinds of shapes: a segment along z grown by a radius, a box, a half-space below its z axis."""

SHAPE = 19
"""Numbers of a shape: kind, joint, its pose there (12), half lengths (3), radius, reach from the center."""

PAIR = 4
"""Numbers of a pair: two shapes, the first no half-space, and a segment where one of them is; how far they
shall stay apart [m]; the distance of their centers from which on they do [m], infinite for half-spaces."""

RANGE = 4
"""Numbers of a dependent range: two joints, place in the tables, number of rows; the tables hold positions of
the first joint, then least and greatest positions of the second."""

FULL = 3
"""Numbers of a coordinate of the tree: the joint on which it depends, gain and offset."""

HEAD = 8
"""Numbers at the beginning of a block: joints of the robot, joints of the tree with the universe, shapes,
pairs, ranges, numbers in their tables, meters for a radian where joints leave a dependent range, and how far
shapes shall stay apart where they only must not touch [m]."""

LEAST_ANGLE = 0.005
"""A joint shall keep this from the ends of a dependent range [rad]."""

MEETING = 1e-6
"""Cores nearer than this meet: their faces tell how to part them [m]."""


class Surroundings(NamedTuple):
    """The tables of a block; see the constants above for their rows."""

    joints: Floats2
    full: Floats2
    above: Floats2
    shapes: Floats2
    pairs: Floats2
    ranges: Floats2
    tables: Floats1
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


def sizes(joints: int, shapes: int, pairs: int, ranges: int, numbers: int) -> list[int]:
    """Return how many doubles each table of a block has, after its head, in order."""
    return [
        JOINT * joints, FULL * (joints - 1), joints * (joints - 1), SHAPE * shapes, PAIR * pairs,
        RANGE * ranges, numbers, joints - 1, 12 * joints, 3 * joints, 12 * shapes,
    ]  # fmt: skip


@compiled
def _surroundings(memory: int) -> Surroundings:
    """Return the tables of a block at an address."""
    head = floats_at(memory, HEAD)
    nj, ns, np_, nr, nt = int(head[1]), int(head[2]), int(head[3]), int(head[4]), int(head[5])
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
    q_full = floats_at(memory + 8 * at, nj - 1)
    at += nj - 1
    poses = _take(memory, at, nj, 12)
    at += 12 * nj
    axes = _take(memory, at, nj, 3)
    at += 3 * nj
    return Surroundings(
        joints, full, above, shapes, pairs, ranges, tables, q_full, poses, axes,
        _take(memory, at, ns, 12), head[6], head[7],
    )  # fmt: skip


@compiled(lean=True)
def _separation(a: Floats1, half_a: Floats1, b: Floats1, half_b: Floats1, n: Floats1) -> float:
    """Return the signed distance of two boxes along the axis that parts them best, written from b to a [m].

    Of the 15 axes of the separating axis theorem (Gottschalk, Lin and Manocha, OBBTree, 1996).
    """
    best = -math.inf
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    for k in range(15):
        if k < 3:
            u, v, w = a[3 + 3 * k], a[4 + 3 * k], a[5 + 3 * k]
            if half_a[k] == 0.0:
                continue
        elif k < 6:
            u, v, w = b[3 * k - 6], b[3 * k - 5], b[3 * k - 4]
        else:
            i, j = 3 + 3 * ((k - 6) // 3), 3 + 3 * ((k - 6) % 3)
            u = a[i + 1] * b[j + 2] - a[i + 2] * b[j + 1]
            v = a[i + 2] * b[j] - a[i] * b[j + 2]
            w = a[i] * b[j + 1] - a[i + 1] * b[j]
            length = u * u + v * v + w * w
            if length < 1e-6 or half_a[(k - 6) // 3] == 0.0:
                continue
            length = 1.0 / math.sqrt(length)
            u, v, w = u * length, v * length, w * length
        along = u * x + v * y + w * z
        apart = abs(along)
        for i in range(3):
            apart -= half_a[i] * abs(u * a[3 + 3 * i] + v * a[4 + 3 * i] + w * a[5 + 3 * i])
            apart -= half_b[i] * abs(u * b[3 + 3 * i] + v * b[4 + 3 * i] + w * b[5 + 3 * i])
        if apart > best + 1e-9:
            best, sign = apart, 1.0 if along >= 0.0 else -1.0
            n[0], n[1], n[2] = sign * u, sign * v, sign * w
    return best


@compiled(lean=True)
def _deepest(pose: Floats1, half: Floats1, n: Floats1, sign: float, point: Floats1) -> None:
    """Write the point of a box that lies farthest along sign times n."""
    for i in range(3):
        point[i] = pose[i]
    for k in range(3):
        along = sign * (n[0] * pose[3 + 3 * k] + n[1] * pose[4 + 3 * k] + n[2] * pose[5 + 3 * k])
        if abs(along) > 1e-6:
            step = half[k] if along > 0.0 else -half[k]
            for i in range(3):
                point[i] += step * pose[3 + 3 * k + i]


@compiled(lean=True)
def _measure(
    first: Floats1, a: Floats1, second: Floats1, b: Floats1, p: Floats1, q: Floats1, n: Floats1
) -> float:
    """Write the nearest points of two shapes and the direction from the second to the first.

    Returns:
        Their signed distance [m].
    """
    half_a, half_b, radii = first[14:17], second[14:17], first[17] + second[17]
    if second[0] == PLANE:
        n[0], n[1], n[2] = b[9], b[10], b[11]
        _deepest(a, half_a, n, -1.0, p)
        height = 0.0
        for i in range(3):
            height += (p[i] - b[i]) * n[i]
        return height - radii
    if first[0] == SEGMENT:
        if second[0] == SEGMENT:
            s, t = nearest_on_segments(a, half_a[2], b, half_b[2])
            for i in range(3):
                p[i], q[i] = a[i] + s * a[9 + i], b[i] + t * b[9 + i]
        else:
            s, _ = nearest_to_box(a, half_a[2], b, half_b)
            for i in range(3):
                p[i], q[i] = a[i] + s * a[9 + i], b[i]
            for axis in range(3):
                along = 0.0
                for i in range(3):
                    along += (p[i] - b[i]) * b[3 + 3 * axis + i]
                along = clamp(along, half_b[axis])
                for i in range(3):
                    q[i] += along * b[3 + 3 * axis + i]
        x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        gap = math.sqrt(x * x + y * y + z * z)
        if gap > MEETING:
            n[0], n[1], n[2] = x / gap, y / gap, z / gap
            return gap - radii
    gap = _separation(a, half_a, b, half_b, n)
    _deepest(a, half_a, n, -1.0, p)
    _deepest(b, half_b, n, 1.0, q)
    return gap - radii


@compiled(lean=True)
def _write_slopes(s: Surroundings, a: int, b: int, p: Floats1, q: Floats1, n: Floats1, row: Floats1) -> None:
    """Write how the joints change the distance of two shapes at nearest points p and q."""
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
    """Return how far one of two joints has to go to keep a dependent range [rad], or 0; write its direction.

    Of the two ways, with the second joint into the range and with the first to where the range is wider, the
    shorter one counts.
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


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def near_rows(configuration: int, result: int, count: int, memory: int) -> int:
    """Write what is nearer at a configuration than it has to be; return the number of rows.

    A row has dd/dq, shape (n,), the shortage (how far two shapes, or two joints, shall part) [m], and how
    much of it has to be made good before they cease to touch [m].

    Args:
        configuration: Address of q, shape (n,) [rad or m].
        result: Address of the rows, shape (count, n + 2).
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
        if s.shapes[k, 1] > 0.0:
            compose(s.poses[int(s.shapes[k, 1])], s.shapes[k, 2:14], s.placed[k])
    first, second, normal, found = np.empty(3), np.empty(3), np.empty(3), 0
    for k in range(s.pairs.shape[0]):
        a, b = int(s.pairs[k, 0]), int(s.pairs[k, 1])
        x, y, z = (
            s.placed[a, 0] - s.placed[b, 0],
            s.placed[a, 1] - s.placed[b, 1],
            s.placed[a, 2] - s.placed[b, 2],
        )
        if x * x + y * y + z * z > s.pairs[k, 3] * s.pairs[k, 3]:
            continue
        distance = _measure(s.shapes[a], s.placed[a], s.shapes[b], s.placed[b], first, second, normal)
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
