"""Cost and barrier of a motion, as compiled functions."""

from __future__ import annotations

import math

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_four
from pepper_kin.kernels.signatures import Floats1, Floats2

from .compiled_term import FAILED, KINDS, TIGHTEN, VALUES
from .tables import (
    ADDRESS,
    COST,
    FIRST,
    FIXED,
    FLOORS,
    MEMORY,
    ORDERS,
    ROWS_COUNT,
    SAMPLING,
    WALL,
    WALLS,
    WITHIN_ONE,
    SplineTables,
    SplineWorkspace,
)

_TINY = 1e-200


@compiled(lean=True)
def sample(tables: SplineTables, work: SplineWorkspace, control: Floats2, duration: float) -> None:
    """Write positions, velocities and accelerations at all samples."""
    n, order_count = control.shape[1], tables.basis.shape[3]
    for s in range(tables.counts.shape[0]):
        count, per = tables.counts[s, 0], tables.counts[s, 1]
        states, scale = work.states[s], 1.0
        for order in range(3):
            for k in range(count):
                place, first = (order * count + k) * n, k // per
                for j in range(n):
                    states[place + j] = 0.0
                for i in range(order_count):
                    weight = tables.basis[s, order, k, i] * scale
                    if weight != 0.0:
                        for j in range(n):
                            states[place + j] += weight * control[first + i, j]
            scale /= duration


@compiled(lean=True)
def ask_term(tables: SplineTables, work: SplineWorkspace, t: int, what: int) -> int:
    """Call a term at its samples with a request; return the term's return value."""
    term = tables.terms[t]
    states = work.states[term[SAMPLING]]
    asked = KINDS * tables.counts[term[SAMPLING], 0] + what
    result = work.results[term[FIRST] :]
    address, memory = int(term[ADDRESS]), int(term[MEMORY])
    return call_four(address, states.ctypes.data, result.ctypes.data, int(asked), memory)


@compiled(lean=True)
def fill_slacks(tables: SplineTables, work: SplineWorkspace, control: Floats2, duration: float) -> None:
    """Write the slacks of positions and rates, relative to their limits; 1 where there is no limit."""
    count, n = control.shape
    slacks, box, rates = work.slacks, tables.box, tables.rates
    for i in range(count):
        inner = FIXED <= i < count - FIXED
        for j in range(n):
            slacks[0, i, j] = (control[i, j] - box[0, j]) / box[2, j] if inner else 1.0
            slacks[1, i, j] = (box[1, j] - control[i, j]) / box[2, j] if inner else 1.0
    scale = 1.0
    for order in range(1, ORDERS + 1):
        scale /= duration
        for i in range(count):
            for j in range(n):
                share = 0.0
                if i < count - order:
                    for k in range(order + 1):
                        share += rates[order - 1, i, k] * control[i + k, j]
                    share *= tables.inverse_limits[order - 1, j] * scale
                slacks[2 * order, i, j] = 1.0 - share
                slacks[2 * order + 1, i, j] = 1.0 + share


@compiled(lean=True)
def box_barrier(work: SplineWorkspace) -> float:
    """Return the sum of -log(slack), by one logarithm of a product of many slacks at a time."""
    total, product = 0.0, 1.0
    slacks = work.slacks.reshape(work.slacks.size)
    for k in range(slacks.size):
        if not slacks[k] > 0.0:
            return math.inf
        product *= slacks[k]
        if product < _TINY or product > 1.0 / _TINY:
            total -= math.log(product)
            product = 1.0
    return total - math.log(product)


@compiled(lean=True)
def barrier_value(values: Floats1, barrier_bound: int) -> float:
    """Return the sum of -log(distance to the bound) of a term's values; see `BarrierBound`."""
    total, product = 0.0, 1.0
    for k in range(values.size):
        workspace = 1.0 - values[k] * values[k] if barrier_bound == WITHIN_ONE else min(values[k], 1.0)
        if not workspace > 0.0:
            return math.inf
        product *= workspace
        if product < _TINY:
            total -= math.log(product)
            product = 1.0
    return total - math.log(product)


@compiled(lean=True)
def jerk_cost(tables: SplineTables, control: Floats2, duration: float) -> float:
    """Return the cost of the jerk, c . J c / T^5."""
    count, n = control.shape
    total = 0.0
    for i in range(count):
        for d in range(tables.jerk.shape[1]):
            if i + d < count:
                part = 0.0
                for j in range(n):
                    part += tables.jerk_weight[j] * control[i, j] * control[i + d, j]
                total += (1.0 if d == 0 else 2.0) * tables.jerk[i, d] * part
    return total / duration**5


@compiled(lean=True)
def term_barrier(tables: SplineTables, work: SplineWorkspace, t: int) -> float:
    """Return the barrier of a constraint whose values are in `results`."""
    term = tables.terms[t]
    count = tables.counts[term[SAMPLING], 0] * term[ROWS_COUNT]
    return barrier_value(work.results[term[FIRST] : term[FIRST] + count], term[WALL])


@compiled(lean=True)
def term_square(tables: SplineTables, work: SplineWorkspace, t: int) -> float:
    """Return the sum of the squared values of a cost whose values are in `results`."""
    term, total = tables.terms[t], 0.0
    for k in range(term[FIRST], term[FIRST] + tables.counts[term[SAMPLING], 0] * term[ROWS_COUNT]):
        total += work.results[k] * work.results[k]
    return total


@compiled(lean=True)
def add_costs(tables: SplineTables, work: SplineWorkspace, control: Floats2, duration: float) -> bool:
    """Write the cost of a motion with known states into `numbers`; return whether no term failed."""
    cost = tables.time_weight[0] * duration + jerk_cost(tables, control, duration)
    for t in range(tables.shares.size):
        if tables.shares[t] >= 0.0:
            if ask_term(tables, work, t, VALUES) == FAILED:
                return False
            count = tables.counts[tables.terms[t, SAMPLING], 0]
            cost += tables.shares[t] * duration * term_square(tables, work, t) / count
    work.numbers[COST] = cost
    return True


@compiled(lean=True)
def measure(tables: SplineTables, work: SplineWorkspace, control: Floats2, duration: float) -> bool:
    """Write the cost and the barrier into `numbers`; return whether no term failed.

    The barrier is infinite, and the cost unknown, if a limit or a constraint is violated.
    """
    numbers = work.numbers
    fill_slacks(tables, work, control, duration)
    walls = box_barrier(work)
    numbers[COST], numbers[WALLS] = math.inf, math.inf
    if not walls < math.inf:
        return True
    sample(tables, work, control, duration)
    for t in range(tables.shares.size):
        if tables.shares[t] < 0.0:
            if ask_term(tables, work, t, VALUES) == FAILED:
                return False
            walls += term_barrier(tables, work, t)
            if not walls < math.inf:
                return True
    numbers[WALLS] = walls
    return add_costs(tables, work, control, duration)


@compiled(lean=True)
def tighten(tables: SplineTables, work: SplineWorkspace, control: Floats2, duration: float) -> int:
    """Raise the floors of terms below a motion; return FAILED or RAISED if a term does, else 0."""
    sample(tables, work, control, duration)
    found = 0
    for t in range(tables.shares.size):
        if tables.terms[t, FLOORS] != 0:
            said = ask_term(tables, work, t, TIGHTEN)
            if said == FAILED:
                return FAILED
            found = max(found, said)
    return found
