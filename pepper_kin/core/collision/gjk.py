"""Distance test of two convex cores, with proven bounds at every step."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from pepper_kin.arrays import Array
from pepper_kin.core.collision.layout import CYLINDER, HULL
from pepper_kin.core.collision.records import POSE, VECTORS, between, dot
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.lanes import (
    LANES,
    double_at,
    greatest_lane,
    lane_maximum,
    lanes_below,
    load_lanes,
    spread,
)
from pepper_kin.kernels.records import SINGLES

STEPS = 40
TOUCHING = 1e-10
"""Cores nearer than this count as meeting [m]."""
FREE, CONTACT, TIE = 0, 1, 2
"""Verdicts: certainly farther than the threshold, certainly nearer, or too near the threshold to decide."""
GJK_WORKSPACE_SIZE = 40
"""Doubles of workspace that `nearer_than` needs."""
SINGLE = 1e-6
"""Maximum error of a vertex's height in single precision, relative to its distance from the core's center.

Three products and two sums of rounded numbers lose less than 9 u of the distance, with u = 2^-24.
"""
_NOW, _NEW, _SQUARES = 12, 16, 20


class ConvexCore(NamedTuple):
    """A convex core, by addresses of doubles.

    Attributes:
        kind: BOX, CYLINDER or HULL.
        half: Half lengths, shape (3,) [m].
        pose: Center [m], x, y and z axis, in the world, shape (12,).
        corners: Number of vertices of a HULL, a multiple of eight; some may be repeated.
        vertices: x, then y, then z of the vertices, in the core's frame [m].
        singles: x, then y, then z of the vertices in single precision [m].
        size: Upper bound of the distance of a vertex from the center [m].
    """

    kind: int
    half: int
    pose: int
    corners: int
    vertices: int
    singles: int
    size: float


@compiled(inline=True, lean=True)
def _single_lanes(core: ConvexCore, k: int) -> tuple[Any, Any, Any]:
    """Return eight of a hull's vertices in single precision, from index k on, in lanes."""
    x, count = SINGLES.at(core.singles, k), core.corners
    return load_lanes(x), load_lanes(SINGLES.at(x, count)), load_lanes(SINGLES.at(x, 2 * count))


@compiled(lean=True)
def _greatest_height(core: ConvexCore, u: float, v: float, w: float) -> float:
    """Return the maximum u x + v y + w z of a hull's vertices in single precision."""
    x, y, z = _single_lanes(core, 0)
    best = x * u + y * v + z * w
    for k in range(LANES, core.corners, LANES):
        x, y, z = _single_lanes(core, k)
        best = lane_maximum(best, x * u + y * v + z * w)
    return float(greatest_lane(best))


@compiled(inline=True, lean=True)
def _vertex(core: ConvexCore, k: int) -> tuple[float, float, float]:
    """Return vertex k of a hull in the core's frame [m]."""
    vertices, count = core.vertices, core.corners
    return double_at(vertices, k), double_at(vertices, k + count), double_at(vertices, k + 2 * count)


@compiled(lean=True)
def _highest(core: ConvexCore, u: float, v: float, w: float) -> int:
    """Return the index of a hull's vertex with the maximum u x + v y + w z, up to rounding."""
    most = 2.0 * SINGLE * core.size * math.sqrt(u * u + v * v + w * w)
    least = spread(_greatest_height(core, u, v, w) - most)
    best, place = -1e300, 0
    for first in range(0, core.corners, LANES):
        x, y, z = _single_lanes(core, first)
        near, k = lanes_below(least, x * u + y * v + z * w), first
        while near != 0:
            if near & 1:
                height = dot(u, v, w, _vertex(core, k))
                if height > best:
                    best, place = height, k
            near >>= 1
            k += 1
    return place


@compiled(inline=True, lean=True)
def turned(pose: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a direction of the world in the frame of a core."""
    return dot(x, y, z, POSE.x_axis(pose)), dot(x, y, z, POSE.y_axis(pose)), dot(x, y, z, POSE.z_axis(pose))


@compiled(inline=True, lean=True)
def turned_back(pose: int, u: float, v: float, w: float) -> tuple[float, float, float]:
    """Return a direction of a core's frame in the world."""
    a, b, c = POSE.x_axis(pose), POSE.y_axis(pose), POSE.z_axis(pose)
    return u * a[0] + v * b[0] + w * c[0], u * a[1] + v * b[1] + w * c[1], u * a[2] + v * b[2] + w * c[2]


@compiled(lean=True)
def _height(core: ConvexCore, x: float, y: float, z: float) -> float:
    """Return an upper bound of how far a core reaches from its center along a unit vector [m]."""
    u, v, w = turned(core.pose, x, y, z)
    if core.kind == HULL:
        return _greatest_height(core, u, v, w) + SINGLE * core.size
    half = VECTORS.xyz(core.half)
    if core.kind == CYLINDER:
        return math.sqrt(u * u + v * v) * half[0] + abs(w) * half[2]
    return float(dot(abs(u), abs(v), abs(w), half))


@compiled(lean=True)
def _support(core: ConvexCore, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the core's support point in a direction, relative to its center."""
    u, v, w = turned(core.pose, x, y, z)
    if core.kind == HULL:
        u, v, w = _vertex(core, _highest(core, u, v, w))
    else:
        half = VECTORS.xyz(core.half)
        if core.kind == CYLINDER:
            across = math.sqrt(u * u + v * v)
            scale = half[0] / across if across > 0 else 0.0
            u, v = scale * u, scale * v
        else:
            u, v = math.copysign(half[0], u), math.copysign(half[1], v)
        w = math.copysign(half[2], w)
    return turned_back(core.pose, u, v, w)


@compiled(lean=True)
def _affine_minimum(points: Array, count: int, weights: Array, squares: Array) -> bool:
    """Write the weights (sum 1) of the minimum-norm point in the points' affine hull.

    It solves (s 1 1^T + P P^T) mu = 1 by elimination and divides mu by its sum (Wolfe 1976).

    Args:
        points: P, three numbers for each point, shape (>= 3 count,) [m].
        count: Number of points, four at most.
        weights: Output, shape (>= count,).
        squares: Workspace, shape (>= 16,).

    Returns:
        False if the points are affinely dependent.
    """
    scale = 1e-30
    for i in range(0, 3 * count, 3):
        scale = max(scale, points[i] ** 2 + points[i + 1] ** 2 + points[i + 2] ** 2)
    rate = 1.0 / scale
    for i in range(count):
        x, y, z = points[3 * i], points[3 * i + 1], points[3 * i + 2]
        for j in range(i, count):
            dot = x * points[3 * j] + y * points[3 * j + 1] + z * points[3 * j + 2]
            squares[4 * i + j] = dot * rate + 1.0
        weights[i] = 1.0
    for i in range(count):
        if squares[5 * i] < 1e-14:
            return False
        inverse = 1.0 / squares[5 * i]
        for j in range(i + 1, count):
            factor = squares[4 * i + j] * inverse
            for k in range(j, count):
                squares[4 * j + k] -= factor * squares[4 * i + k]
            weights[j] -= factor * weights[i]
    total = 0.0
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            weights[i] -= squares[4 * i + k] * weights[k]
        weights[i] /= squares[5 * i]
        total += weights[i]
    if not abs(total) > 1e-300:
        return False
    for i in range(count):
        weights[i] /= total
    return True


@compiled(lean=True)
def nearest_in_hull(scratch: Array, count: int) -> int:
    """Move to the minimum-norm point of a convex hull, and drop the points that it does not need.

    Args:
        scratch: Corners, three numbers each [m], and weights of the present point, both changed; then
            workspace; shape (GJK_WORKSPACE_SIZE,).
        count: Number of corners; those kept are moved to the front.

    Returns:
        Number of points left; -1 if they are affinely dependent.
    """
    points, now, new, squares = scratch, scratch[_NOW:], scratch[_NEW:], scratch[_SQUARES:]
    for _ in range(8):
        if not _affine_minimum(points, count, new, squares):
            return -1
        step = 1.0
        for i in range(count):
            if new[i] <= 0.0 and now[i] - new[i] > 0.0:
                step = min(step, now[i] / (now[i] - new[i]))
        kept = 0
        for i in range(count):
            weight = now[i] + step * (new[i] - now[i])
            if new[i] > 0.0 or weight > 1e-15:
                for k in range(3):
                    points[3 * kept + k] = points[3 * i + k]
                now[kept] = weight
                kept += 1
        done = kept == count and step == 1.0
        if kept == 0:
            return -1
        count = kept
        if done:
            return count
    return -1


@compiled(lean=True)
def separation(a: ConvexCore, b: ConvexCore, axis: int) -> float:
    """Return a lower bound of the separation of two cores along an axis [m]; -inf for a zero axis.

    Args:
        a: One core.
        b: The other core.
        axis: Address of a unit vector in the frame of a, from b to a, or of zeros.
    """
    u, v, w = VECTORS.xyz(axis)
    if u == 0.0 and v == 0.0 and w == 0.0:
        return -math.inf
    x, y, z = turned_back(a.pose, u, v, w)
    return float(dot(x, y, z, between(a.pose, b.pose)) - _height(a, -x, -y, -z) - _height(b, x, y, z))


@compiled(lean=True)
def nearer_than(a: ConvexCore, b: ConvexCore, threshold: float, tie: float, axis: int, scratch: int) -> int:
    """Return whether two convex cores are nearer than a threshold: FREE, CONTACT or TIE.

    The algorithm is by Gilbert, Johnson and Keerthi (1988), with the minimum-norm point by Wolfe (1976): v, a
    point of the difference of the cores, bounds their distance by |v| from above and, with w the support
    point towards the origin, by v . w / |v| from below.  The verdict rests on these bounds only, never on
    convergence.

    Args:
        a: One core.
        b: The other core.
        threshold: Distance [m].
        tie: Half width of the range around the threshold in which a distance is a TIE [m].
        axis: Address of the direction that separated the cores at their last test, a unit vector in the frame
            of a, or zero; it is tried first, and replaced if the cores are separated.
        scratch: Address of a workspace of GJK_WORKSPACE_SIZE doubles.
    """
    if separation(a, b, axis) > threshold + tie:
        return FREE
    points = floats_at(scratch, GJK_WORKSPACE_SIZE)
    now, apart, count = points[_NOW:], between(a.pose, b.pose), 0
    x, y, z = apart
    if x * x + y * y + z * z < TOUCHING**2:
        x = 1.0
    for _ in range(STEPS):
        size = math.sqrt(x * x + y * y + z * z)
        if count > 0 and (size <= TOUCHING or size < threshold - tie):
            return CONTACT
        first, second = _support(a, -x, -y, -z), _support(b, x, y, z)
        wx, wy, wz = (
            apart[0] + first[0] - second[0],
            apart[1] + first[1] - second[1],
            apart[2] + first[2] - second[2],
        )
        lower = (x * wx + y * wy + z * wz) / size
        if lower > threshold + tie:
            VECTORS.set_xyz(axis, turned(a.pose, x / size, y / size, z / size))
            return FREE
        if count == 4 or (count > 0 and size - lower < 1e-12):
            return TIE
        points[3 * count], points[3 * count + 1], points[3 * count + 2] = wx, wy, wz
        now[count] = 1.0 if count == 0 else 0.0
        count = nearest_in_hull(points, count + 1)
        if count < 0:
            return TIE
        x = y = z = 0.0
        for k in range(count):
            x += now[k] * points[3 * k]
            y += now[k] * points[3 * k + 1]
            z += now[k] * points[3 * k + 2]
    return TIE
