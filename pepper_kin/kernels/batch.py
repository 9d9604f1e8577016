"""IR of the loop over the states of row-major arrays.

    int64 kernel_batch(const f64* const* inputs, const int64* input_strides,
                       f64* const* outputs, const int64* output_strides,
                       int64 count, f64* work)

Array `i` holds `count` rows; a row is contiguous and starts `strides[i]` elements after the one before (0:
the same row for all states).  For every W states, W x W squares of the inputs are loaded and transposed by
shuffles into a scratch of vectors (one vector per element, one lane per state) that stays in the first-level
cache; the block function runs; its results go back the same way.

No read or write goes beyond an array.  In the last block the lanes left over repeat the last state, reading
and writing the same row.  The last square of a row is moved back to end with it, overlapping the one before;
rows shorter than W go element by element.

The result tells which inputs held NaN or an infinity: bit min(i, 62) for input i.  The test costs one fused
instruction per load: 0 x is 0 for every finite x, else NaN.
"""

from __future__ import annotations

from pepper_kin.kernels.instructions import Signature
from pepper_kin.kernels.writer import Lanes, Writer

_HEADER = (
    "i64 @kernel_batch(ptr noalias readonly %inputs, ptr noalias readonly %input_strides, "
    "ptr noalias readonly %outputs, ptr noalias readonly %output_strides, "
    "i64 %count, ptr noalias %work) nounwind"
)


def batch_function(signature: Signature, lanes: Lanes) -> str:
    """IR of `kernel_batch` for a function of the given inputs and outputs."""
    w = Writer(lanes)
    input_sizes, output_sizes = signature.input_sizes, signature.output_sizes
    sources = [_array(w, "%inputs", "%input_strides", i) for i in range(len(input_sizes))]
    targets = [_array(w, "%outputs", "%output_strides", i) for i in range(len(output_sizes))]
    checks = [w.value(f"alloca {lanes.vector}, align {lanes.vector_bytes}") for _ in input_sizes]
    for check in checks:
        w.store("zeroinitializer", check)
    block_out = w.element_address("%work", sum(input_sizes))
    block_work = w.element_address("%work", sum(input_sizes) + sum(output_sizes))
    last = w.value("sub nsw i64 %count, 1")

    def block(start: str) -> None:
        rows = [_row_number(w, start, k, last) for k in range(lanes.count)]
        scratch = 0
        for i, size in enumerate(input_sizes):
            addresses = [_row_address(w, sources[i], row) for row in rows]
            _load_rows(w, f"load{i}", addresses, size, w.element_address("%work", scratch), checks[i])
            scratch += size
        w.line(f"call void @kernel_block(ptr %work, ptr {block_out}, ptr {block_work})")
        scratch = 0
        for i, size in enumerate(output_sizes):
            addresses = [_row_address(w, targets[i], row) for row in rows]
            _store_rows(w, f"store{i}", addresses, size, w.element_address(block_out, scratch))
            scratch += size

    w.loop("blocks", "%count", lanes.count, block)
    w.line(f"ret i64 {_findings(w, checks)}")
    return w.function(_HEADER)


def _array(w: Writer, pointers: str, strides: str, index: int) -> tuple[str, str]:
    """Address and row stride of array `index`."""
    pointer = w.value(f"load ptr, ptr {w.element_address(pointers, index, 'ptr')}")
    stride = w.value(f"load i64, ptr {w.element_address(strides, index, 'i64')}")
    return pointer, stride


def _row_number(w: Writer, start: str, lane: int, last: str) -> str:
    """Number of the state in a lane: the last state for the lanes that are left over."""
    row = w.value(f"add nsw i64 {start}, {lane}")
    inside = w.value(f"icmp slt i64 {row}, {last}")
    return w.value(f"select i1 {inside}, i64 {row}, i64 {last}")


def _row_address(w: Writer, array: tuple[str, str], row: str) -> str:
    offset = w.value(f"mul nsw i64 {row}, {array[1]}")
    return w.element_address(array[0], offset, w.lanes.scalar)


def _load_rows(w: Writer, name: str, rows: list[str], size: int, scratch: str, check: str) -> None:
    """Write the load of one input: W rows of `size` elements become `size` vectors."""
    lanes = w.lanes

    def add_to_check(vectors: list[str]) -> None:
        found = "zeroinitializer"  # a chain of its own for every square: squares need not wait for each other
        for vector in vectors:
            found = w.multiply_add(vector, "zeroinitializer", found)
        w.store(w.binary("fadd", w.load(check), found), check)

    def square(column: str) -> None:
        column = _column_of_square(w, column, size)
        vectors = [w.load(w.element_address(row, column, lanes.scalar)) for row in rows]
        add_to_check(vectors)
        for k, vector in enumerate(_transpose(w, vectors)):
            w.store(vector, w.element_address(w.element_address(scratch, column), k))

    def element(column: str) -> None:
        vector = "poison"
        for k, row in enumerate(rows):
            number = w.value(f"load {lanes.scalar}, ptr {w.element_address(row, column, lanes.scalar)}")
            vector = w.value(f"insertelement {lanes.vector} {vector}, {lanes.scalar} {number}, i32 {k}")
        add_to_check([vector])
        w.store(vector, w.element_address(scratch, column))

    if size >= lanes.count:
        w.loop(name, size, lanes.count, square)
    else:
        w.loop(name, size, 1, element)


def _store_rows(w: Writer, name: str, rows: list[str], size: int, scratch: str) -> None:
    """Write the store of one output: `size` vectors become W rows of `size` elements."""
    lanes = w.lanes

    def square(column: str) -> None:
        column = _column_of_square(w, column, size)
        first = w.element_address(scratch, column)
        vectors = [w.load(w.element_address(first, k)) for k in range(lanes.count)]
        for row, vector in zip(rows, _transpose(w, vectors), strict=True):
            w.store(vector, w.element_address(row, column, lanes.scalar))

    def element(column: str) -> None:
        vector = w.load(w.element_address(scratch, column))
        for k, row in enumerate(rows):
            number = w.value(f"extractelement {lanes.vector} {vector}, i32 {k}")
            w.line(f"store {lanes.scalar} {number}, ptr {w.element_address(row, column, lanes.scalar)}")

    if size >= lanes.count:
        w.loop(name, size, lanes.count, square)
    else:
        w.loop(name, size, 1, element)


def _column_of_square(w: Writer, column: str, size: int) -> str:
    """First column of a square: `column`, or less where the square would not end inside the row."""
    if size % w.lanes.count == 0:
        return column
    furthest = size - w.lanes.count
    inside = w.value(f"icmp slt i64 {column}, {furthest}")
    return w.value(f"select i1 {inside}, i64 {column}, i64 {furthest}")


def _transpose(w: Writer, rows: list[str]) -> list[str]:
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


def _findings(w: Writer, checks: list[str]) -> str:
    """Combine the checks: bit min(i, 62) is set when a lane of check i is NaN."""
    lanes, result = w.lanes, "0"
    for i, check in enumerate(checks):
        bad = w.value(f"fcmp uno {lanes.vector} {w.load(check)}, zeroinitializer")
        bits = w.value(f"bitcast {lanes.mask} {bad} to i{lanes.count}")
        found = w.value(f"icmp ne i{lanes.count} {bits}, 0")
        bit = w.value(f"select i1 {found}, i64 {1 << min(i, 62)}, i64 0")
        result = w.value(f"or i64 {result}, {bit}")
    return result
