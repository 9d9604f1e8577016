"""IR of the loop over the states of row-major arrays.

    int64 kernel_batch(const f64* const* inputs, const int64* input_strides,
                       f64* const* outputs, const int64* output_strides,
                       int64 count, f64* work)

Array `i` holds `count` rows; a row is contiguous and starts `strides[i]` elements after the row before (0:
the same row for all states).  For every W states, W x W tiles of the inputs are loaded and transposed by
shuffles into scratch vectors (one vector per element, one lane per state) that stay in the first-level
cache; the block function runs; its results are transposed back in the same way.

Before rows are loaded, the rows of a later block are prefetched: the processor's own prefetcher is too late
if a block takes little time.  All inputs at once would exceed the number of pending loads.  Results that are
too large for the caches are streamed, see `streaming.py`.

No read or write goes beyond an array.  In the last block the unused lanes repeat the last state, reading
and writing the same row.  The last tile of a row is moved back to end with the row, overlapping the tile
before; rows shorter than W go element by element.

The result is a bit mask of the inputs to check, since they hold NaN, an infinity or a number of at least
LARGE's square root: bit min(i, 62) for input i where squares sum to LARGE or more, or to NaN.  The check
costs one fused instruction per load.
"""

from __future__ import annotations

from pepper_kin.kernels.instructions import Signature
from pepper_kin.kernels.squares import column_of_square, row_address, store_rows, transpose
from pepper_kin.kernels.streaming import Stream, output_arrays, staging_size
from pepper_kin.kernels.writer import Lanes, Writer

AHEAD = 8
"""Number of blocks by which rows are prefetched before they are loaded."""

CACHE_LINE = 64

LARGE = 1e18
"""Bound on sums of squares: with smaller sums in each lane, no input is NaN, infinite or beyond 1e9."""

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
    results = w.element_address("%work", sum(input_sizes))
    staging = w.element_address("%work", sum(input_sizes) + sum(output_sizes))
    block_work = w.element_address(staging, staging_size(signature))
    last = w.value("sub nsw i64 %count, 1")
    outputs = output_arrays(w, targets, output_sizes, results)
    stream = Stream(w, outputs, staging) if outputs else None

    def block(start: str) -> None:
        rows = [_row_number(w, start, k, last) for k in range(lanes.count)]
        scratch = 0
        for i, size in enumerate(input_sizes):
            addresses = [row_address(w, sources[i], row) for row in rows]
            _load_rows(w, f"load{i}", addresses, size, w.element_address("%work", scratch), checks[i])
            scratch += size
        w.line(f"call void @kernel_block(ptr %work, ptr {results}, ptr {block_work})")
        if stream is None:
            return
        w.line(f"br i1 {stream.takes(start)}, label %streamed, label %stored")
        w.label("streamed")
        stream.put(start)
        w.line("br label %written")
        w.label("stored")
        for i, output in enumerate(outputs):
            addresses = [row_address(w, output.target, row) for row in rows]
            store_rows(w, f"store{i}", addresses, output.size, output.results)
        w.line("br label %written")
        w.label("written")

    w.loop("blocks", "%count", lanes.count, block)
    if stream is not None:
        stream.finish()
    w.line(f"ret i64 {_findings(w, checks)}")
    return w.function(_HEADER)


def _array(w: Writer, pointers: str, strides: str, index: int) -> tuple[str, str]:
    """Address and row stride of array `index`."""
    pointer = w.value(f"load ptr, ptr {w.element_address(pointers, index, 'ptr')}")
    stride = w.value(f"load i64, ptr {w.element_address(strides, index, 'i64')}")
    return pointer, stride


def _row_number(w: Writer, start: str, lane: int, last: str) -> str:
    """Index of the state in a lane: the last state for unused lanes."""
    row = w.value(f"add nsw i64 {start}, {lane}")
    inside = w.value(f"icmp slt i64 {row}, {last}")
    return w.value(f"select i1 {inside}, i64 {row}, i64 {last}")


def _load_rows(w: Writer, name: str, rows: list[str], size: int, scratch: str, check: str) -> None:
    """Write the load of one input: W rows of `size` elements become `size` vectors."""
    lanes = w.lanes
    length = size * lanes.vector_bytes
    for place in range(AHEAD * length, (AHEAD + 1) * length, CACHE_LINE):  # prefetch of rows without gaps
        address = w.value(f"getelementptr i8, ptr {rows[0]}, i64 {place}")
        w.line(f"call void @llvm.prefetch.p0(ptr {address}, i32 0, i32 3, i32 1)")

    def add_to_check(vectors: list[str]) -> None:
        found = "zeroinitializer"  # a separate sum for every tile, so that tiles are independent
        for vector in vectors:
            found = w.multiply_add(vector, vector, found)
        w.store(w.binary("fadd", w.load(check), found), check)

    def square(column: str) -> None:
        column = column_of_square(w, column, size)
        vectors = [w.load(w.element_address(row, column, lanes.scalar)) for row in rows]
        add_to_check(vectors)
        for k, vector in enumerate(transpose(w, vectors)):
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


def _findings(w: Writer, checks: list[str]) -> str:
    """Combine the checks: bit min(i, 62) is set when a lane of check i is LARGE or more, or NaN."""
    lanes, result = w.lanes, "0"
    for i, check in enumerate(checks):
        bad = w.value(f"fcmp uge {lanes.vector} {w.load(check)}, {lanes.splat(LARGE)}")
        bits = w.value(f"bitcast {lanes.mask} {bad} to i{lanes.count}")
        found = w.value(f"icmp ne i{lanes.count} {bits}, 0")
        bit = w.value(f"select i1 {found}, i64 {1 << min(i, 62)}, i64 0")
        result = w.value(f"or i64 {result}, {bit}")
    return result
