"""Dependent joint ranges, compiled; the counterpart of `DependentRange.violated`."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.dependent_ranges import DependentRange
from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.collision.fast.solids import Array

HEAD = 7
"""Numbers of a table in TABLE_HEADS: joints, place in TABLES, rows, margin, first position, cells per rad."""
CELLS = 128
"""Cells of equal width into which a table is cut."""
CELL = 4
"""Numbers for each cell: below the first or above the second the range is surely left; from the third to the
fourth it is surely kept."""


def pack_tables(ranges: tuple[DependentRange, ...], margin: float) -> tuple[Array, Array, Array]:
    """Return the sections TABLE_HEADS, TABLES and TABLE_CELLS.

    Args:
        ranges: The tables.
        margin: Angle that the second joint keeps from a contact [rad].
    """
    heads, rows, cells = _packed(ranges, margin)
    return heads.copy(), rows.copy(), cells.copy()


@lru_cache(maxsize=64)
def _packed(ranges: tuple[DependentRange, ...], margin: float) -> tuple[Array, Array, Array]:
    heads, rows, cells, place = [], [np.zeros(0)], [np.zeros(0)], 0
    for table in ranges:
        count = len(table.positions)
        span = float(table.positions[-1] - table.positions[0])
        density = CELLS / span if span > 0 else 0.0
        heads.append([table.first, table.second, place, count, margin, table.positions[0], density])
        rows += [table.positions, table.lower, table.upper]
        cells.append(_cells(table, span / CELLS, margin))
        place += 3 * count
    return np.array(heads, dtype=float).ravel(), np.concatenate(rows), np.concatenate(cells)


def _cells(table: DependentRange, width: float, margin: float) -> Array:
    """Return the numbers of all cells of a table, each a little wider than it is, for rounding."""
    x, low, high = table.positions, table.lower, table.upper
    rows = []
    for cell in range(CELLS):
        begin = -np.inf if cell == 0 else x[0] + cell * width - 1e-9
        end = np.inf if cell == CELLS - 1 else x[0] + (cell + 1) * width + 1e-9
        first = max(int(np.searchsorted(x, begin, side="right")) - 1, 0)
        last = min(int(np.searchsorted(x, end, side="left")), len(x) - 1)
        inside = slice(first, last + 1)
        rows.append([low[inside].min(), high[inside].max(), low[inside].max(), high[inside].min()])
    return (np.array(rows) + margin * np.array([1.0, -1.0, 1.0, -1.0])).ravel()


@njit("boolean(float64[::1], float64[::1], float64[::1], int64)", **OPTIONS)
def _violates(heads: Array, tables: Array, q: Array, k: int) -> bool:
    """Whether a configuration leaves the range of one table."""
    h = HEAD * k
    x, y = q[int(heads[h])], q[int(heads[h + 1])]
    count, below = int(heads[h + 3]), 0
    rows = tables[int(heads[h + 2]) : int(heads[h + 2]) + 3 * count]
    while below + 1 < count and rows[below + 1] <= x:
        below += 1
    above = below + 1 if rows[below] < x and below + 1 < count else below
    low = max(rows[count + below], rows[count + above]) + heads[h + 4]
    high = min(rows[2 * count + below], rows[2 * count + above]) - heads[h + 4]
    return y < low or y > high


@njit("void(float64[::1], float64[::1], float64[::1], float64[::1], int64, int64[::1])", **OPTIONS)
def violations(
    heads: Array, tables: Array, cells: Array, rows: Array, n: int, left: NDArray[np.int64]
) -> None:
    """Write whether configurations leave a dependent range.

    Args:
        heads: The section TABLE_HEADS.
        tables: The section TABLES.
        cells: The section TABLE_CELLS.
        rows: Joint positions, one configuration after the other [rad or m].
        n: Number of joints.
        left: Written, one number per configuration.
    """
    left[:] = 0
    for k in range(heads.size // HEAD):
        h = HEAD * k
        a, b, begin, density = int(heads[h]), int(heads[h + 1]), heads[h + 5], heads[h + 6]
        own = cells[CELL * CELLS * k : CELL * CELLS * (k + 1)]
        for i in range(left.size):
            y, place = rows[n * i + b], (rows[n * i + a] - begin) * density
            place = place if place > 0.0 else 0.0  # also keeps NaN from becoming a place
            place = place if place < CELLS - 1.0 else CELLS - 1.0
            c = CELL * int(place)
            surely = (y < own[c]) | (y > own[c + 1])
            perhaps = (y < own[c + 2]) | (y > own[c + 3])
            left[i] |= surely + 2 * perhaps
    for i in range(left.size):
        state, left[i] = left[i], left[i] & 1
        if state == 2:
            for k in range(heads.size // HEAD):
                left[i] |= _violates(heads, tables, rows[n * i : n * i + n], k)
