"""A motion stage by stage, as general solvers take it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..vectors import FloatArray
from .assembly import Objective
from .rows import BarrierBound, Term

if TYPE_CHECKING:
    from .term_callback import TermCallback

_TOLERANCE = 1e-6
_SHORTEST = 1e-3  # durations


class Stages:
    """Variables x_0, j_0, x_1, ..., x_M with x = (p, d, e, T), and constraints stage by stage.

    Args:
        objective: Costs and bounds.
        constraints: Terms that take the place of the objective's constraints.
        unknowns: Control points to start from, shape (size, n).
        duration: Duration to start from.
        free_duration: Whether the duration may change.
    """

    def __init__(
        self, objective: Objective, constraints: list[Term], unknowns: FloatArray, duration: float,
        free_duration: bool,
    ) -> None:  # fmt: skip
        import casadi

        self._objective, self._guess_of = objective, (unknowns, duration)
        n, count = objective.spline.n, objective.spline.intervals
        self._n, self._count = n, count
        self.states = [casadi.MX.sym(f"x{k}", 3 * n + 1) for k in range(count + 1)]
        self.jerks = [casadi.MX.sym(f"j{k}", n) for k in range(count)]
        self._constraints: list[tuple[Any, FloatArray, FloatArray]] = []
        self._equality: list[bool] = []
        self._callbacks: list[TermCallback] = []  # CasADi does not keep them alive
        values = [self._values(term) for term in constraints]
        self._cost: Any = objective.weights.time * self.states[0][-1]
        for weight, term in objective.costs:
            value = self._values(term)
            share = weight / (count * term.per_interval)
            self._cost += sum(
                share * x[-1] * casadi.sumsqr(v) for x, v in zip(self.states, value, strict=False)
            )
        weights = objective.weights.jerk / objective.weights.jerk_scale**2
        for x, jerk in zip(self.states, self.jerks, strict=False):
            self._cost += casadi.sum1(weights * jerk**2) / (x[-1] / count) ** 5
        start = np.concatenate([objective.spline.start, np.zeros(2 * n)])
        for k in range(count):
            self._require(self.states[k + 1] - self._following(k), np.zeros(3 * n + 1), np.zeros(3 * n + 1))
            if k == 0:
                self._require(self.states[0][: 3 * n], start, start)
                if not free_duration:
                    self._require(self.states[0][-1], np.array([duration]), np.array([duration]))
            self._bound(k)
            for term, rows in zip(constraints, values, strict=True):
                low = -1.0 if term.barrier_bound is BarrierBound.WITHIN_ONE else 0.0
                high = 1.0 if term.barrier_bound is BarrierBound.WITHIN_ONE else np.inf
                size = rows[k].numel()
                self._require(casadi.vec(rows[k]), np.full(size, low), np.full(size, high))
        goal = np.concatenate([objective.spline.goal, np.zeros(2 * n)])
        self._require(self.states[-1][: 3 * n], goal, goal)

    def solve(
        self, solver: str, max_iterations: int, timeout: float, reach: float
    ) -> tuple[FloatArray, float, dict[str, Any]]:
        """Return unknowns, duration and the solver's report.

        Args:
            solver: "ipopt" or "fatrop".
            max_iterations: Of the solver.
            timeout: Wall time [s], for ipopt.
            reach: How far positions at knots may go from where they start.
        """
        import casadi

        options: dict[str, Any] = {
            "print_time": False, "error_on_fail": False, f"{solver}.print_level": 0,
            f"{solver}.max_iter": max_iterations, f"{solver}.tol": _TOLERANCE,
        }  # fmt: skip
        if solver == "ipopt":
            options |= {"ipopt.sb": "yes", "ipopt.mu_init": 1e-2, "ipopt.max_wall_time": min(timeout, 1e6)}
        else:
            options |= {"structure_detection": "auto", "equality": self._equality}
        low, high = (np.concatenate([row[i] for row in self._constraints]) for i in (1, 2))
        parts = [part for pair in zip(self.states, self.jerks, strict=False) for part in pair]
        inputs = casadi.vertcat(*parts, self.states[-1])
        g = casadi.vertcat(*(row[0] for row in self._constraints))
        run = casadi.nlpsol("motion", solver, {"x": inputs, "f": self._cost, "g": g}, options)
        guess = self._guess()
        near = np.full(inputs.numel(), np.inf)
        for i in range(self._n):
            near[i :: 4 * self._n + 1] = reach
        least = guess - near
        least[3 * self._n :: 4 * self._n + 1] = _SHORTEST
        found = run(x0=guess, lbx=least, ubx=guess + near, lbg=low, ubg=high)
        return (*self._answer(np.array(found["x"]).ravel()), run.stats())

    def _split(self, k: int) -> tuple[Any, Any, Any, Any]:
        n, x = self._n, self.states[k]
        return x[:n], x[n : 2 * n], x[2 * n : 3 * n], x[-1] / self._count

    def _following(self, k: int) -> Any:
        import casadi

        (p, d, e, _), j = self._split(k), self.jerks[k]
        return casadi.vertcat(p + d + e / 2 + j / 6, d + e + j / 2, e + j, self.states[k][-1])

    def _bound(self, k: int) -> None:
        """Require the control points of the spline and of its rates to be within bounds."""
        (p, d, e, h), bounds = self._split(k), self._objective.bounds
        if 2 <= k <= self._count - 2:
            places = np.flatnonzero(np.isfinite(bounds.lower) | np.isfinite(bounds.upper)).tolist()
            if places:
                self._require((p - e / 6)[places], bounds.lower[places], bounds.upper[places])
        rates = ((d + e / 2) / h, bounds.velocity), (e / h**2, bounds.acceleration)
        for rate, limit in rates if k else rates[:1]:
            places = np.flatnonzero(np.isfinite(limit)).tolist()
            if places:
                one = np.ones(len(places))
                self._require(rate[places] / limit[places], -one, one)

    def _values(self, term: Any) -> list[Any]:
        """Return a term's values at the samples of each interval."""
        import casadi

        from .term_callback import TermCallback

        states: list[list[Any]] = [[], [], []]
        for k in range(self._count):
            (p, d, e, h), j = self._split(k), self.jerks[k]
            for i in range(term.per_interval):
                s = i / term.per_interval
                states[0].append(p + s * d + s**2 / 2 * e + s**3 / 6 * j)
                states[1].append((d + s * e + s**2 / 2 * j) / h)
                states[2].append((e + s * j) / h**2)
        call = TermCallback(term, self._n, len(states[0]))
        self._callbacks.append(call)
        values = call(*(casadi.horzcat(*part) for part in states))
        return list(casadi.horzsplit(values, term.per_interval))

    def _require(self, expression: Any, low: FloatArray, high: FloatArray) -> None:
        self._constraints.append((expression, low, high))
        self._equality += [bool(a == b) for a, b in zip(low, high, strict=True)]

    def _guess(self) -> FloatArray:
        unknowns, t = self._guess_of
        h, spline = t / self._count, self._objective.spline
        segments = (
            spline.segments(unknowns, t)[1] * (h ** np.arange(4) * np.array([1, 1, 2, 6]))[None, :, None]
        )
        rows = np.zeros((self._count + 1, 4 * self._n + 1))
        rows[:-1, : 3 * self._n] = segments[:, :3].reshape(self._count, -1)
        rows[:-1, 3 * self._n + 1 :] = segments[:, 3]
        rows[-1, : self._n], rows[:, 3 * self._n] = spline.goal, t
        return np.asarray(rows.ravel()[: -self._n])

    def _answer(self, x: FloatArray) -> tuple[FloatArray, float]:
        n, count = self._n, self._count
        rows = np.concatenate([x, np.zeros(n)]).reshape(count + 1, 4 * n + 1)
        knots = rows[2 : count - 1]
        return np.array(knots[:, :n] - knots[:, 2 * n : 3 * n] / 6), float(rows[0, 3 * n])
