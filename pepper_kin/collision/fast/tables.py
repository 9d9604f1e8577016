"""Dependent joint ranges as the tables that compiled checks read; see `core.collision.joint_ranges`."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.dependent_ranges import DependentRange, dependent_ranges
from pepper_kin.core.collision.joint_ranges import CELLS
from pepper_kin.model import PepperModel, kept_for_robot


@kept_for_robot(most=32)
def tables_of(pepper: PepperModel) -> tuple[Array, Array, Array]:
    """Return the sections TABLE_HEADS, TABLES and TABLE_CELLS of a robot."""
    return pack_tables(dependent_ranges(pepper))


def pack_tables(ranges: tuple[DependentRange, ...]) -> tuple[Array, Array, Array]:
    """Return the sections TABLE_HEADS, TABLES and TABLE_CELLS."""
    heads, rows, cells, place = [], [np.zeros(0)], [np.zeros(0)], 0
    for table in ranges:
        count = len(table.positions)
        span = float(table.positions[-1] - table.positions[0])
        density = CELLS / span if span > 0 else 0.0
        tightest = table.lower.max(), table.upper.min()
        heads.append([table.first, table.second, place, count, table.positions[0], density, *tightest])
        rows += [table.positions, table.lower, table.upper]
        cells.append(_cells(table, span / CELLS))
        place += 3 * count
    return np.array(heads, dtype=float).ravel(), np.concatenate(rows), np.concatenate(cells)


def _cells(table: DependentRange, width: float) -> Array:
    """Return the bounds of all cells of a table, each slightly widened for rounding, shape (4 CELLS,)."""
    x, low, high = table.positions, table.lower, table.upper
    edges = x[0] + np.arange(CELLS + 1) * width
    begin, end = edges[:-1] - 1e-9, edges[1:] + 1e-9
    begin[0], end[-1] = -np.inf, np.inf
    first = np.maximum(np.searchsorted(x, begin, side="right") - 1, 0)
    last = np.minimum(np.searchsorted(x, end, side="left"), len(x) - 1)
    spans = np.stack([first, last + 1], axis=1).ravel()

    def over_spans(function: np.ufunc, values: Array) -> Array:
        """Return the reduction of rows' values [rad], shape (rows,), to cells, shape (CELLS,)."""
        return np.asarray(function.reduceat(np.append(values, values[-1]), spans)[::2])

    least, greatest = np.minimum, np.maximum
    rows = [
        over_spans(least, low),
        over_spans(greatest, high),
        over_spans(greatest, low),
        over_spans(least, high),
    ]
    return np.stack(rows, axis=1).ravel()
