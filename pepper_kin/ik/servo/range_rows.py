"""Neighbouring bodies without a distance: rows that keep one joint in its range while another moves."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit

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
    side: float
    curve: Array
    name: str


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
        self._names = tuple(e.name for e in self._envelopes for _ in range(2))
        ends = np.cumsum([0, *(e.curve.size for e in self._envelopes)])
        # For the compiled loops: both joints, side, beginning and end of each curve; x and y of all curves.
        self._heads = np.array(
            [
                (e.table.first, e.table.second, e.side, first, last)
                for e, first, last in zip(self._envelopes, ends[:-1], ends[1:], strict=True)
            ],
            dtype=float,
        ).reshape(-1, 5)
        self._curves = np.zeros((2, ends[-1]))
        if self._envelopes:
            self._curves[0] = np.concatenate([e.table.positions for e in self._envelopes])
            self._curves[1] = np.concatenate([e.curve for e in self._envelopes])

    def rows(self, q: Array, stop: Array, gain: float) -> VelocityRows:
        """Return the rows at q, shape (n,) [rad].

        Args:
            q: Joint positions.
            stop: Where the hardest brake would end, shape (n,): the angle left there counts if it is smaller.
            gain: Share of the angle that may be used up per second [1/s].
        """
        count = len(self._envelopes)
        matrix, least = np.zeros((2 * count, self._n)), np.zeros(2 * count)
        _rows(self._heads, self._curves, q, stop, gain, matrix, least)
        return VelocityRows(matrix, least, self._names)

    def entered(self, q: Array, path: Array) -> tuple[tuple[int, int], str] | None:
        """Return the joints and the name of a range that a path leaves although q is in it.

        Args:
            q: Joint positions, shape (n,).
            path: Positions from there on along which every joint goes one way only, shape (m, n).
        """
        for k in range(len(self._envelopes)):
            if _holds_between(self._heads[k], self._curves, q, path[-1]):
                continue
            table = self._envelopes[k].table
            if table.violated(path).any() and not table.violated(q):
                return (table.first, table.second), self._envelopes[k].name
        return None


@lru_cache(maxsize=32)
def range_rows(pepper: PepperModel) -> RangeRows:
    """Return the rows of a robot, made once."""
    return RangeRows(pepper)


@njit(cache=True, nogil=True, error_model="numpy")
def _place(x: Array, at: float) -> int:
    """Return the first place in x, which rises, of a number that is not below another."""
    low, high = 0, x.size
    while low < high:
        middle = (low + high) // 2
        if x[middle] < at:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True, error_model="numpy")
def _left(head: Array, curves: Array, q: Array) -> tuple[float, float]:
    """Return the angle left at q below or above a curve, and the curve's slope there."""
    x, curve = curves[0, int(head[3]) : int(head[4])], curves[1, int(head[3]) : int(head[4])]
    at = q[int(head[0])]
    place = min(max(_place(x, at), 1), x.size - 1)
    slope = (curve[place] - curve[place - 1]) / (x[place] - x[place - 1])
    return head[2] * (q[int(head[1])] - curve[place] - slope * (at - x[place])), slope


@njit(cache=True, nogil=True, error_model="numpy")
def _rows(
    heads: Array, curves: Array, q: Array, stop: Array, gain: float, matrix: Array, least: Array
) -> None:
    """Write the rows of `RangeRows.rows`."""
    for k in range(heads.shape[0]):
        left = _left(heads[k], curves, q)[0]
        left_there, slope = _left(heads[k], curves, stop)
        matrix[2 * k, int(heads[k, 1])] = heads[k, 2]
        matrix[2 * k + 1, int(heads[k, 0])] = -heads[k, 2] * slope
        least[2 * k : 2 * k + 2] = -gain * max(min(left, left_there) - ANGLE_KEPT, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _holds_between(head: Array, curves: Array, q: Array, end: Array) -> bool:
    """Whether all of the rectangle with these two corners is on the safe side of a curve."""
    first, second, side = int(head[0]), int(head[1]), head[2]
    x, curve = curves[0, int(head[3]) : int(head[4])], curves[1, int(head[3]) : int(head[4])]
    nearest = min(side * q[second], side * end[second])
    highest = max(
        side * q[second] - _left(head, curves, q)[0], side * end[second] - _left(head, curves, end)[0]
    )
    low, high = min(q[first], end[first]), max(q[first], end[first])
    for place in range(_place(x, low), _place(x, high)):
        highest = max(highest, side * curve[place])
    return bool(nearest >= highest)


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
