"""The clock of compiled code."""

from __future__ import annotations

import ctypes
import time

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_clock
from pepper_kin.kernels.signatures import Ints1

CLOCK: int = ctypes.cast(ctypes.CDLL(None).clock_gettime, ctypes.c_void_p).value or 0
"""Address of the C library's `clock_gettime`."""

_MONOTONIC = int(time.CLOCK_MONOTONIC)


@compiled(lean=True, inline=True)
def seconds_now(clock: int, place: Ints1) -> float:
    """Return the monotonic clock's time, as `time.perf_counter` does [s].

    Args:
        clock: `CLOCK`, passed as an argument because machine code that is stored must not hold an address.
        place: Workspace, shape (2,).
    """
    call_clock(clock, _MONOTONIC, place.ctypes.data)
    return place[0] + 1e-9 * place[1]
