"""Curves that keep one joint in its range while another moves, for adjacent bodies without a distance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.dependent_ranges import DependentRange, dependent_ranges
from pepper_kin.collision.fast.tables import pack_tables
from pepper_kin.core.velocity_dampers import RangeTable
from pepper_kin.model import PepperModel, kept_for_robot

# Distance beyond the joint's limits at which a curve stands for "no bound" or "never free" [rad].
BEYOND = 0.05


class RangeCurves(NamedTuple):
    """Range curves of a robot.

    Between two rows of a table the tighter one applies, which makes it a staircase; here a row's value is the
    tightest of itself and its neighbors, joined by straight lines, which is nowhere looser.  With h the
    remaining angle and b = gain max(h - kept, 0), each of the two joints separately keeps dh/dt >= -b: they
    must not compensate for one another, because they do not brake alike.

    Attributes:
        table: The curves for machine code.
        names: Clearance constraint of each curve in words.
    """

    table: RangeTable
    names: tuple[str, ...]


@kept_for_robot(most=32)
def range_curves(pepper: PepperModel) -> RangeCurves:
    """Return the curves of a robot, cached."""
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
        # Where the joint's limit comes first, or nothing is free, the distance beyond it does not matter.
        found.append((side, side * np.clip(tight, side * near - BEYOND, side * far + BEYOND)))
    return found
