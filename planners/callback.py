"""A Python oracle behind the address of a C function, so that a compiled planner can ask it."""

from __future__ import annotations

import ctypes
from types import TracebackType

import numpy as np

from .compiled_validity import CompiledValidity
from .deadline import Deadline
from .native_world import STOP
from .oracle import Oracle
from .problem import Problem
from .vectors import FloatArray

_Signature = ctypes.CFUNCTYPE(
    ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
)


class Callback:
    """Answers a compiled planner's questions by an `Oracle`, and keeps what it raises.

    An exception cannot pass through machine code: from then on every state is invalid, the planner is told to
    stop, and the exception is raised when the ``with`` block around the planner ends.

    Attributes:
        compiled: The validity function that asks the oracle.
    """

    def __init__(self, oracle: Oracle, n: int, counters: np.ndarray | None = None) -> None:
        """Make the C function.

        Args:
            oracle: What is asked.
            n: Number of coordinates.
            counters: Of the planner; the third one is set once the oracle has raised something.
        """
        self._oracle, self._n = oracle, n
        self._counters = np.zeros(STOP + 1, dtype=np.int64) if counters is None else counters
        self._error: BaseException | None = None
        function = _Signature(self._answer)
        address = ctypes.cast(function, ctypes.c_void_p).value or 0
        self.compiled = CompiledValidity(address, n, keep_alive=function)

    def __enter__(self) -> CompiledValidity:
        """Return the validity function."""
        return self.compiled

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Raise what the oracle raised."""
        if self._error is not None:
            self._counters[STOP] = 0
            raise self._error

    def _answer(self, a: int, b: int, steps: int, memory: int) -> int:
        if self._error is not None:
            return 0
        try:
            return self._oracle.prefix(self._state(a), self._state(b), steps)
        except BaseException as error:  # also an interrupt from the keyboard
            self._error = error
            self._counters[STOP] = 1
            return 0

    def _state(self, address: int) -> FloatArray:
        return np.frombuffer(memoryview((ctypes.c_double * self._n).from_address(address)), np.float64)


class _MachineCode:
    """The same `with` block for an oracle that needs no callback."""

    def __init__(self, compiled: CompiledValidity) -> None:
        self._compiled = compiled

    def __enter__(self) -> CompiledValidity:
        return self._compiled

    def __exit__(self, *_: object) -> None:
        return None


def machine_code_of(
    problem: Problem,
    deadline: Deadline,
    resolution: float | None = None,
    counters: np.ndarray | None = None,
) -> Callback | _MachineCode:
    """Return a context whose value is the problem's oracle as a C function.

    Args:
        problem: The problem.
        deadline: Time budget of a Python oracle; what it has not checked in time counts as not valid.
        resolution: See `Problem.counting_oracle`.
        counters: See `Callback`.
    """
    if isinstance(problem.oracle, CompiledValidity):
        return _MachineCode(problem.oracle)
    return Callback(problem.counting_oracle(deadline, resolution), problem.n, counters)
