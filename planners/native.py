"""What compiled planners are made of: the call of an oracle by its address, the clock, and random numbers."""

from __future__ import annotations

import ctypes
import time
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

_WORD = 2**64 - 1
_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)


def _call_by_address(
    typing_context: Any, address: Any, first: Any, second: Any, steps: Any, memory: Any
) -> Any:
    """Call `int64 f(const double*, const double*, int64, double*)` at an address; all are integers.

    An address that is an argument, unlike a ctypes function that is a global, lets the caller be cached.
    """
    signature = types.int64(types.intp, types.intp, types.intp, types.int64, types.intp)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        kind = ir.FunctionType(word, [word, word, word, word])
        return builder.call(builder.inttoptr(arguments[0], ir.PointerType(kind)), arguments[1:])

    return signature, generate


def _read_clock_by_address(typing_context: Any, address: Any, clock: Any, place: Any) -> Any:
    """Call `int clock_gettime(clockid_t, struct timespec*)` at an address."""
    signature = types.int32(types.intp, types.int32, types.intp)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), [ir.IntType(32), ir.IntType(64)])
        return builder.call(builder.inttoptr(arguments[0], ir.PointerType(kind)), arguments[1:])

    return signature, generate


call_valid_prefix: Any = intrinsic(_call_by_address)
call_clock_gettime: Any = intrinsic(_read_clock_by_address)

_clock_gettime = ctypes.CDLL(None).clock_gettime
CLOCK: int = ctypes.cast(_clock_gettime, ctypes.c_void_p).value or 0
"""Address of the C library's `clock_gettime`."""

_MONOTONIC = int(time.CLOCK_MONOTONIC)


@njit(nogil=True, cache=True, error_model="numpy")
def seconds_now(clock: int, place: np.ndarray) -> float:
    """Return the time of the monotonic clock [s]; `place` is room for two int64."""
    call_clock_gettime(clock, _MONOTONIC, place.ctypes.data)
    return place[0] + 1e-9 * place[1]


@njit(nogil=True, cache=True, error_model="numpy")
def uniform(key: np.uint64, number: int) -> float:
    """Return the random number in [0, 1) of a place in the stream of a key.

    Source: G. L. Steele, D. Lea and C. H. Flood, Fast splittable pseudorandom number generators, OOPSLA 2014
    (SplitMix64), whose state is a counter: any number of the stream can be had without those before it.
    """
    z = key + np.uint64(number + 1) * _GAMMA
    z = (z ^ (z >> np.uint64(30))) * _FIRST
    z = (z ^ (z >> np.uint64(27))) * _SECOND
    z = z ^ (z >> np.uint64(31))
    return np.int64(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


def stream_key(seed: int, stream: int) -> np.uint64:
    """Return the key of one of several streams of a seed, so that neighbouring seeds share no numbers."""
    value = _mixed(stream + 1)
    while True:  # a seed may have any number of 64-bit words
        value = _mixed(value + (seed & _WORD))
        seed >>= 64
        if not seed:
            return np.uint64(value)


def _mixed(value: int) -> int:
    """Spread every bit of a number over all 64 bits of another."""
    value = (value + int(_GAMMA)) & _WORD
    value = (value ^ (value >> 30)) * int(_FIRST) & _WORD
    value = (value ^ (value >> 27)) * int(_SECOND) & _WORD
    return value ^ (value >> 31)
