"""Spheres of the robot against the objects of a scene, several configurations at a time."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.layout import (
    GROUP_FIRST,
    GROUP_OBJECTS,
    GROUPS,
    LANES_OUT,
    NUMBERS,
    OBJECT_BOXES,
    OBJECT_COUNT,
    OBJECTS,
    REACH,
    SPHERES,
    WORLD,
    section,
    section_bits,
    section_single,
)
from pepper_kin.collision.fast.options import LANES, OPTIONS, VECTOR
from pepper_kin.collision.fast.solids import CYLINDER, Array

Lanes = NDArray[np.float32]

OBJECT_SIZE = 20
"""Numbers of an object in OBJECTS: kind, radius, whether inner bounds hold, half lengths, pose (12), 2 free."""
BOX_SIZE = 6
"""Numbers of an object in OBJECT_BOXES: least and greatest x, y, z of the box around it in the world [m]."""
ZERO = np.float32(0.0)


@njit("int64(float32[::1], float32[::1], float32[::1], float32[::1], float32[::1], float64[::1], int64[::1])", **VECTOR)
def near_groups(
    x: Lanes, y: Lanes, z: Lanes, reach: Lanes, boxes: Lanes, compared: Array, pairs: NDArray[np.int64]
) -> int:
    """List the pairs of group and object whose sphere and box in the world meet in any lane.

    Args:
        x: Centres, one group after the other, each in all lanes [m].
        y: The same.
        z: The same.
        reach: Radii in the same order [m].
        boxes: Of the objects, BOX_SIZE numbers each.
        compared: Above zero where an object (row) is compared with a group.
        pairs: Number of the object times the number of groups plus that of the group, written.

    Returns:
        How many pairs.
    """
    groups, count = reach.size // LANES, 0
    for o in range(boxes.size // BOX_SIZE):
        low_x, low_y, low_z = boxes[6 * o], boxes[6 * o + 1], boxes[6 * o + 2]
        high_x, high_y, high_z = boxes[6 * o + 3], boxes[6 * o + 4], boxes[6 * o + 5]
        for g in range(groups):
            first = g * LANES
            xs, ys, zs = x[first : first + LANES], y[first : first + LANES], z[first : first + LANES]
            r = reach[first]
            square = r * r
            near = np.int32(0)
            for i in range(LANES):
                u = max(max(low_x - xs[i], xs[i] - high_x), ZERO)
                v = max(max(low_y - ys[i], ys[i] - high_y), ZERO)
                w = max(max(low_z - zs[i], zs[i] - high_z), ZERO)
                near |= np.int32(u * u + v * v + w * w < square)
            pairs[count] = o * groups + g
            count += near != 0 and compared[o * groups + g] > 0
    return count


@njit("void(float32[::1], float32[::1], float32[::1], float64[::1], float32[::1])", **VECTOR)
def squared_distances(x: Lanes, y: Lanes, z: Lanes, item: Array, result: Lanes) -> None:
    """Write the squared distance of points to the core of an object [m^2]."""
    hx, hy, hz = np.float32(item[3]), np.float32(item[4]), np.float32(item[5])
    cx, cy, cz = np.float32(item[6]), np.float32(item[7]), np.float32(item[8])
    ax, ay, az = np.float32(item[9]), np.float32(item[10]), np.float32(item[11])
    bx, by, bz = np.float32(item[12]), np.float32(item[13]), np.float32(item[14])
    ex, ey, ez = np.float32(item[15]), np.float32(item[16]), np.float32(item[17])
    if item[0] == CYLINDER:
        for i in range(result.size):
            dx, dy, dz = x[i] - cx, y[i] - cy, z[i] - cz
            u, v = dx * ax + dy * ay + dz * az, dx * bx + dy * by + dz * bz
            w = max(abs(dx * ex + dy * ey + dz * ez) - hz, ZERO)
            r = max(np.sqrt(u * u + v * v) - hx, ZERO)
            result[i] = r * r + w * w
        return
    for i in range(result.size):
        dx, dy, dz = x[i] - cx, y[i] - cy, z[i] - cz
        u = max(abs(dx * ax + dy * ay + dz * az) - hx, ZERO)
        v = max(abs(dx * bx + dy * by + dz * bz) - hy, ZERO)
        w = max(abs(dx * ex + dy * ey + dz * ez) - hz, ZERO)
        result[i] = u * u + v * v + w * w


@njit("void(float32[::1], float32[::1], float32, float32[::1])", **VECTOR)
def least_excess(squared: Lanes, reach: Lanes, radius: float, result: Lanes) -> None:
    """Write for each lane the least of d^2 - (R + r)^2 over spheres.

    Args:
        squared: d^2, sphere by sphere, each in all lanes [m^2].
        reach: R in the same order; below -r for what lies in nothing [m].
        radius: r [m].
        result: Written, one number per lane [m^2].
    """
    for i in range(LANES):
        result[i] = np.float32(1e30)
    for first in range(0, squared.size, LANES):
        row = squared[first : first + LANES]
        total = max(reach[first] + radius, ZERO)
        square = total * total
        for i in range(LANES):
            value = row[i] - square
            result[i] = value if value < result[i] else result[i]


@njit("void(float64[::1], int64[::1], int64[::1])", **OPTIONS)
def check_world(memory: Array, contact: NDArray[np.int64], doubt: NDArray[np.int64]) -> None:
    """Compare the spheres in LANES_OUT with all objects of the scene.

    Args:
        memory: The block; LANES_OUT holds the centres that the kernel `sphere_centers` has written: x, y and z
            of the groups' bounding spheres and of all spheres.
        contact: Whether an inner sphere meets an object, written for each lane.
        doubt: Bits of the groups (above 61: 61) that spheres alone cannot settle, written for each lane.
    """
    numbers, objects, first = section(memory, NUMBERS), section(memory, OBJECTS), section(memory, GROUP_FIRST)
    groups = int(numbers[GROUPS])
    size, wide = (groups + int(numbers[SPHERES])) * LANES, groups * LANES
    centers, reach = section_single(memory, LANES_OUT), section_single(memory, REACH)
    room, pairs = section_single(memory, WORLD), section_bits(memory, WORLD)[size:]
    x, y, z = centers[:size], centers[size : 2 * size], centers[2 * size : 3 * size]
    outer, inner = room[size : size + LANES], room[size + LANES : size + 2 * LANES]
    boxes = section_single(memory, OBJECT_BOXES)[: int(numbers[OBJECT_COUNT]) * BOX_SIZE]
    count = near_groups(
        x[:wide], y[:wide], z[:wide], reach[:wide], boxes, section(memory, GROUP_OBJECTS), pairs
    )
    contact[:] = 0
    doubt[:] = 0
    for k in range(count):
        o, g = pairs[k] // groups, pairs[k] % groups
        item = objects[OBJECT_SIZE * o : OBJECT_SIZE * (o + 1)]
        radius = np.float32(item[1])
        a, b = wide + int(first[g]) * LANES, wide + int(first[g + 1]) * LANES
        squared = room[: b - a]
        squared_distances(x[a:b], y[a:b], z[a:b], item, squared)
        least_excess(squared, reach[a:b], radius, outer)
        least_excess(squared, reach[size + a : size + b], radius, inner)
        for i in range(LANES):
            if outer[i] < 0:
                if item[2] > 0 and inner[i] < 0:
                    contact[i] = 1
                else:
                    doubt[i] |= 1 << min(g, 61)
