"""Manifolds: a face cut by a rectangle, and the few points that stand for what is left."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS

Array = NDArray[np.float64]

ROOM = 16
"""Rows that an outline needs while it is cut."""


@njit("int64(float64[:, ::1], int64, float64, float64, float64[:, ::1])", **OPTIONS)
def clip(outline: Array, count: int, half_u: float, half_v: float, room: Array) -> int:
    """Cut an outline of rows (u, v, height) by |u| <= half_u and |v| <= half_v, in place.

    One row is a point, two are a line, more a convex polygon (Sutherland and Hodgman 1974).

    Args:
        outline: (ROOM, 3), its first `count` rows.
        count: Number of rows.
        half_u: Half length of the rectangle along u [m].
        half_v: Half length along v [m].
        room: Work space like `outline`.

    Returns:
        Number of rows left.
    """
    for side in range(4):
        axis = side % 2
        half = half_u if axis == 0 else half_v
        sign = 1.0 if side < 2 else -1.0
        kept = 0
        for k in range(count):
            here = half - sign * outline[k, axis]
            if here >= 0:
                for i in range(3):
                    room[kept, i] = outline[k, i]
                kept += 1
            if count == 1 or (count == 2 and k == 1):
                continue
            after = (k + 1) % count
            there = half - sign * outline[after, axis]
            if (here >= 0) != (there >= 0):
                share = here / (here - there)
                for i in range(3):
                    room[kept, i] = outline[k, i] + share * (outline[after, i] - outline[k, i])
                kept += 1
        count = kept
        for k in range(count):
            for i in range(3):
                outline[k, i] = room[k, i]
        if count == 0:
            return 0
    return count


@njit("int64(float64[:, ::1], int64, float64[:, ::1])", **OPTIONS)
def reduce(outline: Array, count: int, room: Array) -> int:
    """Keep at most four rows (u, v, height), in place: the lowest and those that span the largest area.

    Returns:
        Number of rows kept.
    """
    if count <= 4:
        return count
    lowest = 0
    for k in range(count):
        if outline[k, 2] < outline[lowest, 2] - 1e-9:
            lowest = k
    far, most = lowest, -1.0
    for k in range(count):
        apart = (outline[k, 0] - outline[lowest, 0]) ** 2 + (outline[k, 1] - outline[lowest, 1]) ** 2
        if apart > most:
            far, most = k, apart
    left, right, above, below = -1, -1, 1e-14, -1e-14
    u, v = outline[far, 0] - outline[lowest, 0], outline[far, 1] - outline[lowest, 1]
    for k in range(count):
        area = u * (outline[k, 1] - outline[lowest, 1]) - v * (outline[k, 0] - outline[lowest, 0])
        if area > above:
            left, above = k, area
        if area < below:
            right, below = k, area
    kept = 0
    for k in (lowest, far, left, right):
        if k >= 0:
            for i in range(3):
                room[kept, i] = outline[k, i]
            kept += 1
    for k in range(kept):
        for i in range(3):
            outline[k, i] = room[k, i]
    return kept
