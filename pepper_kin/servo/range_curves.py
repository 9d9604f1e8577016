"""Neighboring bodies without a distance: curves that keep one joint in its range while another moves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.dependent_ranges import DependentRange, dependent_ranges
from pepper_kin.collision.fast.tables import pack_tables
from pepper_kin.core.velocity_dampers import RangeTable
from pepper_kin.model import PepperModel, kept_for_robot

# How far beyond the joint's limits a curve stands for "no matter" or "never" [rad].
BEYOND = 0.05


class RangeCurves(NamedTuple):
    """The curves of a robot.

    Between two rows of a table the tighter one holds, which makes it a staircase; here a row's value is the
    tightest of itself and its neighbors, joined by straight lines, which is nowhere looser.  With h the
    angle left and b = gain max(h - kept, 0), each of the two joints by itself keeps dh/dt >= -b: they may not
    make up for one another, because they do not brake alike.

    Attributes:
        table: As machine code takes them.
        names: Of what each keeps apart, in words.
    """

    table: RangeTable
    names: tuple[str, ...]


@kept_for_robot(most=32)
def range_curves(pepper: PepperModel) -> RangeCurves:
    """Return the curves of a robot, made once."""
    ranges = dependent_ranges(pepper)
    heads, curves, names, place = [], [np.zeros((2, 0))], [], 0
    for number, table in enumerate(ranges):
        for side, curve in _sides(pepper, table):
            heads.append([table.first, table.second, side, place, place + curve.size, number])
            curves.append(np.stack([table.positions, curve]))
            names.append(f"clearance of {table.links[0]} and {table.links[1]}")
            place += curve.size
    rows = np.array(heads, dtype=float).reshape(-1, 6)
    return RangeCurves(RangeTable(rows, np.hstack(curves), *pack_tables(ranges)[:2]), tuple(names))


def _sides(pepper: PepperModel, table: DependentRange) -> list[tuple[float, Array]]:
    """Return the sides of a table as continuous curves on their safe side: side * (y - curve(x)) >= 0."""
    found = []
    least, most = pepper.lower_limits[table.second], pepper.upper_limits[table.second]
    for side, values, near, far in ((1.0, table.lower, least, most), (-1.0, table.upper, most, least)):
        tight = side * values
        if (tight <= side * near).all():
            continue
        padded = np.concatenate([tight[:1], tight, tight[-1:]])
        tight = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
        # Where a limit of the joint comes first, or nothing is free, it is all one how far beyond it lies.
        found.append((side, side * np.clip(tight, side * near - BEYOND, side * far + BEYOND)))
    return found
