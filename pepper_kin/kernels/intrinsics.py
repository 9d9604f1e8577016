"""Intrinsics of compiled functions: calls of machine code by address, memory as arrays."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from pepper_kin.kernels.signatures import Floats1, Ints1


class Intrinsic:
    """A function that is a few LLVM instructions if compiled, and a Python function if interpreted.

    Attributes:
        python: The Python function.
        described: Name of the function, for the key of machine code that uses it.
    """

    def __init__(self, python: Callable[..., Any], make: Callable[[], Any]) -> None:
        self.python, self._make, self._made = python, make, None
        self.described = f"intrinsic {python.__module__}.{python.__qualname__}"
        self.__doc__, self.__name__, self.__module__ = python.__doc__, python.__name__, python.__module__

    def __call__(self, *arguments: Any) -> Any:
        """Run the Python function."""
        return self.python(*arguments)

    @property
    def _numba_type_(self) -> Any:
        if self._made is None:
            from numba.core.registry import cpu_target

            self._made = self._make()
            cpu_target.typing_context.refresh()
            cpu_target.target_context.refresh()
            self._type = cpu_target.typing_context._lookup_global(self._made)
        return self._type


def intrinsic(make: Callable[..., Any]) -> Callable[[Callable[..., Any]], Intrinsic]:
    """Decorate a Python function whose compiled form `make` writes, a function for Numba's `intrinsic`."""

    def decorate(python: Callable[..., Any]) -> Intrinsic:
        def made() -> Any:
            from numba.extending import intrinsic as numba_intrinsic

            return numba_intrinsic(make)

        return Intrinsic(python, made)

    return decorate


def in_all_lanes(builder: Any, value: Any, vector: Any) -> Any:
    """Write the instructions that put a number into all lanes of a vector; return the vector."""
    from llvmlite import ir

    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.IntType(32)(0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(first, nothing, zeros)


def _emit_call(result: str | None, *arguments: str) -> Callable[..., Any]:
    """Return a writer of a call of a C function at an address; `arguments` names the scalar types."""

    def write(typing_context: Any, address: Any, *operands: Any) -> Any:
        from llvmlite import ir
        from numba import types

        kinds = {"int64": ir.IntType(64), "int32": ir.IntType(32), "float64": ir.DoubleType()}
        signature = getattr(types, result or "void")(types.intp, *(getattr(types, a) for a in arguments))

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            returned = kinds[result] if result else ir.VoidType()
            kind = ir.FunctionType(returned, [kinds[a] for a in arguments])
            called = builder.call(builder.inttoptr(values[0], ir.PointerType(kind)), values[1:])
            return called if result else context.get_dummy_value()

        return signature, generate

    names = ", ".join(f"a{i}" for i in range(len(arguments)))
    scope: dict[str, Any] = {"write": write}
    exec(
        f"def make(typing_context, address, {names}):\n    return write(typing_context, address, {names})",
        scope,
    )
    made: Callable[..., Any] = scope["make"]
    return made


_THREE = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 3)
_FOUR = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 4)
_CLOCK = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int32, ctypes.c_int64)
_SIX = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 6)


@intrinsic(_emit_call(None, "int64", "int64", "int64"))
def call_kernel(address: int, inputs: int, result: int, work: int) -> None:
    """Call `void f(const double*, double*, double*)`, the `single` or `block` of a kernel, at an address."""
    _THREE(address)(inputs, result, work)


@intrinsic(_emit_call("int64", *["int64"] * 6))
def call_batch(
    address: int, inputs: int, in_strides: int, outputs: int, out_strides: int, count: int, work: int
) -> int:
    """Call the `batch` of a kernel at an address; see `Kernel`."""
    return int(_SIX(address)(inputs, in_strides, outputs, out_strides, count, work))


@intrinsic(_emit_call("int64", "int64", "int64", "int64", "int64"))
def call_four(address: int, first: int, second: int, third: int, fourth: int) -> int:
    """Call `int64 f(int64, int64, int64, int64)` at an address."""
    return int(_FOUR(address)(first, second, third, fourth))


@intrinsic(_emit_call("int32", "int32", "int64"))
def call_clock(address: int, clock: int, place: int) -> int:
    """Call `int clock_gettime(clockid_t, struct timespec*)` at an address."""
    return int(_CLOCK(address)(clock, place))


def _emit_array(dtype: str) -> Callable[..., Any]:
    """Return a writer of an array over memory at an address."""

    def make(typing_context: Any, address: Any, count: Any) -> Any:
        from llvmlite import ir
        from numba import types
        from numba.core import cgutils

        kind = types.Array(getattr(types, dtype), 1, "C")

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            word = ir.IntType(64)
            address, count = values
            array = context.make_array(kind)(context, builder)
            array.meminfo = cgutils.get_null_value(array.meminfo.type)
            array.parent = cgutils.get_null_value(array.parent.type)
            array.nitems, array.itemsize = count, word(8)
            array.data = builder.inttoptr(address, context.get_data_type(kind.dtype).as_pointer())
            array.shape = cgutils.pack_array(builder, [count])
            array.strides = cgutils.pack_array(builder, [word(8)])
            return array._getvalue()

        return kind(types.intp, types.intp), generate

    return make


@intrinsic(_emit_array("float64"))
def floats_at(address: int, count: int) -> Floats1:
    """Return the array of float64 at an address, shape (count,); it does not own the memory."""
    return np.frombuffer(memoryview((ctypes.c_double * count).from_address(address)), np.float64)


@intrinsic(_emit_array("int64"))
def words_at(address: int, count: int) -> Ints1:
    """Return the array of int64 at an address, shape (count,); it does not own the memory."""
    return np.frombuffer(memoryview((ctypes.c_int64 * count).from_address(address)), np.int64)
