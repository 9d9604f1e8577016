"""Compiled: where a line enters and leaves a convex solid.

Each function takes a point o of the line and its unit direction d in the solid's own frame and returns the
interval of t for which o + t d lies in the solid; an empty one is (inf, -inf).
"""

from __future__ import annotations

import math
from typing import TypeAlias

from numba import njit

Vector: TypeAlias = tuple[float, float, float]
Interval: TypeAlias = tuple[float, float]

_PARALLEL = 1e-14


@njit(cache=True, nogil=True, error_model="numpy")
def dot(a: Vector, b: Vector) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True, error_model="numpy")
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(cache=True, nogil=True, error_model="numpy")
def minus(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@njit(cache=True, nogil=True, error_model="numpy")
def along(o: Vector, d: Vector, t: float) -> Vector:
    """Return o + t d."""
    return (o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])


@njit(cache=True, nogil=True, error_model="numpy")
def first_of(interval: Interval) -> float:
    """Return the first t >= 0 at which the surface is crossed, from inside too; inf if there is none."""
    enter, leave = interval
    if leave < 0.0 or enter > leave:
        return math.inf
    return enter if enter >= 0.0 else leave


@njit(cache=True, nogil=True, error_model="numpy")
def between(o: float, d: float, low: float, high: float) -> Interval:
    """Return the interval for low <= o + t d <= high, one coordinate."""
    if abs(d) < _PARALLEL:
        return (-math.inf, math.inf) if low <= o <= high else (math.inf, -math.inf)
    a, b = (low - o) / d, (high - o) / d
    return (a, b) if a < b else (b, a)


@njit(cache=True, nogil=True, error_model="numpy")
def sphere(o: Vector, d: Vector, center: Vector, radius: float) -> Interval:
    """Return the interval in a ball."""
    o = minus(o, center)
    nearest = -dot(o, d)
    off = along(o, d, nearest)
    room = radius * radius - dot(off, off)  # from the line's nearest point: no cancellation far away
    if room < 0.0:
        return (math.inf, -math.inf)
    half = math.sqrt(room)
    return (nearest - half, nearest + half)


@njit(cache=True, nogil=True, error_model="numpy")
def box(o: Vector, d: Vector, half: Vector) -> Interval:
    """Return the interval in a box of given half lengths."""
    enter, leave = between(o[0], d[0], -half[0], half[0])
    low, high = between(o[1], d[1], -half[1], half[1])
    enter, leave = max(enter, low), min(leave, high)
    low, high = between(o[2], d[2], -half[2], half[2])
    enter, leave = max(enter, low), min(leave, high)
    return (enter, leave) if enter <= leave else (math.inf, -math.inf)


@njit(cache=True, nogil=True, error_model="numpy")
def tube(o: Vector, d: Vector, radius: float) -> Interval:
    """Return the interval in an endless cylinder about the z axis."""
    square = d[0] * d[0] + d[1] * d[1]
    if square < _PARALLEL:
        inside = o[0] * o[0] + o[1] * o[1] <= radius * radius
        return (-math.inf, math.inf) if inside else (math.inf, -math.inf)
    nearest = -(o[0] * d[0] + o[1] * d[1]) / square
    x, y = o[0] + nearest * d[0], o[1] + nearest * d[1]
    room = (radius * radius - x * x - y * y) / square
    if room < 0.0:
        return (math.inf, -math.inf)
    half = math.sqrt(room)
    return (nearest - half, nearest + half)


@njit(cache=True, nogil=True, error_model="numpy")
def cylinder(o: Vector, d: Vector, radius: float, half: float) -> Interval:
    """Return the interval in a cylinder along z of a given half length."""
    enter, leave = tube(o, d, radius)
    low, high = between(o[2], d[2], -half, half)
    enter, leave = max(enter, low), min(leave, high)
    return (enter, leave) if enter <= leave else (math.inf, -math.inf)


@njit(cache=True, nogil=True, error_model="numpy")
def capsule(o: Vector, d: Vector, radius: float, half: float) -> Interval:
    """Return the interval in a capsule along z, `half` half the length of its straight part.

    The parts are convex and so is their union: it lasts from the first entry to the last exit.
    """
    enter, leave = cylinder(o, d, radius, half)
    for end in (-half, half):
        low, high = sphere(o, d, (0.0, 0.0, end), radius)
        enter, leave = min(enter, low), max(leave, high)
    return (enter, leave)


@njit(cache=True, nogil=True, error_model="numpy")
def half_space(o: Vector, d: Vector, offset: float) -> float:
    """Return the t >= 0 at which the plane z = offset is crossed, or inf."""
    if abs(d[2]) < _PARALLEL:
        return math.inf
    t = (offset - o[2]) / d[2]
    return t if t >= 0.0 else math.inf


@njit(cache=True, nogil=True, error_model="numpy")
def triangle(o: Vector, d: Vector, a: Vector, e: Vector, f: Vector) -> float:
    """Return the t >= 0 at which a triangle with corners a, a + e and a + f is crossed, or inf.

    Moeller and Trumbore, Fast, minimum storage ray/triangle intersection (1997).  Seams between neighbours
    are closed by a tolerance of 1e-9 of the sides.
    """
    p = cross(d, f)
    volume = dot(e, p)
    if volume == 0.0:
        return math.inf
    s = minus(o, a)
    u = dot(s, p) / volume
    if u < -1e-9 or u > 1.0 + 1e-9:
        return math.inf
    q = cross(s, e)
    w = dot(d, q) / volume
    if w < -1e-9 or u + w > 1.0 + 1e-9:
        return math.inf
    t = dot(f, q) / volume
    return t if t >= 0.0 else math.inf


@njit(cache=True, nogil=True, error_model="numpy")
def rounded_triangle(o: Vector, d: Vector, a: Vector, e: Vector, f: Vector, radius: float) -> Interval:
    """Return the interval in all points within `radius` of a triangle with corners a, a + e and a + f.

    A prism and a capsule along each side, joined as in `capsule`.
    """
    normal = cross(e, f)
    length = math.sqrt(dot(normal, normal))
    normal = (normal[0] / length, normal[1] / length, normal[2] / length)
    s = minus(o, a)
    enter, leave = between(dot(s, normal), dot(d, normal), -radius, radius)
    third = minus(f, e)
    for start, side in (((0.0, 0.0, 0.0), e), (e, third), (f, (-f[0], -f[1], -f[2]))):
        inward = cross(normal, side)
        low, high = between(dot(minus(s, start), inward), dot(d, inward), 0.0, math.inf)
        enter, leave = max(enter, low), min(leave, high)
    if enter > leave:
        enter, leave = math.inf, -math.inf
    for start, side in (((0.0, 0.0, 0.0), e), (e, third), (f, (-f[0], -f[1], -f[2]))):
        low, high = _rod(minus(s, start), d, side, radius)
        enter, leave = min(enter, low), max(leave, high)
    return (enter, leave)


@njit(cache=True, nogil=True, error_model="numpy")
def _rod(o: Vector, d: Vector, side: Vector, radius: float) -> Interval:
    """Return the interval in a capsule from the origin to `side`."""
    length = math.sqrt(dot(side, side))
    axis = (side[0] / length, side[1] / length, side[2] / length)
    helper = (1.0, 0.0, 0.0) if abs(axis[0]) < 0.9 else (0.0, 1.0, 0.0)
    across = cross(axis, helper)
    size = math.sqrt(dot(across, across))
    across = (across[0] / size, across[1] / size, across[2] / size)
    third = cross(axis, across)
    o = minus(o, (0.5 * side[0], 0.5 * side[1], 0.5 * side[2]))
    turned_o = (dot(o, across), dot(o, third), dot(o, axis))
    turned_d = (dot(d, across), dot(d, third), dot(d, axis))
    return capsule(turned_o, turned_d, radius, 0.5 * length)


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_of_triangle(p: Vector, a: Vector, e: Vector, f: Vector) -> Vector:
    """Return the point of a triangle with corners a, a + e and a + f that is nearest to p."""
    normal = cross(e, f)
    s = minus(p, a)
    area = dot(normal, normal)
    u = dot(cross(s, f), normal) / area
    w = dot(cross(e, s), normal) / area
    if u >= 0.0 and w >= 0.0 and u + w <= 1.0:
        return (a[0] + u * e[0] + w * f[0], a[1] + u * e[1] + w * f[1], a[2] + u * e[2] + w * f[2])
    best, found = math.inf, a
    for start, side in (
        (a, e),
        (along(a, e, 1.0), minus(f, e)),
        (along(a, f, 1.0), (-f[0], -f[1], -f[2])),
    ):
        share = dot(minus(p, start), side) / dot(side, side)
        point = along(start, side, min(max(share, 0.0), 1.0))
        off = minus(p, point)
        if dot(off, off) < best:
            best, found = dot(off, off), point
    return found
