"""Motions by general solvers: the problem of `descend`, and minimum effort for any dynamics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.working_time import working_time
from pepper_kin.status import ResultStatus

from ..vectors import FloatArray, finite_points, finite_vector, positive_number, read_only
from .assembly import Bounds, Objective
from .descend import LocalResult, OptimizationStatus
from .rows import BarrierBound, Rows, Term

if TYPE_CHECKING:
    import casadi

FATROP = "fatrop"
SOLVERS = ("ipopt", FATROP)
_TOLERANCE, _EFFORT_TOLERANCE = 1e-6, 1e-8
_BROKEN = 1e-4  # violation, relative to a limit, up to which a motion counts as a solution
_ROUNDS, _REACH, _LEAST = 25, 0.4, 1e-3
_ENOUGH = 3e-4  # minimum ratio of the cost that a round must save


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
    """Lower the cost of a motion by a solver of CasADi.

    The spline is written stage by stage (`Stages`).  With d = e = 0 at both ends the stages describe the
    motions of `RestSpline`: its control points are p - e / 6, and the control points of its rates are
    (d + e / 2) / h and e / h^2, so bounds are the same as in `descend`.  Terms are evaluated for all samples
    at once, with exact first derivatives; the Hessian omits their curvature.  Terms with a true attribute
    `kinked` are replaced by tangents, round after round, within a reach that shrinks where the tangents
    mislead.

    Args:
        objective: Costs and constraints; its spline must be cubic.
        unknowns: Control points to start from, shape (size, n).
        duration: Duration to start from.
        solver: "ipopt" (A. Waechter and L. Biegler, 2006), or "fatrop" (L. Vanroye et al., 2023), which makes
            use of the stages.
        free_duration: Whether the duration may change.
        max_iterations: Maximum number of iterations of the solver.
        timeout: Wall time [s]; "fatrop" cannot be stopped by the clock, and accepts only infinity.

    Returns:
        The result; `mu` is nan.  If no motion within the limits was found its status is START_INFEASIBLE.

    Raises:
        InvalidValueError: for a wrong shape, NaN, an unknown solver, a spline of another degree, or a timeout
            for "fatrop".
    """
    begin = working_time()
    spline = objective.spline
    _check_solver(solver)
    if solver == FATROP:
        check_no_timeout(timeout if timeout < float("inf") else None)
    if spline.degree != 3:
        raise InvalidValueError("degree", spline.degree, "3 for a general solver")
    x = np.array(finite_points("unknowns", unknowns, spline.n))
    t = positive_number("duration", duration)
    first_cost = objective.cost(spline.control_points(x), t)
    walk = _Walk(objective, x, t, free_duration)
    report = walk.run(solver, max_iterations, begin + timeout)
    status = {
        "solved": OptimizationStatus.CONVERGED, "time": OptimizationStatus.OUT_OF_TIME,
        "iterations": OptimizationStatus.OUT_OF_ITERATIONS,
    }.get(_outcome(report), OptimizationStatus.STALLED)  # fmt: skip
    if not walk.violation() <= _BROKEN:
        status, walk.x, walk.t = OptimizationStatus.START_INFEASIBLE, x, float(duration)
    cost, spent = objective.cost(spline.control_points(walk.x), walk.t), working_time() - begin
    return LocalResult(status, read_only(walk.x), walk.t, cost, first_cost, walk.steps, float("nan"), spent)


def check_no_timeout(timeout: float | None) -> None:
    """Refuse a time limit, which "fatrop" would not keep: it reads no clock.

    Raises:
        InvalidValueError: for any timeout.
    """
    if timeout is not None:
        allowed = f"none with solver {FATROP!r}, which cannot be stopped by the clock: give max_iterations"
        raise InvalidValueError("timeout", timeout, allowed)


def _check_solver(solver: str) -> None:
    if solver not in SOLVERS:
        raise InvalidValueError("solver", repr(solver), f"one of {', '.join(map(repr, SOLVERS))}")


def _outcome(report: dict[str, Any]) -> str:
    """Return the outcome of a solver: solved, or out of time or of iterations, infeasible or failed."""
    word, unified = (str(report.get(name, "")) for name in ("return_status", "unified_return_status"))
    if report.get("success"):
        return "solved"
    if "Time" in word:
        return "time"
    if "nfeasib" in word or "INFEASIBLE" in unified:
        return "infeasible"
    return "iterations" if "Iteration" in word or "LIMITED" in unified else "failed"


class _Walk:
    """A motion, control points x and duration t, that is improved from one solved problem to the next."""

    def __init__(self, objective: Objective, x: FloatArray, t: float, free_duration: bool) -> None:
        self.x, self.t, self.steps = x, t, 0
        self._objective, self._free = objective, free_duration
        self._kinked = [term for term in objective.constraints if getattr(term, "kinked", False)]

    def run(self, solver: str, max_iterations: int, end: float) -> dict[str, Any]:
        """Solve with tangents in place of kinked terms until the cost no longer falls; return the report."""
        from .stages import solve_spline

        objective, reach = self._objective, _REACH if self._kinked else float("inf")
        report: dict[str, Any] = {}
        for _ in range(_ROUNDS if self._kinked else 1):
            left, steps = end - working_time(), max_iterations - self.steps
            if left <= 0.0 or steps <= 0:
                return {"return_status": "Time" if left <= 0.0 else "Iteration"}
            control = objective.spline.control_points(self.x)
            terms = [
                _Tangent(term, objective.samples(term, control)) if term in self._kinked else term
                for term in objective.constraints
            ]
            options = {"tol": _TOLERANCE, "max_iter": steps}
            if solver == "ipopt":
                options |= {"mu_init": 1e-2, "max_wall_time": min(left, 1e6)}
            x, t, report = solve_spline(objective, terms, self.x, self.t, self._free, solver, options, reach)
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
        """Return the maximum violation of a limit, relative to the limit; 0 or less if all are kept."""
        objective, control = self._objective, self._objective.spline.control_points(self.x)
        found = [-objective.least_slack(control, self.t)]
        for term in objective.constraints:
            values = term.values(*objective.states(term, control, self.t))
            workspace = 1.0 - np.abs(values) if term.barrier_bound is BarrierBound.WITHIN_ONE else values
            found.append(-float(workspace.min(initial=1.0)))
        return max(found)

    def _cost(self) -> float:
        return self._objective.cost(self._objective.spline.control_points(self.x), self.t)

    def _length(self, x: FloatArray, t: float) -> float:
        """Return the first of the ratios 1, 1/2, ... of a step that keeps kinked terms, too."""
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


class _Tangent:
    """Tangent value(q0) + d value/dq (q - q0) at each sample, in place of a term of positions only.

    Distances to the nearest of many bodies have kinks where another body becomes the nearest, and no gradient
    inside a body; general solvers fail at both.  The tangents touch at q0, shape (K, n).
    """

    def __init__(self, term: Term, q: FloatArray) -> None:
        self.per_interval, self.barrier_bound = term.per_interval, term.barrier_bound
        self._q, self._rows = q, term.rows(q, np.zeros_like(q), np.zeros_like(q))

    def values(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the values, shape (K, R), at positions, shape (K, n)."""
        change = np.einsum("krn,kn->kr", self._rows.by_position, q - self._q)
        return np.asarray(self._rows.value + change)

    def rows(self, q: FloatArray, v: FloatArray, a: FloatArray) -> Rows:
        """Return the values and their derivatives."""
        return Rows(self.values(q, v, a), self._rows.by_position)


class EffortStatus(ResultStatus):
    """How the solver ended; `advice` says what to try."""

    SOLVED = "solved", "The motion meets the optimality conditions: no small change lowers its effort."
    INFEASIBLE = "infeasible", "No motion was found within the limits; allow more time or wider limits."
    OUT_OF_ITERATIONS = "out_of_iterations", "Raise max_iterations, or start from a better guess."
    FAILED = "failed", "Try the other solver, more intervals, or a longer duration."


@dataclass(frozen=True, eq=False)
class EffortMotion:
    """Result of `minimum_effort`.

    Attributes:
        status: Status of the solver.
        time: Times of the nodes [s], shape (N + 1,).
        position: Positions at the nodes, shape (N + 1, n); cubic between nodes, with linear acceleration.
        velocity: Velocities at the nodes, shape (N + 1, n).
        acceleration: Accelerations at the nodes, shape (N + 1, n).
        effort: Integral of |torque / scale|^2 over time [s].
        iterations: Number of iterations of the solver.
        violation: Maximum violation of a constraint.
        wall_time: Time to solve, without the time to build the problem [s].
        message: Message of the solver.
    """

    status: EffortStatus
    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    effort: float
    iterations: int
    violation: float
    wall_time: float
    message: str


def minimum_effort(
    torque: casadi.Function,
    start: tuple[ArrayLike, ArrayLike],
    goal: tuple[ArrayLike, ArrayLike],
    duration: float,
    bounds: Bounds,
    torque_limits: ArrayLike,
    *,
    scale: ArrayLike | None = None,
    intervals: int = 20,
    solver: str = "ipopt",
    max_iterations: int = 200,
) -> EffortMotion:
    """Find the motion between two states with a given duration and minimum effort.

    It minimizes the integral of |torque / scale|^2 dt.  Accelerations are linear in each interval, so that
    positions are cubic and stages exact, with jerk as control (`Stages`).  The integral is computed by Gauss
    quadrature with two points in each interval, where torques are also bounded.  CasADi supplies first and
    second derivatives.

    Args:
        torque: CasADi function of q, v and a, columns of n, with the torques as its one output.
        start: First position and velocity, shape (n,) each.
        goal: Last position and velocity, shape (n,) each.
        duration: Duration [s].
        bounds: Limits of positions, velocities and accelerations, inf for none.
        torque_limits: Maximum absolute torques, inf for none, shape (n,).
        scale: Torque of each coordinate that counts as 1, shape (n,); by default the limits.
        intervals: Number of intervals N, at least 2.
        solver: "ipopt", or "fatrop", which makes use of the stages.
        max_iterations: Maximum number of iterations of the solver.

    Returns:
        The motion; unless the status is SOLVED, it is the solver's last iterate, which violates limits or
        dynamics.

    Raises:
        InvalidValueError: for a wrong shape, NaN, an unknown solver, or a scale that is not finite.
    """
    _check_solver(solver)
    for name, value, least in (("intervals", intervals, 2), ("max_iterations", max_iterations, 1)):
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise InvalidValueError(name, value, f"a whole number of at least {least}")
    n = finite_vector("start position", start[0]).size
    names = (("start position", "start velocity"), ("goal position", "goal velocity"))
    ends = [
        np.concatenate([finite_vector(name, part, n) for name, part in zip(words, end, strict=True)])
        for words, end in zip(names, (start, goal), strict=True)
    ]
    duration, limits = positive_number("duration", duration), np.asarray(torque_limits, dtype=float)
    unit = limits if scale is None else np.asarray(scale, dtype=float)
    if unit.shape != (n,) or not (np.isfinite(unit).all() and (unit > 0).all()):
        raise InvalidValueError("scale", unit, f"{n} finite torques above 0")
    from .stages import solve_effort

    options = {"tol": _EFFORT_TOLERANCE, "max_iter": max_iterations}
    found = solve_effort(
        torque, (ends[0], ends[1]), duration, bounds, (limits, unit), intervals, solver, options
    )
    report, times = found.report, np.linspace(0.0, duration, intervals + 1)
    q, v, a = (read_only(part.copy()) for part in np.split(found.rows, 3, axis=1))
    status = {
        "solved": EffortStatus.SOLVED, "infeasible": EffortStatus.INFEASIBLE,
        "iterations": EffortStatus.OUT_OF_ITERATIONS,
    }.get(_outcome(report), EffortStatus.FAILED)  # fmt: skip
    word = str(report.get("return_status", report.get("unified_return_status", "")))
    steps, spent = int(report.get("iter_count", -1)), found.wall_time
    return EffortMotion(status, read_only(times), q, v, a, found.cost, steps, found.violation, spent, word)
