"""Cubic splines stage by stage, for CasADi's solvers; loads CasADi."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import casadi
import numpy as np

from ..vectors import FloatArray
from .assembly import Bounds, Objective
from .rows import BarrierBound, Rows, Term

_SHORTEST = 1e-3  # minimum duration, in the unit of the initial one
_GAUSS = (0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0)


class Solved(NamedTuple):
    """Solution of a solver: p, d, e (and T) at the knots, row by row, cost, violation, time and report."""

    rows: FloatArray
    cost: float
    violation: float
    wall_time: float
    report: dict[str, Any]


class Stages:
    """Variables x_0, j_0, x_1, ..., x_M of a spline, and their constraints, stage by stage.

    Interval k is p + t d + t^2 e / 2 + t^3 j / 6, 0 <= t <= u, so that from stage to stage

        p' = p + u d + u^2 e / 2 + u^3 j / 6,   d' = d + u e + u^2 j / 2,   e' = e + u j.

    With a fixed time h of each interval u = h, and d and e are velocity and acceleration.  With a free
    duration T, which is a part of the state, T' = T, u = 1, and velocity and acceleration are d / h and
    e / h^2, h = T / M, so that the equations remain linear.

    Args:
        n: Number of coordinates.
        count: Number M of intervals.
        interval: Time h of each interval [s]; None for a free duration.
    """

    def __init__(self, n: int, count: int, interval: float | None = None) -> None:
        self.n, self.count, self.timed, self.step = n, count, interval is None, interval or 1.0
        self.states = [casadi.MX.sym(f"x{k}", 3 * n + self.timed) for k in range(count + 1)]
        self.jerks = [casadi.MX.sym(f"j{k}", n) for k in range(count)]
        self.cost: Any = 0.0
        self._required: list[tuple[Any, FloatArray, FloatArray]] = []
        self._kept: list[Any] = []  # references, since CasADi does not keep Python functions alive

    def split(self, x: Any) -> tuple[Any, Any, Any, Any]:
        """Return p, d and e of a state, and the unit of time of d and e."""
        n = self.n
        return x[:n], x[n : 2 * n], x[2 * n : 3 * n], x[-1] / self.count if self.timed else 1.0

    def motion(self, x: Any, j: Any, share: float) -> tuple[Any, Any, Any]:
        """Return position, velocity and acceleration at a fraction of an interval with a state and a jerk."""
        (p, d, e, h), t = self.split(x), share * self.step
        return p + t * d + t**2 / 2 * e + t**3 / 6 * j, (d + t * e + t**2 / 2 * j) / h, (e + t * j) / h**2

    def join(self, k: int) -> None:
        """Require interval k to end in the next state."""
        x, j, u = self.states[k], self.jerks[k], self.step
        p, d, e, _ = self.split(x)
        p, d, e = p + u * d + u**2 / 2 * e + u**3 / 6 * j, d + u * e + u**2 / 2 * j, e + u * j
        self.require(self.states[k + 1] - casadi.vertcat(p, d, e, x[3 * self.n :]), 0.0, 0.0)

    def require(self, expression: Any, low: FloatArray | float, high: FloatArray | float) -> None:
        """Require an expression to stay between two vectors, or numbers."""
        size = (expression.numel(),)
        self._required.append((expression, np.broadcast_to(low, size), np.broadcast_to(high, size)))

    def sampled(self, term: Term) -> list[Any]:
        """Return the values of a term at the samples of each interval, shape (R, samples) each."""
        per = term.per_interval
        places = [(x, j, i / per) for x, j in zip(self.states, self.jerks, strict=False) for i in range(per)]
        states = zip(*(self.motion(*place) for place in places), strict=True)
        call = _TermValues(term, self.n, len(places))
        self._kept.append(call)
        return list(casadi.horzsplit(call(*(casadi.horzcat(*part) for part in states)), per))

    def solve(
        self, solver: str, options: dict[str, Any], guess: FloatArray, low: FloatArray, high: FloatArray
    ) -> Solved:
        """Solve.

        Args:
            solver: "ipopt" or "fatrop".
            options: Options of the solver.
            guess: Initial state and jerk of each knot, shape (M + 1, 3 n + n), or one column more for T; the
                last jerk does not count.
            low: Minimum values, same shape as `guess`.
            high: Maximum values, same shape as `guess`.
        """
        n = self.n
        expressions, least, most = zip(*self._required, strict=True)
        low_g, high_g = np.concatenate(least), np.concatenate(most)
        settings: dict[str, Any] = {"print_time": False, "error_on_fail": False, f"{solver}.print_level": 0}
        if solver == "ipopt":
            settings |= {"ipopt.sb": "yes"}
        else:
            settings |= {"structure_detection": "auto", "equality": (low_g == high_g).tolist()}
        settings |= {f"{solver}.{name}": value for name, value in options.items()}
        parts = [part for pair in zip(self.states, self.jerks, strict=False) for part in pair]
        nlp = {
            "x": casadi.vertcat(*parts, self.states[-1]), "f": self.cost, "g": casadi.vertcat(*expressions),
        }  # fmt: skip
        run = casadi.nlpsol("motion", solver, nlp, settings)
        start, low_x, high_x = (part.ravel()[:-n] for part in (guess, low, high))
        begin = time.perf_counter()
        found = run(x0=start, lbx=low_x, ubx=high_x, lbg=low_g, ubg=high_g)
        spent = time.perf_counter() - begin
        x, g = np.array(found["x"]).ravel(), np.array(found["g"]).ravel()
        violation = max(
            float(part.max(initial=0.0)) for part in (low_g - g, g - high_g, low_x - x, x - high_x)
        )
        rows = np.concatenate([x, np.zeros(n)]).reshape(guess.shape)
        return Solved(rows[:, :-n], float(found["f"]), violation, spent, run.stats())


def solve_spline(
    objective: Objective, constraints: list[Term], x: FloatArray, t: float, free_duration: bool, solver: str,
    options: dict[str, Any], reach: float,
) -> tuple[FloatArray, float, dict[str, Any]]:  # fmt: skip
    """Solve the problem of `descend`: bounds of control points, and terms at samples.

    Args:
        objective: Costs and bounds.
        constraints: Terms that replace the objective's constraints.
        x: Control points to start from, shape (size, n).
        t: Duration to start from.
        free_duration: Whether the duration may change.
        solver: "ipopt" or "fatrop".
        options: Options of the solver.
        reach: Maximum change of positions at knots.

    Returns:
        Control points, duration and the solver's report.
    """
    spline, bounds = objective.spline, objective.bounds
    n, count = spline.n, spline.intervals
    stages = Stages(n, count)
    first, values = stages.states[0], [stages.sampled(term) for term in constraints]
    stages.cost = objective.weights.time * first[-1]
    for weight, term in objective.costs:
        share = weight / (count * term.per_interval)
        for state, value in zip(stages.states, stages.sampled(term), strict=False):
            stages.cost += share * state[-1] * casadi.sumsqr(value)
    for state, jerk in zip(stages.states, stages.jerks, strict=False):
        weights = objective.weights.jerk / objective.weights.jerk_scale**2
        stages.cost += casadi.sum1(weights * jerk**2) / (state[-1] / count) ** 5
    start, goal = (np.concatenate([q, np.zeros(2 * n)]) for q in (spline.start, spline.goal))
    boxed = np.flatnonzero(np.isfinite(bounds.lower) | np.isfinite(bounds.upper)).tolist()
    for k, state in enumerate(stages.states[:-1]):
        stages.join(k)
        if k == 0:
            stages.require(state[: 3 * n], start, start)
            if not free_duration:
                stages.require(state[-1], t, t)
        p, d, e, h = stages.split(state)
        if 2 <= k <= count - 2 and boxed:
            stages.require((p - e / 6)[boxed], bounds.lower[boxed], bounds.upper[boxed])
        rates = ((d + e / 2) / h, bounds.velocity), (e / h**2, bounds.acceleration)
        for rate, limit in rates if k else rates[:1]:
            places = np.flatnonzero(np.isfinite(limit)).tolist()
            if places:
                stages.require(rate[places] / limit[places], -1.0, 1.0)
        for term, rows in zip(constraints, values, strict=True):
            within = term.barrier_bound is BarrierBound.WITHIN_ONE
            stages.require(casadi.vec(rows[k]), -1.0 if within else 0.0, 1.0 if within else np.inf)
    stages.require(stages.states[-1][: 3 * n], goal, goal)
    powers = (t / count) ** np.arange(4) * np.array([1, 1, 2, 6])
    segments = spline.segments(x, t)[1] * powers[None, :, None]
    guess = np.zeros((count + 1, 4 * n + 1))
    guess[:-1, : 3 * n] = segments[:, :3].reshape(count, -1)
    guess[:-1, 3 * n + 1 :] = segments[:, 3]
    guess[-1, :n], guess[:, 3 * n] = spline.goal, t
    near = np.full(guess.shape, np.inf)
    near[:, :n] = reach
    low = guess - near
    low[:, 3 * n] = _SHORTEST
    found = stages.solve(solver, options, guess, low, guess + near)
    knots = found.rows[2 : count - 1]
    return knots[:, :n] - knots[:, 2 * n : 3 * n] / 6, float(found.rows[0, 3 * n]), found.report


def solve_effort(
    torque: Any, ends: tuple[FloatArray, FloatArray], duration: float, bounds: Bounds,
    torques: tuple[FloatArray, FloatArray], intervals: int, solver: str, options: dict[str, Any],
) -> Solved:  # fmt: skip
    """Solve the problem of `minimum_effort` from the straight line at cubic speed.

    Args:
        torque: CasADi function of q, v and a.
        ends: First and last positions and velocities, shape (2 n,) each.
        duration: Duration [s].
        bounds: Limits of positions, velocities and accelerations.
        torques: Maximum absolute torques, and torques that count as 1, shape (n,) each.
        intervals: Number of intervals.
        solver: "ipopt" or "fatrop".
        options: Options of the solver.
    """
    (first, last), (limits, unit), n = ends, torques, ends[0].size // 2
    h, bounded = duration / intervals, np.flatnonzero(np.isfinite(limits)).tolist()
    stages = Stages(n, intervals, h)
    x, j = casadi.SX.sym("x", 3 * n), casadi.SX.sym("j", n)
    efforts = [torque(*stages.motion(x, j, share)) for share in _GAUSS]
    cost = sum(h / 2 * casadi.sumsqr(tau / unit) for tau in efforts)
    shares = casadi.vertcat(*(tau[bounded] / limits[bounded] for tau in efforts))
    stage = casadi.Function("stage", [x, j], [cost, shares])
    for k in range(intervals):
        cost, shares = stage(stages.states[k], stages.jerks[k])
        stages.cost += cost
        stages.join(k)
        if k == 0:
            stages.require(stages.states[0][: 2 * n], first, first)
        if bounded:
            stages.require(shares, -1.0, 1.0)
    stages.require(stages.states[-1][: 2 * n], last, last)
    high = np.concatenate([bounds.upper, bounds.velocity, bounds.acceleration, np.full(n, np.inf)])
    low = np.concatenate([bounds.lower, -high[n:]])
    low, high = np.tile(low, (intervals + 1, 1)), np.tile(high, (intervals + 1, 1))
    for k in (0, -1):  # start and goal are equations, so bounds on the same variables are dropped
        low[k, : 2 * n], high[k, : 2 * n] = -np.inf, np.inf
    s, way = np.linspace(0.0, 1.0, intervals + 1)[:, None], last[:n] - first[:n]
    q, v, a = (3 * s**2 - 2 * s**3) * way, 6 * (s - s**2) * way, (6 - 12 * s) * way
    guess = [first[:n] + q, v / duration, a / duration**2, np.tile(-12 * way / duration**3, (len(s), 1))]
    return stages.solve(solver, options, np.concatenate(guess, axis=1), low, high)


class _TermValues(casadi.Callback):
    """Values of a term, shape (R, K), at all samples at once, as a function of q, v and a, shape (n, K) each.

    The term supplies first derivatives; second derivatives count as zero, so that a solver's Hessian lacks
    the curvature of the term, and its steps are Gauss-Newton steps.

    Args:
        term: The term.
        n: Number of coordinates.
        count: Number K of samples.
    """

    def __init__(self, term: Term, n: int, count: int) -> None:
        super().__init__()
        self._term, self._n, self._count = term, n, count
        rows = term.rows(*np.zeros((3, count, n)))
        self._rows = rows.value.shape[1]
        self._blocks = [self._block(part is not None) for part in _parts(rows)]
        self._derivative: Any = None  # CasADi does not keep it alive
        self.construct("term", {})

    def _block(self, present: bool) -> Any:
        """Return the sparsity of a derivative: values depend on numbers of their own sample, or on none."""
        if not present:
            return casadi.Sparsity(self._rows * self._count, self._n * self._count)
        return casadi.diagcat(*[casadi.Sparsity.dense(self._rows, self._n)] * self._count)

    def get_n_in(self) -> int:
        return 3

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> Any:
        if i == 3:  # values, which derivatives do not need
            return casadi.Sparsity(self._rows, self._count)
        return casadi.Sparsity.dense(self._n, self._count)

    def get_sparsity_out(self, i: int) -> Any:
        return casadi.Sparsity.dense(self._rows, self._count)

    def eval(self, arguments: Any) -> Any:
        return [casadi.DM(self._term.values(*_states(arguments)).T)]

    def has_jac_sparsity(self, out: int, inputs: int) -> bool:
        return True

    def get_jac_sparsity(self, out: int, inputs: int, symmetric: bool) -> Any:
        return self._blocks[inputs]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(self, name: Any, inames: Any, onames: Any, options: Any) -> Any:
        self._derivative = _Slopes(self, name, options)
        return self._derivative


class _Slopes(_TermValues):
    """Derivatives of a term's values by q, v and a, one block per sample; second derivatives are zero."""

    def __init__(self, of: _TermValues, name: str, options: Any) -> None:
        casadi.Callback.__init__(self)
        self._term, self._n, self._count, self._rows = of._term, of._n, of._count, of._rows
        self._blocks = of._blocks
        self.construct(name, options)

    def get_n_in(self) -> int:
        return 4

    def get_n_out(self) -> int:
        return 3

    def get_sparsity_out(self, i: int) -> Any:
        return self._blocks[i]

    def eval(self, arguments: Any) -> Any:
        # Stored column by column: sample, coordinate, row.
        parts = _parts(self._term.rows(*_states(arguments[:3])))
        return [
            casadi.DM(block, np.zeros(0) if part is None else part.transpose(0, 2, 1).ravel())
            for part, block in zip(parts, self._blocks, strict=True)
        ]

    def get_jac_sparsity(self, out: int, inputs: int, symmetric: bool) -> Any:
        return casadi.Sparsity(self.sparsity_out(out).numel(), self.sparsity_in(inputs).numel())

    def get_jacobian(self, name: Any, inames: Any, onames: Any, options: Any) -> Any:
        shapes, outputs = [self.sparsity_in(i) for i in range(4)], [self.sparsity_out(i) for i in range(3)]
        inputs = [casadi.MX.sym(f"i{k}", shape) for k, shape in enumerate([*shapes, *outputs])]
        zeros = [casadi.MX(out.numel(), shape.numel()) for out in outputs for shape in shapes]
        self._derivative = casadi.Function(name, inputs, zeros, inames, onames, options)
        return self._derivative


def _states(arguments: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    q, v, a = (np.ascontiguousarray(np.array(part).T) for part in arguments)
    return q, v, a


def _parts(rows: Rows) -> tuple[FloatArray | None, FloatArray | None, FloatArray | None]:
    return rows.by_position, rows.by_velocity, rows.by_acceleration
