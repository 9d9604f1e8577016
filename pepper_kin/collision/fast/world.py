"""Spheres of the robot against the objects of a scene, several configurations at a time."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS, VECTOR
from pepper_kin.collision.fast.layout import (
    GROUP_FIRST,
    GROUP_OBJECTS,
    GROUPS,
    LANES_OUT,
    NUMBERS,
    OBJECT_COUNT,
    OBJECTS,
    REACH,
    SPHERES,
    WORLD,
    section,
    section_single,
)
from pepper_kin.collision.fast.solids import CYLINDER, Array

Lanes = NDArray[np.float32]

OBJECT_SIZE = 20
"""Numbers of an object in OBJECTS: kind, radius, whether inner bounds hold, half lengths, pose (12), 2 free."""


@njit("void(float32[::1], float32[::1], float32[::1], float64[::1], float32[::1])", **VECTOR)
def squared_distances(x: Lanes, y: Lanes, z: Lanes, item: Array, result: Lanes) -> None:
    """Write the squared distance of points to the core of an object [m^2]."""
    hx, hy, hz = np.float32(item[3]), np.float32(item[4]), np.float32(item[5])
    cx, cy, cz = np.float32(item[6]), np.float32(item[7]), np.float32(item[8])
    ax, ay, az = np.float32(item[9]), np.float32(item[10]), np.float32(item[11])
    bx, by, bz = np.float32(item[12]), np.float32(item[13]), np.float32(item[14])
    ex, ey, ez = np.float32(item[15]), np.float32(item[16]), np.float32(item[17])
    zero = np.float32(0.0)
    if item[0] == CYLINDER:
        for i in range(result.size):
            dx, dy, dz = x[i] - cx, y[i] - cy, z[i] - cz
            u, v = dx * ax + dy * ay + dz * az, dx * bx + dy * by + dz * bz
            w = abs(dx * ex + dy * ey + dz * ez) - hz
            r = np.sqrt(u * u + v * v) - hx
            r, w = max(r, zero), max(w, zero)
            result[i] = r * r + w * w
        return
    for i in range(result.size):
        dx, dy, dz = x[i] - cx, y[i] - cy, z[i] - cz
        u = abs(dx * ax + dy * ay + dz * az) - hx
        v = abs(dx * bx + dy * by + dz * bz) - hy
        w = abs(dx * ex + dy * ey + dz * ez) - hz
        u, v, w = max(u, zero), max(v, zero), max(w, zero)
        result[i] = u * u + v * v + w * w


@njit("void(float32[::1], float32[::1], float32, float32[::1])", **VECTOR)
def less_reach(squared: Lanes, reach: Lanes, radius: float, result: Lanes) -> None:
    """Write d^2 - (R + r)^2."""
    zero = np.float32(0.0)
    for i in range(result.size):
        total = max(reach[i] + radius, zero)
        result[i] = squared[i] - total * total


@njit("boolean(float32[::1])", **VECTOR)
def _any_below_zero(values: Lanes) -> bool:
    least = values[0]
    for i in range(values.size):
        least = min(least, values[i])
    return least < 0


@njit("void(float32[::1], float32[::1], int64)", **VECTOR)
def least_of_rows(values: Lanes, result: Lanes, lanes: int) -> None:
    """Write, lane by lane, the least of rows."""
    for i in range(lanes):
        result[i] = values[i]
    for first in range(lanes, values.size, lanes):
        row = values[first : first + lanes]
        for i in range(lanes):
            result[i] = min(result[i], row[i])


@njit("void(float64[::1], int64, int64[::1], int64[::1])", **OPTIONS)
def check_world(memory: Array, lanes: int, contact: NDArray[np.int64], doubt: NDArray[np.int64]) -> None:
    """Compare the spheres in LANES_OUT with all objects of the scene.

    Args:
        memory: The block; LANES_OUT holds the centres that the kernel `sphere_centers` has written: x, y and z
            of the groups' bounding spheres and of all spheres.
        lanes: Number of configurations side by side.
        contact: Whether an inner sphere meets an object, written for each lane.
        doubt: Bits of the groups (above 61: 61) that spheres alone cannot settle, written for each lane.
    """
    numbers, objects, first = section(memory, NUMBERS), section(memory, OBJECTS), section(memory, GROUP_FIRST)
    compared = section(memory, GROUP_OBJECTS)
    groups, count = int(numbers[GROUPS]), int(numbers[GROUPS] + numbers[SPHERES])
    centers, reach, room = (
        section_single(memory, LANES_OUT), section_single(memory, REACH), section_single(memory, WORLD),
    )  # fmt: skip
    size = count * lanes
    x, y, z = centers[:size], centers[size : 2 * size], centers[2 * size : 3 * size]
    outer_reach, inner_reach = reach[:size], reach[size : 2 * size]
    near, squared, excess = room[: groups * lanes], room[size : 2 * size], room[2 * size : 3 * size]
    outer, inner = room[3 * size : 3 * size + lanes], room[3 * size + lanes : 3 * size + 2 * lanes]
    contact[:lanes] = 0
    doubt[:lanes] = 0
    for o in range(int(numbers[OBJECT_COUNT])):
        item = objects[OBJECT_SIZE * o : OBJECT_SIZE * (o + 1)]
        radius = np.float32(item[1])
        squared_distances(x[: near.size], y[: near.size], z[: near.size], item, near)
        less_reach(near, outer_reach[: near.size], radius, near)
        if not _any_below_zero(near):
            continue
        for g in range(groups):
            if compared[o * groups + g] == 0.0:
                continue
            if not _any_below_zero(near[g * lanes : (g + 1) * lanes]):
                continue
            a, b = (groups + int(first[g])) * lanes, (groups + int(first[g + 1])) * lanes
            d, e = squared[: b - a], excess[: b - a]
            squared_distances(x[a:b], y[a:b], z[a:b], item, d)
            less_reach(d, outer_reach[a:b], radius, e)
            least_of_rows(e, outer, lanes)
            less_reach(d, inner_reach[a:b], radius, e)
            least_of_rows(e, inner, lanes)
            for i in range(lanes):
                if item[2] > 0 and inner[i] < 0:
                    contact[i] = 1
                elif outer[i] < 0:
                    doubt[i] |= 1 << min(g, 61)
