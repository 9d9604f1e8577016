"""Compiled: kernels evaluated for many states by their addresses."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from pepper_kin.kernels import Kernel

Array = NDArray[np.float64]

_WORDS = 8


def evaluate(compiled: Kernel, *states: Array) -> Array:
    """Evaluate a kernel for contiguous arrays of shape (T, n) that are known to be finite.

    Calling it by its address, as it documents, saves the checks of `Kernel.__call__`, which take as long as
    hundreds of states.

    Args:
        compiled: A kernel of two or three joint vectors with one result.
        *states: The joint vectors.

    Returns:
        Shape (T, size of the result).
    """
    result = np.empty((len(states[0]), compiled.signature.output_sizes[0]))
    work, words = np.empty(compiled.work_size + 8), np.empty(_WORDS, np.int64)
    _evaluate(compiled.batch_address, states[0], states[1], states[-1], result, work, words)
    return result


def _call(
    typing_context: Any, address: Any, inputs: Any, in_strides: Any, outputs: Any, out_strides: Any,
    count: Any, work: Any,
) -> Any:  # fmt: skip
    """Call the `batch` function that `Kernel` describes at an address; all arguments are integers."""
    signature = types.int64(*[types.int64] * 7)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        function = ir.FunctionType(word, [word] * 6)
        return builder.call(builder.inttoptr(arguments[0], ir.PointerType(function)), arguments[1:])

    return signature, generate


_call_batch: Any = intrinsic(_call)


@njit(cache=True, nogil=True, error_model="numpy")
def _evaluate(
    address: int, first: Array, second: Array, third: Array, result: Array, work: Array, words: np.ndarray
) -> None:
    """Run a kernel of two or three inputs; all memory belongs to the caller, so that it outlives the call."""
    words[0], words[1], words[2] = first.ctypes.data, second.ctypes.data, third.ctypes.data
    words[3] = words[4] = words[5] = first.shape[1]
    words[6], words[7] = result.ctypes.data, result.shape[1]
    here = words.ctypes.data
    _call_batch(address, here, here + 24, here + 48, here + 56, first.shape[0], work.ctypes.data)


@njit(cache=True, nogil=True, error_model="numpy")
def edge_products(wrench: Array, gain: Array) -> Array:
    """Return wrench @ gain, shape (T, k), without BLAS, which may start threads and wait for a processor."""
    result = np.zeros((wrench.shape[0], gain.shape[1]))
    for t in range(wrench.shape[0]):
        for i in range(wrench.shape[1]):
            for k in range(gain.shape[1]):
                result[t, k] += wrench[t, i] * gain[i, k]
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def linear_speed(velocity: Array, limit: float, k: int, shares: Array) -> None:
    """Write the linear speed of a frame's velocities, shape (T, 6), over its limit to a column."""
    for t in range(velocity.shape[0]):
        x, y, z = velocity[t, 0], velocity[t, 1], velocity[t, 2]
        shares[t, k] = np.sqrt(x * x + y * y + z * z) / limit
