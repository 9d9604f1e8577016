"""Ranges of a joint that depend on another joint, as tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.core.collision.layout import Array
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.lanes import double_at, store_word, word_at

HEAD = 6
"""Numbers of a table in TABLE_HEADS: joints, place in TABLES, rows, first position, cells per rad."""
CELLS = 128
"""Cells of equal width into which a table is cut."""
CELL = 4
"""Numbers for each cell: below the first or above the second the range is surely left; from the third to the
fourth it is surely kept, at a margin of zero."""


@compiled
def _violates(heads: Array, tables: Array, margin: float, q: Array, k: int) -> bool:
    """Whether a configuration leaves the range of one table."""
    h = HEAD * k
    x, y = q[int(heads[h])], q[int(heads[h + 1])]
    count, below = int(heads[h + 3]), 0
    rows = tables[int(heads[h + 2]) : int(heads[h + 2]) + 3 * count]
    while below + 1 < count and rows[below + 1] <= x:
        below += 1
    above = below + 1 if rows[below] < x and below + 1 < count else below
    low = max(rows[count + below], rows[count + above]) + margin
    high = min(rows[2 * count + below], rows[2 * count + above]) - margin
    return y < low or y > high


@compiled
def violations(
    heads: Array,
    tables: Array,
    cells: Array,
    margin: float,
    rows: Array,
    n: int,
    left: NDArray[np.int64],
) -> None:
    """Write whether configurations leave a dependent range.

    Args:
        heads: The section TABLE_HEADS.
        tables: The section TABLES.
        cells: The section TABLE_CELLS.
        margin: Angle that the second joint keeps from a contact [rad].
        rows: Joint positions, one configuration after the other [rad or m].
        n: Number of joints.
        left: Written, one number per configuration.
    """
    left[:] = 0
    places, states, stride = left.ctypes.data, rows.ctypes.data, 8 * n
    for k in range(heads.size // HEAD):
        h = HEAD * k
        begin, density, own = heads[h + 4], heads[h + 5], cells.ctypes.data + 8 * CELL * CELLS * k
        first, second = states + 8 * int(heads[h]), states + 8 * int(heads[h + 1])
        for i in range(left.size):
            y, place = double_at(second + stride * i), (double_at(first + stride * i) - begin) * density
            place = place if place > 0.0 else 0.0  # also keeps NaN from becoming a place
            place = place if place < CELLS - 1.0 else CELLS - 1.0
            cell = own + 8 * CELL * int(place)
            surely = (y < double_at(cell) + margin) | (y > double_at(cell + 8) - margin)
            perhaps = (y < double_at(cell + 16) + margin) | (y > double_at(cell + 24) - margin)
            store_word(places + 8 * i, word_at(places + 8 * i) | (surely + 2 * perhaps))
    for i in range(left.size):
        state, left[i] = left[i], left[i] & 1
        if state == 2:
            for k in range(heads.size // HEAD):
                left[i] |= _violates(heads, tables, margin, rows[n * i : n * i + n], k)
