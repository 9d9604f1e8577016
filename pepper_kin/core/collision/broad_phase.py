"""Spheres of the robot against the objects of a scene, several configurations at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.core.collision.layout import (
    CYLINDER,
    GROUP_FIRST,
    GROUP_OBJECTS,
    GROUPS,
    LANES,
    LANES_OUT,
    NUMBERS,
    OBJECT_BOXES,
    OBJECT_COUNT,
    OBJECTS,
    REACH,
    SPHERES,
    WORLD,
    Array,
    section,
    section_bits,
    section_single,
)
from pepper_kin.kernels.compiled_function import compiled

Lanes = NDArray[np.float32]

OBJECT_SIZE = 20
"""Numbers of an object in OBJECTS: kind, radius, whether inner bounds hold, half lengths, pose (12)."""
BOX_SIZE = 6
"""Numbers of an object in OBJECT_BOXES: least and greatest x, y, z in the world [m]."""
WORDS = LANES // 2
"""Words of 64 bits that flags of 32 bits in all lanes take."""
ZERO = np.float32(0.0)


@compiled(vector=True)
def _in_reach(x: Lanes, y: Lanes, z: Lanes, reach: Lanes, box: Lanes, flags: NDArray[np.int32]) -> None:
    """Write whether spheres meet a box along the world's axes."""
    low_x, low_y, low_z, high_x, high_y, high_z = box[0], box[1], box[2], box[3], box[4], box[5]
    for i in range(flags.size):
        u = max(max(low_x - x[i], x[i] - high_x), ZERO)
        v = max(max(low_y - y[i], y[i] - high_y), ZERO)
        w = max(max(low_z - z[i], z[i] - high_z), ZERO)
        flags[i] = u * u + v * v + w * w < reach[i] * reach[i]


@compiled(vector=True)
def _nearer(squared: Lanes, reach: Lanes, radius: float, flags: NDArray[np.int32]) -> None:
    """Write whether d^2 < (R + r)^2; a reach below -r is that of a sphere in nothing."""
    for i in range(flags.size):
        total = max(reach[i] + radius, ZERO)
        flags[i] = squared[i] < total * total


@compiled
def _any_of_rows(flags: NDArray[np.int64], result: NDArray[np.int64]) -> None:
    """Combine rows of flags, two lanes in a word."""
    for k in range(WORDS):
        found = 0
        for i in range(k, flags.size, WORDS):
            found |= flags[i]
        result[k] = found


@compiled(vector=True)
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


@compiled(vector=True)
def least_excess(squared: Lanes, reach: Lanes, radius: float, lanes: int, result: Lanes) -> None:
    """Write for each lane the least of d^2 - (R + r)^2 over spheres.

    Args:
        squared: d^2, sphere by sphere, each in all lanes [m^2].
        reach: R in the same order [m].
        radius: r [m].
        lanes: LANES; were it a constant, the compiler would unroll the loop, not vectorise it.
        result: Written, one number per lane [m^2].
    """
    result[:] = np.float32(1e30)
    for first in range(0, squared.size, lanes):
        row = squared[first : first + lanes]
        total = max(reach[first] + radius, ZERO)
        square = total * total
        for i in range(lanes):
            value = row[i] - square
            result[i] = value if value < result[i] else result[i]


@compiled
def check_world(memory: Array, contact: NDArray[np.int64], doubt: NDArray[np.int64]) -> None:
    """Compare the spheres in LANES_OUT with all objects of the scene.

    Args:
        memory: The block; LANES_OUT holds the centres that the kernel `sphere_centers` has written: x, y and
            z of the groups' bounding spheres and of all spheres.
        contact: Whether an inner sphere meets an object, written for each lane.
        doubt: Bits of the groups that spheres alone cannot settle, written for each lane.
    """
    numbers, objects, first = section(memory, NUMBERS), section(memory, OBJECTS), section(memory, GROUP_FIRST)
    boxes, compared = section_single(memory, OBJECT_BOXES), section(memory, GROUP_OBJECTS)
    groups = int(numbers[GROUPS])
    size, wide = (groups + int(numbers[SPHERES])) * LANES, groups * LANES
    centers, reach = section_single(memory, LANES_OUT), section_single(memory, REACH)
    words = section_bits(memory, WORLD)
    squared, words = words[: size // 2].view(np.float32), words[size // 2 :]
    flags, outer, inner = words[: size // 2], words[size // 2 :][:WORDS], words[size // 2 + WORDS :][:WORDS]
    x, y, z = centers[:size], centers[size : 2 * size], centers[2 * size : 3 * size]
    near = flags[: wide // 2]
    contact[:] = 0
    doubt[:] = 0
    for o in range(int(numbers[OBJECT_COUNT])):
        box = boxes[BOX_SIZE * o : BOX_SIZE * (o + 1)]
        _in_reach(x[:wide], y[:wide], z[:wide], reach[:wide], box, near.view(np.int32))
        close = 0
        for g in range(groups):
            found = 0
            for k in range(WORDS):
                found |= near[g * WORDS + k]
            if found != 0 and compared[o * groups + g] > 0:
                close |= 1 << g
        if close == 0:
            continue
        item = objects[OBJECT_SIZE * o : OBJECT_SIZE * (o + 1)]
        radius: Any = np.float32(item[1])
        for g in range(groups):
            if not (close >> g) & 1:
                continue
            a, b = wide + int(first[g]) * LANES, wide + int(first[g + 1]) * LANES
            some = flags[: (b - a) // 2]
            squared_distances(x[a:b], y[a:b], z[a:b], item, squared[: b - a])
            _nearer(squared[: b - a], reach[a:b], radius, some.view(np.int32))
            _any_of_rows(some, outer)
            _nearer(squared[: b - a], reach[size + a : size + b], radius, some.view(np.int32))
            _any_of_rows(some, inner)
            for i in range(LANES):
                shift = 32 * (i % 2)
                if (outer[i // 2] >> shift) & 1:
                    if item[2] > 0 and (inner[i // 2] >> shift) & 1:
                        contact[i] = 1
                    else:
                        doubt[i] |= 1 << g
