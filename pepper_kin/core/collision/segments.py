"""Distances of segments and boxes in closed form, compiled."""

from __future__ import annotations

import math

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled

PARALLEL = 1e-9
"""Squared sine of the angle below which two segments count as parallel."""


@compiled(inline=True)
def clamp(x: float, h: float) -> float:
    """Return the number nearest to x in [-h, h]."""
    return min(max(x, -h), h)


@compiled
def nearest_on_segments(a: Array, ha: float, b: Array, hb: float) -> tuple[float, float]:
    """Return the positions of two segments' nearest points, along their axes from their centers [m].

    With r = c_a - c_b and axes u_a, u_b, the nearest points of the lines are at
    s = ((u_a . u_b) (u_b . r) - u_a . r) / (1 - (u_a . u_b)^2) and t = (u_a . u_b) s + u_b . r; clamped to
    the segments one after the other (Ericson, Real-Time Collision Detection, 5.1.9).

    Args:
        a: Pose of the first segment: center [m], x, y and z axis, shape (12,); it lies along z.
        ha: Half length of the first segment [m].
        b: Pose of the second segment, in the same frame, shape (12,).
        hb: Half length of the second segment [m].
    """
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    cosine = a[9] * b[9] + a[10] * b[10] + a[11] * b[11]
    along_a = a[9] * x + a[10] * y + a[11] * z
    along_b = b[9] * x + b[10] * y + b[11] * z
    square = 1.0 - cosine * cosine
    s = 0.0
    if square > PARALLEL:
        s = clamp((cosine * along_b - along_a) / square, ha)
    t = clamp(cosine * s + along_b, hb)
    s = clamp(cosine * t - along_a, ha)
    t = clamp(cosine * s + along_b, hb)
    return s, t


@compiled
def segment_to_segment(a: Array, ha: float, b: Array, hb: float) -> float:
    """Return the distance of two segments [m], by poses of shape (12,); see `nearest_on_segments`."""
    s, t = nearest_on_segments(a, ha, b, hb)
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    x, y, z = x + s * a[9] - t * b[9], y + s * a[10] - t * b[10], z + s * a[11] - t * b[11]
    return math.sqrt(x * x + y * y + z * z)


@compiled(inline=True)
def _beyond(x: float, h: float) -> float:
    """Return the signed distance by which x lies outside [-h, h], 0 inside."""
    return x - clamp(x, h)


@compiled
def nearest_to_box(a: Array, ha: float, b: Array, half: Array) -> tuple[float, float]:
    """Return a segment's point nearest to a solid box, along its axis from its center, and the distance [m].

    The squared distance of the point p + t d to the box is convex in t; its derivative is piecewise linear
    and increasing, with corners where a coordinate passes a face.  Bisection over the corners leaves one
    linear part, whose zero is the solution.

    Args:
        a: Pose of the segment: center [m], x, y and z axis, shape (12,); it lies along z.
        ha: Half length of the segment [m].
        b: Pose of the box, in the same frame, shape (12,).
        half: Half lengths of the box, shape (3,) [m].
    """
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    px, py, pz = (
        x * b[3] + y * b[4] + z * b[5],
        x * b[6] + y * b[7] + z * b[8],
        x * b[9] + y * b[10] + z * b[11],
    )
    x, y, z = a[9], a[10], a[11]
    dx, dy, dz = (
        x * b[3] + y * b[4] + z * b[5],
        x * b[6] + y * b[7] + z * b[8],
        x * b[9] + y * b[10] + z * b[11],
    )
    hx, hy, hz = half[0], half[1], half[2]
    low, high, at_low, at_high = -ha, ha, 0.0, 0.0
    for k in range(8):
        if k == 0:
            t = low
        elif k == 1:
            t = high
        else:
            p, d, h = px, dx, hx
            if k >= 6:
                p, d, h = pz, dz, hz
            elif k >= 4:
                p, d, h = py, dy, hy
            if d == 0.0:
                continue
            t = ((h if k % 2 == 0 else -h) - p) / d
            if not low < t < high:
                continue
        slope = dx * _beyond(px + t * dx, hx) + dy * _beyond(py + t * dy, hy) + dz * _beyond(pz + t * dz, hz)
        if k == 0:
            at_low = slope
            if slope >= 0.0:
                high = low
                break
        elif k == 1:
            at_high = slope
            if slope <= 0.0:
                low = high
                break
        elif slope <= 0.0:
            low, at_low = t, slope
        else:
            high, at_high = t, slope
    t = low
    if high > low and at_high > at_low:
        t = low + (high - low) * at_low / (at_low - at_high)
    x, y, z = _beyond(px + t * dx, hx), _beyond(py + t * dy, hy), _beyond(pz + t * dz, hz)
    return t, math.sqrt(x * x + y * y + z * z)


@compiled
def segment_to_box(a: Array, ha: float, b: Array, half: Array) -> float:
    """Return the distance of a segment to a solid box [m], 0 inside; shapes as in `nearest_to_box`."""
    return nearest_to_box(a, ha, b, half)[1]
