"""Nearest points of two convex bodies, compiled.

A body is a core, which is a box or a cylinder with a pose and half sizes, plus all points within a radius of
it.  A segment is a box without width, a point one without length: so capsules and spheres are bodies, too.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from pepper_kin.core.collision.segments import clamp, nearest_on_segments, nearest_to_box
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1

Point: TypeAlias = tuple[float, float, float]

BOX, CYLINDER = 0, 1
_ROUNDS = 240
_ENOUGH = 1e-10  # share of a squared distance by which a round must move, squared
_TOUCHING = 1e-18  # [m^2]

# Columns of an array of cores: center, x, y and z axis, half sizes, kind.
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
def _by_turns(a: Floats1, b: Floats1, guess: Floats1) -> tuple[Point, Point]:
    """Return the nearest points of two cores by projecting on them by turns, with momentum.

    W. Cheney and A. Goldstein, Proximity maps for convex sets (1959); projecting on one and then the other is
    a gradient step on half the squared distance, which is accelerated as by Y. Nesterov (1983) and started
    again where a step turns back (B. O'Donoghue and E. Candes, 2015).
    """
    x, y, z = a[0], a[1], a[2]
    if guess[0] != 0.0:
        p, q, r = guess[1], guess[2], guess[3]
        x += a[3] * p + a[6] * q + a[9] * r
        y += a[4] * p + a[7] * q + a[10] * r
        z += a[5] * p + a[8] * q + a[11] * r
    mx, my, mz, steps = x, y, z, 0.0
    for _ in range(_ROUNDS):
        u, v, w = project(b, x, y, z)
        nx, ny, nz = project(a, u, v, w)
        distance = (nx - u) ** 2 + (ny - v) ** 2 + (nz - w) ** 2
        rest = (nx - x) ** 2 + (ny - y) ** 2 + (nz - z) ** 2
        turns = (x - nx) * (nx - mx) + (y - ny) * (ny - my) + (z - nz) * (nz - mz) > 0.0
        steps = 0.0 if turns else steps + 1.0
        share = steps / (steps + 3.0)
        x, y, z = nx + share * (nx - mx), ny + share * (ny - my), nz + share * (nz - mz)
        mx, my, mz = nx, ny, nz
        if rest <= _ENOUGH * distance + _TOUCHING:
            break
    dx, dy, dz = mx - a[0], my - a[1], mz - a[2]
    guess[0], guess[1] = 1.0, a[3] * dx + a[4] * dy + a[5] * dz
    guess[2], guess[3] = a[6] * dx + a[7] * dy + a[8] * dz, a[9] * dx + a[10] * dy + a[11] * dz
    return (mx, my, mz), project(b, mx, my, mz)


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
def nearest_points(a: Floats1, b: Floats1, guess: Floats1) -> tuple[Point, Point]:
    """Return the nearest points of two cores; the same point where they overlap.

    Args:
        a: A core in the world, shape (16,).
        b: Another.
        guess: 1 and the nearest point of the first, in its axes, when these two were asked about last, at a
            state nearby; 0 if they were not.  Written, shape (4,).
    """
    if _is_segment(a) and b[KIND] == BOX:
        return _from_segment(a, b)
    if _is_segment(b) and a[KIND] == BOX:
        other, mine = _from_segment(b, a)
        return mine, other
    return _by_turns(a, b, guess)
