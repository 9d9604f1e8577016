"""Costs and constraints of a motion, as arrays for the compiled search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pepper_kin.kernels.tile_products import TILE_COLUMNS

from ..vectors import FloatArray
from .banded import PADDING
from .compiled_term import CalledBack, CompiledTerm
from .newton import measure_cost, measure_motion
from .rows import BarrierBound, Term, Weights
from .spline import RestSpline, basis_at, differences
from .tables import (
    ABOVE_ZERO,
    CONSTRAINT,
    COST,
    NUMBERS,
    ORDERS,
    WALLS,
    WITHIN_ONE,
    SplineTables,
    SplineWorkspace,
)

_FAR = 1e6


@dataclass(frozen=True, eq=False)
class Bounds:
    """Limits that hold at every instant, inf for none, shape (n,) each.

    Attributes:
        lower: Minimum positions.
        upper: Maximum positions.
        velocity: Maximum absolute velocities.
        acceleration: Maximum absolute accelerations.
        jerk: Maximum absolute jerks; None for no limits.
    """

    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray | None = None

    @property
    def rates(self) -> FloatArray:
        """Limits of velocity, acceleration and jerk, shape (3, n)."""
        jerk = np.full(len(self.lower), np.inf) if self.jerk is None else self.jerk
        return np.stack([self.velocity, self.acceleration, jerk])


@dataclass(frozen=True, eq=False)
class Sampling:
    """Samples of splines for one term: the same number in each interval.

    Attributes:
        per_interval: Number of samples in each interval.
        basis: Weights of all control points in derivatives by s, three of shape (K, C).
        local: Weights of the p + 1 control points of each sample's interval, shape (3, K, p + 1).
    """

    per_interval: int
    basis: tuple[FloatArray, ...]
    local: FloatArray

    def states(self, control: FloatArray, duration: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return positions, velocities and accelerations at the samples, shape (K, n) each."""
        b0, b1, b2 = self.basis
        return b0 @ control, b1 @ control / duration, b2 @ control / duration**2


@lru_cache(maxsize=64)
def _sampling(intervals: int, degree: int, per_interval: int) -> Sampling:
    """Return samples at equal steps of s, the first at the start of each interval."""
    count = intervals * per_interval
    s = np.arange(count) / count
    basis = tuple(basis_at(s, intervals, degree, order) for order in range(3))
    columns = np.arange(count)[:, None] // per_interval + np.arange(degree + 1)
    return Sampling(per_interval, basis, np.stack([np.take_along_axis(b, columns, axis=1) for b in basis]))


@lru_cache(maxsize=16)
def _jerk_band(intervals: int, degree: int) -> FloatArray:
    """Return the lower band of the matrix of the integral of the squared jerk, shape (C, p + 1)."""
    points, gauss = np.polynomial.legendre.leggauss(degree - 2)
    s = ((np.arange(intervals)[:, None] + (points + 1) / 2) / intervals).ravel()
    third = basis_at(s, intervals, degree, 3)
    third = third * np.sqrt(np.tile(gauss / 2, intervals) / intervals)[:, None]
    matrix = third.T @ third
    band = np.zeros((intervals + degree, degree + 1))
    for d in range(degree + 1):
        band[: len(band) - d, d] = np.diagonal(matrix, d)
    return band


@lru_cache(maxsize=16)
def _rate_rows(intervals: int, degree: int) -> FloatArray:
    """Return the rows of the matrices to control points of derivatives; see `SplineTables.rates`."""
    rows = np.zeros((ORDERS, intervals + degree, ORDERS + 1))
    for order in range(1, ORDERS + 1):
        matrix = differences(intervals, degree)[order]
        for k in range(order + 1):
            rows[order - 1, : len(matrix), k] = np.diagonal(matrix, k)[: len(matrix)]
    return rows


class Objective:
    """Cost plus barrier of a motion.

    Args:
        spline: The family of motions.
        bounds: Limits of positions and rates.
        weights: Weights of the costs.
        constraints: Terms whose values must stay within their barrier bound.
        costs: Pairs of a weight and a term; the cost is the weighted integral of the term's squared values.
    """

    def __init__(
        self,
        spline: RestSpline,
        bounds: Bounds,
        weights: Weights,
        constraints: Sequence[Term] = (),
        costs: Sequence[tuple[float, Term]] = (),
    ) -> None:
        self.spline, self.bounds, self.weights = spline, bounds, weights
        self.constraints = tuple(constraints)
        self.costs = tuple((weight, term) for weight, term in costs if weight > 0)
        terms = (*constraints, *(term for _, term in self.costs))
        kinds = sorted({term.per_interval for term in terms})
        self._samplings = {m: _sampling(spline.intervals, spline.degree, m) for m in kinds}
        self._called: list[CalledBack] = []
        compiled_terms = []
        for term in terms:
            if not isinstance(term, CompiledTerm):
                states = np.zeros((3, spline.intervals * term.per_interval, spline.n))
                states[0] = spline.start
                called = CalledBack(term, spline.n, states)
                self._called.append(called)
                term = called.compiled
            term.reserve(spline.intervals * term.per_interval)
            compiled_terms.append(term)
        shares = [CONSTRAINT] * len(self.constraints) + [weight for weight, _ in self.costs]
        self.tables = self._make_tables(compiled_terms, kinds, shares)
        self.workspace = self._make_workspace(compiled_terms)
        self._keep_alive = compiled_terms

    def samples(self, term: Term, control: FloatArray) -> FloatArray:
        """Return the positions at a term's samples, shape (K, n), of control points, shape (C, n)."""
        return self._samplings[term.per_interval].basis[0] @ control

    def states(
        self, term: Term, control: FloatArray, duration: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return positions, velocities and accelerations at a term's samples, shape (K, n) each."""
        return self._samplings[term.per_interval].states(control, duration)

    def measure(self, control: FloatArray, duration: float) -> tuple[float, float]:
        """Return the cost without barriers of control points, shape (C, n), and a duration, and the barrier.

        The barrier is the sum of -log(slack) over all limits and constraints.  If one is violated both are
        inf.
        """
        self.check(measure_motion(self.tables, self.workspace, np.ascontiguousarray(control), duration))
        numbers = self.workspace.numbers
        return float(numbers[COST]), float(numbers[WALLS])

    def cost(self, control: FloatArray, duration: float) -> float:
        """Return the cost without barriers; the motion may violate limits."""
        self.check(measure_cost(self.tables, self.workspace, np.ascontiguousarray(control), duration))
        return float(self.workspace.numbers[COST])

    def least_slack(self, control: FloatArray, duration: float) -> float:
        """Return the minimum slack to a limit of positions or rates, as a ratio of the limit."""
        measure_motion(self.tables, self.workspace, np.ascontiguousarray(control), duration)
        return float(self.workspace.slacks.min())

    def worst_slack(self, control: FloatArray, duration: float) -> tuple[float, int, int]:
        """Return the minimum slack as a ratio of its limit, the derivative's order, and the coordinate.

        Order 0 means positions.
        """
        share = self.least_slack(control, duration)
        slacks = self.workspace.slacks
        place = np.unravel_index(np.argmin(slacks), slacks.shape)
        return share, int(place[0]) // 2, int(place[2])

    def check(self, answered: bool) -> None:
        """Raise the exception of a term in Python, if a term has failed."""
        if not answered:
            for called in self._called:
                called.check()

    def _make_tables(
        self, terms: Sequence[CompiledTerm], kinds: list[int], shares: list[float]
    ) -> SplineTables:
        spline, bounds = self.spline, self.bounds
        samplings = [self._samplings[m] for m in kinds]
        counts = [(spline.intervals * m, m) for m in kinds]
        most = max((count for count, _ in counts), default=1)
        basis = np.zeros((max(len(kinds), 1), 3, most, spline.degree + 1))
        for place, sampling in enumerate(samplings):
            basis[place, :, : sampling.local.shape[1]] = sampling.local
        rows, first = [], 0
        for term in terms:
            place = kinds.index(term.per_interval)
            bound = WITHIN_ONE if term.barrier_bound is BarrierBound.WITHIN_ONE else ABOVE_ZERO
            rows.append(
                (term.address, term.memory.ctypes.data, place, term.rows_count, term.parts, bound, first,
                 int(term.has_floors))
            )  # fmt: skip
            first += counts[place][0] * term.rows_count * (1 + term.parts * spline.n)
        self._results = first
        finite = np.isfinite(bounds.upper - bounds.lower)
        lower, upper = np.maximum(bounds.lower, -_FAR), np.minimum(bounds.upper, _FAR)
        return SplineTables(
            basis,
            np.array(counts, np.int64).reshape(-1, 2),
            np.array(rows, np.int64).reshape(-1, 8),
            np.array(shares, float),
            _rate_rows(spline.intervals, spline.degree),
            1.0 / bounds.rates,
            np.stack([lower, upper, np.where(finite, bounds.upper - bounds.lower, _FAR)]),
            _jerk_band(spline.intervals, spline.degree),
            np.asarray(self.weights.jerk / self.weights.jerk_scale**2, float) * np.ones(spline.n),
            np.array([float(self.weights.time)]),
        )

    def _make_workspace(self, terms: Sequence[CompiledTerm]) -> SplineWorkspace:
        spline, basis = self.spline, self.tables.basis
        n, points, size = spline.n, spline.degree + 1, spline.size * spline.n
        count, rows = spline.intervals + spline.degree, sum(term.rows_count for term in terms)
        block = -(-n // TILE_COLUMNS) * TILE_COLUMNS
        return SplineWorkspace(
            np.empty((len(basis), 3 * basis.shape[2] * n)), np.empty(max(self._results, 1)),
            np.empty((2 + 2 * ORDERS, count, n)), np.empty((size + block, points * n + PADDING)),
            np.empty(size), np.empty(size), np.zeros((rows + 4, points * block)),
            np.zeros((rows + 4, points * block)), np.zeros((3, rows + 4 + block)),
            np.empty((4, block, block)), np.empty(size), np.empty(size), np.empty((count, n)),
            np.empty((count, n)),
            np.zeros(NUMBERS), np.zeros(2, np.int64),
        )  # fmt: skip
