"""Shapes as rows of numbers: what the compiled search for contacts knows of them."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS

Array = NDArray[np.float64]

BALL, CAPSULE, BOX, CYLINDER, HALF_SPACE, OTHER = 0, 1, 2, 3, 4, 5
"""Kinds of shapes; OTHER is known to coal alone."""


@njit("float64(int64, float64[::1], float64[:, ::1], float64[::1], float64, float64, float64)", **OPTIONS)
def reach(kind: int, size: Array, rotation: Array, centre: Array, x: float, y: float, z: float) -> float:
    """Return the greatest x . p of a shape's points p along a unit vector (x, y, z) [m].

    `size` is: radius of a ball; radius and half the segment of a capsule; half lengths of a box; radius and
    half the length of a cylinder.
    """
    middle = x * centre[0] + y * centre[1] + z * centre[2]
    if kind == BALL:
        return middle + size[0]
    along = x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2]
    if kind == CAPSULE:
        return middle + size[0] + size[1] * abs(along)
    if kind == CYLINDER:
        return middle + size[0] * math.sqrt(max(0.0, 1.0 - along * along)) + size[1] * abs(along)
    first = x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0]
    second = x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1]
    return middle + size[0] * abs(first) + size[1] * abs(second) + size[2] * abs(along)


@njit("void(float64[:, ::1], int64, float64[::1], float64, float64[::1], float64, float64[::1])", **OPTIONS)
def _point(
    points: Array, row: int, centre: Array, along: float, axis: Array, out: float, outward: Array
) -> None:
    """Write centre + along axis + out outward."""
    for i in range(3):
        points[row, i] = centre[i] + along * axis[i] + out * outward[i]


@njit("int64(float64[::1], float64[::1], float64[::1], float64, float64[::1], float64[:, ::1])", **OPTIONS)
def _rim(size: Array, centre: Array, axis: Array, along: float, d: Array, points: Array) -> int:
    """Write the end or the side of a cylinder that looks along d."""
    outward, side = np.empty(3), np.empty(3)
    least = 0
    for i in range(3):
        outward[i] = d[i] - along * axis[i]
        if abs(axis[i]) < abs(axis[least]):
            least = i
    length = math.sqrt(outward[0] ** 2 + outward[1] ** 2 + outward[2] ** 2)
    if length < 1e-12:  # d along the axis: any radius will do
        for i in range(3):
            outward[i] = -axis[least] * axis[i]
        outward[least] += 1.0
        length = math.sqrt(outward[0] ** 2 + outward[1] ** 2 + outward[2] ** 2)
    for i in range(3):
        outward[i] /= length
    radius, half = size[0], size[1]
    if abs(along) < 0.7:
        _point(points, 0, centre, half, axis, radius, outward)
        _point(points, 1, centre, -half, axis, radius, outward)
        return 2
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        side[i] = axis[k] * outward[m] - axis[m] * outward[k]
    end = half if along > 0 else -half
    _point(points, 0, centre, end, axis, radius, outward)
    _point(points, 1, centre, end, axis, radius, side)
    _point(points, 2, centre, end, axis, -radius, outward)
    _point(points, 3, centre, end, axis, -radius, side)
    return 4


@njit("int64(int64, float64[::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1])", **OPTIONS)
def feature(kind: int, size: Array, rotation: Array, centre: Array, d: Array, points: Array) -> int:
    """Write the point, the ends of the line or the corners of the face that a shape turns along d.

    Returns:
        How many points: 1 of a ball, 2 of a capsule or of a cylinder's side, 4 of a box's face or of a
        cylinder's end, in the order of their outline.
    """
    axis = np.empty(3)
    along = 0.0
    for i in range(3):
        axis[i] = rotation[i, 2]
        along += d[i] * axis[i]
    if kind == BALL:
        _point(points, 0, centre, 0.0, axis, size[0], d)
        return 1
    if kind == CAPSULE:
        _point(points, 0, centre, size[1], axis, size[0], d)
        _point(points, 1, centre, -size[1], axis, size[0], d)
        return 2
    if kind == CYLINDER:
        return _rim(size, centre, axis, along, d, points)
    face, height = 2, along
    for k in range(2):
        other = d[0] * rotation[0, k] + d[1] * rotation[1, k] + d[2] * rotation[2, k]
        if abs(other) > abs(height):
            face, height = k, other
    out = size[face] if height >= 0 else -size[face]
    k, m = (face + 1) % 3, (face + 2) % 3
    for corner in range(4):
        a = size[k] if corner in (0, 3) else -size[k]
        b = size[m] if corner < 2 else -size[m]
        for i in range(3):
            points[corner, i] = centre[i] + out * rotation[i, face] + a * rotation[i, k] + b * rotation[i, m]
    return 4
