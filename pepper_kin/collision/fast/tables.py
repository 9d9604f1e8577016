"""Dependent joint ranges, compiled; the counterpart of `DependentRange.violated`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from pepper_kin.collision.dependent_ranges import DependentRange
from pepper_kin.collision.fast.options import OPTIONS
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


@njit("boolean(float64[::1], float64[::1], float64[::1])", **OPTIONS)
def violates_table(heads: Array, tables: Array, q: Array) -> bool:
    """Whether a configuration leaves a dependent range.

    Rows lie about evenly, so that the row below a position is guessed and then put right; without branches
    where the guess is off by one at most.

    Args:
        heads: The section TABLE_HEADS.
        tables: The section TABLES.
        q: Joint positions, shape (n,) [rad or m].
    """
    for k in range(heads.size // HEAD):
        head = heads[HEAD * k : HEAD * k + HEAD]
        x, y = q[int(head[0])], q[int(head[1])]
        count = int(head[3])
        rows = tables[int(head[2]) : int(head[2]) + 3 * count]
        guess, below = (x - rows[0]) * head[4], 0
        if guess > 0.0:  # also keeps NaN from becoming a place
            below = int(min(guess, count - 1.0))
        below -= below > 0 and rows[below] > x
        below += below + 1 < count and rows[below + 1] <= x
        while below > 0 and rows[below] > x:
            below -= 1
        while below + 1 < count and rows[below + 1] <= x:
            below += 1
        above = below + (rows[below] < x and below + 1 < count)
        low = max(rows[count + below], rows[count + above]) + head[5]
        high = min(rows[2 * count + below], rows[2 * count + above]) - head[5]
        if y < low or y > high:
            return True
    return False
