"""Distances, nearest points and their slopes of all pairs of shapes at once, in machine code."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.exact import clamp, nearest_on_segments, nearest_to_box
from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.collision.fast.placing import compose, pose_of
from pepper_kin.collision.fast.solids import Array

SEGMENT, BOX, PLANE, BOXED = 0, 1, 2, 3
"""Kinds of shapes, as cores: a segment or point, a box, a half-space, something within a box."""

SHAPE = 19
"""Numbers of a shape: kind, joint, the core's pose there (12), half lengths (3), radius, reach from the
centre."""

MEASURED, BOUNDED, BY_BALLS, BY_HEIGHT = 0, 1, 2, 3
"""How a pair is looked at: its distance is computed here; only a lower bound is, by a box around the one, by
balls around both, or by the height of the one's ball above the other, a half-space."""

CROSSING = 1e-6
"""Cores nearer than this count as crossing [m]: the direction in which to part them is coal's to tell."""

SLACK = 1e-5
"""Coal's distances may be too small by this [m]."""


def shape_row(item: Any) -> list[float]:
    """Return the numbers of one of Pinocchio's geometry objects, without padding; see SHAPE."""
    import coal
    import pinocchio

    shape, place, radius = item.geometry, item.placement, 0.0
    if isinstance(shape, coal.Sphere):
        kind, half, radius = SEGMENT, [0.0, 0.0, 0.0], float(shape.radius)
    elif isinstance(shape, coal.Capsule):
        kind, half, radius = SEGMENT, [0.0, 0.0, float(shape.halfLength)], float(shape.radius)
    elif isinstance(shape, coal.Box):
        kind, half = BOX, shape.halfSide.tolist()
    elif isinstance(shape, coal.Halfspace):
        # Its z axis points out of it, and its origin lies on its surface.
        turn = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(shape.n))
        place = place * pinocchio.SE3(turn.matrix(), np.array(shape.n) * shape.d)
        kind, half = PLANE, [0.0, 0.0, 0.0]
    else:
        shape.computeLocalAABB()
        low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
        place = place * pinocchio.SE3(np.eye(3), (low + high) / 2)
        kind, half = BOXED, ((high - low) / 2).tolist()
    return [kind, item.parentJoint, *pose_of(place), *half, radius, math.hypot(*half) + radius]


def pair_row(a: int, b: int, kinds: list[int]) -> tuple[int, int, int, bool]:
    """Return how to look at a pair: its shapes, perhaps in exchange; how; and whether exchanged."""
    swapped = bool(kinds[a] == PLANE or (kinds[a] != SEGMENT and kinds[b] == SEGMENT))
    first, second = (b, a) if swapped else (a, b)
    if kinds[second] == PLANE:
        how = BY_HEIGHT
    elif kinds[first] != SEGMENT:
        how = BY_BALLS
    else:
        how = BOUNDED if kinds[second] == BOXED else MEASURED
    return first, second, how, swapped


@njit("float64(float64[::1], float64[::1], float64[::1], float64[::1], int64)", **OPTIONS)
def _lower_bound(first: Array, pose: Array, second: Array, other: Array, how: int) -> float:
    """Return a lower bound of the distance of two shapes that are not measured [m]."""
    if how == BOUNDED:
        return nearest_to_box(pose, first[16], other, second[14:17])[1] - first[17]
    x, y, z = pose[0] - other[0], pose[1] - other[1], pose[2] - other[2]
    if how == BY_HEIGHT:
        return x * other[9] + y * other[10] + z * other[11] - first[18]
    return math.sqrt(x * x + y * y + z * z) - first[18] - second[18]


@njit(
    "float64(float64[::1], float64[::1], float64[::1], float64[::1], float64[:, ::1])",
    **OPTIONS,
)
def _nearest(first: Array, pose: Array, second: Array, other: Array, points: Array) -> float:
    """Write the nearest points of two cores, the first a segment, and return their distance [m]."""
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


@njit(
    "UniTuple(int64, 2)(float64[:, ::1], float64[:, ::1], int64[:, ::1], float64[::1], float64,"
    " int64[::1], float64[::1], float64[:, :, ::1], float64[:, ::1], int64[::1])",
    **OPTIONS,
)
def find_near(
    poses: Array, shapes: Array, pairs: NDArray[np.int64], paddings: Array, distance: float,
    found: NDArray[np.int64], distances: Array, points: Array, normals: Array, open_pairs: NDArray[np.int64],
) -> tuple[int, int]:  # fmt: skip
    """Find the pairs nearer than a distance, and those of which only coal can tell.

    The distance of two cores with nearest points a and b, grown by r_a and r_b, is |a - b| - r_a - r_b, also
    below zero, where that is how far they have to part; the nearest points are a - r_a n and b + r_b n with
    n = (a - b) / |a - b|.

    Args:
        poses: Of the joints, see `place_joints`.
        shapes: Rows of `shape_row`.
        pairs: Rows of `pair_row`, shape (m, 4).
        paddings: How far the two of each pair reach beyond their shapes together [m], shape (m,).
        distance: Farther pairs are left out [m].
        found: Written, places among the pairs, shape (m,), as the next three.
        distances: Written [m].
        points: Written, nearest points, shape (m, 2, 3).
        normals: Written, from the second to the first, shape (m, 3).
        open_pairs: Written, places of pairs that may be nearer and have to be measured by coal.

    Returns:
        How many are found, and how many are open.
    """
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
                open_pairs[undecided] = k
                undecided += 1
            continue
        gap = _nearest(first, placed[a], second, placed[b], near)
        if gap - first[17] - second[17] >= reach:
            continue
        if gap < CROSSING:
            open_pairs[undecided] = k
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


@njit(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], int8[:, ::1],"
    " float64[:, :, ::1], float64[:, ::1], float64[:, ::1])",
    **OPTIONS,
)
def slopes(
    joints: Array, poses: Array, axes: Array, sides: NDArray[np.int8], points: Array, normals: Array,
    gradients: Array,
) -> None:  # fmt: skip
    """Write the derivatives of distances by the coordinates of `pinocchio_model`.

    With n the normal, p the nearest point of the body that a joint moves, o and u the joint's origin and
    axis: +-n . (u x (p - o)), or +-n . u where it slides, with - for the second body.

    Args:
        joints: See `joint_table`.
        poses: Of the joints, see `place_joints`.
        axes: Of the joints in the world.
        sides: 1 where a joint moves the first body alone, -1 the second, else 0, shape (k, njoints - 1).
        points: Nearest points, shape (k, 2, 3) [m].
        normals: Shape (k, 3).
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
