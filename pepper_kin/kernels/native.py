"""Calls of kernels by address from Numba-compiled code."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _call_kernel(typing_context: Any, address: Any, given: Any, result: Any, work: Any) -> Any:
    """Call `void f(const f64*, f64*, f64*)` at an address; all four are integers.

    An address that is an argument, unlike a ctypes function that is a global, lets the caller be cached.
    """
    signature = types.void(types.intp, types.intp, types.intp, types.intp)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word, word, word])
        function = builder.inttoptr(arguments[0], ir.PointerType(kind))
        builder.call(function, arguments[1:])
        return context.get_dummy_value()

    return signature, generate


call_kernel: Any = intrinsic(_call_kernel)
