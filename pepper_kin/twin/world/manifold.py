"""Contacts of two shapes as points, where they follow from faces and round ends alone."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.twin.world.clipping import ROOM, clip, reduce
from pepper_kin.twin.world.kinds import BALL, BOX, CAPSULE, feature, reach

Array = NDArray[np.float64]

OPEN = -1
"""Returned where neither faces nor round ends decide: edges and corners, which are left to coal."""
SETTLED = 1e-4
"""A manifold counts if its lowest point is as low as the other shape reaches, but for this [m]."""

_SHAPE = "int64, float64[::1], float64[:, ::1], float64[::1]"


@njit(
    "void(float64[:, ::1], int64, float64, float64, float64, float64, float64, float64, float64)", **OPTIONS
)
def _write(
    rows: Array, row: int, x: float, y: float, z: float, nx: float, ny: float, nz: float, gap: float
) -> None:
    """Write a point, halfway between the surfaces, given that on the second shape's."""
    half = 0.5 * gap
    rows[row, 0], rows[row, 1], rows[row, 2] = x + half * nx, y + half * ny, z + half * nz
    rows[row, 3], rows[row, 4], rows[row, 5], rows[row, 6] = nx, ny, nz, gap


@njit(f"int64({_SHAPE}, {_SHAPE}, float64, float64[:, ::1])", **OPTIONS)
def on_plane(
    kind: int,
    size: Array,
    rotation: Array,
    centre: Array,
    _kind: int,
    plane_size: Array,
    plane_rotation: Array,
    plane_centre: Array,
    margin: float,
    rows: Array,
) -> int:
    """Write contacts of a shape with a half-space, rows (point, normal, gap); the normal leaves the plane."""
    x, y, z = plane_rotation[0, 2], plane_rotation[1, 2], plane_rotation[2, 2]
    height = plane_size[0] + x * plane_centre[0] + y * plane_centre[1] + z * plane_centre[2]
    if -reach(kind, size, rotation, centre, -x, -y, -z) - height > margin:
        return 0
    down, points = np.empty(3), np.empty((4, 3))
    down[0], down[1], down[2] = -x, -y, -z
    count = feature(kind, size, rotation, centre, down, points)
    kept = 0
    for k in range(count):
        a, b, c = points[k, 0], points[k, 1], points[k, 2]
        gap = x * a + y * b + z * c - height
        if gap <= margin:
            _write(rows, kept, a - gap * x, b - gap * y, c - gap * z, x, y, z, gap)
            kept += 1
    return kept


@njit(f"int64({_SHAPE}, {_SHAPE}, float64, float64[:, ::1])", **OPTIONS)
def of_round(
    kind: int,
    size: Array,
    rotation: Array,
    centre: Array,
    other_kind: int,
    other_size: Array,
    other_rotation: Array,
    other_centre: Array,
    margin: float,
    rows: Array,
) -> int:
    """Write the contact of two balls or capsules, where their segments are nearest."""
    u, w, apart, normal = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    half = size[1] if kind == CAPSULE else 0.0
    other_half = other_size[1] if other_kind == CAPSULE else 0.0
    uu, ww, uw, ud, wd = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        u[i], w[i] = half * rotation[i, 2], other_half * other_rotation[i, 2]
        apart[i] = centre[i] - other_centre[i]
        uu, ww, uw = uu + u[i] * u[i], ww + w[i] * w[i], uw + u[i] * w[i]
        ud, wd = ud + u[i] * apart[i], wd + w[i] * apart[i]
    # |apart + s u - t w| least over s, t in [-1, 1]: free, then one clamped after the other
    # (Ericson, Real-Time Collision Detection, 2005, 5.1.9)
    across = uu * ww - uw * uw
    s = 0.0
    if across > 1e-12 * uu * ww:
        s = min(1.0, max(-1.0, (uw * wd - ww * ud) / across))
    t = (uw * s + wd) / ww if ww > 0 else 0.0
    t = min(1.0, max(-1.0, t))
    if uu > 0:
        s = min(1.0, max(-1.0, (uw * t - ud) / uu))
    for i in range(3):
        normal[i] = apart[i] + s * u[i] - t * w[i]
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    gap = length - size[0] - other_size[0]
    if gap > margin:
        return 0
    for i in range(3):
        normal[i] = normal[i] / length if length > 1e-12 else (1.0 if i == 2 else 0.0)
        apart[i] = other_centre[i] + t * w[i] + other_size[0] * normal[i]
    _write(rows, 0, apart[0], apart[1], apart[2], normal[0], normal[1], normal[2], gap)
    return 1


@njit(f"float64({_SHAPE}, {_SHAPE}, int64[::1])", **OPTIONS)
def _best_face(
    kind: int,
    size: Array,
    rotation: Array,
    centre: Array,
    _kind: int,
    box_size: Array,
    box_rotation: Array,
    box_centre: Array,
    face: NDArray[np.int64],
) -> float:
    """Return how far a shape is above that face of a box which it is farthest above; write axis and sign."""
    best = -math.inf
    for k in range(3):
        x, y, z = box_rotation[0, k], box_rotation[1, k], box_rotation[2, k]
        middle = x * box_centre[0] + y * box_centre[1] + z * box_centre[2]
        above = -reach(kind, size, rotation, centre, -x, -y, -z) - middle - box_size[k]
        below = -reach(kind, size, rotation, centre, x, y, z) + middle - box_size[k]
        if above > best:
            best, face[0], face[1] = above, k, 1
        if below > best:
            best, face[0], face[1] = below, k, -1
    return best


@njit(
    "int64(float64, float64[::1], float64[::1], float64[:, ::1], float64[::1], float64, float64[:, ::1])",
    **OPTIONS,
)
def _ball_on_corner(
    radius: float,
    centre: Array,
    box_size: Array,
    box_rotation: Array,
    box_centre: Array,
    margin: float,
    rows: Array,
) -> int:
    """Write the contact of a ball, centre outside, with the nearest point of a box."""
    nearest, normal = np.empty(3), np.empty(3)
    for i in range(3):
        nearest[i] = box_centre[i]
    for k in range(3):
        along = 0.0
        for i in range(3):
            along += (centre[i] - box_centre[i]) * box_rotation[i, k]
        along = min(box_size[k], max(-box_size[k], along))
        for i in range(3):
            nearest[i] += along * box_rotation[i, k]
    for i in range(3):
        normal[i] = centre[i] - nearest[i]
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    gap = length - radius
    if gap > margin:
        return 0
    if length < 1e-12:
        return OPEN
    x, y, z = normal[0] / length, normal[1] / length, normal[2] / length
    _write(rows, 0, nearest[0], nearest[1], nearest[2], x, y, z, gap)
    return 1


@njit(
    f"int64({_SHAPE}, float64[::1], float64[:, ::1], float64[::1], int64[::1], float64, float64, float64, "
    "float64[:, ::1])",
    **OPTIONS,
)
def _on_face(
    kind: int,
    size: Array,
    rotation: Array,
    centre: Array,
    box_size: Array,
    box_rotation: Array,
    box_centre: Array,
    face: NDArray[np.int64],
    lowest: float,
    margin: float,
    sense: float,
    rows: Array,
) -> int:
    k = face[0]
    first, second = (k + 1) % 3, (k + 2) % 3
    normal, down, points = np.empty(3), np.empty(3), np.empty((4, 3))
    for i in range(3):
        normal[i] = face[1] * box_rotation[i, k]
        down[i] = -normal[i]
    count = feature(kind, size, rotation, centre, down, points)
    outline, room = np.empty((ROOM, 3)), np.empty((ROOM, 3))
    for p in range(count):
        u, v, w = 0.0, 0.0, 0.0
        for i in range(3):
            apart = points[p, i] - box_centre[i]
            u += apart * box_rotation[i, first]
            v += apart * box_rotation[i, second]
            w += apart * normal[i]
        outline[p, 0], outline[p, 1], outline[p, 2] = u, v, w - box_size[k]
    if kind == BALL:
        u, v = abs(outline[0, 0]) - box_size[first], abs(outline[0, 1]) - box_size[second]
        if u > 0 or v > 0:
            return _ball_on_corner(size[0], centre, box_size, box_rotation, box_centre, margin, rows)
    count = clip(outline, count, box_size[first], box_size[second], room)
    least, kept = math.inf, 0
    for p in range(count):
        least = min(least, outline[p, 2])
        if outline[p, 2] <= margin:
            for i in range(3):
                outline[kept, i] = outline[p, i]
            kept += 1
    if least > lowest + SETTLED:
        return OPEN
    kept = reduce(outline, kept, room)
    for p in range(kept):
        for i in range(3):
            rows[p, i] = (
                box_centre[i]
                + outline[p, 0] * box_rotation[i, first]
                + outline[p, 1] * box_rotation[i, second]
                + (box_size[k] + 0.5 * outline[p, 2]) * normal[i]
            )
            rows[p, 3 + i] = sense * normal[i]
        rows[p, 6] = outline[p, 2]
    return kept


@njit(f"int64({_SHAPE}, {_SHAPE}, float64, float64[:, ::1])", **OPTIONS)
def on_box(
    kind: int,
    size: Array,
    rotation: Array,
    centre: Array,
    box_kind: int,
    box_size: Array,
    box_rotation: Array,
    box_centre: Array,
    margin: float,
    rows: Array,
) -> int:
    """Write contacts of a shape with a box.

    The shape is at least as far from the box as above any face of either.  Where its lowest point above the
    best face lies over that face, it is no farther, and the face's normal is that of the contact.
    """
    face, other_face = np.zeros(2, np.int64), np.zeros(2, np.int64)
    gap = _best_face(
        kind, size, rotation, centre, box_kind, box_size, box_rotation, box_centre, face
    )  # fmt: skip
    if gap > margin:
        return 0
    if kind == BOX:
        other = _best_face(
            box_kind, box_size, box_rotation, box_centre, kind, size, rotation, centre, other_face
        )
        if other > margin:
            return 0
        if other > gap + 1e-7:
            return _on_face(
                box_kind, box_size, box_rotation, box_centre, size, rotation, centre,
                other_face, other, margin, -1.0, rows,
            )  # fmt: skip
    return _on_face(
        kind, size, rotation, centre, box_size, box_rotation, box_centre, face, gap, margin, 1.0, rows
    )
