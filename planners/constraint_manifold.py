"""States that meet constraints F(x) = 0, each to a tolerance, and projection onto them."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_kernel, floats_at
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Ints1

from .search_space import distance
from .vectors import BoolArray, FloatArray, finite_points, read_only, whole_number

ConstraintFunction = Callable[[FloatArray], tuple[ArrayLike, ArrayLike]]
"""Function of states, shape (m, n), that returns F, shape (m, r), and the Jacobians, shape (m, r, n)."""

_Signature = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)


INNER = 0.5
"""Fraction of a tolerance that projected states keep, so that edges between them keep the tolerance."""

BETWEEN = 0.9
"""Fraction of a tolerance that the middle of an edge keeps."""

MOST_ITERATIONS = 30
_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e3
_MOST = 10_000  # maximum number of coordinates, or of residuals
_HALVINGS = 10  # maximum number of halvings of a step
_STEP = 0.9  # length of a straight step relative to the resolution
_PROGRESS = 0.05  # minimum progress relative to a step


class BoxedManifold(NamedTuple):
    """A manifold within a box, and scratch space of one thread.

    Attributes:
        address: Address of the residual function.
        kernel_input: Input of the residual function.
        out: Output of the residual function: residuals, then the Jacobian.
        work: Scratch space of the residual function.
        places: Index of each coordinate in the input, shape (n,).
        columns: Column of each coordinate in the Jacobian, shape (n,).
        groups: Constraint of each residual, shape (r,).
        tolerances: Tolerances of the constraints, in the units of F, shape (g,).
        lower: Lower bounds of the box, shape (n,).
        upper: Upper bounds of the box, shape (n,).
        weights: Weights of the metric, shape (n,).
        norms: Memory for the error of each constraint, shape (g,).
        held: Memory for whether a constraint takes part in the projection, shape (g,).
        slopes: Memory for the rows of the linear system, shape (r, n).
        gram: Memory for the matrix of the normal equations, shape (r, r).
        right: Memory for the right-hand side, shape (2, r).
        rows: Memory for states, shape (6, n).
        stop: Flag, shape (1,); not zero once a Python function has failed.
        width: Number of columns of the Jacobian.
    """

    address: int
    kernel_input: Floats1
    out: Floats1
    work: Floats1
    places: Ints1
    columns: Ints1
    groups: Ints1
    tolerances: Floats1
    lower: Floats1
    upper: Floats1
    weights: Floats1
    norms: Floats1
    held: Ints1
    slopes: Floats2
    gram: Floats2
    right: Floats2
    rows: Floats2
    stop: Ints1
    width: int


@dataclass(frozen=True, eq=False)
class CompiledManifold:
    """A residual function in machine code.

    At its address is a C function

        void residual(const double *in, double *out, double *work)

    that writes the r residuals and then their Jacobian, row by row, r x `width` numbers, to `out`.  Several
    threads may call it at once, each with its own arrays.

    Attributes:
        address: Address of the function.
        kernel_input: Content of `in`, shape (k,); the state's coordinates are written into it.
        places: Index of each of the n coordinates in `kernel_input`, shape (n,).
        columns: Column of each coordinate in the Jacobian, shape (n,).
        width: Number of columns of the Jacobian.
        work_size: Length of `work`, in numbers.
        keep_alive: Object that must live as long as the address is used.
        size: Number of values that the function writes, 0 if unknown: callers make sure that they fit.
    """

    address: int
    kernel_input: FloatArray
    places: np.ndarray
    columns: np.ndarray
    width: int
    work_size: int = 1
    keep_alive: object = field(default=None, repr=False)
    size: int = 0


@dataclass(frozen=True, eq=False)
class ConstraintManifold:
    """The states x of n coordinates at which all constraints hold: |F_g(x)| <= tolerance_g.

    The r components of F are grouped into constraints; |F_g| is the Euclidean norm of constraint g's.
    A small tolerance makes it an equation, a large one an inequality: "within ten degrees of upright".

    Attributes:
        function: F and its Jacobian: a callable (see `ConstraintFunction`), or machine code
            (`CompiledManifold`).
        n: Number of coordinates of a state.
        rows: Number r of residuals.
        tolerances: Tolerance of each constraint, in the units of F, shape (g,); one number applies to all.
        groups: Constraint to which each residual belongs, 0 .. g - 1, shape (r,).  If omitted, all residuals
            are one constraint.
        names: Names of the constraints, for messages; "constraint 0" and so on if omitted.
    """

    function: ConstraintFunction | CompiledManifold
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
            whole_number(quantity, getattr(self, quantity), 1, _MOST)
        if not callable(self.function) and not isinstance(self.function, CompiledManifold):
            raise InvalidValueError("function", self.function, "a callable or a CompiledManifold")
        groups = self._checked_groups()
        count = int(groups.max()) + 1
        tolerances = self._checked_tolerances(count)
        names = tuple(f"constraint {g}" for g in range(count)) if self.names is None else tuple(self.names)
        if len(names) != count:
            raise InvalidValueError("names", names, f"{count} names")
        object.__setattr__(self, "groups", groups)
        object.__setattr__(self, "tolerances", read_only(tolerances))
        object.__setattr__(self, "names", names)

    def _checked_groups(self) -> np.ndarray:
        """Return the constraint of each residual, shape (r,)."""
        if self.groups is None:
            return np.zeros(self.rows, dtype=np.int64)
        allowed = f"{self.rows} numbers of constraints, 0, 1, ... without a gap"
        try:
            groups = np.array(self.groups)
        except ValueError:  # ragged rows
            raise InvalidValueError("groups", self.groups, allowed) from None
        if groups.dtype.kind not in "iu" or groups.shape != (self.rows,):
            raise InvalidValueError("groups", self.groups, allowed)
        if set(groups.tolist()) != set(range(int(groups.max()) + 1)):
            raise InvalidValueError("groups", self.groups, allowed)
        return groups.astype(np.int64)

    def _checked_tolerances(self, count: int) -> FloatArray:
        """Return the tolerance of each constraint, shape (count,)."""
        allowed = f"a finite number above 0, or {count} of them"
        try:
            plain = np.asarray(self.tolerances)
            if plain.dtype.kind not in "fiu":
                raise TypeError(plain.dtype)
            tolerances = np.array(np.broadcast_to(plain.astype(float), (count,)))
        except (TypeError, ValueError):
            raise InvalidValueError("tolerances", self.tolerances, allowed) from None
        if not (np.isfinite(tolerances) & (tolerances > 0)).all():
            raise InvalidValueError("tolerances", self.tolerances, allowed)
        return tolerances

    def errors(self, states: ArrayLike) -> FloatArray:
        """Return |F_g| of each constraint at some states.

        Args:
            states: States, shape (m, n).

        Returns:
            Errors, shape (m, g), in the units of F.

        Raises:
            InvalidValueError: The states or the results of F have the wrong shape.
        """
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
    """Manifold for machine code, as a `with` block; exceptions of a Python function are raised at its end."""

    def __init__(
        self, manifold: ConstraintManifold, lower: FloatArray, upper: FloatArray, weights: FloatArray
    ) -> None:
        """Prepare a manifold for one thread.

        Args:
            manifold: The manifold.
            lower: Lower bounds within which states are moved, shape (n,).
            upper: Upper bounds, shape (n,).
            weights: Weights of the metric in which states are moved as little as possible, shape (n,).
        """
        self._manifold, self._box = manifold, (lower, upper, weights)
        self._error: BaseException | None = None
        self._stop = np.zeros(1, dtype=np.int64)

    def __enter__(self) -> BoxedManifold:
        """Return the manifold for machine code."""
        code = self._manifold.function
        if not isinstance(code, CompiledManifold):
            n = self._manifold.n
            self._c_function = _Signature(self._answer)
            address = ctypes.cast(self._c_function, ctypes.c_void_p).value or 0
            order = np.arange(n, dtype=np.int64)
            code = CompiledManifold(address, np.zeros(n), order, order, n)
        return _surface_of(self._manifold, code, *self._box, self._stop)

    def __exit__(self, *_: object) -> None:
        """Raise the exception that the function raised."""
        if self._error is not None:
            raise self._error

    def _answer(self, kernel_input: int, out: int, work: int) -> None:
        """Call the Python function back from machine code; NaN is written after an exception."""
        n, rows = self._manifold.n, self._manifold.rows
        answer = floats_at(out, rows * (1 + n))
        answer[:] = np.nan
        if self._error is not None:
            return
        try:
            state = floats_at(kernel_input, n).copy()
            residual, jacobian = self._manifold.function(state[None])  # type: ignore[operator]
            values, slopes = np.asarray(residual, dtype=float), np.asarray(jacobian, dtype=float)
            if values.shape != (1, rows) or slopes.shape != (1, rows, n):
                got = f"shapes {values.shape} and {slopes.shape} for 1 state"
                raise InvalidValueError("answer of the manifold", got, f"(1, {rows}) and (1, {rows}, {n})")
            answer[:rows], answer[rows:] = values[0], slopes.ravel()
        except BaseException as error:  # also an interrupt from the keyboard
            self._error = error
            self._stop[0] = 1


TRIAL, STEP, FIXED, CURRENT, MIDDLE, AIM = 0, 1, 2, 3, 4, 5  # indices into `BoxedManifold.rows`


def _surface_of(
    manifold: ConstraintManifold,
    code: CompiledManifold,
    lower: FloatArray,
    upper: FloatArray,
    weights: FloatArray,
    stop: np.ndarray,
) -> BoxedManifold:
    """Return a manifold for machine code, with new scratch arrays.

    Args:
        manifold: The manifold, of r rows over n coordinates.
        code: Its kernel.
        lower: Lower bounds of the box, shape (n,).
        upper: Upper bounds, shape (n,).
        weights: Weights of the metric, shape (n,).
        stop: Flag that is set to stop, shape (1,).

    Raises:
        InvalidValueError: if the kernel writes more numbers than the rows hold.
    """
    n, r, tolerances = manifold.n, manifold.rows, np.array(manifold.tolerances)
    g = tolerances.size
    if code.size > r * (1 + code.width):
        size = f"{r} rows of 1 + {code.width} numbers"
        raise InvalidValueError("output buffer of a manifold", size, f"space for {code.size} numbers")
    return BoxedManifold(
        int(code.address),
        np.array(code.kernel_input, dtype=np.float64),
        np.zeros(r * (1 + code.width)),
        np.zeros(max(1, code.work_size)),
        np.array(code.places, dtype=np.int64),
        np.array(code.columns, dtype=np.int64),
        np.array(manifold.groups, dtype=np.int64),
        tolerances,
        np.array(lower, dtype=np.float64),
        np.array(upper, dtype=np.float64),
        np.array(weights, dtype=np.float64),
        np.zeros(g),
        np.zeros(g, dtype=np.int64),
        np.zeros((r, n)),
        np.zeros((r, r)),
        np.zeros((2, r)),
        np.zeros((6, n)),
        stop,
        int(code.width),
    )


def no_surface(lower: FloatArray, upper: FloatArray, weights: FloatArray) -> BoxedManifold:
    """Return a manifold without constraints that contains all states; its function is never called."""
    n, none, ints = lower.size, np.zeros(0), np.zeros(0, dtype=np.int64)
    return BoxedManifold(
        0, none, none, none, ints, ints, ints, none, lower.copy(), upper.copy(), weights.copy(), none, ints,
        np.zeros((0, n)), np.zeros((0, 0)), np.zeros((2, 0)), np.zeros((6, n)),
        np.zeros(1, dtype=np.int64), 0,
    )  # fmt: skip


@compiled
def evaluate(surface: BoxedManifold, state: FloatArray) -> float:
    """Evaluate F and its Jacobian at a state; return the largest error relative to its tolerance."""
    for i in range(state.size):
        surface.kernel_input[surface.places[i]] = state[i]
    call_kernel(
        surface.address, surface.kernel_input.ctypes.data, surface.out.ctypes.data, surface.work.ctypes.data
    )
    for g in range(surface.norms.size):
        surface.norms[g] = 0.0
    for k in range(surface.groups.size):
        surface.norms[surface.groups[k]] += surface.out[k] * surface.out[k]
    worst = 0.0
    for g in range(surface.norms.size):
        surface.norms[g] = math.sqrt(surface.norms[g])
        ratio = surface.norms[g] / surface.tolerances[g]
        if not ratio <= worst:
            worst = ratio
        if math.isnan(ratio):
            return math.inf
    return worst


@compiled
def _violation(surface: BoxedManifold, inner: float) -> float:
    """Return the sum of squares of the errors' excess over a fraction of their tolerances."""
    total = 0.0
    for g in range(surface.norms.size):
        beyond = surface.norms[g] / surface.tolerances[g] - inner
        if beyond > 0.0:
            total += beyond * beyond
    return total


@compiled
def _linearize(surface: BoxedManifold, aim: float) -> int:
    """Write the residuals to be removed and their scaled Jacobian; return their number.

    For a constraint with error |r| above the fraction rho of its tolerance, r (1 - rho / |r|) is to be
    removed, so that a wide tolerance is just met.  A constraint that has taken part once stays held.
    """
    count, n = 0, surface.weights.size
    for k in range(surface.groups.size):
        g = surface.groups[k]
        rho = aim * surface.tolerances[g]
        outside = surface.norms[g] > rho
        if outside:
            surface.held[g] = 1
        if surface.held[g] == 0:
            continue
        surface.right[0, count] = surface.out[k] * (1.0 - rho / surface.norms[g]) if outside else 0.0
        first = surface.groups.size + k * surface.width
        for i in range(n):
            surface.slopes[count, i] = surface.out[first + surface.columns[i]] / surface.weights[i]
        count += 1
    return count


@compiled
def _least_step(surface: BoxedManifold, count: int, damping: float) -> None:
    """Write the smallest step of the coordinates that are not fixed that removes the residuals.

    step = -W^-1 A^T (A A^T + damping diag(A A^T))^-1 e with A = J W^-1, by Cholesky's factorization.
    """
    gram, right, slopes, n = surface.gram, surface.right, surface.slopes, surface.weights.size
    for a in range(count):
        for b in range(a + 1):
            total = 0.0
            for i in range(n):
                if surface.rows[FIXED, i] == 0.0:
                    total += slopes[a, i] * slopes[b, i]
            gram[a, b] = total
        gram[a, a] += damping * gram[a, a] + 1e-24
    for a in range(count):
        value = right[0, a]
        for b in range(a):
            total = gram[a, b]
            for c in range(b):
                total -= gram[a, c] * gram[b, c]
            gram[a, b] = total / gram[b, b]
            value -= gram[a, b] * right[1, b]
        pivot = gram[a, a]
        for c in range(a):
            pivot -= gram[a, c] * gram[a, c]
        gram[a, a] = math.sqrt(max(pivot, 1e-12 * gram[a, a] + 1e-24))
        right[1, a] = value / gram[a, a]
    for a in range(count - 1, -1, -1):
        for b in range(a + 1, count):
            right[1, a] -= gram[b, a] * right[1, b]
        right[1, a] /= gram[a, a]
    for i in range(n):
        total = 0.0
        for a in range(count):
            total += slopes[a, i] * right[1, a]
        surface.rows[STEP, i] = 0.0 if surface.rows[FIXED, i] != 0.0 else -total / surface.weights[i]


@compiled
def _step_in_box(surface: BoxedManifold, state: FloatArray, count: int, damping: float) -> None:
    """Write the step and the next state; coordinates that would leave the box stay."""
    n = state.size
    for i in range(n):
        surface.rows[FIXED, i] = 0.0
    for _ in range(n):
        _least_step(surface, count, damping)
        changed = False
        for i in range(n):
            step = surface.rows[STEP, i]
            at_low, at_high = state[i] <= surface.lower[i], state[i] >= surface.upper[i]
            if (at_low and step < 0.0) or (at_high and step > 0.0):
                surface.rows[FIXED, i], changed = 1.0, True
        if not changed:
            break
    for i in range(n):
        moved = state[i] + surface.rows[STEP, i]
        surface.rows[TRIAL, i] = min(max(moved, surface.lower[i]), surface.upper[i])


@compiled
def project(surface: BoxedManifold, state: FloatArray, inner: float) -> bool:
    """Move a state onto the manifold, in place, by damped Gauss-Newton steps within the box.

    The damping grows where a step does not help (Levenberg, 1944; Marquardt, 1963).

    Args:
        surface: The manifold.
        state: State inside the box, shape (n,).
        inner: Fraction of the tolerances that the moved state keeps.

    Returns:
        Whether the state is on the manifold.
    """
    damping, ratio = _LEAST_DAMPING, evaluate(surface, state)
    for g in range(surface.held.size):
        surface.held[g] = 0
    violation = _violation(surface, inner)
    for _ in range(MOST_ITERATIONS):
        if ratio <= inner:
            return True
        if math.isinf(ratio):
            return False
        count = _linearize(surface, 0.8 * inner)
        while True:
            _step_in_box(surface, state, count, damping)
            ratio = evaluate(surface, surface.rows[TRIAL])
            if surface.stop[0] != 0:
                return False
            better = _violation(surface, inner)
            if ratio <= inner or (better < violation and not math.isinf(ratio)):
                break
            damping = max(1e-3, 10.0 * damping)
            if damping > _MOST_DAMPING:
                return False
        damping = max(_LEAST_DAMPING, 0.1 * damping)
        violation = better
        for i in range(state.size):
            state[i] = surface.rows[TRIAL, i]
    return ratio <= inner


@compiled
def edge_holds(surface: BoxedManifold, a: FloatArray, b: FloatArray) -> bool:
    """Return whether the middle of an edge, where it is furthest from the manifold, meets the constraints."""
    for i in range(a.size):
        surface.rows[MIDDLE, i] = 0.5 * (a[i] + b[i])
    return evaluate(surface, surface.rows[MIDDLE]) <= BETWEEN


@compiled
def _next(
    surface: BoxedManifold, current: FloatArray, target: FloatArray, length: float, longest: float
) -> float:
    """Write the next state on the way to a target to rows[AIM]; return its distance to the target, or -1."""
    step = min(_STEP * longest, length)
    for _ in range(_HALVINGS):
        for i in range(current.size):
            surface.rows[AIM, i] = current[i] + (target[i] - current[i]) * (step / length)
        if project(surface, surface.rows[AIM], INNER):
            for i in range(current.size):
                surface.rows[MIDDLE, i] = current[i] + (target[i] - current[i]) * (step / length)
            aside = distance(surface.rows[MIDDLE], surface.rows[AIM], surface.weights)
            moved = distance(current, surface.rows[AIM], surface.weights)
            left = distance(surface.rows[AIM], target, surface.weights)
            if aside <= step and left > length - _PROGRESS * step:
                return -1.0
            if aside <= step and moved <= longest and edge_holds(surface, current, surface.rows[AIM]):
                return left
        if surface.stop[0] != 0:
            return -1.0
        step *= 0.5
    return -1.0


@compiled("int64(BoxedManifold, float64[::1], float64[::1], float64, boolean, float64[:, ::1])")
def extend(
    surface: BoxedManifold,
    origin: FloatArray,
    target: FloatArray,
    resolution: float,
    exact: bool,
    chain: FloatArray,
) -> int:
    """Walk along the manifold towards a target: short straight steps, each moved back onto the manifold.

    The walk ends where no step leads nearer.  Source: D. Berenson, S. Srinivasa, D. Ferguson and J. Kuffner,
    Manipulation planning on constraint manifolds, ICRA 2009 (CBiRRT).

    Args:
        surface: The manifold.
        origin: A state on the manifold, shape (n,).
        target: Any state, shape (n,).
        resolution: Maximum step [length unit of the metric].
        exact: Whether the target is on the manifold and is to be met.
        chain: The states after `origin`, written, shape (m, n).

    Returns:
        Number c of states written; -c - 1 if the walk ends with them, short of the target.  The last state
        is the target if it was reached.
    """
    n = origin.size
    for i in range(n):
        surface.rows[CURRENT, i] = origin[i]
    current = surface.rows[CURRENT]
    length = distance(current, target, surface.weights)
    for count in range(chain.shape[0]):
        if length <= resolution and exact and edge_holds(surface, current, target):
            for i in range(n):
                chain[count, i] = target[i]
            return count + 1
        if length <= 1e-6 * resolution:
            return -count - 1
        length = _next(surface, current, target, length, resolution)
        if length < 0.0:
            return -count - 1
        for i in range(n):
            current[i] = surface.rows[AIM, i]
            chain[count, i] = current[i]
    return chain.shape[0]


@compiled("void(BoxedManifold, float64[:, ::1], float64[:, ::1])")
def measure_rows(surface: BoxedManifold, states: FloatArray, errors: FloatArray) -> None:
    """Write the error of each constraint, shape (m, g), at states of shape (m, n)."""
    for j in range(states.shape[0]):
        evaluate(surface, states[j])
        for g in range(surface.norms.size):
            error = surface.norms[g]
            errors[j, g] = math.inf if math.isnan(error) else error


@compiled("void(BoxedManifold, float64[:, ::1], float64, boolean[::1])")
def project_rows(surface: BoxedManifold, states: FloatArray, inner: float, done: Flags1) -> None:
    """Move states, shape (m, n), onto the manifold in place; write which are on it, shape (m,)."""
    for j in range(states.shape[0]):
        done[j] = surface.stop[0] == 0 and project(surface, states[j], inner)


@compiled("boolean(BoxedManifold, float64[:, ::1])")
def edges_hold(surface: BoxedManifold, points: FloatArray) -> bool:
    """Return whether all edges of a polyline, shape (k, n), meet the constraints in their middles."""
    k = 0
    while k < points.shape[0] - 1 and edge_holds(surface, points[k], points[k + 1]):
        k += 1
    return k == points.shape[0] - 1
