"""Shapes and joints that are nearer at a configuration than they shall be, and slopes, for the local solver.

Distances guide descents; the exact check decides whether something touches.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.core.collision.distances import NearPoints, NearTable, find_near, write_slopes
from pepper_kin.core.kinematic_tree import place_joints
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1, Ints2
from pepper_kin.kernels.tables import table_reader

LEAST_ANGLE = 0.005
"""A joint shall keep this from the ends of a dependent range [rad]."""


class ProximityTable(NamedTuple):
    """A robot in a scene, and what `near_rows` writes, for one thread.

    Attributes:
        near: The shapes and pairs.
        points: Written: what is near.
        leaders: The joint on which each coordinate of the tree depends, shape (njoints - 1,).
        gains: By which it does, shape (njoints - 1,).
        offsets: What is added [rad or m], shape (njoints - 1,).
        ranges: Of dependent ranges: two joints, place in the tables, number of rows; shape (r, 4).
        tables: Positions of the first joint, then least and greatest ones of the second, of one range after
            the other [rad], shape (t,).
        q_full: Written: coordinates of the tree [rad or m], shape (njoints - 1,).
        poses: Written: of the joints in the world, shape (njoints, 12).
        axes: Written: of the joints in the world, shape (njoints, 3).
        gradient: Written: of a distance by the coordinates of the tree, shape (njoints - 1,).
        joints: n.
        lever: Meters that count as a radian where joints leave a dependent range.
        apart: How far bodies shall stay apart beyond margins [m].
    """

    near: NearTable
    points: NearPoints
    leaders: Ints1
    gains: Floats1
    offsets: Floats1
    ranges: Ints2
    tables: Floats1
    q_full: Floats1
    poses: Floats2
    axes: Floats2
    gradient: Floats1
    joints: int
    lever: float
    apart: float


_surroundings_at = table_reader(ProximityTable)


@compiled(lean=True)
def _range_fault(s: ProximityTable, k: int, q: Floats1, row: Floats1) -> float:
    """Return how far one of two joints is off a dependent range, times `lever` [m], or 0; write its slope.

    Of the two ways, with the second joint into the range and with the first to where the range is wider, the
    shorter one counts.

    Args:
        s: The tables.
        k: The range.
        q: Configuration, shape (n,) [rad or m].
        row: Zeros, shape (>= n,); receives the slope of the joint that has to move [m/rad].
    """
    i, j, place, count = s.ranges[k, 0], s.ranges[k, 1], s.ranges[k, 2], s.ranges[k, 3]
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
        memory_address: Address of a `TableMemory` of ProximityTable.
    """
    s = _surroundings_at(memory_address)
    near, n, apart = s.points, s.joints, s.apart
    q, rows = floats_at(configuration, n), floats_at(result, count * (n + 2)).reshape((count, n + 2))
    for k in range(s.q_full.size):
        s.q_full[k] = q[s.leaders[k]] * s.gains[k] + s.offsets[k]
    place_joints(s.near.joints, s.q_full, s.poses, s.axes)
    found = min(find_near(s.poses, s.near, apart, False, near)[0], count)
    for r in range(found):
        pair = s.near.pairs[near.found[r]]
        ends = pair[pair[2]], pair[1 - pair[2]]
        write_slopes(s.near, s.poses, s.axes, ends, near.points[r], near.normals[r], s.gradient)
        rows[r] = 0.0
        for j in range(s.gradient.size):
            rows[r, s.leaders[j]] += s.gradient[j] * s.gains[j]
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
