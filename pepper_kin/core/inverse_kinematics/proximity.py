"""Shapes and joints that are nearer at a configuration than they shall be, and slopes, for the local solver.

Distances guide descents; the exact check decides whether something touches.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.core.array_memory import MEMORY_SIZE, floats_of, rows_of, words_of
from pepper_kin.core.collision.distances import NearPoints, NearTable, find_near, table_of, write_slopes
from pepper_kin.core.kinematic_tree import place_joints
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.signatures import Floats1, Floats2

RANGE = 4
"""Numbers of a dependent range: two joints, place in the tables, number of rows; the tables hold positions of
the first joint, then least and greatest positions of the second."""

FULL = 3
"""Numbers of a coordinate of the tree: the joint on which it depends, gain and offset."""

LEAST_ANGLE = 0.005
"""A joint shall keep this from the ends of a dependent range [rad]."""

ROBOT_JOINTS, LEVER, APART, NEAR_TABLE = range(4)
(
    FULL_MAP, RANGES, TABLES, Q_FULL, POSES, AXES, GRADIENT, FOUND, DISTANCES, POINTS, NORMALS, UNDECIDED,
    PLACED, NEAR, WORK,
) = range(17, 47, 2)  # fmt: skip
"""Places in a memory, see `memory_of`: three numbers, then the arrays, those of a `NearTable` first."""


class _Surroundings(NamedTuple):
    """What a memory holds.

    Attributes:
        near: The shapes and pairs.
        full: Shape (njoints - 1, FULL).
        ranges: Shape (r, RANGE).
        tables: Of the ranges [rad], shape (t,).
        q_full: Written: coordinates of the tree [rad or m], shape (njoints - 1,).
        poses: Written: of the joints in the world, shape (njoints, 12).
        axes: Written: of the joints in the world, shape (njoints, 3).
        gradient: Written: of a distance by the coordinates of the tree, shape (njoints - 1,).
        lever: Meters for a radian where joints leave a dependent range.
    """

    near: NearTable
    full: Floats2
    ranges: Floats2
    tables: Floats1
    q_full: Floats1
    poses: Floats2
    axes: Floats2
    gradient: Floats1
    lever: float


@compiled
def _surroundings(memory: Floats1) -> _Surroundings:
    return _Surroundings(
        table_of(memory, NEAR_TABLE), rows_of(memory, FULL_MAP, FULL), rows_of(memory, RANGES, RANGE),
        floats_of(memory, TABLES), floats_of(memory, Q_FULL), rows_of(memory, POSES, 12),
        rows_of(memory, AXES, 3), floats_of(memory, GRADIENT), memory[LEVER],
    )  # fmt: skip


@compiled
def _near_points(memory: Floats1) -> NearPoints:
    points = floats_of(memory, POINTS)
    return NearPoints(
        words_of(memory, FOUND), floats_of(memory, DISTANCES), points.reshape((points.size // 6, 2, 3)),
        rows_of(memory, NORMALS, 3), words_of(memory, UNDECIDED), rows_of(memory, PLACED, 12),
        rows_of(memory, NEAR, 3), floats_of(memory, WORK),
    )  # fmt: skip


@compiled(lean=True)
def _range_fault(s: _Surroundings, k: int, q: Floats1, row: Floats1) -> float:
    """Return how far one of two joints is off a dependent range, times `lever` [m], or 0; write its slope.

    Of the two ways, with the second joint into the range and with the first to where the range is wider, the
    shorter one counts.

    Args:
        s: The tables.
        k: The range.
        q: Configuration, shape (n,) [rad or m].
        row: Zeros, shape (>= n,); receives the slope of the joint that has to move [m/rad].
    """
    count, place = int(s.ranges[k, 3]), int(s.ranges[k, 2])
    i, j = int(s.ranges[k, 0]), int(s.ranges[k, 1])
    x, y = q[i], q[j]
    rows, low, high = s.tables[place:], s.tables[place + count :], s.tables[place + 2 * count :]
    cell = 0
    while cell + 2 < count and rows[cell + 1] <= x:
        cell += 1
    least, most = max(low[cell], low[cell + 1]) + LEAST_ANGLE, min(high[cell], high[cell + 1]) - LEAST_ANGLE
    if least <= y <= most:
        return 0.0
    best, slope, joint = math.inf, 0.0, j
    if least <= most:
        best, slope = (least - y, 1.0) if y < least else (y - most, -1.0)
    for c in range(count - 1):
        if c == cell:
            continue
        if max(low[c], low[c + 1]) + LEAST_ANGLE <= y <= min(high[c], high[c + 1]) - LEAST_ANGLE:
            way = rows[c] - x if c > cell else x - rows[c + 1]
            if way + LEAST_ANGLE < best:
                best, slope, joint = way + LEAST_ANGLE, 1.0 if c > cell else -1.0, i
    if best == math.inf:
        return 0.0
    row[joint] = slope * s.lever
    return best * s.lever


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def near_rows(configuration: int, result: int, count: int, memory_address: int) -> int:
    """Write what is nearer at a configuration than it shall be; return the number of rows.

    A row has dd/dq, shape (n,), the shortage (how far two shapes, or two joints, shall part) [m], and the
    shortage less what shapes keep beyond their margins [m], above zero where they touch or are nearer.

    Args:
        configuration: Address of q, shape (n,) [rad or m].
        result: Address of the rows, shape (count, n + 2) [m/rad or 1, then m].
        count: Rows at most.
        memory_address: Address of a memory, shape (MEMORY_SIZE,), whose last arrays are written.
    """
    memory = floats_at(memory_address, MEMORY_SIZE)
    s, near, n, apart = _surroundings(memory), _near_points(memory), int(memory[ROBOT_JOINTS]), memory[APART]
    q, rows = floats_at(configuration, n), floats_at(result, count * (n + 2)).reshape((count, n + 2))
    for k in range(s.q_full.size):
        s.q_full[k] = q[int(s.full[k, 0])] * s.full[k, 1] + s.full[k, 2]
    place_joints(s.near.joints, s.q_full, s.poses, s.axes)
    found = min(find_near(s.poses, s.near, apart, False, near)[0], count)
    for r in range(found):
        pair = s.near.pairs[near.found[r]]
        ends = pair[pair[2]], pair[1 - pair[2]]
        write_slopes(s.near, s.poses, s.axes, ends, near.points[r], near.normals[r], s.gradient)
        rows[r] = 0.0
        for j in range(s.gradient.size):
            rows[r, int(s.full[j, 0])] += s.gradient[j] * s.full[j, 1]
        rows[r, n + 1] = s.near.keep[near.found[r]] - near.distances[r]
        rows[r, n] = rows[r, n + 1] + apart
    for k in range(s.ranges.shape[0]):
        if found == count:
            break
        rows[found] = 0.0
        shortage = _range_fault(s, k, q, rows[found])
        if shortage > 0.0:
            rows[found, n], rows[found, n + 1] = shortage, shortage - s.lever * LEAST_ANGLE
            found += 1
    return found
