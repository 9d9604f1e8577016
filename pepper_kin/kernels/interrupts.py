"""Signals, such as Ctrl-C, during long calls of machine code.

Python runs the handlers of signals between its own instructions, so not while machine code runs.  Machine
code that may take long calls `interrupted` several times a second; after its return `raise_interrupt` raises
the handler's exception.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from pepper_kin.kernels.compiled_function import INTERPRETED, compiled
from pepper_kin.kernels.intrinsics import _emit_call, call_kernel, intrinsic
from pepper_kin.kernels.signatures import Ints1

PULSE = 0.1
"""Time between two checks [s]."""

ENSURE, RELEASE, CHECK, FETCH, STOPPED, RAISED = 0, 1, 2, 3, 4, 5
"""Indices into a table: addresses of the interpreter's functions, stop flag, and exception (3 words)."""

_NAMES = ("PyGILState_Ensure", "PyGILState_Release", "PyErr_CheckSignals", "PyErr_Fetch")


def _nothing(*_: Any) -> int:
    """Return 0: interpreted code needs no check, since Python handles signals itself."""
    return 0


_CALL = ctypes.CFUNCTYPE(ctypes.c_int64)


@intrinsic(_emit_call("int64"))
def call_back(address: int) -> int:
    """Call `int64 f()` at an address, such as `address` of a `pepper_kin.kernels.callback.Callback`."""
    return int(_CALL(address)())


_ask = intrinsic(_emit_call("int32"))(_nothing)
_tell = intrinsic(_emit_call(None, "int32"))(_nothing)


def interrupt_table() -> Ints1:
    """Return a new table for `interrupted`, shape (8,); concurrent calls need a table each."""
    table = np.zeros(8, np.int64)
    if not INTERPRETED:
        for place, name in enumerate(_NAMES):
            table[place] = ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0
    return table


@compiled
def interrupted(table: Ints1) -> bool:
    """Return whether a signal's handler has raised; the table, shape (8,), keeps exception and stop flag."""
    if table[ENSURE] == 0:
        return False
    state = _ask(table[ENSURE])
    raised = _ask(table[CHECK]) != 0
    if raised:
        place = table.ctypes.data + 8 * RAISED
        call_kernel(table[FETCH], place, place + 8, place + 16)
        table[STOPPED] = 1
    _tell(table[RELEASE], state)
    return raised


def raise_interrupt(table: Ints1) -> None:
    """Raise the exception that a table, shape (8,), keeps, if any, and clear the table for the next call."""
    table[STOPPED] = 0
    if table[RAISED]:
        kept = [ctypes.c_void_p(int(word)) for word in table[RAISED:]]
        table[RAISED:] = 0
        ctypes.pythonapi.PyErr_Restore(
            *kept
        )  # ctypes raises an exception that is set when a `pythonapi` function returns
