"""Barrier term of joint ranges that depend on another joint, where neighboring bodies would meet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.checker import RANGE_RADIUS
from pepper_kin.collision.dependent_ranges import DependentRange, dependent_ranges
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.signatures import Floats1, Ints1, Ints2
from pepper_kin.kernels.tables import TableMemory, table_reader
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.motion.optimization.floors import FlooredTerm, any_below_zero
from pepper_kin.motion.optimization.moving import Moving
from pepper_kin.planners.optimization import KINDS, ROWS, START, TIGHTEN, VALUES

INFLUENCE = 0.3
"""Angle inside a range's end above which the range has no effect [rad]."""
_SPARE = 0.005  # [rad]
_RAMP = 0.05  # [rad]


@dataclass(frozen=True, eq=False)
class _Edge:
    """One side of a range: sign * (y - edge(x)) > 0, with the edge linear between tabulated positions.

    Attributes:
        first: Index of joint x.
        second: Index of joint y.
        sign: 1 for a lower, -1 for an upper edge.
        x: Tabulated positions, increasing [rad], shape (m,).
        y: Edge at the tabulated positions [rad], shape (m,).
    """

    first: int
    second: int
    sign: float
    x: Array
    y: Array


class _EdgeTable(NamedTuple):
    """Edges of all ranges, for compiled functions.

    Attributes:
        floor: Floors, see `FlooredTerm`.
        joints: Indices of the joints that move, shape (k,).
        rest: A whole configuration with the other joints' positions [rad or m], shape (n,).
        places: Indices of both joints of each edge, and their indices among the moving joints, or -1, (e, 4).
        signs: Signs of the edges, shape (e,).
        first: Offset of each edge's numbers in x and y, shape (e + 1,).
        x: Tabulated positions of all edges [rad].
        y: Edge values at these positions [rad].
    """

    floor: Floats1
    joints: Ints1
    rest: Floats1
    places: Ints2
    signs: Floats1
    first: Ints1
    x: Floats1
    y: Floats1


_edges_at = table_reader(_EdgeTable)


class RangeTerm(FlooredTerm):
    """Slack of the angles to the ends of ranges that replace the collision check of neighboring bodies.

    The table's ranges change in steps; the edges used here are continuous and lie inside them.  As in
    `ClearanceTerm`, a floor admits initial motions beyond an edge.

    Args:
        moving: The joints that move.
        self_margin: Distance that parts of the robot keep from each other [m].
        per_interval: Samples in each interval of the spline.
    """

    def __init__(self, moving: Moving, self_margin: float, per_interval: int) -> None:
        pepper = moving.pepper
        margin = self_margin / RANGE_RADIUS
        place = np.full(pepper.n, -1)
        place[moving.joints] = np.arange(moving.joints.size)
        edges = [
            edge for edge in _edges_of(pepper, margin) if place[edge.first] >= 0 or place[edge.second] >= 0
        ]
        joints = [(e.first, e.second, place[e.first], place[e.second]) for e in edges]
        table = TableMemory(
            _EdgeTable,
            floor=np.zeros(0),
            joints=moving.joints,
            rest=moving.rest,
            places=np.array(joints, np.int64).reshape(-1, 4),
            signs=np.array([edge.sign for edge in edges]),
            first=np.cumsum([0, *(edge.x.size for edge in edges)], dtype=np.int64),
            x=np.concatenate([np.zeros(0), *(edge.x for edge in edges)]),
            y=np.concatenate([np.zeros(0), *(edge.y for edge in edges)]),
        )
        super().__init__(range_rows.address, table, len(edges), per_interval, per_sample=len(edges))


@compiled(lean=True)
def _edge_at(x: Floats1, y: Floats1, at: float) -> tuple[float, float]:
    """Return an edge's value and slope; the edge is constant beyond its ends."""
    if at <= x[0]:
        return y[0], 0.0
    if at >= x[-1]:
        return y[-1], 0.0
    low, high = 0, x.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if x[middle] <= at:
            low = middle
        else:
            high = middle
    slope = (y[high] - y[low]) / (x[high] - x[low])
    return y[low] + slope * (at - x[low]), slope


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def range_rows(states: int, result: int, asked: int, memory_address: int) -> int:
    """Evaluate a range term; see `CompiledTerm`."""
    what, count = asked % KINDS, asked // KINDS
    t = _edges_at(memory_address)
    floors, places, signs, first, x, y = t.floor, t.places, t.signs, t.first, t.x, t.y
    n, rows = t.joints.size, signs.size
    if what == TIGHTEN and not any_below_zero(floors):
        return 0
    q = floats_at(states, count * n)
    is_values = what in (VALUES, ROWS)
    numbers = floats_at(result, count * rows * (1 + n) if what == ROWS else count * rows if is_values else 0)
    for k in range(count):
        for e in range(rows):
            along, across = places[e, 2], places[e, 3]
            at = q[k * n + along] if along >= 0 else t.rest[places[e, 0]]
            other = q[k * n + across] if across >= 0 else t.rest[places[e, 1]]
            limit, slope = _edge_at(x[first[e] : first[e + 1]], y[first[e] : first[e + 1]], at)
            slack, row = signs[e] * (other - limit), k * rows + e
            if not is_values:
                under = 0.0 if slack > _SPARE else slack - 2.0 * _SPARE
                if what == START:
                    floors[row] = under
                elif under == 0.0:
                    floors[row] = 0.0
                continue
            floor = floors[row] if row < floors.size else 0.0
            numbers[row] = (slack - floor) / (INFLUENCE - floor)
            if what == ROWS:
                own = numbers[count * rows + row * n : count * rows + (row + 1) * n]
                for j in range(n):
                    own[j] = 0.0
                if along >= 0:
                    own[along] = -signs[e] * slope / (INFLUENCE - floor)
                if across >= 0:
                    own[across] = signs[e] / (INFLUENCE - floor)
    return 0


@kept_for_robot(most=16)
def _edges_of(pepper: PepperModel, margin: float) -> tuple[_Edge, ...]:
    """Return the edges of all tables of a robot."""
    limits = pepper.lower_limits, pepper.upper_limits
    return tuple(edge for table in dependent_ranges(pepper) for edge in _edges(table, *limits, margin))


def _edges(table: DependentRange, lower: Array, upper: Array, margin: float) -> list[_Edge]:
    """Return a table's lower and upper edge, each only if it lies within the joint's own limits.

    Args:
        table: The table.
        lower: Lower limits of all joints [rad or m], shape (n,).
        upper: Upper limits of all joints [rad or m], shape (n,).
        margin: Angle that the edges are moved inward by [rad].
    """
    found = []
    for sign, column, limit in ((1.0, table.lower, lower), (-1.0, table.upper, upper)):
        own = sign * limit[table.second]
        values = np.clip(sign * column + margin, own - INFLUENCE, own + 2.0)
        if values.max() <= own - INFLUENCE:
            continue
        x, y = _ramps(table.positions, values)
        found.append(_Edge(table.first, table.second, sign, x, sign * y))
    return found


def _ramps(x: Array, values: Array) -> tuple[Array, Array]:
    """Return corners of the lowest continuous function with short ramps above a table's steps.

    Between two rows the larger value holds.  A ramp ends at a step up, and begins at a step down.

    Args:
        x: Positions of the rows, increasing [rad], shape (m,).
        values: Values of the rows [rad], shape (m,).

    Returns:
        Positions and values of the corners [rad], shape (2 m,) each.
    """
    steps = np.concatenate([values[:1], np.maximum(values[:-1], values[1:]), values[-1:]])
    width = min(_RAMP, float(np.diff(x).min()) / 3)
    begin = np.where(np.diff(steps) > 0, x - width, x)
    corners = np.stack([begin, begin + width], axis=1).ravel()
    return corners, np.stack([steps[:-1], steps[1:]], axis=1).ravel()
