"""Bounding spheres of spheres, and inscribed spheres of convex hulls, both nearly optimal."""

from __future__ import annotations

import math

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled

ROUNDS = 40


@compiled("float64(float64[:, ::1], float64[::1], float64[::1])")
def ball_around_balls(points: Array, radii: Array, center: Array) -> float:
    """Return the radius of a small sphere that encloses spheres (Badoiu and Clarkson, 2003) [m].

    Args:
        points: Centers of the spheres, shape (k, 3) [m].
        radii: Radii of the spheres, shape (k,) [m].
        center: Center of the enclosing sphere, output, shape (3,) [m].
    """
    count = points.shape[0]
    for i in range(3):
        center[i] = 0.0
        for k in range(count):
            center[i] += points[k, i] / count
    radius = 0.0
    for step in range(ROUNDS + 1):
        furthest, radius = 0, -math.inf
        for k in range(count):
            x, y, z = points[k, 0] - center[0], points[k, 1] - center[1], points[k, 2] - center[2]
            reach = math.sqrt(x * x + y * y + z * z) + radii[k]
            if reach > radius:
                furthest, radius = k, reach
        if step < ROUNDS:
            for i in range(3):
                center[i] += (points[furthest, i] - center[i]) / (step + 2)
    return radius


@compiled("float64(float64[:, ::1], float64[::1], float64[::1], float64[::1])")
def ball_within_planes(planes: Array, low: Array, high: Array, center: Array) -> float:
    """Return the radius of a large sphere inside a convex hull, its center inside a box, by iteration [m].

    Args:
        planes: Outward unit normal n of each of the hull's faces, and offset d of the height n . x + d above
            the face, shape (k, 4) [m].
        low: Minimum corner of the box, shape (3,) [m].
        high: Maximum corner of the box, shape (3,) [m].
        center: Center of the sphere, output, shape (3,) [m].
    """
    radius, step, x, y, z = -math.inf, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        step = max(step, high[i] - low[i])
    x, y, z = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2
    for _ in range(ROUNDS):
        nearest, depth = 0, -math.inf
        for k in range(planes.shape[0]):
            height = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z + planes[k, 3]
            if height > depth:
                nearest, depth = k, height
        if -depth > radius:
            center[0], center[1], center[2], radius = x, y, z, -depth
        else:
            step *= 0.8
        x = min(max(x - step * planes[nearest, 0], low[0]), high[0])
        y = min(max(y - step * planes[nearest, 1], low[1]), high[1])
        z = min(max(z - step * planes[nearest, 2], low[2]), high[2])
    return radius
