"""Joint ranges that depend on another joint, where neighbouring bodies would meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.checker import LEVER
from pepper_kin.collision.dependent_ranges import DependentRange, dependent_ranges
from pepper_kin.motion.optimisation.moving import Moving
from pepper_kin.planners.optimisation import Rows, Wall

Array = NDArray[np.float64]

INFLUENCE = 0.3
"""Angles beyond the range's end by this do not act on a motion [rad]."""
_SPARE = 0.005  # [rad]
_RAMP = 0.05  # [rad]


@dataclass(frozen=True, eq=False)
class _Edge:
    """One side of a range: sign * (y - edge(x)) > 0, edge linear between tabulated positions.

    Attributes:
        first: Place of joint x.
        second: Place of joint y.
        sign: 1 for a lower, -1 for an upper edge.
        x: Tabulated positions, rising [rad], shape (m,).
        y: Edge at them [rad], shape (m,).
        slope: Its slope between them, shape (m - 1,).
    """

    first: int
    second: int
    sign: float
    x: Array
    y: Array
    slope: Array


class RangeTerm:
    """Angles left to the ends of the ranges that replace the collision check of neighbouring bodies.

    The table's ranges change in steps; the edges used here are continuous and lie inside of them.  As in
    `ClearanceTerm` a floor admits motions that start beyond an edge.

    Args:
        moving: The joints that move.
        self_margin: Distance that parts of the robot keep from each other [m].
        per_interval: Samples in each interval of the spline.
    """

    def __init__(self, moving: Moving, self_margin: float, per_interval: int) -> None:
        self.per_interval, self.wall = per_interval, Wall.ABOVE_ZERO
        self._moving, pepper = moving, moving.pepper
        margin = self_margin / LEVER
        edges = [
            edge
            for table in dependent_ranges(pepper)
            for edge in _edges(table, pepper.lower_limits, pepper.upper_limits, margin)
        ]
        moves = np.zeros(pepper.n, np.bool_)
        moves[moving.joints] = True
        self._edges = [e for e in edges if moves[e.first] or moves[e.second]]
        self._floor: Array | float = 0.0

    def __len__(self) -> int:
        return len(self._edges)

    def start_from(self, q: Array) -> None:
        """Lower the floors under a motion, given at the samples, shape (K, k)."""
        room = self._room(self._moving.positions(q))
        self._floor = np.where(room > _SPARE, 0.0, room - 2 * _SPARE)

    def tighten(self, q: Array) -> None:
        """Raise the floors to zero at samples that are inside now."""
        if np.min(self._floor) < 0.0:
            room = self._room(self._moving.positions(q))
            self._floor = np.where(room > _SPARE, 0.0, self._floor)

    def values(self, q: Array, v: Array, a: Array) -> Array:
        """Return the slacks, shape (K, number of edges), at states of the moving joints."""
        return (self._room(self._moving.positions(q)) - self._floor) / (INFLUENCE - self._floor)

    def rows(self, q: Array, v: Array, a: Array) -> Rows:
        """Return the slacks and their derivatives."""
        whole = self._moving.positions(q)
        room = self._room(whole)
        by_position = np.zeros((*room.shape, self._moving.pepper.n))
        for k, edge in enumerate(self._edges):
            piece = np.searchsorted(edge.x[1:-1], whole[:, edge.first])
            by_position[:, k, edge.second] = edge.sign
            by_position[:, k, edge.first] = -edge.sign * edge.slope[piece]
        span = INFLUENCE - self._floor
        scaled = by_position[:, :, self._moving.joints] / np.broadcast_to(span, room.shape)[..., None]
        return Rows((room - self._floor) / span, scaled)

    def _room(self, q: Array) -> Array:
        """Return what is left to each edge, shape (K, E) [rad]."""
        room = np.empty((len(q), len(self._edges)))
        for k, edge in enumerate(self._edges):
            room[:, k] = edge.sign * (q[:, edge.second] - np.interp(q[:, edge.first], edge.x, edge.y))
        return room


def _edges(table: DependentRange, lower: Array, upper: Array, margin: float) -> list[_Edge]:
    """Return a table's lower and upper edge, each only where it lies within the joint's own limits."""
    found = []
    for sign, column, limit in ((1.0, table.lower, lower), (-1.0, table.upper, upper)):
        own = sign * limit[table.second]
        values = np.clip(sign * column + margin, own - INFLUENCE, own + 2.0)
        if values.max() <= own - INFLUENCE:
            continue
        x, y = _ramps(table.positions, values)
        found.append(_Edge(table.first, table.second, sign, x, sign * y, sign * np.diff(y) / np.diff(x)))
    return found


def _ramps(x: Array, values: Array) -> tuple[Array, Array]:
    """Return corners of the lowest continuous function with short ramps above a table's steps.

    Between two rows the greater value holds.  Where that steps up, the ramp ends at the step, where it steps
    down, it begins there.
    """
    steps = np.concatenate([values[:1], np.maximum(values[:-1], values[1:]), values[-1:]])
    width = min(_RAMP, float(np.diff(x).min()) / 3)
    begin = np.where(np.diff(steps) > 0, x - width, x)
    corners = np.stack([begin, begin + width], axis=1).ravel()
    return corners, np.stack([steps[:-1], steps[1:]], axis=1).ravel()
