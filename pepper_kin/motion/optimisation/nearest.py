"""Nearest points of two convex bodies, compiled.

A body is a core, which is a box or a cylinder with a pose and half sizes, plus all points within a radius of
it.  A segment is a box without width, a point one without length: so capsules and spheres are bodies, too.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from pepper_kin.core.collision.segments import clamp, nearest_on_segments, nearest_to_box
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

Point: TypeAlias = tuple[float, float, float]

BOX, CYLINDER = 0, 1
_ROUNDS = 240
_ENOUGH = 1e-8  # share of a squared distance that a round must save
_TOUCHING = 1e-18  # [m^2]

# Columns of an array of cores: centre, x, y and z axis, half sizes, kind.
CENTER, AXES, HALF, KIND = 0, 3, 12, 15
COLUMNS = 16


@compiled(lean=True)
def project(core: Floats1, px: float, py: float, pz: float) -> Point:
    """Return the point of a core that is nearest to a point."""
    dx, dy, dz = px - core[0], py - core[1], pz - core[2]
    x = core[3] * dx + core[4] * dy + core[5] * dz
    y = core[6] * dx + core[7] * dy + core[8] * dz
    z = core[9] * dx + core[10] * dy + core[11] * dz
    if core[KIND] == CYLINDER:
        out = math.sqrt(x * x + y * y)
        if out > core[12]:
            x, y = x * core[12] / out, y * core[12] / out
    else:
        x, y = clamp(x, core[12]), clamp(y, core[13])
    z = clamp(z, core[14])
    return (
        core[0] + core[3] * x + core[6] * y + core[9] * z,
        core[1] + core[4] * x + core[7] * y + core[10] * z,
        core[2] + core[5] * x + core[8] * y + core[11] * z,
    )


@compiled(lean=True)
def _by_turns(a: Floats1, b: Floats1) -> tuple[Point, Point]:
    """Return the nearest points of two cores by projecting on them by turns.

    W. Cheney and A. Goldstein, Proximity maps for convex sets (1959).
    """
    before = np.inf
    mine = (a[0], a[1], a[2])
    other = mine
    for _ in range(_ROUNDS):
        other = project(b, mine[0], mine[1], mine[2])
        mine = project(a, other[0], other[1], other[2])
        distance = (mine[0] - other[0]) ** 2 + (mine[1] - other[1]) ** 2 + (mine[2] - other[2]) ** 2
        if before - distance < _ENOUGH * distance + _TOUCHING:
            break
        before = distance
    return mine, other


@compiled(lean=True, inline=True)
def _is_segment(core: Floats1) -> bool:
    return core[KIND] == BOX and core[HALF] == 0.0 and core[HALF + 1] == 0.0


@compiled(lean=True, inline=True)
def _on_axis(core: Floats1, s: float) -> Point:
    return core[0] + s * core[9], core[1] + s * core[10], core[2] + s * core[11]


@compiled(lean=True)
def _from_segment(a: Floats1, b: Floats1) -> tuple[Point, Point]:
    """Return the nearest points of a segment and another box."""
    if _is_segment(b):
        s, t = nearest_on_segments(a, a[14], b, b[14])
        return _on_axis(a, s), _on_axis(b, t)
    s, _ = nearest_to_box(a, a[14], b, b[HALF:KIND])
    x, y, z = _on_axis(a, s)
    return (x, y, z), project(b, x, y, z)


@compiled(lean=True)
def nearest_points(a: Floats1, b: Floats1) -> tuple[Point, Point]:
    """Return the nearest points of two cores; the same point where they overlap."""
    if _is_segment(a) and b[KIND] == BOX:
        return _from_segment(a, b)
    if _is_segment(b) and a[KIND] == BOX:
        other, mine = _from_segment(b, a)
        return mine, other
    return _by_turns(a, b)


@compiled(lean=True)
def place_core(pose: Floats2, local: Floats1, core: Floats1) -> None:
    """Write a core in the world, given that in a frame and the frame's pose, shape (4, 4)."""
    for column in range(4):
        x, y, z = local[3 * column], local[3 * column + 1], local[3 * column + 2]
        for i in range(3):
            own = pose[i, 3] if column == 0 else 0.0
            core[3 * column + i] = own + x * pose[i, 0] + y * pose[i, 1] + z * pose[i, 2]
