"""Dependent joint ranges, compiled; the counterpart of `DependentRange.violated`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from pepper_kin.collision.dependent_ranges import DependentRange
from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.collision.fast.layout import TABLE_HEADS, TABLES, section
from pepper_kin.collision.fast.solids import Array

HEAD = 6
"""Numbers for each table in TABLE_HEADS: both joints, place in TABLES, rows, rows per radian, margin."""


def pack_tables(ranges: Sequence[DependentRange], margin: float) -> tuple[Array, Array]:
    """Return the sections TABLE_HEADS and TABLES.

    Args:
        ranges: The tables.
        margin: Angle that the second joint keeps from a contact [rad].
    """
    heads, rows, place = [], [np.zeros(0)], 0
    for table in ranges:
        count = len(table.positions)
        span = table.positions[-1] - table.positions[0]
        density = (count - 1) / span if span > 0 else 0.0
        heads.append([table.first, table.second, place, count, density, margin])
        rows += [table.positions, table.lower, table.upper]
        place += 3 * count
    return np.array(heads, dtype=float).reshape(-1, HEAD), np.concatenate(rows)


@njit("boolean(float64[::1], float64[::1])", **OPTIONS)
def violates_table(memory: Array, q: Array) -> bool:
    """Whether a configuration leaves a dependent range.

    Rows lie about evenly, so that the row below a position is guessed and then put right.
    """
    heads, tables = section(memory, TABLE_HEADS), section(memory, TABLES)
    for k in range(heads.size // HEAD):
        head = HEAD * k
        x, y = q[int(heads[head])], q[int(heads[head + 1])]
        start, count, margin = int(heads[head + 2]), int(heads[head + 3]), heads[head + 5]
        guess = (x - tables[start]) * heads[head + 4]
        below = int(min(max(guess, 0.0), count - 1.0))
        while below > 0 and tables[start + below] > x:
            below -= 1
        while below + 1 < count and tables[start + below + 1] <= x:
            below += 1
        above = below
        if tables[start + below] < x and below + 1 < count:
            above = below + 1
        lower = max(tables[start + count + below], tables[start + count + above])
        upper = min(tables[start + 2 * count + below], tables[start + 2 * count + above])
        if y < lower + margin or y > upper - margin:
            return True
    return False
