"""Cutting a long program into chunks, each of which becomes one function.

The time to compile a straight-line function grows faster than its length.  Chunks of bounded length keep it
linear.  Inside a chunk values live in registers; a value that a later chunk reads is kept in a slot of a work
array, and a slot is used again once its last reader has run.  Constants and inputs need no slot: every chunk
reads them where they are.

Sines and cosines of inputs (of joint angles, say) are taken before the first chunk, in one small loop, and
stay in the first slots: the loop overlaps several of them, where straight-line code would wait for each.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass

from pepper_kin.kernels.instructions import Operation, Program

TRIGONOMETRIC = frozenset(("sin", "cos", "tan"))
"""Operations that are computed from sine and cosine."""

_WEIGHTS = {"sin": 4, "cos": 4, "tan": 8}


@dataclass(frozen=True)
class Chunk:
    """A run of operations.

    Attributes:
        values: Numbers of the values computed here, in order; those that every chunk can read are left out.
        loads: Values read here and computed in an earlier chunk, with their slots.
        stores: Values computed here and read in a later chunk, with their slots.
        outputs: (element of the outputs, value) stored by this chunk; the value is None for a structural
            zero.
    """

    values: tuple[int, ...]
    loads: dict[int, int]
    stores: dict[int, int]
    outputs: tuple[tuple[int, int | None], ...]


@dataclass(frozen=True)
class Partition:
    """A program in chunks.

    Attributes:
        angles: Elements of the inputs whose sine and cosine are taken first; those of `angles[k]` are in
            slots 2 k and 2 k + 1.
        chunks: The chunks, in the order in which they run.
        slot_count: Number of slots that the work array needs.
    """

    angles: tuple[int, ...]
    chunks: tuple[Chunk, ...]
    slot_count: int


def partition(program: Program, chunk_length: int) -> Partition:
    """Cut a program into chunks.

    Args:
        program: The program.
        chunk_length: Number of operations of a chunk, at most; sine and cosine count for twelve.
    """
    angles = {value: None for value in map(_angle_of(program), program.operations) if value is not None}
    runs = _runs(program, chunk_length)
    chunk_of = {value: index for index, run in enumerate(runs) for value in run}
    last_reader = dict(chunk_of)
    for value, index in chunk_of.items():
        for operand in program.operations[value].operands:
            if operand in chunk_of:
                last_reader[operand] = max(last_reader[operand], index)
    outputs: list[list[tuple[int, int | None]]] = [[] for _ in runs]
    for element, output in enumerate(program.outputs):
        outputs[0 if output is None else chunk_of.get(output, 0)].append((element, output))
    slots, slot_count = _assign_slots(runs, last_reader, 2 * len(angles))
    chunks = []
    for index, run in enumerate(runs):
        read = {operand for value in run for operand in program.operations[value].operands}
        loads = {value: slots[value] for value in sorted(read) if chunk_of.get(value, index) < index}
        stores = {value: slots[value] for value in run if last_reader[value] > index}
        chunks.append(Chunk(tuple(run), loads, stores, tuple(outputs[index])))
    return Partition(tuple(angles), tuple(chunks), slot_count)


def _angle_of(program: Program) -> Callable[[Operation], int | None]:
    """A function of an operation: the input element of which it is the sine, cosine or tangent, or None."""

    def angle(operation: Operation) -> int | None:
        if operation.name not in TRIGONOMETRIC:
            return None
        argument = program.operations[operation.operands[0]]
        return int(argument.immediate) if argument.name == "input" else None

    return angle


def _runs(program: Program, chunk_length: int) -> list[list[int]]:
    """Consecutive operations, cut where the weight reaches `chunk_length`; there is always one run."""
    angle = _angle_of(program)
    weights = {
        value: 1 if angle(operation) is not None else _WEIGHTS.get(operation.name, 1)
        for value, operation in enumerate(program.operations)
        if not operation.is_leaf and (angle(operation) is None or operation.name == "tan")
    }
    total = sum(weights.values())
    # Equal parts: a short last chunk would cost a call for little.
    limit = total / max(1, -(-total // chunk_length))
    runs: list[list[int]] = [[]]
    sum_so_far = 0.0
    for value, weight in weights.items():
        if sum_so_far >= limit:
            runs.append([])
            sum_so_far -= limit
        runs[-1].append(value)
        sum_so_far += weight
    return runs


def _assign_slots(
    runs: list[list[int]], last_reader: dict[int, int], slot_count: int
) -> tuple[dict[int, int], int]:
    """A slot for every value that outlives its chunk: the lowest free one beyond the first `slot_count`."""
    slots: dict[int, int] = {}
    free: list[int] = []
    ends: dict[int, list[int]] = {}
    for index, run in enumerate(runs):
        # A slot read for the last time in chunk k may be written again in chunk k + 1, not earlier: inside
        # one chunk the order of reading and writing would matter.
        for value in ends.pop(index - 1, ()):
            heapq.heappush(free, slots[value])
        for value in run:
            if last_reader[value] > index:
                if not free:
                    heapq.heappush(free, slot_count)
                    slot_count += 1
                slots[value] = heapq.heappop(free)
                ends.setdefault(last_reader[value], []).append(value)
    return slots, slot_count
