"""Tables of a scene's objects for compiled checks, written for all objects at once."""

from __future__ import annotations

import math

from pepper_kin.core.collision.layout import BOX, CLOUD, CYLINDER, OTHER
from pepper_kin.core.collision.records import OBJECT
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.lanes import store_single
from pepper_kin.kernels.signatures import Floats2, Floats3, Singles2

KIND, RADIUS, BOUNDING, FILLED, CORNER, HALF, PLACE, ROW = 0, 1, 2, 3, 4, 5, 8, 20
"""Columns of a solid, and their number: kind, radius, bounding radius, whether it is filled, distance of the
core's farthest corner, half lengths (3), pose of the core: center, x, y and z axis (12)."""

BALL, BAR, ROUND, BLOCK = 0, 1, 2, 3
"""Kinds of primitive shapes and their sizes: sphere (radius), capsule and cylinder (radius, length), box
(full lengths)."""


@compiled("void(float64[:, ::1], float64[:, :, ::1], float64[:, ::1])", lean=True)
def write_simple_rows(shapes: Floats2, poses: Floats3, rows: Floats2) -> None:
    """Write the rows of primitive shapes.

    Args:
        shapes: Kind of each shape, and its three sizes [m], shape (k, 4).
        poses: Transforms from the shapes' frames to the world, shape (k, 4, 4).
        rows: Output, shape (k, ROW).
    """
    for k in range(shapes.shape[0]):
        shape, a, b, c = int(shapes[k, 0]), shapes[k, 1], shapes[k, 2], shapes[k, 3]
        radius = a if shape in (BALL, BAR) else 0.0
        x = 0.5 * a if shape == BLOCK else a if shape == ROUND else 0.0
        y = 0.5 * b if shape == BLOCK else x
        z = 0.5 * c if shape == BLOCK else 0.5 * b if shape in (BAR, ROUND) else 0.0
        corner = math.sqrt(x * x + y * y + z * z)
        beyond = math.sqrt(x * x + z * z) if shape == ROUND else corner
        rows[k, 0] = CYLINDER if shape == ROUND else BOX
        rows[k, 1], rows[k, 2], rows[k, 3], rows[k, 4] = radius, beyond + radius, 1.0, corner
        rows[k, 5], rows[k, 6], rows[k, 7] = x, y, z
        for i in range(3):
            rows[k, 8 + i] = poses[k, i, 3]
            for j in range(3):
                rows[k, 11 + 3 * j + i] = poses[k, i, j]


NO_INNER = -1e3
"""Inner radius of shapes without an inner sphere [m]."""
VAST = 1e6
"""Half length that replaces an infinite one [m]."""


@compiled(
    "void(float64[:, ::1], float64, float64, float64, float32[:, ::1], float64[:, ::1], float64[:, ::1])",
    lean=True,
)
def write_objects(
    rows: Floats2,
    rounding: float,
    far: float,
    farthest: float,
    items: Singles2,
    lows: Floats2,
    highs: Floats2,
) -> None:
    """Write the section OBJECTS, which spheres are compared with, and the boxes around the objects.

    Args:
        rows: Rows of the objects, shape (k, ROW).
        rounding: Rounding error of a comparison relative to its distances.
        far: Limit of an object's size in that error: larger objects reach the robot wherever they are [m].
        farthest: Maximum reach of the robot [m].
        items: Output: the objects in single precision, shape (k, OBJECT.width).
        lows: Output: minimum corners of the boxes, shape (k, 3) [m].
        highs: Output: maximum corners of the boxes, shape (k, 3) [m].
    """
    for k in range(rows.shape[0]):
        kind, radius, corner = rows[k, 0], rows[k, 1], rows[k, 4]
        slack = rounding * (min(corner + radius, far) + farthest)
        known = kind in (BOX, CYLINDER, CLOUD)
        item = OBJECT.at(items.ctypes.data, k)
        half, pose = OBJECT.half_at(item), OBJECT.center_at(item)
        OBJECT.set_kind(item, kind)
        OBJECT.set_outer(item, radius + slack)
        OBJECT.set_inner(item, radius - slack if known else NO_INNER)
        for i in range(3):
            store_single(half, min(rows[k, 5 + i], VAST), i)
            length = radius + slack
            for j in range(3):
                length += abs(rows[k, 11 + 3 * j + i]) * min(rows[k, 5 + j], VAST)
            lows[k, i], highs[k, i] = rows[k, 8 + i] - length, rows[k, 8 + i] + length
        for i in range(12):
            store_single(pose, rows[k, 8 + i], i)
        OBJECT.set_bounding(item, (VAST if kind == OTHER else corner) + radius + slack)
