"""IR that writes results to memory past the caches.

Ordinary stores to uncached memory first read the memory, and evict everything else from the caches; memory
traffic, not arithmetic, then limits a large batch of matrices.  If all arrays of results are contiguous and
have STREAM_FROM bytes or more together, each block of W states is therefore first assembled in a staging
area, W rows one after the other, and written to memory by non-temporal stores.  Only a few of these stores
can be pending at a time, so they are spread out: while one array's block is assembled, the block before (the
last array's of the states before) is sent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pepper_kin.kernels.instructions import Signature
from pepper_kin.kernels.squares import rounds, row_address, store_rows
from pepper_kin.kernels.writer import Writer

STREAM_FROM = 1 << 22
"""Minimum size of all results that are written past the caches [bytes]: more than one core has of caches."""

LEAST_ALIGNMENT = 16
"""Minimum alignment of arrays that are written past the caches [bytes]; NumPy guarantees no more."""


@dataclass(frozen=True)
class Output:
    """An array of results, not of size 0.

    Attributes:
        target: Names in IR of its address and its row stride.
        size: Number of elements of a row.
        results: Name in IR of the address of a block's vectors.
    """

    target: tuple[str, str]
    size: int
    results: str


def output_arrays(
    w: Writer, targets: Sequence[tuple[str, str]], sizes: Sequence[int], results: str
) -> list[Output]:
    """Return the arrays of results with the addresses of their vectors, without arrays of size 0."""
    outputs, place = [], 0
    for target, size in zip(targets, sizes, strict=True):
        if size:
            outputs.append(Output(target, size, w.element_address(results, place)))
        place += size
    return outputs


def staging_size(signature: Signature) -> int:
    """Return the size of the staging area, two arrays' blocks, in vectors."""
    return 2 * max(signature.output_sizes, default=0)


class Stream:
    """Writer of the parts of a function that send results past the caches.

    Args:
        w: Writer of the function; `%count` is the number of states.
        outputs: The arrays.
        staging: Name of the address of the staging area.
    """

    def __init__(self, w: Writer, outputs: Sequence[Output], staging: str) -> None:
        self._w, self._outputs = w, outputs
        self._half = max(output.size for output in outputs)
        self._areas = staging, w.element_address(staging, self._half)
        self._used, self._aligned = self._is_used()

    def takes(self, start: str) -> str:
        """Write the test whether the block from a state on is sent: the last block may lack states."""
        w = self._w
        end = w.value(f"add nsw i64 {start}, {w.lanes.count}")
        whole = w.value(f"icmp sle i64 {end}, %count")
        return w.value(f"and i1 {self._used}, {whole}")

    def put(self, start: str) -> None:
        """Write the assembly of a block of all arrays, which sends the block before."""
        w, lanes = self._w, self._w.lanes
        started = self._waiting(start)
        for i, output in enumerate(self._outputs):
            here, _ = self._halves(start, i)
            rows = [w.element_address(here, k * output.size, lanes.scalar) for k in range(lanes.count)]
            beside = self._sender(i, self._before(start, i), "true" if i else started)
            store_rows(w, f"stage{i}", rows, output.size, output.results, beside)

    def _sender(self, i: int, ends: tuple[str, str], waiting: str) -> Callable[[str], None]:
        """Return a writer that sends a part of the array before, for an iteration that assembles array i."""
        w, size = self._w, self._outputs[i - 1].size
        share = -(-size // rounds(self._outputs[i].size, w.lanes))

        def send(number: str) -> None:
            w.line(f"br i1 {waiting}, label %send{i}, label %sent{i}")
            w.label(f"send{i}")
            first = w.value(f"mul nuw nsw i64 {number}, {share}")
            indices = []
            for k in range(share):
                index = w.value(f"add nuw nsw i64 {first}, {k}")
                inside = w.value(f"icmp slt i64 {index}, {size - 1}")
                indices.append(w.value(f"select i1 {inside}, i64 {index}, i64 {size - 1}"))
            self._send(f"array{i}", *ends, indices)
            w.line(f"br label %sent{i}")
            w.label(f"sent{i}")

        return send

    def _before(self, start: str, i: int) -> tuple[str, str]:
        """Return the addresses of the array before array i in the staging area and in its target."""
        w = self._w
        row = start if i else w.value(f"sub nsw i64 {start}, {w.lanes.count}")
        return self._halves(start, i)[1], row_address(w, self._outputs[i - 1].target, row)

    def _waiting(self, start: str) -> str:
        """Write the test whether there is a block before."""
        w = self._w
        return w.value(f"and i1 {self._used}, {w.value(f'icmp ne i64 {start}, 0')}")

    def finish(self) -> None:
        """Write the sending of the last block, and a fence: nothing else orders non-temporal stores."""
        w, lanes = self._w, self._w.lanes
        whole = w.value(f"and i64 %count, {-lanes.count}")
        begin = w.value(f"sub nsw i64 {whole}, {lanes.count}")
        last = len(self._outputs) - 1
        area, _ = self._halves(begin, last)
        goal = row_address(w, self._outputs[last].target, begin)
        any_block = w.value(f"icmp sgt i64 {whole}, 0")
        needed = w.value(f"and i1 {self._used}, {any_block}")
        count = w.value(f"select i1 {needed}, i64 {self._outputs[last].size}, i64 0")
        w.loop("rest", count, 1, lambda index: self._send("last", area, goal, [index]))
        w.line("fence seq_cst")

    def _is_used(self) -> tuple[str, str]:
        """Write the tests whether results are sent, and whether all arrays are aligned to whole vectors."""
        w = self._w
        row = sum(output.size for output in self._outputs) * w.lanes.scalar_bytes
        used = w.value(f"icmp sge i64 %count, {-(-STREAM_FROM // row)}")
        bits = "0"
        for output in self._outputs:
            contiguous = w.value(f"icmp eq i64 {output.target[1]}, {output.size}")
            used = w.value(f"and i1 {used}, {contiguous}")
            bits = w.value(f"or i64 {bits}, {w.value(f'ptrtoint ptr {output.target[0]} to i64')}")
        beyond = [w.value(f"and i64 {bits}, {n - 1}") for n in (LEAST_ALIGNMENT, w.lanes.vector_bytes)]
        some, all_ = (w.value(f"icmp eq i64 {number}, 0") for number in beyond)
        return w.value(f"and i1 {used}, {some}"), all_

    def _halves(self, start: str, number: int) -> tuple[str, str]:
        """Return the halves of the staging area for an array's block, and for the block before."""
        w = self._w
        block = w.value(f"udiv i64 {start}, {w.lanes.count}")
        item = w.value(f"mul nuw nsw i64 {block}, {len(self._outputs)}")
        odd = w.value(f"trunc i64 {w.value(f'add nuw nsw i64 {item}, {number}')} to i1")
        first, second = self._areas
        here = w.value(f"select i1 {odd}, ptr {second}, ptr {first}")
        return here, w.value(f"select i1 {odd}, ptr {first}, ptr {second}")

    def _send(self, name: str, area: str, goal: str, indices: Sequence[str]) -> None:
        """Write the sending of some vectors, in parts of 16 bytes if whole vectors are not aligned."""
        w = self._w
        vectors = [w.load(w.element_address(area, index)) for index in indices]
        places = [w.element_address(goal, index) for index in indices]
        w.line(f"br i1 {self._aligned}, label %{name}_whole, label %{name}_halves")
        for label, alignment in (("whole", w.lanes.vector_bytes), ("halves", LEAST_ALIGNMENT)):
            w.label(f"{name}_{label}")
            for vector, place in zip(vectors, places, strict=True):
                w.line(f"store {w.lanes.vector} {vector}, ptr {place}, align {alignment}, !nontemporal !0")
            w.line(f"br label %{name}_done")
        w.label(f"{name}_done")
