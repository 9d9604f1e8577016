"""Evaluation of kernels of joint vectors for many states, without the checks of their Python calls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_batch

if TYPE_CHECKING:
    from pepper_kin.kernels import Kernel


_WORDS = 8


def evaluate(kernel: Kernel, *states: Array) -> Array:
    """Evaluate a kernel for contiguous, finite arrays of shape (T, n).

    Calling the kernel by its address, as it documents, avoids the checks of `Kernel.__call__`, which take as
    long as hundreds of states.

    Args:
        kernel: A kernel of one to three joint vectors with one result.
        *states: The joint vectors, shape (T, n) [rad or m].

    Returns:
        The result, shape (T, size of the result).
    """
    result = np.empty((len(states[0]), kernel.signature.output_sizes[0]))
    work, words = np.empty(kernel.work_size + 8), np.empty(_WORDS, np.int64)
    second, last = states[min(1, len(states) - 1)], states[-1]
    width = sum(state.shape[1] for state in states)
    address = kernel.address_of("batch", inputs=width, outputs=result.shape[1], work=work.size)
    evaluate_batch(address, states[0], second, last, result, work, words)
    return result


@compiled(
    "void(int64, float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1],"
    " float64[::1], int64[::1])",
    lean=True,
)
def evaluate_batch(
    address: int, first: Array, second: Array, third: Array, result: Array, work: Array, words: np.ndarray
) -> None:
    """Run the `batch` function of a kernel of one to three inputs.

    All memory belongs to the caller, so that it outlives the call.

    Args:
        address: Address of the kernel's `batch`.
        first: First input, shape (T, n).
        second: Second input, shape (T, n); not read if there is only one.
        third: Third input, shape (T, n); not read if there are only two.
        result: Output, shape (T, size of the result).
        work: Workspace, shape (>= work_size,).
        words: Workspace, shape (8,).
    """
    words[0], words[1], words[2] = first.ctypes.data, second.ctypes.data, third.ctypes.data
    words[3] = words[4] = words[5] = first.shape[1]
    words[6], words[7] = result.ctypes.data, result.shape[1]
    here = words.ctypes.data
    call_batch(address, here, here + 24, here + 48, here + 56, first.shape[0], work.ctypes.data)


@compiled("void(float64[:, ::1], float64[:, ::1], float64[:, ::1])", lean=True)
def matrix_product(left: Array, right: Array, result: Array) -> None:
    """Write left @ right without BLAS, which may start threads and wait for a processor.

    Args:
        left: Left factor, shape (T, m).
        right: Right factor, shape (m, k).
        result: Output, shape (T, k).
    """
    for t in range(left.shape[0]):
        for k in range(right.shape[1]):
            result[t, k] = 0.0
        for i in range(left.shape[1]):
            for k in range(right.shape[1]):
                result[t, k] += left[t, i] * right[i, k]


@compiled("void(float64[:, ::1], float64, int64, float64[:, ::1])", lean=True)
def linear_speed_share(velocity: Array, limit: float, column: int, shares: Array) -> None:
    """Write the ratio of a frame's linear speed to its limit into a column.

    Args:
        velocity: Spatial velocities, linear part first, shape (T, 6) [m/s and rad/s].
        limit: Maximum speed [m/s].
        column: Column of `shares`.
        shares: Output, shape (T, f).
    """
    for t in range(velocity.shape[0]):
        x, y, z = velocity[t, 0], velocity[t, 1], velocity[t, 2]
        shares[t, column] = np.sqrt(x * x + y * y + z * z) / limit
