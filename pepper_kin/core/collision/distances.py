"""Distances, nearest points and their slopes of all pairs of shapes at once."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.collision.segments import clamp, nearest_on_segments, nearest_to_box
from pepper_kin.core.kinematic_tree import compose
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1, Ints2

SEGMENT, BOX, PLANE, BOXED = 0, 1, 2, 3
"""Kinds of shapes, as cores: a segment or point, a box, a half-space, something within a box."""

SHAPE = 19
"""Numbers of a shape: kind, joint, the core's pose there (12), half lengths (3), radius, reach from the
center."""

MEASURED, BOUNDED, BY_BALLS, BY_HEIGHT = 0, 1, 2, 3
"""How a pair is compared: its distance is computed here; only a lower bound is, by a box around the one, by
balls around both, or by the height of the one's ball above the other, a half-space."""

CROSSING = 1e-6
"""Cores nearer than this count as crossing [m]: coal computes the direction in which to part them."""

SLACK = 1e-5
"""Coal's distances may be too small by this [m]."""


@compiled
def _lower_bound(first: Array, pose: Array, second: Array, other: Array, how: int) -> float:
    """Return a lower bound of the distance of two shapes that are not measured [m].

    Args:
        first: Numbers of the first, shape (SHAPE,).
        pose: Pose of its core in the world, shape (12,).
        second: Numbers of the second, shape (SHAPE,).
        other: Pose of its core in the world, shape (12,).
        how: BOUNDED, BY_BALLS or BY_HEIGHT.
    """
    if how == BOUNDED:
        return nearest_to_box(pose, first[16], other, second[14:17])[1] - first[17]
    x, y, z = pose[0] - other[0], pose[1] - other[1], pose[2] - other[2]
    if how == BY_HEIGHT:
        return x * other[9] + y * other[10] + z * other[11] - first[18]
    return math.sqrt(x * x + y * y + z * z) - first[18] - second[18]


@compiled
def _nearest(first: Array, pose: Array, second: Array, other: Array, points: Array) -> float:
    """Write the nearest points of two cores, the first a segment, and return their distance [m].

    Args:
        first: Numbers of the first, shape (SHAPE,).
        pose: Pose of its core in the world, shape (12,).
        second: Numbers of the second, a segment or a box, shape (SHAPE,).
        other: Pose of its core in the world, shape (12,).
        points: Written, in the world, shape (2, 3) [m].
    """
    if second[0] == SEGMENT:
        s, t = nearest_on_segments(pose, first[16], other, second[16])
        for i in range(3):
            points[0, i], points[1, i] = pose[i] + s * pose[9 + i], other[i] + t * other[9 + i]
    else:
        s, _ = nearest_to_box(pose, first[16], other, second[14:17])
        for i in range(3):
            points[0, i], points[1, i] = pose[i] + s * pose[9 + i], other[i]
        for axis in range(3):
            along, u = 0.0, other[3 + 3 * axis : 6 + 3 * axis]
            for i in range(3):
                along += (points[0, i] - other[i]) * u[i]
            along = clamp(along, second[14 + axis])
            for i in range(3):
                points[1, i] += along * u[i]
    x, y, z = points[0, 0] - points[1, 0], points[0, 1] - points[1, 1], points[0, 2] - points[1, 2]
    return math.sqrt(x * x + y * y + z * z)


class ShapeTable(NamedTuple):
    """Shapes and pairs of them.

    Attributes:
        shapes: A row of SHAPE numbers for each shape, shape (k, SHAPE).
        pairs: First and second shape, how they are compared, whether results swap the two, shape (m, 4).
        paddings: How far the two of each pair reach beyond their shapes together, shape (m,) [m].
    """

    shapes: Floats2
    pairs: Ints2
    paddings: Floats1


class NearTable(NamedTuple):
    """What `find_near` writes, for m pairs at most.

    Attributes:
        found: Places among the pairs of those that are near, shape (m,).
        distances: Their distances, shape (m,) [m].
        points: Their nearest points in the world, shape (m, 2, 3) [m].
        normals: Unit vectors from the second to the first, in the world, shape (m, 3).
        undecided: Places of pairs that may be nearer and have to be measured otherwise, shape (m,).
    """

    found: Ints1
    distances: Floats1
    points: Floats3
    normals: Floats2
    undecided: Ints1


@compiled("Tuple(int64, int64)(float64[:, ::1], ShapeTable, float64, NearTable)")
def find_near(poses: Floats2, table: ShapeTable, distance: float, result: NearTable) -> tuple[int, int]:
    """Find the pairs nearer than a distance, and those that only coal can measure.

    The distance of two cores with nearest points a and b, grown by r_a and r_b, is |a - b| - r_a - r_b, also
    below zero, where that is how far they have to part; the nearest points are a - r_a n and b + r_b n with
    n = (a - b) / |a - b|.

    Args:
        poses: Of the joints in the world, see `place_joints`, shape (njoints, 12).
        table: The shapes and pairs.
        distance: Farther pairs are left out [m].
        result: Written.

    Returns:
        How many are found, and how many are undecided.
    """
    shapes, pairs, paddings = table.shapes, table.pairs, table.paddings
    found, distances, points, normals = result.found, result.distances, result.points, result.normals
    placed = np.empty((shapes.shape[0], 12))
    for k in range(shapes.shape[0]):
        compose(poses[int(shapes[k, 1])], shapes[k, 2:14], placed[k])
    near = np.empty((2, 3))
    count, undecided = 0, 0
    for k in range(pairs.shape[0]):
        a, b, how = pairs[k, 0], pairs[k, 1], pairs[k, 2]
        first, second, reach = shapes[a], shapes[b], distance + paddings[k]
        apart = _lower_bound(first, placed[a], second, placed[b], BY_BALLS)
        if how != BY_HEIGHT and apart >= reach + SLACK:
            continue
        if how != MEASURED:
            if not _lower_bound(first, placed[a], second, placed[b], how) >= reach + SLACK:
                result.undecided[undecided] = k
                undecided += 1
            continue
        gap = _nearest(first, placed[a], second, placed[b], near)
        if gap - first[17] - second[17] >= reach:
            continue
        if gap < CROSSING:
            result.undecided[undecided] = k
            undecided += 1
            continue
        found[count] = k
        distances[count] = gap - first[17] - second[17] - paddings[k]
        side, sign = pairs[k, 3], 1.0 - 2.0 * pairs[k, 3]
        for i in range(3):
            n = (near[0, i] - near[1, i]) / gap
            normals[count, i] = sign * n
            points[count, side, i] = near[0, i] - first[17] * n
            points[count, 1 - side, i] = near[1, i] + second[17] * n
        count += 1
    return count, undecided


@compiled(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], int64[:, ::1], float64[:, :, ::1], "
    "float64[:, ::1], float64[:, ::1])"
)
def slopes(
    joints: Array, poses: Array, axes: Array, sides: Ints2, points: Array, normals: Array,
    gradients: Array,
) -> None:  # fmt: skip
    """Write the derivatives of distances by the coordinates of `pinocchio_model`.

    With n the normal, p the nearest point of the body that a joint moves, o and u the joint's origin and
    axis: +-n . (u x (p - o)), or +-n . u where it slides, with - for the second body.

    Args:
        joints: See `joint_table`, shape (njoints, JOINT).
        poses: Of the joints in the world, see `place_joints`, shape (njoints, 12).
        axes: Of the joints in the world, shape (njoints, 3).
        sides: 1 where a joint moves the first body alone, -1 the second, else 0, shape (k, njoints - 1).
        points: Nearest points in the world, shape (k, 2, 3) [m].
        normals: From the second to the first body, in the world, shape (k, 3).
        gradients: Written, shape (k, njoints - 1) [m/rad or 1].
    """
    for k in range(sides.shape[0]):
        n = normals[k]
        for j in range(sides.shape[1]):
            gradients[k, j] = 0.0
            if sides[k, j] == 0:
                continue
            u, o, p = axes[j + 1], poses[j + 1], points[k, 0 if sides[k, j] > 0 else 1]
            if joints[j + 1, 1] > 0.0:
                slope = n[0] * u[0] + n[1] * u[1] + n[2] * u[2]
            else:
                x, y, z = p[0] - o[0], p[1] - o[1], p[2] - o[2]
                slope = (
                    n[0] * (u[1] * z - u[2] * y) + n[1] * (u[2] * x - u[0] * z) + n[2] * (u[0] * y - u[1] * x)
                )
            gradients[k, j] = sides[k, j] * slope
