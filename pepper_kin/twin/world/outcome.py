"""What a solved step does: velocities of the free bodies, forces at the points, the load on the robot."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@njit("boolean(float64[:, ::1], float64[::1], float64)", **OPTIONS)
def fall(velocity: Array, gravity: Array, h: float) -> bool:
    """Add the pull of gravity over h [s] to all bodies; return whether all velocities are finite."""
    total = 0.0
    for b in range(len(velocity)):
        for i in range(3):
            velocity[b, i] += h * gravity[i]
            total += velocity[b, i] + velocity[b, 3 + i]
    return math.isfinite(total)


@njit(
    "boolean(float64[::1], float64[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], int64[::1], "
    "float64[::1], float64, float64[:, ::1], float64[:, ::1], float64[::1])",
    **OPTIONS,
)
def apply(
    u: Array,
    pushes: Array,
    jacobian: Array,
    rows: Array,
    tangents: Array,
    columns: Indices,
    gravity: Array,
    h: float,
    velocity: Array,
    forces: Array,
    load: Array,
) -> bool:
    """Write velocities of all bodies, forces of all points in the world's axes and the load on the robot.

    Returns:
        Whether all velocities and loads are finite.
    """
    total, touched = 0.0, len(u)
    for b in range(len(columns)):
        k = columns[b]
        if k >= 0:
            touched -= 6
        for i in range(6):
            if k >= 0:
                velocity[b, i] = u[k + i]
            elif i < 3:
                velocity[b, i] += h * gravity[i]
            total += velocity[b, i]
    for c in range(len(rows)):
        n, t = rows[c, 3:6], tangents[c]
        for i in range(3):
            k, m = (i + 1) % 3, (i + 2) % 3
            across = n[k] * t[m] - n[m] * t[k]
            forces[c, i] = (pushes[3 * c] * n[i] + pushes[3 * c + 1] * t[i] + pushes[3 * c + 2] * across) / h
    load[:] = 0.0
    if touched:
        for r in range(len(pushes)):
            if pushes[r] != 0.0:
                for k in range(len(load)):
                    load[k] += jacobian[r, k] * pushes[r] / h
        for k in range(len(load)):
            total += load[k]
    return math.isfinite(total)
