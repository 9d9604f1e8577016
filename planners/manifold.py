"""States that meet constraints F(x) = 0, each to a tolerance."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError

from .vectors import BoolArray, FloatArray, finite_points, read_only, whole_number

if TYPE_CHECKING:
    from .native_manifold import Surface

ConstraintFunction = Callable[[FloatArray], tuple[ArrayLike, ArrayLike]]
"""From states, shape (m, n), to residuals F, shape (m, r), and their Jacobians dF/dx, shape (m, r, n)."""

_Signature = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)


@dataclass(frozen=True, eq=False)
class MachineCodeManifold:
    """Where a residual function lies that is machine code.

    At the address is a C function

        void residual(const double *in, double *out, double *work)

    that writes the r residuals and then their Jacobian, row by row, r x `width` numbers, to `out`.  Several
    threads may call it at once, each with its own arrays.

    Attributes:
        address: Address of the function.
        given: What `in` holds, shape (k,); the state's coordinates are put into it.
        places: For each of the n coordinates its place in `given`, shape (n,).
        columns: For each coordinate its column of the Jacobian, shape (n,).
        width: Number of columns of the Jacobian.
        work_size: Room that `work` has, in numbers.
        keep_alive: What must live as long as the address is used.
    """

    address: int
    given: FloatArray
    places: np.ndarray
    columns: np.ndarray
    width: int
    work_size: int = 1
    keep_alive: object = field(default=None, repr=False)


@dataclass(frozen=True, eq=False)
class Manifold:
    """The states x of n coordinates at which all constraints hold: |F_g(x)| <= tolerance_g.

    The r components of F are sorted into constraints; |.| is the Euclidean length of those of one constraint.
    A small tolerance makes it an equation, a large one an inequality: "within ten degrees of upright".

    Attributes:
        function: F and its Jacobian: a callable (see `ConstraintFunction`), or machine code
            (`MachineCodeManifold`).
        n: Number of coordinates of a state.
        rows: Number r of residuals.
        tolerances: Tolerance of each constraint, shape (g,); one number serves for all.
        groups: For each residual the constraint it belongs to, 0 .. g - 1, shape (r,).  If omitted, all
            residuals are one constraint.
        names: Names of the constraints, for messages; "constraint 0" and so on if omitted.
    """

    function: ConstraintFunction | MachineCodeManifold
    n: int
    rows: int
    tolerances: FloatArray | float = 1e-6
    groups: np.ndarray | Sequence[int] | None = None
    names: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Check and copy the fields.

        Raises:
            InvalidValueError: A field has the wrong shape or a value that is not allowed.
        """
        for quantity in ("n", "rows"):
            if whole_number(quantity, getattr(self, quantity)) < 1:
                raise InvalidValueError(quantity, getattr(self, quantity), "1 or more")
        if not callable(self.function) and not isinstance(self.function, MachineCodeManifold):
            raise InvalidValueError("function", self.function, "a callable or a MachineCodeManifold")
        groups = np.zeros(self.rows, dtype=np.int64) if self.groups is None else np.array(self.groups)
        count = int(groups.max(initial=-1)) + 1
        if groups.shape != (self.rows,) or set(groups.tolist()) != set(range(count)):
            allowed = f"{self.rows} numbers of constraints, 0, 1, ... without a gap"
            raise InvalidValueError("groups", self.groups, allowed)
        tolerances = np.array(np.broadcast_to(np.asarray(self.tolerances, dtype=float), (count,)))
        if not (np.isfinite(tolerances) & (tolerances > 0)).all():
            raise InvalidValueError("tolerances", self.tolerances, "finite numbers above 0")
        names = tuple(f"constraint {g}" for g in range(count)) if self.names is None else tuple(self.names)
        if len(names) != count:
            raise InvalidValueError("names", names, f"{count} names")
        object.__setattr__(self, "groups", groups.astype(np.int64))
        object.__setattr__(self, "tolerances", read_only(tolerances))
        object.__setattr__(self, "names", names)

    def errors(self, states: ArrayLike) -> FloatArray:
        """Return |F_g| of each constraint at some states.

        Args:
            states: Shape (m, n).

        Returns:
            Shape (m, g), in the units of F.

        Raises:
            InvalidValueError: The states have the wrong shape, or F answers in one.
        """
        from .native_manifold import measure_rows

        rows = np.array(finite_points("states", states, self.n))
        wide = np.full(self.n, math.inf)
        found = np.empty((len(rows), self.tolerances.size))  # type: ignore[union-attr]
        with OnSurface(self, -wide, wide, np.ones(self.n)) as surface:
            measure_rows(surface, rows, found)
        return found

    def contains(self, states: ArrayLike) -> BoolArray:
        """Return which states, shape (m, n), meet all constraints; shape (m,)."""
        return np.asarray((self.errors(states) <= self.tolerances).all(axis=1))

    def worst(self, states: ArrayLike) -> float:
        """Return the largest error of some states, shape (m, n), as a multiple of its tolerance."""
        return float((self.errors(states) / self.tolerances).max())


class OnSurface:
    """Hands a manifold to machine code; what a Python function raises there comes out of the `with` block."""

    def __init__(self, manifold: Manifold, lower: FloatArray, upper: FloatArray, weights: FloatArray) -> None:
        """Make room for one thread.

        Args:
            manifold: The manifold.
            lower: Lower bounds within which states are moved, shape (n,).
            upper: Upper bounds, shape (n,).
            weights: Weights of the metric in which they are moved as little as possible, shape (n,).
        """
        self._manifold, self._box = manifold, (lower, upper, weights)
        self._error: BaseException | None = None
        self._stop = np.zeros(1, dtype=np.int64)

    def __enter__(self) -> Surface:
        """Return what machine code takes."""
        from .native_manifold import surface_of

        code = self._manifold.function
        if not isinstance(code, MachineCodeManifold):
            n = self._manifold.n
            self._c_function = _Signature(self._answer)
            address = ctypes.cast(self._c_function, ctypes.c_void_p).value or 0
            order = np.arange(n, dtype=np.int64)
            code = MachineCodeManifold(address, np.zeros(n), order, order, n)
        return surface_of(self._manifold, code, *self._box, self._stop)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Raise what the function raised."""
        if self._error is not None:
            raise self._error

    def _answer(self, given: int, out: int, work: int) -> None:
        n, rows = self._manifold.n, self._manifold.rows
        answer = _numbers_at(out, rows * (1 + n))
        answer[:] = np.nan
        if self._error is not None:
            return
        try:
            state = _numbers_at(given, n).copy()
            residual, jacobian = self._manifold.function(state[None])  # type: ignore[operator]
            values, slopes = np.asarray(residual, dtype=float), np.asarray(jacobian, dtype=float)
            if values.shape != (1, rows) or slopes.shape != (1, rows, n):
                got = f"shapes {values.shape} and {slopes.shape} for 1 state"
                raise InvalidValueError("answer of the manifold", got, f"(1, {rows}) and (1, {rows}, {n})")
            answer[:rows], answer[rows:] = values[0], slopes.ravel()
        except BaseException as error:  # also an interrupt from the keyboard
            self._error = error
            self._stop[0] = 1


def _numbers_at(address: int, count: int) -> FloatArray:
    return np.frombuffer(memoryview((ctypes.c_double * count).from_address(address)), np.float64)
