"""A feasible interior-point method: every iterate keeps all limits."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from pepper_kin.exceptions import InvalidValueError

from ..vectors import FloatArray, finite_points, positive_number, read_only
from .assembly import FIXED, Objective

_ARMIJO = 1e-4
_SHORTEST = 1e-5  # step lengths below are given up
_FIRST_MU, _LAST_MU = 2e-3, 1e-4  # shares of the cost
_SHRINK = 0.4  # of mu, after a step of good length or near its minimum
_LONG = 0.5
_LIGHT, _MOST_DAMPING = 1e-3, 1e6
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
        mu: Last weight of the barrier, in units of the cost.
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

    The start must keep all limits with room to spare, and so does every iterate: the search along a step
    stops before the first wall (A. Fiacco and G. McCormick, Nonlinear Programming: Sequential Unconstrained
    Minimization Techniques, 1968).  Matrices are Gauss and Newton's: of constraints only first derivatives
    are needed.

    Args:
        objective: Costs and constraints.
        unknowns: Control points to start from, shape (size, n).
        duration: Duration to start from.
        free_duration: Whether the duration may change.
        max_iterations: Number of steps at most.
        timeout: Wall time after which the best motion so far is returned [s].
        tolerance: Last mu as a share of the cost: with k limits that act, the cost found exceeds the nearest
            minimum by about k times that share.
        after_step: Called with control points and duration after each step.  It may tighten constraints, if
            that motion stays feasible; where it returns True the search ends.

    Returns:
        The descent; its motion keeps all limits, unless the start did not.

    Raises:
        InvalidValueError: for a wrong shape, NaN, or a duration that is not above zero.
    """
    begin = time.perf_counter()
    spline = objective.spline
    x = np.array(finite_points("unknowns", unknowns, spline.n))
    if len(x) != spline.size:
        raise InvalidValueError("unknowns", f"{len(x)} control points", f"{spline.size} control points")
    walk = _Walk(objective, x, positive_number("duration", duration), free_duration, tolerance)
    first_cost = objective.cost(spline.control_points(x), walk.t)
    status, iterations = OptimisationStatus.START_INFEASIBLE, 0
    if objective.barrier(spline.control_points(x), walk.t) < np.inf:
        status = OptimisationStatus.OUT_OF_ITERATIONS
        while iterations < max_iterations:
            if time.perf_counter() - begin > timeout:
                status = OptimisationStatus.OUT_OF_TIME
                break
            iterations += 1
            moved, ending = walk.step()
            if moved and after_step is not None and after_step(spline.control_points(walk.x), walk.t):
                ending = OptimisationStatus.STOPPED
            if ending is not None:
                status = ending
                break
    cost = objective.cost(spline.control_points(walk.x), walk.t)
    return Descent(
        status, read_only(walk.x), walk.t, cost, first_cost, iterations, walk.mu, time.perf_counter() - begin
    )


class _Walk:
    """A motion, control points x and duration t, that goes downhill step by step."""

    def __init__(
        self, objective: Objective, x: FloatArray, t: float, free_duration: bool, tolerance: float
    ) -> None:
        self.x, self.t = x, t
        self._objective, self._free, self._tolerance = objective, free_duration, tolerance
        self._share, self._damping = max(_FIRST_MU, tolerance), 1e-6
        self.mu = self._share * objective.cost(objective.spline.control_points(x), t)

    def step(self) -> tuple[bool, OptimisationStatus | None]:
        """Make a step and lower mu where due; return whether it moved, and how the walk ended, if it did."""
        objective = self._objective
        control = objective.spline.control_points(self.x)
        system, cost, walls = objective.system(control, self.t, self.mu)
        try:
            step, t_step, slope = system.solve(FIXED, self._damping, self._free)
        except np.linalg.LinAlgError:
            self._damping *= 10
            return False, None if self._damping < _MOST_DAMPING else OptimisationStatus.STALLED
        value, damping = cost + self.mu * walls, self._damping
        length = _search(objective, self.x, self.t, step, t_step, slope, value, self.mu)
        self.x, self.t = self.x + length * step, self.t + length * t_step
        if length:
            self._damping = max(self._damping / 5, 1e-9) if length > _LONG else min(4 * self._damping, 1e3)
        else:
            self._damping *= 100
        stuck = self._damping > _MOST_DAMPING
        # A damped step promises little wherever it is made.
        near = stuck or (length > 0 and -slope < _NEAR * self.mu and damping <= _LIGHT)
        if near and self._share <= self._tolerance:
            return length > 0, OptimisationStatus.STALLED if stuck else OptimisationStatus.CONVERGED
        if near or length >= _LONG:
            self._share = max(_SHRINK * self._share, self._tolerance)
            self.mu = min(self.mu, self._share * cost)
            self._damping = min(self._damping, 1.0)
        return length > 0, None


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
