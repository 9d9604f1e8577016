"""IR that transposes vectors of one lane per state into rows of one state each, tile by tile."""

from __future__ import annotations

from collections.abc import Callable

from pepper_kin.kernels.writer import Lanes, Writer


def row_address(w: Writer, array: tuple[str, str], row: str) -> str:
    """Write the address of a row of an array, which is a pointer and a stride in elements."""
    offset = w.value(f"mul nsw i64 {row}, {array[1]}")
    return w.element_address(array[0], offset, w.lanes.scalar)


def store_rows(
    w: Writer,
    name: str,
    rows: list[str],
    size: int,
    scratch: str,
    beside: Callable[[str], None] | None = None,
) -> None:
    """Write the stores of one output: `size` vectors become rows of `size` elements, one row per lane.

    Args:
        w: Writer of the function.
        name: Prefix of the labels; unique in the function.
        rows: Addresses of the rows.
        size: Number of elements of a row.
        scratch: Address of the vectors.
        beside: Writer of additional code in each iteration of the loop, see `rounds`; gets the name of the
            iteration's index in IR.
    """
    lanes = w.lanes

    def square(column: str) -> None:
        if beside is not None:
            beside(w.value(f"udiv i64 {column}, {lanes.count}"))
        column = column_of_square(w, column, size)
        first = w.element_address(scratch, column)
        vectors = [w.load(w.element_address(first, k)) for k in range(lanes.count)]
        for row, vector in zip(rows, transpose(w, vectors), strict=True):
            w.store(vector, w.element_address(row, column, lanes.scalar))

    def element(column: str) -> None:
        if beside is not None:
            beside(column)
        vector = w.load(w.element_address(scratch, column))
        for k, row in enumerate(rows):
            number = w.value(f"extractelement {lanes.vector} {vector}, i32 {k}")
            w.line(f"store {lanes.scalar} {number}, ptr {w.element_address(row, column, lanes.scalar)}")

    if size >= lanes.count:
        w.loop(name, size, lanes.count, square)
    else:
        w.loop(name, size, 1, element)


def rounds(size: int, lanes: Lanes) -> int:
    """Number of iterations of the loop of `store_rows`."""
    return -(-size // lanes.count) if size >= lanes.count else size


def column_of_square(w: Writer, column: str, size: int) -> str:
    """First column of a tile: `column`, or less if the tile would not end inside the row."""
    if size % w.lanes.count == 0:
        return column
    furthest = size - w.lanes.count
    inside = w.value(f"icmp slt i64 {column}, {furthest}")
    return w.value(f"select i1 {inside}, i64 {column}, i64 {furthest}")


def transpose(w: Writer, rows: list[str]) -> list[str]:
    """Write the transposition of W vectors of W lanes.

    Stage by stage, blocks of 1, 2, 4, ... lanes off the diagonal change places between two vectors.
    """
    count, vectors = w.lanes.count, list(rows)
    width = 1
    while width < count:
        low = [k if not k & width else k - width + count for k in range(count)]
        high = [k + width if not k & width else k + count for k in range(count)]
        for upper in range(count):
            if not upper & width:
                pair = vectors[upper], vectors[upper + width]
                vectors[upper], vectors[upper + width] = _shuffle(w, *pair, low), _shuffle(w, *pair, high)
        width *= 2
    return vectors


def _shuffle(w: Writer, left: str, right: str, lanes: list[int]) -> str:
    v = w.lanes.vector
    mask = ", ".join(f"i32 {lane}" for lane in lanes)
    return w.value(f"shufflevector {v} {left}, {v} {right}, <{w.lanes.count} x i32> <{mask}>")
