"""The problem that `descend` solves, by a general solver: a reference."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from pepper_kin.exceptions import InvalidValueError

from ..vectors import FloatArray, finite_points, positive_number, read_only
from .assembly import Objective
from .descend import LocalResult, OptimizationStatus
from .linearized import Linearized
from .rows import BarrierBound, Term
from .stages import Stages

FATROP = "fatrop"
SOLVERS = ("ipopt", FATROP)
_BROKEN = 1e-4  # shares of the limits by which a motion may exceed them and still count as one
_ROUNDS, _REACH, _LEAST = 25, 0.4, 1e-3
_ENOUGH = 3e-4  # share of the cost that a round must save


def descend_by(
    objective: Objective,
    unknowns: FloatArray,
    duration: float,
    *,
    solver: str = "ipopt",
    free_duration: bool = True,
    max_iterations: int = 400,
    timeout: float = float("inf"),
) -> LocalResult:
    """Lower the cost of a motion by a solver of CasADi's.

    A cubic spline is, interval by interval, p + s d + s^2 e / 2 + s^3 j / 6, 0 <= s <= 1, with the states

        p' = p + d + e / 2 + j / 6,   d' = d + e + j / 2,   e' = e + j,   T' = T

    from stage to stage; v = d / h, a = e / h^2, h = T / M.  With d = e = 0 at both ends these are the
    motions of `RestSpline`, whose control points are p - e / 6, and of whose rates they are (d + e / 2) / h
    and e / h^2: bounds are the same as in `descend`.  Terms are asked for all samples at once and give
    first derivatives, exactly; of the Hessian their curvature is left out.  Terms with an attribute
    `kinked` that is true are replaced by tangents, round after round, within a reach that shrinks where
    these mislead.

    Args:
        objective: Costs and constraints; its spline must be cubic.
        unknowns: Control points to start from, shape (size, n).
        duration: Duration to start from.
        solver: "ipopt" (A. Waechter and L. Biegler, 2006), or "fatrop" (L. Vanroye et al., 2023), which makes
            use of the stages.
        free_duration: Whether the duration may change.
        max_iterations: Of the solver.
        timeout: Wall time [s]; "fatrop" cannot be stopped by the clock, and takes none but infinity.

    Returns:
        The descent; `mu` is nan.  Where no motion within the limits was found its status is START_INFEASIBLE.

    Raises:
        InvalidValueError: for a wrong shape, NaN, an unknown solver, a spline of another degree, or a timeout
            for "fatrop".
    """
    begin = time.perf_counter()
    spline = objective.spline
    if solver not in SOLVERS:
        raise InvalidValueError("solver", repr(solver), f"one of {', '.join(map(repr, SOLVERS))}")
    if solver == FATROP:
        check_no_timeout(timeout if timeout < float("inf") else None)
    if spline.degree != 3:
        raise InvalidValueError("degree", spline.degree, "3 for a general solver")
    x = np.array(finite_points("unknowns", unknowns, spline.n))
    t = positive_number("duration", duration)
    first_cost = objective.cost(spline.control_points(x), t)
    walk = _Walk(objective, x, t, free_duration)
    report = walk.run(solver, max_iterations, begin + timeout)
    status = _status(report)
    if not walk.violation() <= _BROKEN:
        status, walk.x, walk.t = OptimizationStatus.START_INFEASIBLE, x, float(duration)
    cost, spent = objective.cost(spline.control_points(walk.x), walk.t), time.perf_counter() - begin
    return LocalResult(status, read_only(walk.x), walk.t, cost, first_cost, walk.steps, float("nan"), spent)


def check_no_timeout(timeout: float | None) -> None:
    """Refuse a time that "fatrop" would not keep: nothing in it looks at a clock.

    Raises:
        InvalidValueError: for any timeout.
    """
    if timeout is not None:
        allowed = f"none with solver {FATROP!r}, which cannot be stopped by the clock: give max_iterations"
        raise InvalidValueError("timeout", timeout, allowed)


class _Walk:
    """A motion, control points x and duration t, that goes from one solved problem to the next."""

    def __init__(self, objective: Objective, x: FloatArray, t: float, free_duration: bool) -> None:
        self.x, self.t, self.steps = x, t, 0
        self._objective, self._free = objective, free_duration
        self._kinked = [term for term in objective.constraints if getattr(term, "kinked", False)]

    def run(self, solver: str, max_iterations: int, end: float) -> dict[str, Any]:
        """Solve, with tangents in the place of terms that have kinks, until the cost falls no more."""
        objective, reach = self._objective, _REACH if self._kinked else float("inf")
        report: dict[str, Any] = {}
        for _ in range(_ROUNDS if self._kinked else 1):
            left, steps = end - time.perf_counter(), max_iterations - self.steps
            if left <= 0.0 or steps <= 0:
                return {"return_status": "Time" if left <= 0.0 else "Iteration"}
            terms = [self._tangent(term) if term in self._kinked else term for term in objective.constraints]
            stages = Stages(objective, terms, self.x, self.t, self._free)
            x, t, report = stages.solve(solver, steps, left, reach)
            self.steps += max(int(report.get("iter_count", 0)), 1)
            if not np.isfinite(x).all() or not t > 0:
                return report
            before, length = self._cost(), self._length(x, t)
            shut = self.violation() > _BROKEN
            self.x, self.t = self.x + length * (x - self.x), self.t + length * (t - self.t)
            reach *= 0.5 if length < 1.0 else 1.5
            if not shut and length == 1.0 and before - self._cost() < _ENOUGH * before:
                break
        return report

    def violation(self) -> float:
        """Return by how much of a limit the motion breaks one, at most; 0 or less where it breaks none."""
        objective, control = self._objective, self._objective.spline.control_points(self.x)
        found = [-objective.least_slack(control, self.t)]
        for term in objective.constraints:
            values = term.values(*objective.states(term, control, self.t))
            workspace = 1.0 - np.abs(values) if term.barrier_bound is BarrierBound.WITHIN_ONE else values
            found.append(-float(workspace.min(initial=1.0)))
        return max(found)

    def _cost(self) -> float:
        return self._objective.cost(self._objective.spline.control_points(self.x), self.t)

    def _tangent(self, term: Term) -> Linearized:
        control = self._objective.spline.control_points(self.x)
        return Linearized(term, self._objective.samples(term, control))

    def _length(self, x: FloatArray, t: float) -> float:
        """Return the first of 1, 1/2, ... of a step after which terms with kinks are kept, too."""
        length, objective = 1.0, self._objective
        while self._kinked and length > _LEAST:
            control = objective.spline.control_points(self.x + length * (x - self.x))
            states = [objective.states(k, control, self.t + length * (t - self.t)) for k in self._kinked]
            least = min(
                float(k.values(*state).min(initial=1.0))
                for k, state in zip(self._kinked, states, strict=True)
            )
            if least > 0.0:
                return length
            length /= 2
        return length if self._kinked else 1.0


def _status(report: dict[str, Any]) -> OptimizationStatus:
    word = str(report.get("return_status", ""))
    if report.get("success"):
        return OptimizationStatus.CONVERGED
    if "Time" in word:
        return OptimizationStatus.OUT_OF_TIME
    if "Iteration" in word or "LIMITED" in str(report.get("unified_return_status", "")):
        return OptimizationStatus.OUT_OF_ITERATIONS
    return OptimizationStatus.STALLED
