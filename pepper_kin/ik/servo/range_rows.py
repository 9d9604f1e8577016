"""Neighbouring bodies without a distance: rows that keep one joint in its range while another moves."""

from __future__ import annotations

from bisect import bisect_left
from typing import NamedTuple

import numpy as np

from pepper_kin.collision.dependent_ranges import DependentRange, dependent_ranges
from pepper_kin.ik.servo.half_spaces import VelocityRows
from pepper_kin.ik.tasks.task import Array
from pepper_kin.model import PepperModel

# Angle kept from the tabulated range [rad].
ANGLE_KEPT = 0.01

# How far beyond the joint's limits a curve stands for "no matter" or "never" [rad].
BEYOND = 0.05


class _Envelope(NamedTuple):
    """One side of a table as a continuous curve on its safe side: side * (y - curve(x)) >= 0."""

    table: DependentRange
    first: int
    second: int
    side: float
    x: list[float]
    curve: list[float]
    name: str

    def left(self, q: list[float]) -> tuple[float, float]:
        """Return the angle left at q and the slope of the curve there."""
        x, curve, at = self.x, self.curve, q[self.first]
        place = min(max(bisect_left(x, at), 1), len(x) - 1)
        slope = (curve[place] - curve[place - 1]) / (x[place] - x[place - 1])
        return self.side * (q[self.second] - curve[place] - slope * (at - x[place])), slope

    def holds_between(self, q: list[float], end: list[float]) -> bool:
        """Whether all of the rectangle with these two corners is on the safe side."""
        low, high = sorted((q[self.first], end[self.first]))
        nearest = min(self.side * q[self.second], self.side * end[self.second])
        between = self.curve[bisect_left(self.x, low) : bisect_left(self.x, high)]
        curve = [self.side * place[self.second] - self.left(place)[0] for place in (q, end)]
        return nearest >= max([*curve, *(self.side * value for value in between)])


class RangeRows:
    """Velocity dampers on the tabulated joint ranges.

    Between two rows of a table the tighter one holds, which makes it a staircase; here a row's value is the
    tightest of itself and its neighbours, joined by straight lines, which is nowhere looser.  With h the
    angle left and b = gain max(h - kept, 0), each of the two joints by itself keeps dh/dt >= -b: they may not
    make up for one another, because they do not brake alike.

    Args:
        pepper: The robot.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self._n = pepper.n
        self._envelopes = [e for table in dependent_ranges(pepper) for e in _envelopes(pepper, table)]

    def rows(self, q: Array, stop: Array, gain: float) -> VelocityRows:
        """Return the rows at q, shape (n,) [rad].

        Args:
            q: Joint positions.
            stop: Where the hardest brake would end, shape (n,): the angle left there counts if it is smaller.
            gain: Share of the angle that may be used up per second [1/s].
        """
        count = len(self._envelopes)
        matrix, least = np.zeros((2 * count, self._n)), np.zeros(2 * count)
        here, there = q.tolist(), stop.tolist()
        for k, envelope in enumerate(self._envelopes):
            (left, _), (left_there, slope) = envelope.left(here), envelope.left(there)
            matrix[2 * k, envelope.second] = envelope.side
            matrix[2 * k + 1, envelope.first] = -envelope.side * slope
            least[2 * k : 2 * k + 2] = -gain * max(min(left, left_there) - ANGLE_KEPT, 0.0)
        return VelocityRows(matrix, least, tuple(e.name for e in self._envelopes for _ in range(2)))

    def entered(self, q: Array, path: Array) -> tuple[tuple[int, int], str] | None:
        """Return the joints and the name of a range that a path leaves although q is in it.

        Args:
            q: Joint positions, shape (n,).
            path: Positions from there on along which every joint goes one way only, shape (m, n).
        """
        here, end = q.tolist(), path[-1].tolist()
        for envelope in self._envelopes:
            if envelope.holds_between(here, end):
                continue
            table = envelope.table
            if table.violated(path).any() and not table.violated(q):
                return (table.first, table.second), envelope.name
        return None


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
        x = table.positions.tolist()
        found.append(_Envelope(table, table.first, table.second, side, x, curve.tolist(), name))
    return found
