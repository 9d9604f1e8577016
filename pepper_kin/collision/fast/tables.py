"""Dependent joint ranges as the tables that compiled checks read; see `core.collision.joint_ranges`."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pepper_kin.collision.dependent_ranges import DependentRange
from pepper_kin.core.collision.joint_ranges import CELLS
from pepper_kin.core.collision.layout import Array


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
