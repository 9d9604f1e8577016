"""Lower bounds of distances, compiled: part by part of the robot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pepper_kin.core.collision.broad_phase import OBJECT_SIZE, least_excess, squared_distances
from pepper_kin.core.collision.check import gather
from pepper_kin.core.collision.layout import (
    CENTER_KERNEL,
    CLASS_KERNELS,
    CLASS_RADII,
    CLASSES,
    GROUP_FIRST,
    GROUP_OBJECTS,
    GROUP_RADII,
    GROUP_SOLIDS,
    GROUPS,
    LANES,
    LANES_IN,
    LANES_OUT,
    LANES_WORK,
    NEAR_KERNEL,
    NUMBERS,
    OBJECT_COUNT,
    OBJECTS,
    PAIR_FIRST,
    PAIRS,
    POSE_KERNEL,
    POSES,
    QUEUE,
    REACH,
    ROOM,
    ROWS,
    SINGLE_WORK,
    SOLIDS,
    SPHERES,
    WORLD,
    Array,
    N,
    section,
    section_bits,
    section_single,
)
from pepper_kin.core.collision.narrow_phase import SOLID_SIZE, pair_distance
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_kernel

SMALL = 0.03
"""Bounds by spheres below this are replaced by exact distances where there is a closed form [m]."""


@compiled
def distance_bound(excess: float, greatest: float) -> float:
    """Return the least d - R for which d^2 - R^2 is at least `excess`, R being at most `greatest` [m].

    d - R = sqrt(excess + R^2) - R falls with R.  Below zero nothing is known: d is the distance to a core,
    not how deep it is entered.

    Args:
        excess: A lower bound of d^2 - R^2 [m^2].
        greatest: Greatest radius R [m].
    """
    if excess >= 0.0:
        return math.sqrt(excess + greatest * greatest) - greatest
    return -math.inf


@compiled
def _self_bounds(memory: Array, bounds: Array, first: int, count: int) -> None:
    """Write the bounds of all classes of pairs for the configurations in LANES_IN."""
    numbers, kernels, radii = (
        section(memory, NUMBERS),
        section(memory, CLASS_KERNELS),
        section(memory, CLASS_RADII),
    )
    given, found = section_single(memory, LANES_IN), section_single(memory, LANES_OUT)
    work, classes = section(memory, LANES_WORK), int(numbers[CLASSES])
    if classes > 0:
        call_kernel(int(numbers[NEAR_KERNEL]), given.ctypes.data, found.ctypes.data, work.ctypes.data)
    for c in range(classes):
        for i in range(count):
            rough = distance_bound(found[c * LANES + i], radii[2 * c + 1])
            bounds[first + i, c] = rough
    for c in range(classes):
        call_kernel(int(kernels[c]), given.ctypes.data, found.ctypes.data, work.ctypes.data)
        for i in range(count):
            fine = distance_bound(found[i], radii[2 * c])
            bounds[first + i, c] = max(bounds[first + i, c], fine)


@compiled
def _scene_bounds(memory: Array, bounds: Array, first: int, count: int, lanes: int) -> None:
    """Write the bounds of all groups of solids to the scene for the configurations in LANES_IN."""
    numbers, objects, starts = (
        section(memory, NUMBERS),
        section(memory, OBJECTS),
        section(memory, GROUP_FIRST),
    )
    compared, radii = section(memory, GROUP_OBJECTS), section(memory, GROUP_RADII)
    given, found = section_single(memory, LANES_IN), section_single(memory, LANES_OUT)
    reach, room, work = (
        section_single(memory, REACH),
        section_single(memory, WORLD),
        section(memory, LANES_WORK),
    )
    groups, classes = int(numbers[GROUPS]), int(numbers[CLASSES])
    size = (groups + int(numbers[SPHERES])) * LANES
    if groups == 0 or numbers[OBJECT_COUNT] == 0:
        return
    call_kernel(int(numbers[CENTER_KERNEL]), given.ctypes.data, found.ctypes.data, work.ctypes.data)
    x, y, z = found[:size], found[size : 2 * size], found[2 * size : 3 * size]
    least = room[size : size + LANES]
    for g in range(groups):
        a, b = (groups + int(starts[g])) * LANES, (groups + int(starts[g + 1])) * LANES
        squared = room[: b - a]
        for i in range(count):
            bounds[first + i, classes + g] = math.inf
        for o in range(int(numbers[OBJECT_COUNT])):
            if compared[o * groups + g] == 0.0:
                continue
            item = objects[OBJECT_SIZE * o : OBJECT_SIZE * (o + 1)]
            radius: Any = np.float32(item[1])
            squared_distances(x[a:b], y[a:b], z[a:b], item, squared)
            least_excess(squared, reach[a:b], radius, lanes, least)
            for i in range(count):
                bound = distance_bound(least[i], radii[g] + item[1])
                bounds[first + i, classes + g] = min(bounds[first + i, classes + g], bound)


@compiled
def _sharpen(memory: Array, bounds: Array, row: int) -> None:
    """Raise those bounds of a configuration in ROWS that are small, by exact distances."""
    numbers, solids, poses = section(memory, NUMBERS), section(memory, SOLIDS), section(memory, POSES)
    first, pairs, members = section(memory, PAIR_FIRST), section(memory, PAIRS), section(memory, GROUP_SOLIDS)
    compared, work = section(memory, GROUP_OBJECTS), section(memory, SINGLE_WORK)
    n, classes, groups = int(numbers[N]), int(numbers[CLASSES]), int(numbers[GROUPS])
    objects, q = int(numbers[OBJECT_COUNT]), section(memory, ROWS)[n * row : n * row + n]
    if bounds.size == 0 or bounds.min() > SMALL:
        return
    call_kernel(int(numbers[POSE_KERNEL]), q.ctypes.data, poses.ctypes.data, work.ctypes.data)
    for c in range(classes):
        if bounds[c] > SMALL:
            continue
        least = math.inf
        for k in range(int(first[c]), int(first[c + 1])):
            least = min(
                least, pair_distance(memory, solids, poses, int(pairs[2 * k]), int(pairs[2 * k + 1]), least)
            )
        bounds[c] = max(bounds[c], least)
    for g in range(groups):
        if bounds[classes + g] > SMALL:
            continue
        least = math.inf
        for k in range(members.size // 2):
            for o in range(objects):
                if int(members[2 * k]) == g and compared[o * groups + g] > 0:
                    b = solids.size // SOLID_SIZE - objects + o
                    least = min(
                        least, pair_distance(memory, solids, poses, int(members[2 * k + 1]), b, least)
                    )
        bounds[classes + g] = max(bounds[classes + g], least)


@compiled("void(float64[::1], float64[:, ::1], float64[:, ::1], int64)")
def part_bounds(memory: Array, q: Array, bounds: Array, lanes: int) -> None:
    """Write lower bounds of the distance of each class of pairs and of each group to the scene [m].

    Args:
        memory: A block whose margins are zero.
        q: Configurations, shape (m, n).
        bounds: Written, shape (m, classes + groups).
        lanes: LANES; see `least_excess`.
    """
    numbers, rows, queue = section(memory, NUMBERS), section(memory, ROWS), section_bits(memory, QUEUE)
    n = int(numbers[N])
    for start in range(0, q.shape[0], ROOM):
        count = min(ROOM, q.shape[0] - start)
        for i in range(count):
            queue[i] = i
            for k in range(n):
                rows[n * i + k] = q[start + i, k]
        for first in range(0, count, LANES):
            gather(memory, queue, first, count)
            _self_bounds(memory, bounds, start + first, min(LANES, count - first))
            _scene_bounds(memory, bounds, start + first, min(LANES, count - first), lanes)
        for i in range(count):
            _sharpen(memory, bounds[start + i], i)
