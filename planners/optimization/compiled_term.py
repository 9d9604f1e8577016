"""Terms as C functions, which the compiled search calls by address."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_four, floats_at
from pepper_kin.kernels.signatures import Floats1, Floats3

from ..vectors import FloatArray
from .rows import BarrierBound, Rows, Term

VALUES, ROWS, START, TIGHTEN = range(4)
"""Requests to a term: values; values and derivatives; lower its floors below a motion that violates it; raise
the floors again where a motion keeps the term."""
KINDS = 4
FAILED = 1
"""Return value of a term that could not be evaluated."""
RAISED = 2
"""Return value to TIGHTEN if floors rose so far that a search that would end should go on."""

_Signature = ctypes.CFUNCTYPE(
    ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
)


class CompiledTerm:
    """A term that is machine code.

    At the address is a C function

        int64_t term(const double *states, double *result, int64_t what, void *memory)

    `what` is 4 K + VALUES, ROWS, START or TIGHTEN for K samples.  `states` holds the samples' positions,
    velocities and accelerations, shape (3, K, n).  The result holds the values, shape (K, R), and, for ROWS,
    their derivatives by positions, shape (K, R, n), followed by the derivatives by velocities and
    accelerations if the term depends on them.  START and TIGHTEN write to the memory only.  The function
    returns 0, FAILED, or, to TIGHTEN, RAISED.

    Attributes:
        address: Address of the function.
        memory: Memory of the function, an array of any type.
        rows_count: Number R of values per sample.
        parts: 1 if values depend on positions only, else 3.
        per_interval: Number of samples in each interval of the spline.
        barrier_bound: Allowed range of the values.
        has_floors: Whether the term handles START and TIGHTEN.
    """

    def __init__(
        self, address: int, memory: NDArray[Any], rows_count: int, parts: int, per_interval: int,
        barrier_bound: BarrierBound, *, has_floors: bool = False, keep_alive: object = None,
    ) -> None:  # fmt: skip
        self.address, self.memory, self.rows_count, self.parts = address, memory, rows_count, parts
        self.per_interval, self.barrier_bound, self.has_floors = per_interval, barrier_bound, has_floors
        self._keep_alive = keep_alive

    def values(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the values, shape (K, R), at positions, velocities and accelerations, shape (K, n)."""
        return self._ask(VALUES, q, v, a)[: q.shape[0] * self.rows_count].reshape(-1, self.rows_count)

    def rows(self, q: FloatArray, v: FloatArray, a: FloatArray) -> Rows:
        """Return the values and their derivatives."""
        size, n = q.shape[0] * self.rows_count, q.shape[1]
        numbers = self._ask(ROWS, q, v, a)
        slopes = numbers[size:].reshape(self.parts, -1, self.rows_count, n)
        return Rows(numbers[:size].reshape(-1, self.rows_count), *slopes)

    def start_from(self, q: FloatArray) -> None:
        """Lower the floors below a motion, given by its positions at the samples, shape (K, n)."""
        self._ask(START, q, 0 * q, 0 * q)

    def tighten(self, q: FloatArray) -> None:
        """Raise the floors where a motion, shape (K, n), keeps the term better; it stays above the floors."""
        self._ask(TIGHTEN, q, 0 * q, 0 * q)

    def reserve(self, count: int) -> None:
        """Allocate memory for a number of samples; terms that need none do nothing."""

    def _ask(self, what: int, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        self.reserve(len(q))
        states = np.stack([q, v, a]).astype(float)
        size = q.shape[0] * self.rows_count * (1 + self.parts * q.shape[1])
        result = np.zeros(max(size, 1))
        ask(self.address, states, result, what, self.memory.ctypes.data)
        return result[:size]


@compiled("int64(int64, float64[:, :, ::1], float64[::1], int64, int64)", lean=True)
def ask(address: int, states: Floats3, result: Floats1, what: int, memory: int) -> int:
    """Call a term with a request; return 0, FAILED or RAISED, see `CompiledTerm`."""
    asked = KINDS * states.shape[1] + what
    return call_four(address, states.ctypes.data, result.ctypes.data, asked, memory)


class CalledBack:
    """A term in Python behind the address of a C function.

    An exception cannot pass through machine code: the search ends with FAILED, and `check` raises the
    exception.

    Args:
        term: The term.
        n: Number of coordinates.
        states: Some states at which the term is evaluated to find its dependences, shape (3, K, n).

    Attributes:
        compiled: The C function.
    """

    def __init__(self, term: Term, n: int, states: FloatArray) -> None:
        self._term, self._n = term, n
        self._error: BaseException | None = None
        rows = term.rows(*states)
        self._count = rows.value.shape[1]
        self._parts = 1 if rows.by_velocity is None and rows.by_acceleration is None else 3
        function = _Signature(self._answer)
        address = ctypes.cast(function, ctypes.c_void_p).value or 0
        self.compiled = CompiledTerm(
            address, np.zeros(1), self._count, self._parts, term.per_interval, term.barrier_bound,
            has_floors=hasattr(term, "tighten"), keep_alive=function,
        )  # fmt: skip

    def check(self) -> None:
        """Raise the exception that the term raised, if any."""
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _answer(self, states: int, result: int, asked: int, memory: int) -> int:
        """Call the term back from machine code; return 0, FAILED or RAISED."""
        if self._error is not None:
            return FAILED
        try:
            what, count = asked % KINDS, asked // KINDS
            q, v, a = floats_at(states, 3 * count * self._n).reshape(3, count, self._n)
            if what in (START, TIGHTEN):
                term: Any = self._term
                (term.start_from if what == START else term.tighten)(q)
                return 0
            size = count * self._count
            if what == VALUES:
                floats_at(result, size)[:] = self._term.values(q, v, a).ravel()
                return 0
            rows = self._term.rows(q, v, a)
            numbers = floats_at(result, size * (1 + self._parts * self._n))
            numbers[:size] = rows.value.ravel()
            slopes = (rows.by_position, rows.by_velocity, rows.by_acceleration)
            for part, slope in zip(numbers[size:].reshape(self._parts, -1), slopes, strict=False):
                part[:] = 0.0 if slope is None else np.ravel(slope)
            return 0
        except BaseException as error:  # also an interrupt from the keyboard
            self._error = error
            return FAILED
