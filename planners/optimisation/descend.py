"""A feasible interior-point method: every iterate keeps all limits."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners.optimisation.assembly import FIXED, Objective
from pepper_kin.planners.vectors import FloatArray, finite_points, positive_number, read_only

_ARMIJO = 1e-4
_SHORTEST = 1e-5  # step lengths below are given up
_FIRST_MU, _LAST_MU = 2e-3, 1e-4
_SHRINK = 0.4  # of mu, after a step of good length or near its minimum
_LONG = 0.5
_NEAR = 0.3  # squared Newton decrement over mu


class OptimisationStatus(Enum):
    """How a descent ended; `advice` says what to try."""

    CONVERGED = "converged"
    OUT_OF_ITERATIONS = "out_of_iterations"
    OUT_OF_TIME = "out_of_time"
    STALLED = "stalled"
    STOPPED = "stopped"
    START_INFEASIBLE = "start_infeasible"

    @property
    def advice(self) -> str:
        """One sentence: what the status means and what to try."""
        return _ADVICE[self]


_ADVICE = {
    OptimisationStatus.CONVERGED: "No small change makes the motion cheaper.",
    OptimisationStatus.OUT_OF_ITERATIONS: "The motion keeps all limits; more iterations make it cheaper.",
    OptimisationStatus.OUT_OF_TIME: "The motion keeps all limits; more time makes it cheaper.",
    OptimisationStatus.STALLED: "The motion keeps all limits; start elsewhere to find a cheaper one.",
    OptimisationStatus.STOPPED: "The caller ended the search; the motion keeps all limits.",
    OptimisationStatus.START_INFEASIBLE: "Start from a slower motion, or one further from the constraints.",
}


@dataclass(frozen=True, eq=False)
class Descent:
    """The outcome of `descend`.

    Attributes:
        status: How it ended.
        unknowns: Control points, shape (size, n), read-only.
        duration: Duration T.
        cost: Cost without barriers.
        first_cost: The same of the start.
        iterations: Number of Newton steps.
        mu: Last weight of the barrier.
        time: Wall time [s].
    """

    status: OptimisationStatus
    unknowns: FloatArray
    duration: float
    cost: float
    first_cost: float
    iterations: int
    mu: float
    time: float


def descend(
    objective: Objective,
    unknowns: FloatArray,
    duration: float,
    *,
    free_duration: bool = True,
    max_iterations: int = 60,
    timeout: float = float("inf"),
    tolerance: float = _LAST_MU,
    after_step: Callable[[FloatArray, float], bool] | None = None,
) -> Descent:
    """Lower the cost of a motion by Newton steps on cost + mu * barrier, with mu falling.

    The start must keep all limits with room to spare, and so does every iterate: the search along a step stops
    before the first wall (A. Fiacco and G. McCormick, Nonlinear Programming: Sequential Unconstrained
    Minimization Techniques, 1968).  Matrices are Gauss and Newton's: of constraints only first derivatives are
    needed.

    Args:
        objective: Costs and constraints.
        unknowns: Control points to start from, shape (size, n).
        duration: Duration to start from.
        free_duration: Whether the duration may change.
        max_iterations: Number of steps at most.
        timeout: Wall time after which the best motion so far is returned [s].
        tolerance: Weight of the barrier at which the search ends, in units of the cost.
        after_step: Called with control points and duration after each step.  It may tighten constraints, if
            that motion stays feasible; where it returns True the search ends.

    Returns:
        The descent; its motion costs no more than the start.

    Raises:
        InvalidValueError: for a wrong shape, NaN, or a duration that is not above zero.
    """
    begin = time.perf_counter()
    spline = objective.spline
    x = np.array(finite_points("unknowns", unknowns, spline.n))
    if len(x) != spline.size:
        raise InvalidValueError("unknowns", f"{len(x)} control points", f"{spline.size} control points")
    t = positive_number("duration", duration)
    first_cost = cost = objective.cost(spline.control_points(x), t)

    def ended(status: OptimisationStatus, iterations: int) -> Descent:
        spent = time.perf_counter() - begin
        return Descent(status, read_only(x), t, cost, first_cost, iterations, mu, spent)

    mu, damping = _FIRST_MU, 1e-6
    if not objective.barrier(spline.control_points(x), t) < np.inf:
        return ended(OptimisationStatus.START_INFEASIBLE, 0)
    failures = 0
    for iteration in range(max_iterations):
        if time.perf_counter() - begin > timeout:
            return ended(OptimisationStatus.OUT_OF_TIME, iteration)
        control = spline.control_points(x)
        system, cost, walls = objective.system(control, t, mu)
        try:
            step, t_step, slope = system.solve(FIXED, damping, free_duration)
        except np.linalg.LinAlgError:
            damping = max(10 * damping, 1e-6)
            continue
        length = _search(objective, x, t, step, t_step, slope, cost + mu * walls, mu)
        x, t = x + length * step, t + length * t_step
        if length and after_step is not None and after_step(spline.control_points(x), t):
            cost = objective.cost(spline.control_points(x), t)
            return ended(OptimisationStatus.STOPPED, iteration + 1)
        damping = max(damping / 5, 1e-9) if length > 0.5 else min(damping * 4, 1e3)
        failures = 0 if length else failures + 1
        near = -slope < _NEAR * mu or failures > 1
        if near or (mu > tolerance and length >= _LONG):
            if mu <= tolerance:
                cost = objective.cost(spline.control_points(x), t)
                status = OptimisationStatus.STALLED if failures > 1 else OptimisationStatus.CONVERGED
                return ended(status, iteration + 1)
            mu, failures = max(_SHRINK * mu, tolerance), 0
    cost = objective.cost(spline.control_points(x), t)
    return ended(OptimisationStatus.OUT_OF_ITERATIONS, max_iterations)


def _search(
    objective: Objective,
    x: FloatArray,
    t: float,
    step: FloatArray,
    t_step: float,
    slope: float,
    value: float,
    mu: float,
) -> float:
    """Return the first of 1, 1/2, 1/4 ... of a step that stays inside and lowers the merit; 0 for none."""
    length = 1.0 if t_step >= 0 else min(1.0, 0.5 * t / -t_step)
    spline = objective.spline
    while length > _SHORTEST:
        control, duration = spline.control_points(x + length * step), t + length * t_step
        walls = objective.barrier(control, duration)
        if walls < np.inf:
            new = objective.cost(control, duration) + mu * walls
            if new <= value + _ARMIJO * length * slope + 1e-12 * abs(value):
                return length
        length /= 2
    return 0.0
