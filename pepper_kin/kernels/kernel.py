"""Compiled functions: `compile_function` and the `Kernel` that it returns."""

from __future__ import annotations

import ctypes
import dataclasses
import hashlib
import math
import struct
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.arrays import RowView, make_outputs, read_inputs, refuse_not_finite
from pepper_kin.kernels.compiler import LOADING, LoadedCode, compile_ir
from pepper_kin.kernels.image import KernelImage
from pepper_kin.kernels.instructions import Signature, check_function, read_program
from pepper_kin.kernels.sources import file_digest
from pepper_kin.kernels.store import obtain
from pepper_kin.kernels.target import Target, host_target
from pepper_kin.kernels.threads import LARGEST_PIECE, run_in_pieces

if TYPE_CHECKING:
    import casadi

CHUNK_LENGTH = 200
"""Maximum number of operations of a compiled function; longer programs are cut."""

_BATCH = ctypes.CFUNCTYPE(
    ctypes.c_int64,
    ctypes.c_void_p,
    ctypes.c_void_p,
    ctypes.c_void_p,
    ctypes.c_void_p,
    ctypes.c_int64,
    ctypes.c_void_p,
)


class Kernel:
    """A function compiled for batches of states.

    For Python, call it with arrays.  For other compiled code (Numba, C), these functions are at its
    addresses; `f64` is `float` in a float32 kernel, W is `lanes`, elements are numbered row-major, all inputs
    (outputs) one after the other, and no two of the arrays may overlap:

    * `void single(const f64* in, f64* out, f64* work)` at `single_address`: one state, `in[k]` is element k.
    * `void block(const f64* in, f64* out, f64* work)` at `block_address`: W states, `in[k * W + lane]`.
    * `int64 batch(const f64* const* inputs, const int64* input_strides, f64* const* outputs,
      const int64* output_strides, int64 count, f64* work)` at `batch_address`: `count` states in row-major
      arrays, strides in elements from row to row; the result is nonzero if an input held NaN, an infinity or
      a number beyond 1e9, and may be nonzero if many numbers are nearly as large.

    `work` is an array of `work_size` numbers, one per thread; it needs no initial content, and only the
    alignment of a number (64 bytes is fastest).  The addresses are valid while the kernel lives.

    Attributes:
        signature: Names and shapes of inputs and outputs.
        dtype: Number format of inputs and outputs, float64 or float32.
        lanes: Number of states that one vector holds.
        work_size: Size of `work`, in numbers of `dtype`.
        flop_count: Number of arithmetic operations for one state; a sine counts as one.
        from_cache: Whether the code was read from disk.
        single_address: Address of `single`.
        block_address: Address of `block`.
        batch_address: Address of `batch`; 0 for a kernel made without it.
    """

    def __init__(self, image: KernelImage, target: Target, *, from_cache: bool = False) -> None:
        self.signature: Signature = image.signature
        self.dtype = np.dtype(image.dtype)
        self.lanes = image.lanes
        self.flop_count = image.flop_count
        self.from_cache = from_cache
        self.work_size = image.work_size
        self._output_sizes = self.signature.output_sizes
        self._code = LoadedCode(image.object_code, target)
        self.single_address = self._code.address("kernel_single")
        self.block_address = self._code.address("kernel_block")
        self.batch_address = self._code.address("kernel_batch")
        self._batch = _BATCH(self.batch_address) if self.batch_address else _no_batch

    def __call__(
        self,
        *inputs: ArrayLike,
        out: object = None,
        threads: int = 1,
        check_finite: bool = True,
        check_large: Callable[[], object] | None = None,
    ) -> NDArray[np.floating] | tuple[NDArray[np.floating], ...]:
        """Evaluate the function for every state.

        Args:
            inputs: One array per input, shape (..., rows) if the function has a column vector, else
                (..., rows, columns).  Leading axes must agree; an input without leading axes holds for all
                states.
                Other real dtypes and layouts are converted; rows that are contiguous are read in place.
            out: Array for the result (a sequence of arrays for several outputs) of the right shape and dtype.
            threads: Number of threads that share the states.  The result does not depend on it.
            check_finite: Whether NaN and infinities are refused.  If one is found, `out` has been written to.
            check_large: Function that is called instead if inputs hold NaN, an infinity or a number beyond
                1e9, and sometimes if many are nearly as large: it raises for inputs that the caller refuses.

        Returns:
            Results, shape (..., rows) or (..., rows, columns); a tuple of arrays unless there is exactly one
            output.  Structural zeros are exact zeros.

        Raises:
            InvalidValueError: An argument has the wrong shape or type, or is not finite.
        """
        if isinstance(threads, bool) or not isinstance(threads, (int, np.integer)) or threads < 1:
            raise InvalidValueError("threads", repr(threads), "an integer of at least 1")
        leading, rows = read_inputs(self.signature, self.dtype, inputs)
        results = make_outputs(self.signature, self.dtype, leading, out, rows)
        count = math.prod(leading)
        if count and self._evaluate(rows, results, count, int(threads)):
            if check_large is not None:
                check_large()
            elif check_finite:
                refuse_not_finite(self.signature, rows)
        return results[0] if len(results) == 1 else tuple(results)

    def address_of(self, function: str, *, inputs: int, outputs: int, work: int) -> int:
        """Return the address of a function for a caller whose buffers are large enough for it.

        All callers in machine code get addresses here, so that no code runs on buffers made for another
        kernel, such as one of another robot or of other tasks.

        Args:
            function: "single", "block" or "batch".
            inputs: Number of elements of one state in all input buffers; exactly the signature's number.
            outputs: Number of elements of one state in all output buffers.
            work: Size of the work buffer, in numbers.

        Raises:
            InvalidValueError: A buffer does not fit; names the kernel and the buffer.
        """
        name, needed = self.signature.name, sum(self.signature.input_sizes)
        if inputs != needed:
            raise InvalidValueError(f"input buffer of {name}", f"{inputs} numbers a state", f"{needed}")
        needed = sum(self.signature.output_sizes)
        if outputs < needed:
            raise InvalidValueError(
                f"output buffer of {name}", f"{outputs} numbers a state", f"{needed} or more"
            )
        if work < self.work_size:
            raise InvalidValueError(f"work buffer of {name}", f"{work} numbers", f"{self.work_size} or more")
        address: int = getattr(self, f"{function}_address")
        if not address:
            raise InvalidValueError(f"function of {name}", repr(function), "one that it was made with")
        return address

    def __repr__(self) -> str:
        """Name, inputs, outputs and format."""
        inputs = ", ".join(f"{n}[{r}x{c}]" for n, (r, c) in _named(self.signature, "input"))
        outputs = ", ".join(f"{n}[{r}x{c}]" for n, (r, c) in _named(self.signature, "output"))
        return f"Kernel({self.signature.name}: ({inputs}) -> ({outputs}), {self.dtype}, {self.lanes} lanes)"

    def _evaluate(
        self, inputs: Sequence[RowView], outputs: Sequence[np.ndarray], count: int, threads: int
    ) -> bool:
        """Run the compiled loop; outputs have shape (..., *core).  Return whether an input may be large."""
        sources = [(rows.address, rows.stride) for rows in inputs]
        targets = [(array.ctypes.data, size) for array, size in zip(outputs, self._output_sizes, strict=True)]
        input_strides = _pack([stride for _, stride in sources])
        output_strides = _pack([stride for _, stride in targets])
        item = self.dtype.itemsize
        findings: list[int] = []

        def run(start: int, stop: int) -> None:
            starts = _pack([address + start * stride * item for address, stride in sources])
            ends = _pack([address + start * stride * item for address, stride in targets])
            work = np.empty(self.work_size * item + 64, np.uint8)
            aligned = -(-work.ctypes.data // 64) * 64
            findings.append(self._batch(starts, input_strides, ends, output_strides, stop - start, aligned))

        if threads == 1 and count <= LARGEST_PIECE:
            run(0, count)
        else:
            run_in_pieces(count, threads, self.lanes, run)
        return any(findings)


def compile_function(
    function: casadi.Function | Callable[[], casadi.Function],
    *,
    dtype: str = "float64",
    key: str | None = None,
    cache: bool = True,
    target: Target | None = None,
    vector_bytes: int | None = None,
    batch: bool = True,
) -> Kernel:
    """Compile a CasADi function for batches of states, or read its code from the cache.

    Args:
        function: A function of SX expressions (`function.expand()` of an MX function).  With a `key`, it may
            also be a callable without arguments that makes one; it is called only if the cache has no code.
        dtype: "float64" or "float32": format of inputs, outputs and intermediate values.
        key: Name under which the code is cached.  It must change whenever the function does.  If omitted, the
            function's serialized expression is the key.
        cache: Whether to read and write the cache on disk.
        target: Processor to compile for: this machine's, or one with fewer instructions.
        vector_bytes: Width of the vectors of lanes [bytes], for callers that need a certain number of lanes;
            the processor's if omitted.
        batch: Whether the kernel can be called with arrays; without, only compiled code calls it, by address.

    Raises:
        InvalidValueError: `function` is not a function of SX expressions, or `dtype` is unknown.
        UnsupportedInstructionError: The function holds an instruction that cannot be compiled.
    """
    (target or host_target()).lanes(dtype)  # refuses an unknown dtype before any work is done
    if key is None:
        check_function(function)
        content = function.serialize()  # type: ignore[union-attr]
    else:
        content = f"key {key}"
    name = "a kernel" if key is None else key.partition("(")[0][:40].strip()

    def make(wanted: Target) -> bytes:
        return _compile(_made(function), _widened(wanted, vector_bytes), dtype, batch).to_bytes()

    wanted_key = _key(content, f"{dtype} {vector_bytes or 0} {batch}")
    with LOADING:
        part = obtain(name, wanted_key, make, target=target, keep=cache)
    return Kernel(KernelImage.from_bytes(part.content), part.target, from_cache=not part.made)


def _key(content: str, dtype: str) -> str:
    """Hash of a function's content, the format, and the source of the code generator itself."""
    digest = hashlib.sha256(_source_digest())
    for text in (content, dtype, str(CHUNK_LENGTH)):
        data = text.encode("utf-8", "surrogatepass")  # an unknown dtype is refused by the compilation
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()


@cache
def _source_digest() -> bytes:
    """Return a hash of the source files here that determine machine code, given an expression."""
    names = (
        "arrays batch codegen compiler elementary image instructions kernel partition squares streaming"
        " target trigonometry writer"
    )
    files = (Path(__file__).with_name(f"{name}.py") for name in names.split())
    return hashlib.sha256("".join(file_digest(str(file)) for file in files).encode()).digest()


def _widened(target: Target, vector_bytes: int | None) -> Target:
    return target if vector_bytes is None else dataclasses.replace(target, vector_bytes=vector_bytes)


def _made(function: casadi.Function | Callable[[], casadi.Function]) -> casadi.Function:
    """Return the function itself, or the function that the callable makes."""
    return cast("casadi.Function", function if hasattr(function, "class_name") else function())


def kernel_ir(function: casadi.Function, *, dtype: str = "float64", target: Target | None = None) -> str:
    """The LLVM IR that `compile_function` would compile, as text to read."""
    from pepper_kin.kernels.codegen import module_ir
    from pepper_kin.kernels.partition import partition

    program = read_program(function)
    return module_ir(program, partition(program, CHUNK_LENGTH), target or host_target(), dtype)


def _compile(function: casadi.Function, target: Target, dtype: str, batch: bool) -> KernelImage:
    """Return the image of a CasADi function, compiled for a processor."""
    from pepper_kin.kernels.codegen import module_ir
    from pepper_kin.kernels.partition import partition
    from pepper_kin.kernels.streaming import staging_size

    program = read_program(function)
    parts = partition(program, CHUNK_LENGTH)
    code = compile_ir(module_ir(program, parts, target, dtype, batch=batch), target)
    signature, lanes = program.signature, target.lanes(dtype)
    elements = sum(signature.input_sizes) + sum(signature.output_sizes)
    work_size = (elements + staging_size(signature) + parts.slot_count) * lanes
    return KernelImage(signature, dtype, lanes, work_size, program.flop_count, code)


def _no_batch(*_: object) -> int:
    raise TypeError("this kernel was made for compiled code only (batch=False)")


def _pack(numbers: Sequence[int]) -> bytes:
    """Return a C array of int64 (or of pointers, of the same size) as bytes; ctypes passes their address."""
    return struct.pack(f"={len(numbers)}q", *numbers)


def _named(signature: Signature, kind: str) -> list[tuple[str, tuple[int, int]]]:
    if kind == "input":
        return list(zip(signature.input_names, signature.input_shapes, strict=True))
    return list(zip(signature.output_names, signature.output_shapes, strict=True))
