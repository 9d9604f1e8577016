"""Velocity dampers that keep joints in tabulated ranges, and bounds on the distances of pairs on a path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.core.collision.joint_ranges import leaves_range
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Flags2, Floats1, Floats2

# Angle kept from the limits of a tabulated range [rad].
ANGLE_KEPT = 0.01


class PairTable(NamedTuple):
    """k nearby pairs of bodies, for n joints.

    Attributes:
        gradients: Gradients of the distances, shape (k, n) [m/rad].
        movers: Which joints move each pair, shape (k, n).
        cores: Length of the straight part of each pair, shape (k,) [m].
        motion_bounds: R: maximum motion of a point for one unit of each joint, shape (n,) [m/rad or 1].
        spare: Amount by which the distances may shrink, shape (k,) [m].
    """

    gradients: Floats2
    movers: Flags2
    cores: Floats1
    motion_bounds: Floats1
    spare: Floats1


@compiled
def clear_rows(shifts: Floats2, first: int, pairs: PairTable, reach: float, doubts: Flags1) -> int:
    """Find how far along a path pairs outside the table stay away, and which pairs of the table may not.

    For changes dq of position no point moves by more than sum R |dq| over the joints that move a pair.  Also,
    the plane between the two bodies, moved along with the first, still separates them after the second has
    come nearer by no more than

        -g . dq + w L + w sum(R |dq|) / 2,    w = sum |dq|,

    with L the straight part of the shape (the effect of rotation) and the last term for second order.  A
    pair's distance shrinks by no more than the smaller of both.

    Args:
        shifts: Displacements along the path, shape (m, n) [rad or m].
        first: Row of `shifts` at which the pairs were measured; dq is relative to it.
        pairs: The pairs.
        reach: Amount by which distances of pairs outside the table may shrink [m].
        doubts: Output: whether more than a pair's spare may be used up until then, shape (k,).

    Returns:
        The number of rows after `first` in which no other pair comes too near, -1 if this fails at `first`.
    """
    bounds, n = pairs.motion_bounds, pairs.motion_bounds.size
    doubts[:] = False
    turned = np.empty(n)
    for row in range(first, shifts.shape[0]):
        travel = 0.0
        for i in range(n):
            turned[i] = abs(shifts[row, i] - shifts[first, i])
            travel += bounds[i] * turned[i]
        if travel > reach:
            return row - first - 1
        for k in range(pairs.spare.size):
            if doubts[k]:
                continue
            bound, turn, plane = 0.0, 0.0, 0.0
            for i in range(n):
                plane -= pairs.gradients[k, i] * (shifts[row, i] - shifts[first, i])
                if pairs.movers[k, i]:
                    turn += turned[i]
                    bound += bounds[i] * turned[i]
            plane += turn * pairs.cores[k] + 0.5 * turn * bound
            doubts[k] = min(bound, plane) > pairs.spare[k]
    return shifts.shape[0] - first - 1


class RangeTable(NamedTuple):
    """Curves that bound one joint from one side, as a function of another joint.

    Attributes:
        heads: Both joints, the side (1 above, -1 below), start and end of each curve, and the tabulated range
            that it stands for, shape (k, 6).
        curves: x and y of all curves, shape (2, total) [rad].
        table_heads: Heads of the ranges, see `collision.joint_ranges`.
        tables: Rows of the ranges, see `collision.joint_ranges`.
    """

    heads: Floats2
    curves: Floats2
    table_heads: Floats1
    tables: Floats1


@compiled
def _place(x: Floats1, at: float) -> int:
    """Return the first index in x, ascending, shape (m,), of a number that is not below `at`."""
    low, high = 0, x.size
    while low < high:
        middle = (low + high) // 2
        if x[middle] < at:
            low = middle + 1
        else:
            high = middle
    return low


@compiled
def _left(head: Floats1, curves: Floats2, q: Floats1) -> tuple[float, float]:
    """Return the angle between q and a curve, negative beyond it [rad], and the curve's slope at q.

    Args:
        head: See `RangeTable`, shape (6,).
        curves: See `RangeTable`, shape (2, total) [rad].
        q: Joint positions, shape (n,) [rad].
    """
    x, curve = curves[0, int(head[3]) : int(head[4])], curves[1, int(head[3]) : int(head[4])]
    at = q[int(head[0])]
    place = min(max(_place(x, at), 1), x.size - 1)
    slope = (curve[place] - curve[place - 1]) / (x[place] - x[place - 1])
    return head[2] * (q[int(head[1])] - curve[place] - slope * (at - x[place])), slope


@compiled
def write_range_rows(
    table: RangeTable, q: Floats1, stop: Floats1, gain: float, matrix: Floats2, least: Floats1
) -> None:
    """Write the dampers of all curves, matrix @ v >= least, two rows for each curve.

    Args:
        table: The curves.
        q: Joint positions, shape (n,) [rad].
        stop: Positions after braking at maximum deceleration, shape (n,) [rad]: the smaller angle counts.
        gain: Maximum ratio of the angle that is used up per second [1/s].
        matrix: Output, zeros on entry, shape (2 k, n).
        least: Output, shape (2 k,).
    """
    heads, curves = table.heads, table.curves
    for k in range(heads.shape[0]):
        left = _left(heads[k], curves, q)[0]
        left_there, slope = _left(heads[k], curves, stop)
        matrix[2 * k, int(heads[k, 1])] = heads[k, 2]
        matrix[2 * k + 1, int(heads[k, 0])] = -heads[k, 2] * slope
        for i in range(2):
            least[2 * k + i] = -gain * max(min(left, left_there) - ANGLE_KEPT, 0.0)


@compiled
def _holds_between(table: RangeTable, k: int, q: Floats1, end: Floats1) -> bool:
    """Return whether the whole rectangle with corners q and `end`, shape (n,), is allowed by curve k."""
    head, curves = table.heads[k], table.curves
    first, second, side = int(head[0]), int(head[1]), head[2]
    x, curve = curves[0, int(head[3]) : int(head[4])], curves[1, int(head[3]) : int(head[4])]
    nearest = min(side * q[second], side * end[second])
    highest = max(
        side * q[second] - _left(head, curves, q)[0], side * end[second] - _left(head, curves, end)[0]
    )
    low, high = min(q[first], end[first]), max(q[first], end[first])
    for place in range(_place(x, low), _place(x, high)):
        highest = max(highest, side * curve[place])
    return nearest >= highest


@compiled
def entered_range(table: RangeTable, q: Floats1, shifts: Floats2) -> int:
    """Return the curve of a range that a path leaves although q is in it, -1 for none.

    Args:
        table: The curves and ranges.
        q: Joint positions, shape (n,) [rad].
        shifts: Displacements from q along the path, each joint monotonic, shape (m, n) [rad].
    """
    place = np.empty(q.size)
    for k in range(table.heads.shape[0]):
        _write_sum(q, shifts[shifts.shape[0] - 1], place)
        if _holds_between(table, k, q, place):
            continue
        number = int(table.heads[k, 5])
        if leaves_range(table.table_heads, table.tables, 0.0, q, number):
            continue
        for row in range(shifts.shape[0]):
            _write_sum(q, shifts[row], place)
            if leaves_range(table.table_heads, table.tables, 0.0, place, number):
                return k
    return -1


@compiled
def _write_sum(a: Floats1, b: Floats1, total: Floats1) -> None:
    """Write a + b, shape (n,) each."""
    for i in range(a.size):
        total[i] = a[i] + b[i]
