"""The motion of least effort between two states, transcribed for a general solver."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.status import ResultStatus

from ..vectors import FloatArray, finite_vector, positive_number, read_only
from .assembly import Bounds

if TYPE_CHECKING:
    import casadi

SOLVERS = ("ipopt", "fatrop")
_GAUSS = (0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0)
_TOLERANCE = 1e-8


class EffortStatus(ResultStatus):
    """How the solver ended; `advice` says what to try."""

    SOLVED = "solved", "The motion meets the optimality conditions: no small change lowers its effort."
    INFEASIBLE = "infeasible", "No motion was found within the limits; allow more time or wider limits."
    OUT_OF_ITERATIONS = "out_of_iterations", "Raise max_iterations, or start from a better guess."
    FAILED = "failed", "Try the other solver, more intervals, or a longer duration."


@dataclass(frozen=True, eq=False)
class EffortMotion:
    """The outcome of `minimum_effort`.

    Attributes:
        status: How the solver ended.
        time: Times of the nodes, shape (N + 1,).
        position: At the nodes, shape (N + 1, n); between them cubic, with linear acceleration.
        velocity: Shape (N + 1, n).
        acceleration: Shape (N + 1, n).
        effort: Integral of the squared shares of the torques.
        iterations: Of the solver.
        violation: Greatest violation of a constraint.
        wall_time: Time to solve, without what building takes [s].
        message: The solver's own word.
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
    """Find the motion between two states of given duration that takes the least effort.

    It minimizes the integral of |torque / scale|^2 dt.  Accelerations are linear in each interval, so that
    positions are cubic: the stage k -> k + 1 is exact, with jerk j_k as control,

        a' = a + h j,   v' = v + h a + h^2 j / 2,   q' = q + h v + h^2 a / 2 + h^3 j / 6.

    The integral is taken by Gauss's rule with two points in each interval, where torques are also bounded.
    First and second derivatives are CasADi's.

    Args:
        torque: CasADi function of q, v and a, columns of n, with the torques as its one output.
        start: First position and velocity, shape (n,) each.
        goal: Last position and velocity.
        duration: Duration [s].
        bounds: Limits of positions, velocities and accelerations, inf for none.
        torque_limits: Greatest absolute torques, inf for none, shape (n,).
        scale: Torque of each coordinate that counts as 1; by default the limits.
        intervals: Number of intervals N, at least 2.
        solver: "ipopt", or "fatrop", which makes use of the stages.
        max_iterations: Of the solver.

    Returns:
        The motion; where the status is not SOLVED it is where the solver stopped, and breaks limits or laws.

    Raises:
        InvalidValueError: for a wrong shape, NaN, an unknown solver, or a scale that is not finite.
    """
    first, last, duration = _states(start, goal, duration, intervals, solver, max_iterations)
    n = first.size // 2
    limits = np.asarray(torque_limits, dtype=float)
    unit = limits if scale is None else np.asarray(scale, dtype=float)
    if unit.shape != (n,) or not (np.isfinite(unit).all() and (unit > 0).all()):
        raise InvalidValueError("scale", unit, f"{n} finite torques above 0")
    problem = _Transcription(torque, (first, last), duration / intervals, intervals, bounds, limits, unit)
    options = _options(solver, max_iterations)
    if solver == "fatrop":
        options |= {"equality": problem.equality, "structure_detection": "auto"}
    return problem.solve(solver, options)


def _states(
    start: tuple[ArrayLike, ArrayLike],
    goal: tuple[ArrayLike, ArrayLike],
    duration: float,
    intervals: int,
    solver: str,
    max_iterations: int,
) -> tuple[FloatArray, FloatArray, float]:
    """Return start and goal as one vector of positions and velocities each, shape (2 n,), and the duration.

    Args:
        start: First position and velocity, shape (n,) each.
        goal: Last position and velocity, shape (n,) each.
        duration: Duration [s].
        intervals: Number of intervals, 2 or more.
        solver: A name of `SOLVERS`.
        max_iterations: 1 or more.

    Raises:
        InvalidValueError: for an argument that is not allowed.
    """
    if solver not in SOLVERS:
        raise InvalidValueError("solver", repr(solver), f"one of {', '.join(map(repr, SOLVERS))}")
    for name, value, least in (("intervals", intervals, 2), ("max_iterations", max_iterations, 1)):
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise InvalidValueError(name, value, f"a whole number of at least {least}")
    q = finite_vector("start position", start[0])
    first = np.concatenate([q, finite_vector("start velocity", start[1], q.size)])
    last = [finite_vector("goal position", goal[0], q.size), finite_vector("goal velocity", goal[1], q.size)]
    return first, np.concatenate(last), positive_number("duration", duration)


def _options(solver: str, max_iterations: int) -> dict[str, Any]:
    common: dict[str, Any] = {"print_time": False, "error_on_fail": False}
    if solver == "ipopt":
        return common | {
            "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": max_iterations,
            "ipopt.tol": _TOLERANCE,
        }  # fmt: skip
    return common | {"fatrop.print_level": 0, "fatrop.max_iter": max_iterations, "fatrop.tol": _TOLERANCE}


class _Transcription:
    """Variables x_0, j_0, x_1, ..., x_N with x = (q, v, a), and constraints stage by stage."""

    def __init__(
        self, torque: Any, ends: tuple[FloatArray, FloatArray], h: float, intervals: int, bounds: Bounds,
        limits: FloatArray, unit: FloatArray,
    ) -> None:  # fmt: skip
        import casadi

        first, last = ends

        self._n, self._h, self._intervals = first.size // 2, h, intervals
        self._first, self._last = first, last
        n, far = self._n, np.full(self._n, np.inf)
        states = [casadi.MX.sym(f"x{k}", 3 * n) for k in range(intervals + 1)]
        jerks = [casadi.MX.sym(f"j{k}", n) for k in range(intervals)]
        low = np.concatenate([bounds.lower, -bounds.velocity, -bounds.acceleration])
        high = np.concatenate([bounds.upper, bounds.velocity, bounds.acceleration])
        self._constraints: list[tuple[Any, FloatArray, FloatArray]] = []
        self.equality: list[bool] = []
        bounded = np.flatnonzero(np.isfinite(limits)).tolist()
        stage = self._stage(torque, bounded, limits, unit)
        self._cost: Any = 0.0
        zero = np.zeros(3 * n)
        for k in range(intervals):
            following, cost, shares = stage(states[k], jerks[k])
            self._cost += cost
            self._require(states[k + 1] - following, zero, zero)
            if k == 0:
                self._require(states[0][: 2 * n], first, first)
            if bounded:
                self._require(shares, -np.ones(2 * len(bounded)), np.ones(2 * len(bounded)))
        self._require(states[-1][: 2 * n], last, last)
        parts = [part for pair in zip(states, jerks, strict=False) for part in pair]
        self._variables = casadi.vertcat(*parts, states[-1])
        self._low = np.concatenate([*[np.concatenate([low, -far])] * intervals, low])
        self._high = np.concatenate([*[np.concatenate([high, far])] * intervals, high])
        # Start and goal are equations: bounds in the same place would be so, too, and are left out.
        self._low[: 2 * n], self._high[: 2 * n] = -np.inf, np.inf
        self._low[-3 * n : -n], self._high[-3 * n : -n] = -np.inf, np.inf

    def solve(self, solver: str, options: dict[str, Any]) -> EffortMotion:
        """Solve from the straight line at cubic speed."""
        import casadi

        constraints = casadi.vertcat(*(c for c, _, _ in self._constraints))
        low = np.concatenate([low for _, low, _ in self._constraints])
        high = np.concatenate([high for _, _, high in self._constraints])
        nlp = {"x": self._variables, "f": self._cost, "g": constraints}
        solve = casadi.nlpsol("effort", solver, nlp, options)
        begin = time.perf_counter()
        found = solve(x0=self._guess(), lbx=self._low, ubx=self._high, lbg=low, ubg=high)
        spent = time.perf_counter() - begin
        report = solve.stats()
        x, g = np.array(found["x"]).ravel(), np.array(found["g"]).ravel()
        violations = [low - g, g - high, self._low - x, x - self._high]
        violation = float(max(part.max(initial=0.0) for part in violations))
        n, count = self._n, self._intervals
        rows = np.concatenate([x, np.zeros(n)]).reshape(count + 1, 4 * n)
        times = np.linspace(0.0, count * self._h, count + 1)
        q, v, a = (read_only(rows[:, i * n : (i + 1) * n].copy()) for i in range(3))
        word = str(report.get("return_status", report.get("unified_return_status", "")))
        status = _status(bool(report.get("success")), word, str(report.get("unified_return_status", "")))
        cost, iterations = float(found["f"]), int(report.get("iter_count", -1))
        return EffortMotion(status, read_only(times), q, v, a, cost, iterations, violation, spent, word)

    def _require(self, expression: Any, low: FloatArray, high: FloatArray) -> None:
        self._constraints.append((expression, low, high))
        self.equality += [bool(a == b) for a, b in zip(low, high, strict=True)]

    def _stage(self, torque: Any, bounded: list[int], limits: FloatArray, unit: FloatArray) -> Any:
        """Return the function (x, j) -> next x, cost of the interval, shares of the limits at both points."""
        import casadi

        n, h = self._n, self._h
        x, j = casadi.SX.sym("x", 3 * n), casadi.SX.sym("j", n)

        def after(t: float) -> tuple[Any, Any, Any]:
            q, v, a = x[:n], x[n : 2 * n], x[2 * n :]
            position = q + t * v + t**2 / 2 * a + t**3 / 6 * j
            return position, v + t * a + t**2 / 2 * j, a + t * j

        torques = [torque(*after(point * h)) for point in _GAUSS]
        cost = sum(h / 2 * casadi.sumsqr(tau / unit) for tau in torques)
        shares = casadi.vertcat(*(tau[bounded] / limits[bounded] for tau in torques))
        return casadi.Function("stage", [x, j], [casadi.vertcat(*after(h)), cost, shares])

    def _guess(self) -> FloatArray:
        n, s = self._n, np.linspace(0.0, 1.0, self._intervals + 1)[:, None]
        total = self._intervals * self._h
        way = self._last[:n] - self._first[:n]
        q = self._first[:n] + (3 * s**2 - 2 * s**3) * way
        v, a = 6 * (s - s**2) * way / total, (6 - 12 * s) * way / total**2
        jerk = np.tile(-12 * way / total**3, (len(s), 1))
        return np.concatenate([q, v, a, jerk], axis=1).ravel()[:-n]


def _status(success: bool, word: str, unified: str) -> EffortStatus:
    if success:
        return EffortStatus.SOLVED
    if "nfeasib" in word or "INFEASIBLE" in unified:
        return EffortStatus.INFEASIBLE
    if "LIMITED" in unified or "Maximum_Iterations" in word:
        return EffortStatus.OUT_OF_ITERATIONS
    return EffortStatus.FAILED
