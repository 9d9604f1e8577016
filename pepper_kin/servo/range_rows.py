"""Neighboring bodies without a distance: rows that keep one joint in its range while another moves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.dependent_ranges import DependentRange, dependent_ranges
from pepper_kin.core.velocity_dampers import RangeTable, range_holds_between, write_range_rows
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.servo.half_spaces import VelocityRows

# How far beyond the joint's limits a curve stands for "no matter" or "never" [rad].
BEYOND = 0.05


class _Envelope(NamedTuple):
    """One side of a table as a continuous curve on its safe side: side * (y - curve(x)) >= 0."""

    table: DependentRange
    side: float
    curve: Array
    name: str


class RangeRows:
    """Velocity dampers on the tabulated joint ranges.

    Between two rows of a table the tighter one holds, which makes it a staircase; here a row's value is the
    tightest of itself and its neighbors, joined by straight lines, which is nowhere looser.  With h the
    angle left and b = gain max(h - kept, 0), each of the two joints by itself keeps dh/dt >= -b: they may not
    make up for one another, because they do not brake alike.

    Args:
        pepper: The robot.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self._n = pepper.n
        self._envelopes = [e for table in dependent_ranges(pepper) for e in _envelopes(pepper, table)]
        self._names = tuple(e.name for e in self._envelopes for _ in range(2))
        ends = np.cumsum([0, *(e.curve.size for e in self._envelopes)])
        heads = np.array(
            [
                (e.table.first, e.table.second, e.side, first, last)
                for e, first, last in zip(self._envelopes, ends[:-1], ends[1:], strict=True)
            ],
            dtype=float,
        ).reshape(-1, 5)
        curves = np.zeros((2, ends[-1]))
        if self._envelopes:
            curves[0] = np.concatenate([e.table.positions for e in self._envelopes])
            curves[1] = np.concatenate([e.curve for e in self._envelopes])
        self._table = RangeTable(heads, curves)

    def rows(self, q: Array, stop: Array, gain: float) -> VelocityRows:
        """Return the rows at q, shape (n,) [rad].

        Args:
            q: Joint positions.
            stop: Where the hardest brake would end, shape (n,): the angle left there counts if it is smaller.
            gain: Share of the angle that may be used up per second [1/s].
        """
        count = len(self._envelopes)
        matrix, least = np.zeros((2 * count, self._n)), np.zeros(2 * count)
        write_range_rows(self._table, q, stop, gain, matrix, least)
        return VelocityRows(matrix, least, self._names)

    def entered(self, q: Array, path: Array) -> tuple[tuple[int, int], str] | None:
        """Return the joints and the name of a range that a path leaves although q is in it.

        Args:
            q: Joint positions, shape (n,).
            path: Positions from there on along which every joint goes one way only, shape (m, n).
        """
        for k in range(len(self._envelopes)):
            if range_holds_between(self._table, k, q, path[-1]):
                continue
            table = self._envelopes[k].table
            if table.violated(path).any() and not table.violated(q):
                return (table.first, table.second), self._envelopes[k].name
        return None


@kept_for_robot(most=32)
def range_rows(pepper: PepperModel) -> RangeRows:
    """Return the rows of a robot, made once."""
    return RangeRows(pepper)


def _envelopes(pepper: PepperModel, table: DependentRange) -> list[_Envelope]:
    found = []
    least, most = pepper.lower_limits[table.second], pepper.upper_limits[table.second]
    for side, values, near, far in ((1.0, table.lower, least, most), (-1.0, table.upper, most, least)):
        tight = side * values
        if (tight <= side * near).all():
            continue
        padded = np.concatenate([tight[:1], tight, tight[-1:]])
        tight = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
        # Where a limit of the joint comes first, or nothing is free, it is all one how far beyond it lies.
        curve = side * np.clip(tight, side * near - BEYOND, side * far + BEYOND)
        name = f"clearance of {table.links[0]} and {table.links[1]}"
        found.append(_Envelope(table, side, curve, name))
    return found
