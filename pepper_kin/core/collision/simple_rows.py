"""Numbers of simple shapes as compiled checks take them, for all of a scene at once."""

from __future__ import annotations

import math

from pepper_kin.core.collision.layout import BOX, CYLINDER
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats2, Floats3

ROW = 20
"""Numbers of a solid: kind, radius, bounding radius, whether it is filled, distance of the core's farthest
corner, half lengths, center, x, y and z axis."""

BALL, BAR, ROUND, BLOCK = 0, 1, 2, 3
"""Simple shapes with their sizes: a sphere (radius), a capsule and a cylinder (radius, length) and a
box (its full lengths)."""


@compiled("void(float64[:, ::1], float64[:, :, ::1], float64[:, ::1])", lean=True)
def write_simple_rows(shapes: Floats2, poses: Floats3, rows: Floats2) -> None:
    """Write the rows of simple shapes.

    Args:
        shapes: Which shape, and its three sizes [m], shape (k, 4).
        poses: Transforms from their own frames to the world, shape (k, 4, 4).
        rows: Receives the numbers, shape (k, ROW).
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
