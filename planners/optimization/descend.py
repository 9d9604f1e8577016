"""Feasible interior-point method: every iterate keeps all limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pepper_kin.core.clock import CLOCK
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.working_time import on_perf_counter, working_time
from pepper_kin.status import ResultStatus

from ..vectors import FloatArray, finite_points, positive_number, read_only
from .assembly import Objective
from .newton import (
    BROKEN,
    CONVERGED,
    FIRST_MU,
    GOING_ON,
    LAST_MU,
    SHORT_ENOUGH,
    STALLED,
    TIME_UP,
    search,
)
from .tables import BEND, DAMPING, DURATION, FIXED, MU, QUIET, SHARE

_FIRST_DAMPING = 1e-6
_SLICE = 0.25  # maximum time that machine code runs until Python checks for an interrupt [s]


class OptimizationStatus(ResultStatus):
    """How a descent ended; `advice` says what to try."""

    CONVERGED = "converged", "No small change makes the motion cheaper."
    OUT_OF_ITERATIONS = "out_of_iterations", "The motion keeps all limits; more iterations make it cheaper."
    OUT_OF_TIME = "out_of_time", "The motion keeps all limits; more time makes it cheaper."
    STALLED = "stalled", "The motion keeps all limits; start elsewhere to find a cheaper one."
    STOPPED = "stopped", "The motion is as short as it has to be, and keeps all limits."
    START_INFEASIBLE = "start_infeasible", "Start from a slower motion, or one further from the constraints."


_STATUSES = {
    CONVERGED: OptimizationStatus.CONVERGED,
    STALLED: OptimizationStatus.STALLED,
    TIME_UP: OptimizationStatus.OUT_OF_TIME,
    SHORT_ENOUGH: OptimizationStatus.STOPPED,
}


@dataclass(frozen=True, eq=False)
class LocalResult:
    """Result of `descend`.

    Attributes:
        status: Status of the descent.
        unknowns: Control points, shape (size, n), read-only.
        duration: Duration T.
        cost: Cost without barriers.
        first_cost: Cost of the start without barriers.
        iterations: Number of Newton steps.
        mu: Last weight of the barrier, in units of the cost.
        time: Wall time [s].
    """

    status: OptimizationStatus
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
    tolerance: float = LAST_MU,
    stop_below: float = 0.0,
) -> LocalResult:
    """Lower the cost of a motion by Newton steps on cost + mu * barrier, with mu falling.

    The start must keep all limits with some slack, and so does every iterate: the line search
    stops before the first limit (A. Fiacco and G. McCormick, Nonlinear Programming: Sequential Unconstrained
    Minimization Techniques, 1968).  Matrices are Gauss-Newton matrices: constraints need only first
    derivatives.

    Args:
        objective: Costs and constraints.
        unknowns: Control points to start from, shape (size, n).
        duration: Duration to start from.
        free_duration: Whether the duration may change.
        max_iterations: Maximum number of steps.
        timeout: Wall time after which the best motion so far is returned [s].
        tolerance: Last mu relative to the cost: with k active limits, the cost exceeds the nearest minimum by
            about k times this ratio.
        stop_below: Duration below which the search ends.

    Returns:
        The result; its motion keeps all limits, unless the start did not.

    Raises:
        InvalidValueError: for a wrong shape, NaN, or a duration that is not above zero.
    """
    begin = working_time()
    spline = objective.spline
    x = np.array(finite_points("unknowns", unknowns, spline.n))
    if len(x) != spline.size:
        raise InvalidValueError("unknowns", f"{len(x)} control points", f"{spline.size} control points")
    t = positive_number("duration", duration)
    work = objective.workspace
    work.control[:] = spline.control_points(x)
    work.trial[:] = work.control
    first_cost = objective.cost(work.control, t)
    share = max(FIRST_MU, tolerance)
    work.numbers[[SHARE, MU, DAMPING, DURATION]] = share, share * first_cost, _FIRST_DAMPING, t
    work.numbers[[QUIET, BEND]] = 0.0
    status, iterations = OptimizationStatus.START_INFEASIBLE, 0
    if objective.measure(work.control, t)[1] < np.inf:
        status = OptimizationStatus.OUT_OF_ITERATIONS
        end = begin + timeout
        while iterations < max_iterations:
            until = min(end, working_time() + _SLICE)
            ended, steps = search(
                objective.tables, work, free_duration, max_iterations - iterations, tolerance,
                on_perf_counter(until), stop_below, CLOCK,
            )  # fmt: skip
            iterations += steps
            objective.check(ended != BROKEN)
            if ended == GOING_ON or (ended == TIME_UP and working_time() < end):
                continue
            status = _STATUSES[ended]
            break
    control, t = work.control.copy(), float(work.numbers[DURATION])
    return LocalResult(
        status, read_only(control[FIXED:-FIXED]), t, objective.cost(control, t), first_cost, iterations,
        float(work.numbers[MU]), working_time() - begin,
    )  # fmt: skip
