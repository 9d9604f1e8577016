"""Space that compiled planners search: a box, a metric, and the validity of motions in the box."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from pepper_kin.core.clock import CLOCK
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_four
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

from .vectors import FloatArray

if TYPE_CHECKING:
    from .motion_validator import CompiledMotionValidator
    from .problem import Problem

STATES, CALLS, STOP, ITERATIONS = range(4)
"""First indices of a planner's counters: states checked, calls of the validity function, stop flag, and
iterations."""

_FIRST_STEPS = 8  # number of states of an edge that are checked in the first, coarse pass


class SearchSpace(NamedTuple):
    """The box, the metric and the validity function of a problem, for machine code.

    Attributes:
        validity: Address of the validity function, see `CompiledMotionValidator`.
        memory: Memory of the validity function.
        clock: Address of `clock_gettime`.
        resolution: Maximum step of an edge [length unit of the metric].
        reach: Maximum length of an extension [length unit of the metric].
        lower: Lower bounds, shape (n,).
        extent: Upper bounds minus lower bounds, shape (n,).
        weights: Weights of the metric, shape (n,).
    """

    validity: int
    memory: Floats1
    clock: int
    resolution: float
    reach: float
    lower: Floats1
    extent: Floats1
    weights: Floats1


def space_of(
    problem: Problem, code: CompiledMotionValidator, resolution: float, reach: float = math.inf
) -> SearchSpace:
    """Return the space of a problem, with fresh memory for the validity function.

    Args:
        problem: The problem.
        code: The problem's validity as a C function.
        resolution: Maximum distance between checked states of an edge [length unit of the metric].
        reach: Maximum length of an extension [length unit of the metric].
    """
    memory, lower, weights = code.fresh_memory(), problem.lower, problem.metric.weights
    return SearchSpace(
        code.address, memory, CLOCK, float(resolution), float(reach), lower, problem.extent, weights
    )


@compiled(lean=True)
def distance(a: FloatArray, b: FloatArray, weights: FloatArray) -> float:
    """Return the distance of two states, shapes (n,) [length unit of the metric]."""
    total = 0.0
    for i in range(a.size):
        difference = (b[i] - a[i]) * weights[i]
        total += difference * difference
    return math.sqrt(total)


@compiled(lean=True)
def measure(points: FloatArray, size: int, weights: FloatArray, lengths: FloatArray) -> None:
    """Write the length of a path from the first to each of its points.

    Args:
        points: The points, shape (m, n), of which the first `size` count.
        size: Number of points.
        weights: Weights of the metric, shape (n,).
        lengths: Arc lengths, written, shape (m,) [length unit of the metric].
    """
    lengths[0] = 0.0
    for k in range(1, size):
        lengths[k] = lengths[k - 1] + distance(points[k - 1], points[k], weights)


@compiled(lean=True)
def distance_to_nearest(state: FloatArray, goals: FloatArray, weights: FloatArray) -> float:
    """Return the distance of a state, shape (n,), from the nearest of some goals, shape (k, n)."""
    least = math.inf
    for g in range(goals.shape[0]):
        least = min(least, distance(state, goals[g], weights))
    return least


@compiled(lean=True)
def step_count(length: float, resolution: float) -> int:
    """Return the number of steps of an edge, none longer than the resolution; at least one."""
    return max(1, math.ceil(length / resolution))


@compiled("int64(SearchSpace, float64[::1], float64[::1], int64, int64[::1])", lean=True)
def last_valid_step(space: SearchSpace, a: Floats1, b: Floats1, steps: int, counters: Ints1) -> int:
    """Return `steps` if the states a + (b - a) j / steps, j = 1 .. steps, are valid, and else less.

    Args:
        space: The space.
        a: Start of the edge, shape (n,).
        b: End of the edge, shape (n,).
        steps: Number of states.
        counters: Counters of the planner, see `STATES`.
    """
    count = call_four(space.validity, a.ctypes.data, b.ctypes.data, steps, space.memory.ctypes.data)
    counters[STATES] += min(count + 1, steps)
    counters[CALLS] += 1
    return count


@compiled(
    "boolean(SearchSpace, float64[::1], float64[::1], int64, float64[:, ::1], int64[::1], boolean)", lean=True
)
def edge_valid(
    space: SearchSpace,
    a: Floats1,
    b: Floats1,
    steps: int,
    rows: Floats2,
    counters: Ints1,
    with_start: bool,
) -> bool:
    """Return whether all states of an edge but its start are valid: coarsely first, then halfway between.

    The number of steps is rounded up to a multiple of a power of two; no state is checked twice.

    Args:
        space: The space.
        a: Start of the edge, shape (n,), taken to be valid unless `with_start`.
        b: End of the edge, shape (n,).
        steps: Minimum number of states.
        rows: Scratch space, shape (2, n) or more; a and b must not lie in its first two rows.
        counters: Counters of the planner, see `STATES`.
        with_start: Whether the start is checked too, up to its rounding, together with the first states.
    """
    doublings = 0
    while (steps >> doublings) > _FIRST_STEPS:
        doublings += 1
    count = (steps + (1 << doublings) - 1) >> doublings
    if with_start:
        for i in range(a.size):
            rows[0, i] = a[i] - (b[i] - a[i]) / count
        if last_valid_step(space, rows[0], b, count + 1, counters) <= count:
            return False
    elif last_valid_step(space, a, b, count, counters) < count:
        return False
    for _ in range(doublings):
        back = 0.5 / count
        for i in range(a.size):
            shift = back * (b[i] - a[i])
            rows[0, i] = a[i] - shift
            rows[1, i] = b[i] - shift
        if last_valid_step(space, rows[0], rows[1], count, counters) < count:
            return False
        count *= 2
    return True
