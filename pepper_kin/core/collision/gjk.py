"""Whether two convex cores are nearer than a distance, with proven bounds at every step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.collision.layout import CYLINDER, HULL, Array
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

STEPS = 40
TOUCHING = 1e-10
"""Cores nearer than this count as meeting [m]."""
FREE, CONTACT, TIE = 0, 1, 2
"""Verdicts: surely further than the threshold, surely nearer, too near to it to tell."""


class ConvexCore(NamedTuple):
    """A convex core.

    Attributes:
        kind: BOX, CYLINDER or HULL.
        half: Its half lengths, shape (3,) [m].
        pose: Its center, x, y and z axis, shape (12,).
        vertices: Of a HULL, x, y and z, shape (3, k) [m].
    """

    kind: float
    half: Floats1
    pose: Floats1
    vertices: Floats2


@compiled(vector=True)
def _greatest_height(x: Array, y: Array, z: Array, u: float, v: float, w: float) -> float:
    """Return the greatest of u x + v y + w z."""
    best = -1e300
    for k in range(x.size):
        height = u * x[k] + v * y[k] + w * z[k]
        best = height if height > best else best
    return best


@compiled
def _highest(x: Array, y: Array, z: Array, u: float, v: float, w: float) -> int:
    """Return the place of the greatest u x + v y + w z, but for rounding."""
    best = _greatest_height(x, y, z, u, v, w)
    least = best - 1e-12 * abs(best)
    for k in range(x.size):
        if u * x[k] + v * y[k] + w * z[k] >= least:
            return k
    return 0


@compiled
def _height(core: ConvexCore, x: float, y: float, z: float) -> float:
    """Return how far a core reaches beyond its centre in a direction, times the direction's length."""
    half, pose, vertices = core.half, core.pose, core.vertices
    u = x * pose[3] + y * pose[4] + z * pose[5]
    v = x * pose[6] + y * pose[7] + z * pose[8]
    w = x * pose[9] + y * pose[10] + z * pose[11]
    if core.kind == HULL:
        return _greatest_height(vertices[0], vertices[1], vertices[2], u, v, w)
    if core.kind == CYLINDER:
        return math.sqrt(u * u + v * v) * half[0] + abs(w) * half[2]
    return abs(u) * half[0] + abs(v) * half[1] + abs(w) * half[2]


@compiled
def _subtract_support(core: ConvexCore, direction: Array, result: Array, sign: float) -> None:
    """Take from `result` sign times the core's furthest point in the direction sign times `direction`."""
    half, pose, vertices = core.half, core.pose, core.vertices
    x, y, z = sign * direction[0], sign * direction[1], sign * direction[2]
    u = x * pose[3] + y * pose[4] + z * pose[5]
    v = x * pose[6] + y * pose[7] + z * pose[8]
    w = x * pose[9] + y * pose[10] + z * pose[11]
    if core.kind == HULL:
        place = _highest(vertices[0], vertices[1], vertices[2], u, v, w)
        u, v, w = vertices[0, place], vertices[1, place], vertices[2, place]
    else:
        if core.kind == CYLINDER:
            across = math.sqrt(u * u + v * v)
            scale = half[0] / across if across > 0 else 0.0
            u, v = scale * u, scale * v
        else:
            u, v = math.copysign(half[0], u), math.copysign(half[1], v)
        w = math.copysign(half[2], w)
    for i in range(3):
        result[i] -= sign * (pose[i] + u * pose[3 + i] + v * pose[6 + i] + w * pose[9 + i])


@compiled
def _affine_minimum(points: Array, count: int, weights: Array, room: Array) -> bool:
    """Write the weights (sum 1) of the point of least norm in the points' affine hull.

    It solves (s 1 1^T + P P^T) mu = 1 by elimination and divides mu by its sum (Wolfe 1976).
    """
    scale = 1e-30
    for i in range(count):
        scale = max(scale, points[i, 0] ** 2 + points[i, 1] ** 2 + points[i, 2] ** 2)
    for i in range(count):
        for j in range(count):
            dot = points[i, 0] * points[j, 0] + points[i, 1] * points[j, 1] + points[i, 2] * points[j, 2]
            room[i, j] = dot / scale + 1.0
        weights[i] = 1.0
    for i in range(count):
        if room[i, i] < 1e-14:
            return False
        for j in range(i + 1, count):
            factor = room[j, i] / room[i, i]
            for k in range(i, count):
                room[j, k] -= factor * room[i, k]
            weights[j] -= factor * weights[i]
    total = 0.0
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            weights[i] -= room[i, k] * weights[k]
        weights[i] /= room[i, i]
        total += weights[i]
    if not abs(total) > 1e-300:
        return False
    for i in range(count):
        weights[i] /= total
    return True


@compiled
def _nearest_in_hull(points: Array, count: int, now: Array, new: Array, room: Array) -> int:
    """Move to the point of least norm in the points' convex hull, dropping points that it does not need.

    Args:
        points: Corners, shape (4, 3).
        count: How many are in use; those kept are moved to the front.
        now: Weights of the present point, written.
        new: Room.
        room: Room.

    Returns:
        How many points are left; -1 where they are dependent.
    """
    for _ in range(8):
        if not _affine_minimum(points, count, new, room):
            return -1
        step = 1.0
        for i in range(count):
            if new[i] <= 0.0 and now[i] - new[i] > 0.0:
                step = min(step, now[i] / (now[i] - new[i]))
        kept = 0
        for i in range(count):
            weight = now[i] + step * (new[i] - now[i])
            if new[i] > 0.0 or weight > 1e-15:
                points[kept, 0], points[kept, 1], points[kept, 2] = points[i, 0], points[i, 1], points[i, 2]
                now[kept] = weight
                kept += 1
        done = kept == count and step == 1.0
        if kept == 0:
            return -1
        count = kept
        if done:
            return count
    return -1


@compiled
def _separates(a: ConvexCore, b: ConvexCore, axis: Array, least: float) -> bool:
    """Whether a plane across an axis, given in the frame of the first core, parts the cores by a distance."""
    pose, other = a.pose, b.pose
    x = axis[0] * pose[3] + axis[1] * pose[6] + axis[2] * pose[9]
    y = axis[0] * pose[4] + axis[1] * pose[7] + axis[2] * pose[10]
    z = axis[0] * pose[5] + axis[1] * pose[8] + axis[2] * pose[11]
    apart = (pose[0] - other[0]) * x + (pose[1] - other[1]) * y + (pose[2] - other[2]) * z
    return apart - _height(a, -x, -y, -z) - _height(b, x, y, z) > least


@compiled
def nearer_than(a: ConvexCore, b: ConvexCore, threshold: float, tie: float, axis: Array) -> int:
    """Tell whether two convex cores are nearer than a threshold.

    Gilbert, Johnson and Keerthi (1988) with the point of least norm by Wolfe (1976): v, a point of the
    difference of the cores, bounds their distance by |v| from above and, with w its furthest point towards
    the origin, by v . w / |v| from below.  The verdict rests on these bounds only, never on convergence.

    Args:
        a: One core.
        b: The other.
        threshold: Distance [m].
        tie: Distances within this of the threshold are ties [m].
        axis: Direction that parted the cores when they were last asked about, a unit vector in the frame of
            the first, or zero; it is tried first.  Written where they are parted.
    """
    known = axis[0] != 0.0 or axis[1] != 0.0 or axis[2] != 0.0
    if known and _separates(a, b, axis, threshold + tie):
        return FREE
    points, now, new, room = np.zeros((4, 3)), np.zeros(4), np.zeros(4), np.zeros((4, 4))
    v, w = a.pose[:3] - b.pose[:3], np.zeros(3)
    if v[0] * v[0] + v[1] * v[1] + v[2] * v[2] < TOUCHING**2:
        v[0] = 1.0
    count = 0
    for _ in range(STEPS):
        size = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        if count > 0 and (size <= TOUCHING or size < threshold - tie):
            return CONTACT
        w[0] = w[1] = w[2] = 0.0
        _subtract_support(a, v, w, -1.0)
        _subtract_support(b, v, w, 1.0)
        lower = (v[0] * w[0] + v[1] * w[1] + v[2] * w[2]) / size
        if lower > threshold + tie:
            for i in range(3):
                row = a.pose[3 + 3 * i : 6 + 3 * i]
                axis[i] = (v[0] * row[0] + v[1] * row[1] + v[2] * row[2]) / size
            return FREE
        if count == 4 or (count > 0 and size - lower < 1e-12):
            return TIE
        points[count, 0], points[count, 1], points[count, 2] = w[0], w[1], w[2]
        now[count] = 1.0 if count == 0 else 0.0
        count = _nearest_in_hull(points, count + 1, now, new, room)
        if count < 0:
            return TIE
        for i in range(3):
            v[i] = 0.0
            for k in range(count):
                v[i] += now[k] * points[k, i]
    return TIE
