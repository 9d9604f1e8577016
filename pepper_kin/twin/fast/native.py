"""Calls of kernels by address from Numba-compiled code."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _call_kernel(typing_context: Any, address: Any, given: Any, result: Any, work: Any) -> Any:
    """Call `void f(const number*, number*, number*)` at an address; all four arguments are integers."""
    signature = types.void(types.int64, types.int64, types.int64, types.int64)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        function = ir.FunctionType(ir.VoidType(), [word, word, word])
        builder.call(builder.inttoptr(arguments[0], ir.PointerType(function)), arguments[1:])
        return context.get_dummy_value()

    return signature, generate


call_kernel: Any = intrinsic(_call_kernel)
