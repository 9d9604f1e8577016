"""Projection onto a manifold, and steps along it, in machine code.

After work on the files whose functions are inlined here, remove `__pycache__` (see `native_connect`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from .native_world import INDICES, MATRIX, VECTOR, distance
from .vectors import BoolArray, FloatArray

if TYPE_CHECKING:
    from .manifold import MachineCodeManifold, Manifold

INNER = 0.5
"""Of a tolerance: projected states are this near, so that the edges between them hold the tolerance."""

BETWEEN = 0.9
"""Of a tolerance: how near the middle of an edge is."""

MOST_ITERATIONS = 30
_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e3
_HALVINGS = 10
_STEP = 0.9  # of the resolution
_PROGRESS = 0.05  # of a step


def _call_residual(typing_context: Any, address: Any, given: Any, out: Any, work: Any) -> Any:
    """Call `void f(const double*, double*, double*)` at an address; all four are integers."""
    signature = types.void(types.intp, types.intp, types.intp, types.intp)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word, word, word])
        builder.call(builder.inttoptr(arguments[0], ir.PointerType(kind)), arguments[1:])
        return context.get_dummy_value()

    return signature, generate


call_residual: Any = intrinsic(_call_residual)


class Surface(NamedTuple):
    """A manifold within a box, and room for one thread.

    Attributes:
        address: Of the residual function.
        given: Its input.
        out: Its output: residuals, then the Jacobian.
        work: Its room.
        places: Places of the coordinates in the input, shape (n,).
        columns: Columns of the Jacobian, shape (n,).
        groups: Constraint of each residual, shape (r,).
        tolerances: Shape (g,).
        lower: Shape (n,).
        upper: Shape (n,).
        weights: Shape (n,).
        norms: Room: error of each constraint, shape (g,).
        held: Room: whether a constraint takes part in the projection, shape (g,).
        slopes: Room: rows of the linear system, shape (r, n).
        gram: Room, shape (r, r).
        right: Room, shape (2, r).
        rows: Room for states, shape (6, n).
        stop: One number; not zero once a function in Python has failed.
        width: Columns of the Jacobian.
    """

    address: int
    given: FloatArray
    out: FloatArray
    work: FloatArray
    places: np.ndarray
    columns: np.ndarray
    groups: np.ndarray
    tolerances: FloatArray
    lower: FloatArray
    upper: FloatArray
    weights: FloatArray
    norms: FloatArray
    held: np.ndarray
    slopes: FloatArray
    gram: FloatArray
    right: FloatArray
    rows: FloatArray
    stop: np.ndarray
    width: int


SURFACE = types.NamedTuple(
    (
        types.int64, VECTOR, VECTOR, VECTOR, INDICES, INDICES, INDICES, VECTOR, VECTOR, VECTOR, VECTOR,
        VECTOR, INDICES, MATRIX, MATRIX, MATRIX, MATRIX, INDICES, types.int64,
    ),
    Surface,
)  # fmt: skip

TRIAL, STEP, FIXED, CURRENT, MIDDLE, AIM = 0, 1, 2, 3, 4, 5  # rows


def surface_of(
    manifold: Manifold,
    code: MachineCodeManifold,
    lower: FloatArray,
    upper: FloatArray,
    weights: FloatArray,
    stop: np.ndarray,
) -> Surface:
    """Return a manifold as machine code takes it, with fresh room."""
    n, r, tolerances = manifold.n, manifold.rows, np.array(manifold.tolerances)
    g = tolerances.size
    return Surface(
        int(code.address),
        np.array(code.given, dtype=np.float64),
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


@njit(nogil=True, cache=True, error_model="numpy")
def evaluate(surface: Surface, state: FloatArray) -> float:
    """Evaluate F and its Jacobian at a state; return the largest error relative to its tolerance."""
    for i in range(state.size):
        surface.given[surface.places[i]] = state[i]
    call_residual(
        surface.address, surface.given.ctypes.data, surface.out.ctypes.data, surface.work.ctypes.data
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


@njit(nogil=True, cache=True, error_model="numpy")
def _excess(surface: Surface, inner: float) -> float:
    """Return the sum of squares of what errors exceed a part of their tolerances by."""
    total = 0.0
    for g in range(surface.norms.size):
        beyond = surface.norms[g] / surface.tolerances[g] - inner
        if beyond > 0.0:
            total += beyond * beyond
    return total


@njit(nogil=True, cache=True, error_model="numpy")
def _linearise(surface: Surface, aim: float) -> int:
    """Write the residuals to be removed and their scaled Jacobian; return their number.

    Of a constraint with error |r| above a part of its tolerance rho, r (1 - rho / |r|) is to be removed, so
    that a wide tolerance is entered and no more.  A constraint that has taken part once is held from then on.
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


@njit(nogil=True, cache=True, error_model="numpy")
def _least_step(surface: Surface, count: int, damping: float) -> None:
    """Write the smallest step that removes the residuals, of the coordinates that are not fixed.

    step = -W^-1 A^T (A A^T + damping diag(A A^T))^-1 e with A = J W^-1, by Cholesky's factorisation.
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


@njit(nogil=True, cache=True, error_model="numpy")
def _step_in_box(surface: Surface, state: FloatArray, count: int, damping: float) -> None:
    """Write the step and the state it leads to; coordinates that it would push out of the box stay."""
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


@njit(nogil=True, cache=True, error_model="numpy")
def project(surface: Surface, state: FloatArray, inner: float) -> bool:
    """Move a state onto the manifold, in place, by damped Gauss-Newton steps within the box.

    The damping grows where a step does not help (Levenberg, 1944; Marquardt, 1963).

    Args:
        surface: The manifold.
        state: Shape (n,), inside the box.
        inner: Part of the tolerances to which it is moved.

    Returns:
        Whether it is there.
    """
    damping, ratio = _LEAST_DAMPING, evaluate(surface, state)
    for g in range(surface.held.size):
        surface.held[g] = 0
    excess = _excess(surface, inner)
    for _ in range(MOST_ITERATIONS):
        if ratio <= inner:
            return True
        if math.isinf(ratio):
            return False
        count = _linearise(surface, 0.8 * inner)
        while True:
            _step_in_box(surface, state, count, damping)
            ratio = evaluate(surface, surface.rows[TRIAL])
            if surface.stop[0] != 0:
                return False
            better = _excess(surface, inner)
            if ratio <= inner or (better < excess and not math.isinf(ratio)):
                break
            damping = max(1e-3, 10.0 * damping)
            if damping > _MOST_DAMPING:
                return False
        damping = max(_LEAST_DAMPING, 0.1 * damping)
        excess = better
        for i in range(state.size):
            state[i] = surface.rows[TRIAL, i]
    return ratio <= inner


@njit(nogil=True, cache=True, error_model="numpy")
def edge_holds(surface: Surface, a: FloatArray, b: FloatArray) -> bool:
    """Return whether the middle of an edge, where it is furthest from the manifold, meets the constraints."""
    for i in range(a.size):
        surface.rows[MIDDLE, i] = 0.5 * (a[i] + b[i])
    return evaluate(surface, surface.rows[MIDDLE]) <= BETWEEN


@njit(nogil=True, cache=True, error_model="numpy")
def _next(surface: Surface, current: FloatArray, target: FloatArray, length: float, longest: float) -> float:
    """Write the next state on the way to a target to rows[AIM]; return how far it is from it, or -1."""
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


@njit(
    types.int64(SURFACE, VECTOR, VECTOR, types.float64, types.boolean, MATRIX),
    nogil=True,
    cache=True,
    error_model="numpy",
)
def extend(
    surface: Surface,
    origin: FloatArray,
    target: FloatArray,
    resolution: float,
    exact: bool,
    chain: FloatArray,
) -> int:
    """Walk along the manifold towards a target: short straight steps, each moved back onto the manifold.

    It ends where no step leads nearer.  Source: D. Berenson, S. Srinivasa, D. Ferguson and J. Kuffner,
    Manipulation planning on constraint manifolds, ICRA 2009 (CBiRRT).

    Args:
        surface: The manifold.
        origin: A state on it, shape (n,).
        target: Any state, shape (n,).
        resolution: Greatest step [length unit of the metric].
        exact: Whether the target is on the manifold and is to be met.
        chain: The states after `origin`, written, shape (m, n).

    Returns:
        Number c of states written; -c - 1 where the way ends with them, short of the target.  The last one
        is the target where that was reached.
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


@njit(types.void(SURFACE, MATRIX, MATRIX), nogil=True, cache=True, error_model="numpy")
def measure_rows(surface: Surface, states: FloatArray, errors: FloatArray) -> None:
    """Write the error of each constraint, shape (m, g), at states of shape (m, n)."""
    for j in range(states.shape[0]):
        evaluate(surface, states[j])
        for g in range(surface.norms.size):
            error = surface.norms[g]
            errors[j, g] = math.inf if math.isnan(error) else error


@njit(
    types.void(SURFACE, MATRIX, types.float64, types.boolean[::1]),
    nogil=True,
    cache=True,
    error_model="numpy",
)
def project_rows(surface: Surface, states: FloatArray, inner: float, done: BoolArray) -> None:
    """Move states, shape (m, n), onto the manifold in place; write which are there."""
    for j in range(states.shape[0]):
        done[j] = surface.stop[0] == 0 and project(surface, states[j], inner)


@njit(types.boolean(SURFACE, MATRIX), nogil=True, cache=True, error_model="numpy")
def edges_hold(surface: Surface, points: FloatArray) -> bool:
    """Return whether all edges of a polyline, shape (k, n), meet the constraints in their middles."""
    k = 0
    while k < points.shape[0] - 1 and edge_holds(surface, points[k], points[k + 1]):
        k += 1
    return k == points.shape[0] - 1
