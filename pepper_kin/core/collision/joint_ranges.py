"""Tables of joint ranges that depend on the position of another joint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.lanes import double_at, store_word, word_at
from pepper_kin.kernels.records import DOUBLES, RecordView, double

HEAD = 8
"""Size of a table's head in TABLE_HEADS: two joints, offset in TABLES, number of rows, first position, cells
per rad, and the range that every row allows."""
CELLS = 128
"""Number of cells of equal width into which a table is divided."""
CELL = RecordView("CELL", low=double, high=double, inner_low=double, inner_high=double)
"""Bounds of a cell: below the first or above the second the range is certainly violated; from the third to
the fourth it is certainly kept, at a margin of zero."""

SLACK = 1e-9
"""Tolerance by which a curve may leave a range, for rounding [rad or m]."""
_HALVINGS = 40  # maximum depth of halving a segment of a curve


@compiled
def leaves_range(heads: Array, tables: Array, margin: float, q: Array, k: int) -> bool:
    """Return whether a configuration is outside the range of one table.

    Args:
        heads: The section TABLE_HEADS, shape (HEAD t,).
        tables: The section TABLES, shape (r,).
        margin: Angle that the second joint keeps from a contact [rad].
        q: Configuration, shape (n,) [rad or m].
        k: Index of the table.
    """
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
    """Write whether configurations are outside a dependent range.

    Args:
        heads: The section TABLE_HEADS, shape (HEAD t,).
        tables: The section TABLES, shape (r,).
        cells: The section TABLE_CELLS, shape (CELL.width CELLS t,).
        margin: Angle that the second joint keeps from a contact [rad].
        rows: Joint positions, one configuration after the other, shape (>= count n,) [rad or m].
        n: Number of joints.
        left: Output: 1 for each configuration outside a range, else 0, shape (count,).
    """
    left[:] = 0
    places, states = left.ctypes.data, rows.ctypes.data
    for k in range(heads.size // HEAD):
        h = HEAD * k
        begin, density, own = heads[h + 4], heads[h + 5], CELL.at(cells.ctypes.data, CELLS * k)
        first, second = DOUBLES.at(states, int(heads[h])), DOUBLES.at(states, int(heads[h + 1]))
        for i in range(left.size):
            y, place = double_at(second, n * i), (double_at(first, n * i) - begin) * density
            place = place if place > 0.0 else 0.0  # also turns NaN into an index
            place = place if place < CELLS - 1.0 else CELLS - 1.0
            cell = CELL.at(own, int(place))
            surely = (y < CELL.low(cell) + margin) | (y > CELL.high(cell) - margin)
            perhaps = (y < CELL.inner_low(cell) + margin) | (y > CELL.inner_high(cell) - margin)
            store_word(places, word_at(places, i) | (surely + 2 * perhaps), i)
    for i in range(left.size):
        state, left[i] = left[i], left[i] & 1
        if state == 2:
            for k in range(heads.size // HEAD):
                left[i] |= leaves_range(heads, tables, margin, rows[n * i : n * i + n], k)


@compiled
def _row_below(rows: Array, count: int, x: float) -> int:
    """Return the last index of the first `count` rows, ascending, shape (k,), at x or below, or -1."""
    low, high = -1, count
    while high - low > 1:
        middle = (low + high) // 2
        if rows[middle] <= x:
            low = middle
        else:
            high = middle
    return low


@compiled
def _line_keeps(
    rows: Array, count: int, margin: float, a: tuple[float, float], b: tuple[float, float]
) -> bool:
    """Return whether a straight line keeps the range of one table at every point.

    Args:
        rows: Positions of the first joint, lower and upper limits of the second, shape (3 count,) [rad].
        count: Number of rows.
        margin: Angle that the second joint keeps from a contact [rad].
        a: Positions of the first and second joint at the end where the first joint's is smaller [rad].
        b: Positions of the first and second joint at the other end [rad].
    """
    slope = (b[1] - a[1]) / (b[0] - a[0]) if b[0] > a[0] else 0.0
    row = _row_below(rows, count, a[0])
    if row >= 0 and rows[row] == b[0]:  # exactly on a row: only this row applies
        low, high = rows[count + row], rows[2 * count + row]
        return min(a[1], b[1]) >= low + margin and max(a[1], b[1]) <= high - margin
    y = a[1]
    while True:
        last = row + 1 >= count or rows[row + 1] >= b[0]
        end = b[1] if last else a[1] + slope * (rows[row + 1] - a[0])
        below, above = max(row, 0), min(row + 1, count - 1)
        low = max(rows[count + below], rows[count + above]) + margin
        high = min(rows[2 * count + below], rows[2 * count + above]) - margin
        if min(y, end) < low or max(y, end) > high:
            return False
        if last:
            return True
        y, row = end, row + 1


@compiled
def _box_keeps(rows: Array, count: int, x: tuple[float, float], y: tuple[float, float]) -> bool:
    """Return whether all of a box keeps the range of one table.

    Args:
        rows: Positions of the first joint, lower and upper limits of the second, shape (3 count,) [rad].
        count: Number of rows.
        x: Minimum and maximum of the first joint [rad].
        y: Minimum and maximum of the second joint [rad].
    """
    row = max(_row_below(rows, count, x[0]), 0)
    while True:
        if y[0] < rows[count + row] - SLACK or y[1] > rows[2 * count + row] + SLACK:
            return False
        if rows[row] >= x[1] or row + 1 == count:
            return True
        row += 1


@compiled
def _write_control(coefficients: Array, i: int, h: float, j: int, points: Array) -> None:
    """Write the Bezier points, shape (4,), of joint j on segment i, of width h; curve: shape (m, 4, n)."""
    constant, first = coefficients[i, 0, j], coefficients[i, 1, j] * h
    second, third = coefficients[i, 2, j] * h * h, coefficients[i, 3, j] * h * h * h
    points[0], points[1] = constant, constant + first / 3.0
    points[2], points[3] = constant + (2.0 * first + second) / 3.0, constant + first + second + third


@compiled
def _halve(stack: Array, top: int, k: int) -> None:
    """Replace the Bezier points of an interval by those of its second half, and push those of the first half.

    Args:
        stack: Rows of Bezier points, changed, shape (_HALVINGS + 2, 8).
        top: Row of the interval.
        k: Column of a joint's first point: 0 or 4.
    """
    p, q, r, s = stack[top, k], stack[top, k + 1], stack[top, k + 2], stack[top, k + 3]
    pq, qr, rs = 0.5 * (p + q), 0.5 * (q + r), 0.5 * (r + s)
    left, right = 0.5 * (pq + qr), 0.5 * (qr + rs)
    middle = 0.5 * (left + right)
    stack[top + 1, k], stack[top + 1, k + 1] = p, pq
    stack[top + 1, k + 2], stack[top + 1, k + 3] = left, middle
    stack[top, k], stack[top, k + 1], stack[top, k + 2] = middle, right, rs


@compiled
def _piece_keeps(rows: Array, count: int, stack: Array) -> bool:
    """Return whether a segment of a curve keeps the range of one table, halving it as needed.

    Args:
        rows: Positions of the first joint, lower and upper limits of the second, shape (3 count,) [rad].
        count: Number of rows.
        stack: Workspace, shape (_HALVINGS + 2, 8); the first row holds the Bezier points of both joints.
    """
    top = 0
    while top >= 0:
        part = stack[top]
        x = min(part[0], part[1], part[2], part[3]), max(part[0], part[1], part[2], part[3])
        y = min(part[4], part[5], part[6], part[7]), max(part[4], part[5], part[6], part[7])
        if _box_keeps(rows, count, x, y):
            top -= 1
        elif top == _HALVINGS or max(x[1] - x[0], y[1] - y[0]) < SLACK:
            return False
        else:
            _halve(stack, top, 0)
            _halve(stack, top, 4)
            top += 1
    return True


@compiled
def edge_keeps_ranges(heads: Array, tables: Array, margin: float, a: Array, b: Array) -> bool:
    """Return whether all configurations on the line between two keep all dependent ranges.

    Args:
        heads: The section TABLE_HEADS, shape (HEAD t,).
        tables: The section TABLES, shape (r,).
        margin: Angle that the second joint keeps from a contact [rad].
        a: One end, shape (n,) [rad or m].
        b: The other end, shape (n,).
    """
    for h in range(0, heads.size, HEAD):
        first, second, begin, count = int(heads[h]), int(heads[h + 1]), int(heads[h + 2]), int(heads[h + 3])
        least, greatest = min(a[second], b[second]) - margin, max(a[second], b[second]) + margin
        if least >= heads[h + 6] and greatest <= heads[h + 7]:
            continue
        rows, one, other = tables[begin : begin + 3 * count], a, b
        if a[first] > b[first]:
            one, other = b, a
        if not _line_keeps(rows, count, margin, (one[first], one[second]), (other[first], other[second])):
            return False
    return True


@compiled
def curve_keeps_ranges(heads: Array, tables: Array, breaks: Array, coefficients: Array) -> bool:
    """Return whether all configurations on a piecewise cubic curve keep all dependent ranges, without margin.

    Checking states only would miss a corner of the range, which is piecewise constant.

    Args:
        heads: The section TABLE_HEADS, shape (HEAD t,).
        tables: The section TABLES, shape (r,).
        breaks: Ends of the segments, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n) [rad or m].
    """
    if heads.size == 0:
        return True
    stack = np.empty((_HALVINGS + 2, 8))
    control = stack[0]
    for h in range(0, heads.size, HEAD):
        first, second, begin, count = int(heads[h]), int(heads[h + 1]), int(heads[h + 2]), int(heads[h + 3])
        rows = tables[begin : begin + 3 * count]
        for i in range(coefficients.shape[0]):
            width = breaks[i + 1] - breaks[i]
            _write_control(coefficients, i, width, second, control[4:])
            least = min(control[4], control[5], control[6], control[7])
            greatest = max(control[4], control[5], control[6], control[7])
            if least >= heads[h + 6] and greatest <= heads[h + 7]:
                continue
            _write_control(coefficients, i, width, first, control[:4])
            if not _piece_keeps(rows, count, stack):
                return False
    return True
