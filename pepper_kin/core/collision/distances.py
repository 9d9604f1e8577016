"""Signed distances of convex shapes, their nearest points, and gradients of the distances.

Shapes are convex cores grown by a radius: boxes (segments and points are flat boxes), cylinders, convex hulls
of points, and half-spaces.  Where cores overlap, the distance is minus the depth by which they would have to
be moved apart.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.collision.gjk import nearest_in_hull
from pepper_kin.core.collision.layout import BOX, CYLINDER, HULL
from pepper_kin.core.collision.scene_rows import BOUNDING, HALF, KIND, PLACE, RADIUS, ROW
from pepper_kin.core.collision.segments import clamp, nearest_on_segments, nearest_to_box
from pepper_kin.core.kinematic_tree import compose
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1, Ints2

PLANE = 5
"""Kind of a half-space, in addition to the kinds of `layout`: it ends at the upper face of its box."""

KNOWN = (BOX, CYLINDER, PLANE)
"""Kinds whose core is the whole shape, for which `measure` is exact."""

CARRIER, FIRST, COUNT, SHAPE = ROW, ROW + 1, ROW + 2, ROW + 3
"""Columns of a shape after the columns of `scene_rows`, and their total number: the joint that carries it,
first vertex and number of vertices of a HULL.  The bounding radius of a PLANE is infinite."""

MEETING = 1e-6
"""Distance below which cores count as overlapping and are measured along axes of the separating axis
theorem [m]."""

SLACK = 1e-5
"""Maximum error by which coal's distances are too small [m]."""

STEPS, ENOUGH = 40, 1e-9
"""Maximum number of iterations of the search for the nearest points of general cores, and relative tolerance
of the squared distance."""

SCRATCH = 64
"""Doubles of workspace that `measure` needs: workspace of `gjk`, and the points of two cores at four
corners."""
_CORNERS = 40


class NearTable(NamedTuple):
    """The shapes of a robot and a scene, and the pairs of them that are compared.

    Attributes:
        joints: Placements of the joints, see `core.kinematic_tree`, shape (njoints, JOINT).
        above: 1 where a joint is moved by a coordinate of the tree, shape (njoints, njoints - 1).
        shapes: Shapes by the columns CARRIER, ..., shape (s, SHAPE).
        vertices: Vertices of the hulls, in the frames of their cores [m], shape (v, 3).
        pairs: Two shapes, a segment first and a half-space second if there is one; and 1 if they are swapped
            in results, else 0, shape (m, 3).
        reaches: Distance of the two centers beyond which the shapes cannot touch, shape (m,) [m].
        keep: Distance that the two shapes have to keep, shape (m,) [m].
    """

    joints: Floats2
    above: Floats2
    shapes: Floats2
    vertices: Floats2
    pairs: Ints2
    reaches: Floats1
    keep: Floats1


class NearPoints(NamedTuple):
    """Output and workspace of `find_near`, for m pairs at most.

    Attributes:
        found: Indices of the pairs that are near, shape (m,).
        distances: Distances of the pairs, shape (m,) [m].
        points: Nearest points of the pairs in the world, shape (m, 2, 3) [m].
        normals: Unit vectors from the second to the first shape, in the world, shape (m, 3).
        undecided: Indices of pairs that may be nearer and have to be measured by coal, shape (m,).
        placed: Poses of the cores in the world, shape (s, 12); for those that no joint moves it is input.
        near: Workspace, shape (3, 3).
        work: Workspace, shape (SCRATCH + s,).
    """

    found: Ints1
    distances: Floats1
    points: Floats3
    normals: Floats2
    undecided: Ints1
    placed: Floats2
    near: Floats2
    work: Floats1


def near_points(table: NearTable, most: int, undecided: int) -> NearPoints:
    """Return memory for the results of `most` pairs and `undecided` undecided pairs at most."""
    return NearPoints(
        np.empty(most, np.int64), np.empty(most), np.empty((most, 2, 3)), np.empty((most, 3)),
        np.empty(undecided, np.int64), table.shapes[:, PLACE:ROW].copy(), np.empty((3, 3)),
        np.empty(SCRATCH + len(table.shapes)),
    )  # fmt: skip


@compiled(lean=True)
def is_segment(shape: Floats1) -> bool:
    """Return whether the core of a shape, shape (SHAPE,), is a segment along z or a point."""
    return shape[KIND] == BOX and shape[HALF] == 0.0 and shape[HALF + 1] == 0.0


@compiled(lean=True)
def _farthest(
    shape: Floats1, pose: Floats1, vertices: Floats2, u: float, v: float, w: float, point: Floats1
) -> float:
    """Write a core's support point along (u, v, w), shape (3,); return its product with (u, v, w).

    The product uses the point relative to the core's center.
    """
    a = u * pose[3] + v * pose[4] + w * pose[5]
    b = u * pose[6] + v * pose[7] + w * pose[8]
    c = u * pose[9] + v * pose[10] + w * pose[11]
    if shape[KIND] == HULL:
        first, best = int(shape[FIRST]), 0
        height = -math.inf
        for i in range(first, first + int(shape[COUNT])):
            along = a * vertices[i, 0] + b * vertices[i, 1] + c * vertices[i, 2]
            if along > height:
                height, best = along, i
        x, y, z = vertices[best, 0], vertices[best, 1], vertices[best, 2]
    else:
        # Along a face, any of its points is a support point: the middle is taken.
        flat = 1e-6 * (abs(u) + abs(v) + abs(w))
        x = shape[HALF] * (0.0 if abs(a) <= flat else 1.0 if a > 0.0 else -1.0)
        y = shape[HALF + 1] * (0.0 if abs(b) <= flat else 1.0 if b > 0.0 else -1.0)
        z = shape[HALF + 2] * (0.0 if abs(c) <= flat else 1.0 if c > 0.0 else -1.0)
        if shape[KIND] == CYLINDER:
            across = math.sqrt(a * a + b * b)
            x, y = (shape[HALF] * a / across, shape[HALF] * b / across) if across > flat else (0.0, 0.0)
    for i in range(3):
        point[i] = pose[i] + x * pose[3 + i] + y * pose[6 + i] + z * pose[9 + i]
    return a * x + b * y + c * z


@compiled(lean=True)
def _part(
    first: Floats1,
    pose: Floats1,
    second: Floats1,
    other: Floats1,
    vertices: Floats2,
    far: float,
    near: Floats2,
) -> float:
    """Write the best separating axis of two cores and their deepest points along it; see `measure`.

    The axes are those of the separating axis theorem for the boxes around the cores (Gottschalk, Lin and
    Manocha, OBBTree, 1996), and the line of the centers projected across the axis of a cylinder.

    Returns:
        Separation of the cores along that axis, negative where they overlap [m].
    """
    p, q, n, best = near[0], near[1], near[2], -math.inf
    x, y, z = pose[0] - other[0], pose[1] - other[1], pose[2] - other[2]
    for k in range(17):
        if k < 3:
            u, v, w = pose[3 + 3 * k], pose[4 + 3 * k], pose[5 + 3 * k]
        elif k < 6:
            u, v, w = other[3 * k - 6], other[3 * k - 5], other[3 * k - 4]
        elif k < 15:
            i, j = 3 + 3 * ((k - 6) // 3), 3 + 3 * ((k - 6) % 3)
            u = pose[i + 1] * other[j + 2] - pose[i + 2] * other[j + 1]
            v = pose[i + 2] * other[j] - pose[i] * other[j + 2]
            w = pose[i] * other[j + 1] - pose[i + 1] * other[j]
        else:
            if (first if k == 15 else second)[KIND] != CYLINDER:
                continue
            axis = pose if k == 15 else other
            along = x * axis[9] + y * axis[10] + z * axis[11]
            u, v, w = x - along * axis[9], y - along * axis[10], z - along * axis[11]
        length = math.sqrt(u * u + v * v + w * w)
        if length < 1e-6:
            continue
        length = (1.0 if u * x + v * y + w * z >= 0.0 else -1.0) / length
        u, v, w = u * length, v * length, w * length
        apart = u * x + v * y + w * z
        apart -= _farthest(first, pose, vertices, -u, -v, -w, p)
        apart -= _farthest(second, other, vertices, u, v, w, q)
        if apart > best + 1e-9:
            best = apart
            n[0], n[1], n[2] = u, v, w
        if best > far:
            break
    _farthest(first, pose, vertices, -n[0], -n[1], -n[2], p)
    _farthest(second, other, vertices, n[0], n[1], n[2], q)
    return best


@compiled(lean=True)
def _approach(
    first: Floats1, pose: Floats1, second: Floats1, other: Floats1, vertices: Floats2, far: float,
    near: Floats2, scratch: Floats1,
) -> None:  # fmt: skip
    """Write the nearest points of two cores, which nearly coincide if the cores meet; see `measure`.

    The algorithm is by Gilbert, Johnson and Keerthi (1988), as in `gjk.nearer_than`, and also keeps both
    cores' points of each corner.
    """
    p, q, corners, weights = near[0], near[1], scratch[_CORNERS:], scratch[12:]
    count = 0
    for i in range(3):
        p[i], q[i] = pose[i], other[i]
    for _ in range(STEPS):
        x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        square = x * x + y * y + z * z
        if count == 4 or (count > 0 and square < MEETING * MEETING):
            break
        one, two = corners[6 * count :], corners[6 * count + 3 :]
        _farthest(first, pose, vertices, -x, -y, -z, one)
        _farthest(second, other, vertices, x, y, z, two)
        u, v, w = one[0] - two[0], one[1] - two[1], one[2] - two[2]
        along = x * u + y * v + z * w
        if (along > 0.0 and along * along > far * far * square) or (
            count > 0 and square - along <= ENOUGH * square
        ):
            break
        scratch[3 * count], scratch[3 * count + 1], scratch[3 * count + 2] = u, v, w
        weights[count] = 1.0 if count == 0 else 0.0
        count = nearest_in_hull(scratch, count + 1)
        if count < 0:
            break
        for i in range(3):
            p[i] = q[i] = 0.0
        place = 0
        for k in range(count):
            # The corners that are left are in order: find the pair of points of each.
            while (
                corners[6 * place] - corners[6 * place + 3] != scratch[3 * k]
                or corners[6 * place + 1] - corners[6 * place + 4] != scratch[3 * k + 1]
                or corners[6 * place + 2] - corners[6 * place + 5] != scratch[3 * k + 2]
            ):
                place += 1
            for i in range(6):
                corners[6 * k + i] = corners[6 * place + i]
            for i in range(3):
                p[i] += weights[k] * corners[6 * k + i]
                q[i] += weights[k] * corners[6 * k + 3 + i]
            place += 1


@compiled(lean=True)
def measure(
    first: Floats1, pose: Floats1, second: Floats1, other: Floats1, vertices: Floats2, far: float,
    near: Floats2, scratch: Floats1,
) -> float:  # fmt: skip
    """Write the nearest points of two cores and the direction from the second to the first.

    Where the cores overlap, the points are the deepest ones.

    Args:
        first: A shape, shape (SHAPE,); a segment if one of the two is.
        pose: Pose of the first shape's core in the world, shape (12,).
        second: Another shape, shape (SHAPE,); a half-space if one of the two is.
        other: Pose of the second shape's core in the world, shape (12,).
        vertices: Vertices of the hulls, shape (v, 3).
        far: Distance beyond which a lower bound suffices, at least 0 [m].
        near: Output: both points in the world [m], and the direction, a unit vector, shape (3, 3).
        scratch: Workspace, shape (SCRATCH,).

    Returns:
        The signed distance of the cores [m].
    """
    p, q, n = near[0], near[1], near[2]
    if second[KIND] == PLANE:
        gap = -second[HALF + 2]
        n[0], n[1], n[2] = other[9], other[10], other[11]
        _farthest(first, pose, vertices, -n[0], -n[1], -n[2], p)
        for i in range(3):
            gap += (p[i] - other[i]) * n[i]
        for i in range(3):
            q[i] = p[i] - gap * n[i]
        return gap
    if is_segment(first) and second[KIND] == BOX:
        if is_segment(second):
            along, across = nearest_on_segments(pose, first[HALF + 2], other, second[HALF + 2])
            for k in range(3):
                p[k], q[k] = pose[k] + along * pose[9 + k], other[k] + across * other[9 + k]
        else:
            along, _ = nearest_to_box(pose, first[HALF + 2], other, second[HALF:PLACE])
            for k in range(3):
                p[k], q[k] = pose[k] + along * pose[9 + k], other[k]
            for axis in range(3):
                across = 0.0
                for k in range(3):
                    across += (p[k] - other[k]) * other[3 + 3 * axis + k]
                across = clamp(across, second[HALF + axis])
                for k in range(3):
                    q[k] += across * other[3 + 3 * axis + k]
    else:
        if first[KIND] == BOX and second[KIND] == BOX:
            apart = _part(first, pose, second, other, vertices, far, near)
            if apart <= 0.0 or apart > far:
                return apart
        _approach(first, pose, second, other, vertices, far, near, scratch)
    x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    gap = math.sqrt(x * x + y * y + z * z)
    if gap <= MEETING:
        return _part(first, pose, second, other, vertices, far, near)
    n[0], n[1], n[2] = x / gap, y / gap, z / gap
    return gap


@compiled(lean=True)
def _may_be_near(first: Floats1, pose: Floats1, second: Floats1, other: Floats1, reach: float) -> bool:
    """Return whether two shapes, shapes (SHAPE,) and (12,), may be nearer than a distance [m], by a bound."""
    if second[KIND] == PLANE:
        height = -second[HALF + 2]
        for i in range(3):
            height += (pose[i] - other[i]) * other[9 + i]
        return height - first[BOUNDING] < reach + SLACK
    if not is_segment(first):
        return True
    apart = nearest_to_box(pose, first[HALF + 2], other, second[HALF:PLACE])[1]
    return not apart - first[RADIUS] - second[RADIUS] >= reach + SLACK


@compiled(lean=True)
def is_known(shape: Floats1) -> bool:
    """Return whether a shape, shape (SHAPE,), is of a KNOWN kind."""
    return shape[KIND] == KNOWN[0] or shape[KIND] == KNOWN[1] or shape[KIND] == KNOWN[2]


@compiled(lean=True)
def _turn(table: NearTable, poses: Floats2, k: int, turned: Floats1, placed: Floats2) -> None:
    """Write the axes of a core whose center is written, unless `turned`, shape (s,), marks it."""
    if turned[k] == 0.0 and table.shapes[k, CARRIER] > 0.0:
        compose(poses[int(table.shapes[k, CARRIER])], table.shapes[k, PLACE:ROW], placed[k])
    turned[k] = 1.0


@compiled(lean=True, inline=True)
def _is_beyond(shape: Floats1, pose: Floats1, x: float, y: float, z: float, far: float) -> bool:
    """Return whether the box of a shape is certainly farther than a distance from a point (x, y, z) [m].

    Args:
        shape: Shape whose core is a box or lies inside one, shape (SHAPE,).
        pose: Pose of its core in the world, shape (12,).
        x: x of the point relative to the core's center, in the world's axes [m].
        y: y of the point [m].
        z: z of the point [m].
        far: The distance, 0 or more [m].
    """
    square = 0.0
    for i in range(3):
        k = 3 + 3 * i
        out = abs(x * pose[k] + y * pose[k + 1] + z * pose[k + 2]) - shape[HALF + i]
        square += out * out if out > 0.0 else 0.0
    return square > (far + SLACK) ** 2


@compiled("Tuple(int64, int64)(float64[:, ::1], NearTable, float64, boolean, NearPoints)", lean=True)
def find_near(
    poses: Floats2, table: NearTable, distance: float, exact: bool, result: NearPoints
) -> tuple[int, int]:
    """Find the pairs that are nearer than their required distance plus a given one.

    The distance of two cores with nearest points a and b, grown by r_a and r_b, is |a - b| - r_a - r_b; a
    negative value is the depth by which they overlap.  The nearest points are a - r_a n and b + r_b n with
    n = (a - b) / |a - b|.

    Args:
        poses: Poses of the joints in the world, see `place_joints`, shape (njoints, 12).
        table: The shapes and pairs.
        distance: Pairs farther apart, and pairs beyond the size of the result, are left out [m].
        exact: Whether pairs whose distance only coal computes exactly are left undecided.
        result: Output.

    Returns:
        The number of pairs found, and the number of undecided pairs.
    """
    shapes, pairs, placed = table.shapes, table.pairs, result.placed
    for k in range(shapes.shape[0]):
        shape, pose = shapes[k], poses[int(shapes[k, CARRIER])]
        for i in range(3 if shape[CARRIER] > 0.0 else 0):
            placed[k, i] = pose[i]
            for j in range(3):
                placed[k, i] += shape[PLACE + j] * pose[3 + 3 * j + i]
    near, scratch, turned = result.near, result.work, result.work[SCRATCH:]
    for k in range(turned.size):
        turned[k] = 0.0
    count, undecided = 0, 0
    for k in range(pairs.shape[0]):
        a, b, reach = pairs[k, 0], pairs[k, 1], distance + table.keep[k]
        here, there = placed[a], placed[b]
        x, y, z = here[0] - there[0], here[1] - there[1], here[2] - there[2]
        if x * x + y * y + z * z > (table.reaches[k] + reach + SLACK) ** 2:
            continue
        first, second = shapes[a], shapes[b]
        far = reach + first[RADIUS] + second[RADIUS]
        _turn(table, poses, b, turned, placed)
        compact = second[KIND] == BOX and is_segment(first)
        if compact and _is_beyond(second, placed[b], x, y, z, far + first[HALF + 2]):
            continue
        _turn(table, poses, a, turned, placed)
        if exact and not (is_known(first) and is_known(second)):
            if _may_be_near(first, placed[a], second, placed[b], reach):
                result.undecided[undecided] = k
                undecided += 1
            continue
        gap = measure(first, placed[a], second, placed[b], table.vertices, far, near, scratch)
        if gap >= far or count == result.found.size:
            continue
        if exact and gap < MEETING and second[KIND] != PLANE:
            result.undecided[undecided] = k
            undecided += 1
            continue
        result.found[count] = k
        result.distances[count] = gap - first[RADIUS] - second[RADIUS]
        side, sign = pairs[k, 2], 1.0 - 2.0 * pairs[k, 2]
        for i in range(3):
            result.normals[count, i] = sign * near[2, i]
            result.points[count, side, i] = near[0, i] - first[RADIUS] * near[2, i]
            result.points[count, 1 - side, i] = near[1, i] + second[RADIUS] * near[2, i]
        count += 1
    return count, undecided


@compiled(lean=True)
def write_slopes(
    table: NearTable, poses: Floats2, axes: Floats2, pair: tuple[int, int], points: Floats2, n: Floats1,
    gradient: Floats1,
) -> None:  # fmt: skip
    """Write the gradient of the distance of two shapes by the coordinates of `pinocchio_model`.

    With n the normal, p the nearest point of the shape that a joint moves, o and u the joint's origin and
    axis, a component is +-n . (u x (p - o)), or +-n . u for a prismatic joint, with - for the second shape.

    Args:
        table: The joints and shapes.
        poses: Poses of the joints in the world, of which origins are read, shape (njoints, 12).
        axes: Axes of the joints in the world, shape (njoints, 3).
        pair: Indices of the two shapes.
        points: Nearest points of the shapes in the world, shape (2, 3) [m].
        n: Normal from the second to the first shape, in the world, shape (3,).
        gradient: Output, shape (njoints - 1,) [m/rad or 1].
    """
    first, second = int(table.shapes[pair[0], CARRIER]), int(table.shapes[pair[1], CARRIER])
    for j in range(gradient.size):
        # A joint that carries both shapes moves both alike and does not change their distance.
        side = table.above[first, j] - table.above[second, j]
        gradient[j] = 0.0
        if side == 0.0:
            continue
        u, o, p = axes[j + 1], poses[j + 1], points[0 if side > 0.0 else 1]
        if table.joints[j + 1, 1] > 0.0:
            slope = n[0] * u[0] + n[1] * u[1] + n[2] * u[2]
        else:
            x, y, z = p[0] - o[0], p[1] - o[1], p[2] - o[2]
            slope = n[0] * (u[1] * z - u[2] * y) + n[1] * (u[2] * x - u[0] * z) + n[2] * (u[0] * y - u[1] * x)
        gradient[j] = side * slope


@compiled(
    "void(NearTable, float64[:, ::1], float64[:, ::1], int64[::1], float64[:, :, ::1], float64[:, ::1], "
    "float64[:, ::1])"
)
def slopes(
    table: NearTable, poses: Floats2, axes: Floats2, found: Ints1, points: Floats3, normals: Floats2,
    gradients: Floats2,
) -> None:  # fmt: skip
    """Write the gradients of the distances of k pairs; see `write_slopes`.

    Args:
        table: The joints, shapes and pairs.
        poses: Poses of the joints in the world, see `place_joints`, shape (njoints, 12).
        axes: Axes of the joints in the world, shape (njoints, 3).
        found: Indices of the pairs, shape (k,).
        points: Nearest points in the world, shape (k, 2, 3) [m].
        normals: Unit vectors from the second to the first body, in the world, shape (k, 3).
        gradients: Output, shape (k, njoints - 1) [m/rad or 1].
    """
    for k in range(found.size):
        side = table.pairs[found[k], 2]
        ends = table.pairs[found[k], side], table.pairs[found[k], 1 - side]
        write_slopes(table, poses, axes, ends, points[k], normals[k], gradients[k])
