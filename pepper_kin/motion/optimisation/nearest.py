"""Nearest points of two convex bodies, compiled.

A body is a core, which is a box or a cylinder with centre c, axes R and half sizes, plus all points within a
radius of it.  A segment is a box without width, a point one without length: so capsules and spheres are
bodies, too.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pepper_kin.kernels.compiled_function import compiled

Array = NDArray[np.float64]
Point: TypeAlias = tuple[float, float, float]

BOX, CYLINDER = 0, 1
_ROUNDS = 60
_SMALL = 1e-9  # [m]


# Columns of an array of cores in the world, one row each.  Functions take it whole and a row number: views of
# rows, and tuples of arrays, cost more than the arithmetic.
CENTER, TURN, HALF, KIND = 0, 3, 12, 15
COLUMNS = 16


@compiled
def project(cores: Array, b: int, px: float, py: float, pz: float) -> Point:
    """Return the point of core b that is nearest to a point."""
    dx, dy, dz = px - cores[b, 0], py - cores[b, 1], pz - cores[b, 2]
    x = cores[b, 3] * dx + cores[b, 6] * dy + cores[b, 9] * dz
    y = cores[b, 4] * dx + cores[b, 7] * dy + cores[b, 10] * dz
    z = cores[b, 5] * dx + cores[b, 8] * dy + cores[b, 11] * dz
    if cores[b, KIND] == CYLINDER:
        out = math.sqrt(x * x + y * y)
        if out > cores[b, 12]:
            x, y = x * cores[b, 12] / out, y * cores[b, 12] / out
    else:
        x, y = min(max(x, -cores[b, 12]), cores[b, 12]), min(max(y, -cores[b, 13]), cores[b, 13])
    z = min(max(z, -cores[b, 14]), cores[b, 14])
    return (
        cores[b, 0] + cores[b, 3] * x + cores[b, 4] * y + cores[b, 5] * z,
        cores[b, 1] + cores[b, 6] * x + cores[b, 7] * y + cores[b, 8] * z,
        cores[b, 2] + cores[b, 9] * x + cores[b, 10] * y + cores[b, 11] * z,
    )


@compiled
def _beside(cores: Array, a: int, b: int, t: float) -> tuple[float, Point, Point]:
    """Return half d(distance^2)/dt at the point t of segment a, that point, and core b's nearest to it."""
    ex, ey, ez = cores[a, 5], cores[a, 8], cores[a, 11]
    x, y, z = cores[a, 0] + ex * t, cores[a, 1] + ey * t, cores[a, 2] + ez * t
    u, v, w = project(cores, b, x, y, z)
    return (x - u) * ex + (y - v) * ey + (z - w) * ez, (x, y, z), (u, v, w)


@compiled
def _from_segment(cores: Array, a: int, b: int) -> tuple[Point, Point]:
    """Return the nearest points of segment a and core b.

    The squared distance to a convex set is convex along the segment, so that its slope crosses zero at most
    once: the place is found by false position (with the Illinois rule).
    """
    low = -cores[a, 14]
    high, t = -low, low
    at_low, at_high, stage = 0.0, 0.0, 0
    mine = other = (0.0, 0.0, 0.0)
    for _ in range(_ROUNDS):
        slope, mine, other = _beside(cores, a, b, t)
        if stage == 0:  # at the low end
            if slope >= 0.0 or high - low <= _SMALL:
                break
            at_low, t, stage = slope, high, 1
            continue
        if stage == 1:  # at the high end
            if slope <= 0.0:
                break
            at_high, stage = slope, 2
        elif abs(slope) < 1e-12 or high - low < _SMALL:
            break
        elif slope < 0.0:
            low, at_low, at_high = t, slope, at_high * 0.5
        else:
            high, at_high, at_low = t, slope, at_low * 0.5
        t = (low * at_high - high * at_low) / (at_high - at_low)
    return mine, other


@compiled
def _of_thick(cores: Array, a: int, b: int) -> tuple[Point, Point]:
    """Return the nearest points of two cores by projecting on them by turns.

    W. Cheney and A. Goldstein, Proximity maps for convex sets (1959).
    """
    before = np.inf
    mine = (cores[a, 0], cores[a, 1], cores[a, 2])
    other = mine
    for _ in range(4 * _ROUNDS):
        other = project(cores, b, mine[0], mine[1], mine[2])
        mine = project(cores, a, other[0], other[1], other[2])
        distance = (mine[0] - other[0]) ** 2 + (mine[1] - other[1]) ** 2 + (mine[2] - other[2]) ** 2
        if before - distance < _SMALL**2:
            break
        before = distance
    return mine, other


@compiled
def nearest_points(cores: Array, a: int, b: int) -> tuple[Point, Point]:
    """Return the nearest points of cores a and b; the same point where they overlap."""
    if cores[a, KIND] == BOX and cores[a, 12] == 0.0 and cores[a, 13] == 0.0:
        return _from_segment(cores, a, b)
    if cores[b, KIND] == BOX and cores[b, 12] == 0.0 and cores[b, 13] == 0.0:
        other, mine = _from_segment(cores, b, a)
        return mine, other
    return _of_thick(cores, a, b)
