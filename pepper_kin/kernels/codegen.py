"""IR of a program: chunks of straight-line vector code and the functions that run them.

The functions of a compiled module (`f64` stands for the number format, W for the number of lanes):

    void kernel_block(const f64* in, f64* out, f64* work)      W states, structure of arrays
    void kernel_single(const f64* in, f64* out, f64* work)     one state
    int64 kernel_batch(...)                                    any number of states, row-major (batch.py)
"""

from __future__ import annotations

from pepper_kin.kernels.batch import batch_function
from pepper_kin.kernels.elementary import (
    LIBRARY_FUNCTIONS,
    emit_operation,
    intrinsic_declarations,
    library_declaration,
    library_function,
)
from pepper_kin.kernels.instructions import OPERAND_COUNT, Program
from pepper_kin.kernels.partition import TRIGONOMETRIC, Chunk, Partition
from pepper_kin.kernels.target import Target
from pepper_kin.kernels.trigonometry import sine_cosine_functions
from pepper_kin.kernels.writer import ConstantTable, Lanes, Writer


def module_ir(program: Program, parts: Partition, target: Target, dtype: str, *, batch: bool = True) -> str:
    """The text of the LLVM module of a program.

    Args:
        program: The program.
        parts: The program in chunks.
        target: The processor.
        dtype: "float64" or "float32".
        batch: Whether `kernel_batch` is among the functions.
    """
    lanes = Lanes(dtype, target.lanes(dtype))
    constants = ConstantTable(lanes)
    functions = [_angles_function(parts.angles, constants)]
    functions += [_chunk_function(program, parts, index, constants) for index in range(len(parts.chunks))]
    functions += _library(program, constants, target)
    functions += [_block_function(len(parts.chunks), lanes), _single_function(program, lanes)]
    functions += [*([batch_function(program.signature, lanes)] if batch else []), "!0 = !{i32 1}\n"]
    head = [f'target triple = "{target.triple}"\n', intrinsic_declarations(lanes), constants.definition()]
    return "\n".join(head + functions)


def _library(program: Program, constants: ConstantTable, target: Target) -> list[str]:
    """IR of the functions that the operations of a program call."""
    lanes = constants.lanes
    used = {operation.name for operation in program.operations}
    called = {(LIBRARY_FUNCTIONS[name], OPERAND_COUNT[name]) for name in used if name in LIBRARY_FUNCTIONS}
    texts = [library_function(lanes, *function) for function in sorted(called)]
    if used & TRIGONOMETRIC:
        called |= {("sin", 1), ("cos", 1)}
        texts.append(sine_cosine_functions(constants, target.has_fma))
    return texts + [library_declaration(lanes, *function) for function in sorted(called)]


_PARAMETERS = "ptr noalias readonly %in, ptr noalias %out, ptr noalias %work"
# Chunks are not "internal": LLVM would see their only caller and put the table's address back into them.
_CHUNK_PARAMETERS = f"{_PARAMETERS}, ptr noalias readonly %constants"


class _ChunkWriter:
    """Writer of the operations of one chunk; leaves and sines are written when they are first read."""

    def __init__(self, program: Program, chunk: Chunk, angles: tuple[int, ...], table: ConstantTable) -> None:
        self.writer = Writer(table.lanes, table)
        self._program, self._chunk = program, chunk
        self._angle_slots = {angle: 2 * k for k, angle in enumerate(angles)}
        self._names: dict[int, str] = {}
        self._sine_cosine: dict[int, tuple[str, str]] = {}

    def compute(self, value: int) -> str:
        """Return the name of a value in IR; operations that it needs are written first."""
        if value not in self._names:
            self._names[value] = self._write(value)
        return self._names[value]

    def _write(self, value: int) -> str:
        w, operation = self.writer, self._program.operations[value]
        if value in self._chunk.loads:
            return w.load(w.element_address("%work", self._chunk.loads[value]))
        if operation.name == "const":
            return w.constant(operation.immediate)
        if operation.name == "input":
            return w.load(w.element_address("%in", int(operation.immediate)))
        if operation.name in TRIGONOMETRIC:
            return self._trigonometric(operation.name, operation.operands[0])
        return emit_operation(w, operation.name, [self.compute(operand) for operand in operation.operands])

    def _trigonometric(self, name: str, argument: int) -> str:
        """Sine, cosine or tangent of a value."""
        if argument not in self._sine_cosine:
            self._sine_cosine[argument] = self._take_sine_cosine(argument)
        sine, cosine = self._sine_cosine[argument]
        if name == "tan":
            return self.writer.binary("fdiv", sine, cosine)
        return sine if name == "sin" else cosine

    def _take_sine_cosine(self, argument: int) -> tuple[str, str]:
        """Return sine and cosine of a value, from a slot or computed here by one range reduction."""
        w, operation = self.writer, self._program.operations[argument]
        if operation.name == "input":
            slot = self._angle_slots[int(operation.immediate)]
            return w.load(w.element_address("%work", slot)), w.load(w.element_address("%work", slot + 1))
        return _call_sine_cosine(w, "sine_cosine_called", self.compute(argument))


def _call_sine_cosine(w: Writer, function: str, argument: str) -> tuple[str, str]:
    v = w.lanes.vector
    both = w.value(f"call {{{v}, {v}}} @{function}({v} {argument}, ptr %constants)")
    return w.value(f"extractvalue {{{v}, {v}}} {both}, 0"), w.value(f"extractvalue {{{v}, {v}}} {both}, 1")


def _angles_function(angles: tuple[int, ...], constants: ConstantTable) -> str:
    """IR of the loop that computes sine and cosine of inputs."""
    w = Writer(constants.lanes, constants)
    table = f"@angles = internal constant [{len(angles)} x i64] [{', '.join(f'i64 {a}' for a in angles)}]\n"

    def one(index: str) -> None:
        element = w.value(f"load i64, ptr {w.element_address('@angles', index, 'i64')}")
        results = _call_sine_cosine(w, "sine_cosine", w.load(w.element_address("%in", element)))
        slot = w.value(f"mul nuw nsw i64 {index}, 2")
        for k, result in enumerate(results):
            w.store(result, w.element_address(w.element_address("%work", slot), k))

    w.loop("angles", len(angles), 1, one)
    w.line("ret void")
    return (table if angles else "") + w.function(f"void @take_angles({_CHUNK_PARAMETERS}) noinline nounwind")


def _chunk_function(program: Program, parts: Partition, index: int, constants: ConstantTable) -> str:
    """IR of the function of one chunk."""
    chunk = parts.chunks[index]
    body = _ChunkWriter(program, chunk, parts.angles, constants)
    w = body.writer
    outputs: dict[int | None, list[int]] = {}
    for element, output in chunk.outputs:
        outputs.setdefault(output, []).append(element)
    for value in chunk.values:
        name = body.compute(value)
        if value in chunk.stores:
            w.store(name, w.element_address("%work", chunk.stores[value]))
        for element in outputs.pop(value, ()):
            w.store(name, w.element_address("%out", element))
    for left_over, elements in outputs.items():  # structural zeros, and leaves that are outputs themselves
        name = "zeroinitializer" if left_over is None else body.compute(left_over)
        for element in elements:
            w.store(name, w.element_address("%out", element))
    w.line("ret void")
    # Registers saved on the stack are whole vectors: without the alignment, some would straddle cache lines.
    return w.function(f"void @chunk{index}({_CHUNK_PARAMETERS}) noinline nounwind alignstack(64)")


def _block_function(chunk_count: int, lanes: Lanes) -> str:
    """IR of `kernel_block`, which calls the functions of all chunks."""
    w = Writer(lanes)
    w.line("call void @take_angles(ptr %in, ptr %out, ptr %work, ptr @constants)")
    for index in range(chunk_count):
        w.line(f"call void @chunk{index}(ptr %in, ptr %out, ptr %work, ptr @constants)")
    w.line("ret void")
    return w.function(f"void @kernel_block({_PARAMETERS}) nounwind")


def _single_function(program: Program, lanes: Lanes) -> str:
    """IR of `kernel_single`: all lanes get the one state, and the first lane is the result.

    A vector operation takes as long as a scalar one, so a second, scalar body would gain nothing.
    The work array holds the inputs, the outputs, then the work array of the block.
    """
    w = Writer(lanes)
    input_count = sum(program.signature.input_sizes)
    output_count = sum(program.signature.output_sizes)
    block_out = w.element_address("%work", input_count)
    block_work = w.element_address("%work", input_count + output_count)

    def splat(index: str) -> None:
        scalar = w.value(f"load {lanes.scalar}, ptr {w.element_address('%in', index, lanes.scalar)}")
        first = w.value(f"insertelement {lanes.vector} poison, {lanes.scalar} {scalar}, i32 0")
        zeros = f"<{lanes.count} x i32> zeroinitializer"
        vector = w.value(f"shufflevector {lanes.vector} {first}, {lanes.vector} poison, {zeros}")
        w.store(vector, w.element_address("%work", index))

    def take_first(index: str) -> None:
        scalar = w.value(f"load {lanes.scalar}, ptr {w.element_address(block_out, index)}")
        w.line(f"store {lanes.scalar} {scalar}, ptr {w.element_address('%out', index, lanes.scalar)}")

    w.loop("splat", input_count, 1, splat)
    w.line(f"call void @kernel_block(ptr %work, ptr {block_out}, ptr {block_work})")
    w.loop("take", output_count, 1, take_first)
    w.line("ret void")
    return w.function(f"void @kernel_single({_PARAMETERS}) nounwind")
