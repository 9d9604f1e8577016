"""Partition of a long program into chunks, each of which becomes one function.

The time to compile a straight-line function grows faster than its length; chunks of bounded length keep it
linear.  Chunks of a few hundred operations are also faster: within one function LLVM moves operations over
any distance, and a value that is moved away from its use has to be spilled and reloaded.

The order is CasADi's own, or depth first from the outputs, the last rows and columns of all matrices first,
whichever keeps fewer values alive: a robot's matrices are filled joint by joint, not one after the other.

Inside a chunk values live in registers; a value that a later chunk reads is kept in a slot of a work array,
and a slot is reused once its last reader has run.  Constants and inputs need no slot: every chunk reads them
directly.

Sines and cosines of inputs (such as joint angles) are computed before the first chunk, in one small loop, and
stay in the first slots: the loop overlaps several evaluations, which straight-line code would run in turn.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate

from pepper_kin.kernels.instructions import Operation, Program

TRIGONOMETRIC = frozenset(("sin", "cos", "tan"))
"""Operations that are computed from sine and cosine."""


@dataclass(frozen=True)
class Chunk:
    """A sequence of operations.

    Attributes:
        values: Indices of the values computed here, in order, without values that every chunk can read.
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
        angles: Elements of the inputs whose sine and cosine are computed first; sine and cosine of
            `angles[k]` are in slots 2 k and 2 k + 1.
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
        chunk_length: Maximum number of operations of a chunk.
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
    """Return a function that maps a sine, cosine or tangent of an input to its element, others to None."""

    def angle(operation: Operation) -> int | None:
        if operation.name not in TRIGONOMETRIC:
            return None
        argument = program.operations[operation.operands[0]]
        return int(argument.immediate) if argument.name == "input" else None

    return angle


def _runs(program: Program, chunk_length: int) -> list[list[int]]:
    """Return runs of consecutive operations; a run is cut in its second half, where fewest values live."""
    angle = _angle_of(program)
    values = [
        value
        for value, operation in enumerate(program.operations)
        if not operation.is_leaf and (angle(operation) is None or operation.name == "tan")
    ]
    orders = values, _joint_by_joint(program, set(values))
    values, alive = min(((order, _alive_after(program, order)) for order in orders), key=lambda o: sum(o[1]))
    runs, start = [], 0
    while len(values) - start > chunk_length:
        # The later of two equal cuts makes fewer chunks.
        cut = min(range(chunk_length, max(1, chunk_length // 2) - 1, -1), key=lambda n: alive[start + n - 1])
        runs.append(values[start : start + cut])
        start += cut
    return [*runs, values[start:]]


def _joint_by_joint(program: Program, values: set[int]) -> list[int]:
    """Return the values, operands first, from the outputs of the last rows and columns to the first ones."""
    signature = program.signature
    places = [
        max(i, j) for rows, columns in signature.output_shapes for i in range(rows) for j in range(columns)
    ]
    order: dict[int, None] = {}
    for element in sorted(range(len(places)), key=lambda element: -places[element]):
        waiting = [program.outputs[element]]
        while waiting:
            value = waiting[-1]
            if value is None or value in order:
                waiting.pop()
                continue
            missing = [operand for operand in program.operations[value].operands if operand not in order]
            if missing:
                waiting.extend(reversed(missing))
            else:
                order[value] = None
    return [value for value in order if value in values]


def _alive_after(program: Program, values: list[int]) -> list[int]:
    """Return the number of live values after each value, if computed in the given order."""
    place = {value: index for index, value in enumerate(values)}
    last_read = list(range(len(values)))
    for index, value in enumerate(values):
        for operand in program.operations[value].operands:
            if operand in place:
                last_read[place[operand]] = index
    change = [0] * (len(values) + 1)
    for index, last in enumerate(last_read):
        change[index] += 1
        change[last] -= 1
    return list(accumulate(change))[:-1]


def _assign_slots(
    runs: list[list[int]], last_reader: dict[int, int], slot_count: int
) -> tuple[dict[int, int], int]:
    """Return a slot for every value that outlives its chunk: the lowest free one from `slot_count` on."""
    slots: dict[int, int] = {}
    free: list[int] = []
    ends: dict[int, list[int]] = {}
    for index, run in enumerate(runs):
        # A slot read for the last time in chunk k may be written again in chunk k + 1, not earlier: inside
        # one chunk, reading would have to precede writing.
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
