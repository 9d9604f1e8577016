"""Motions from rest to rest as B-splines whose control points are the unknowns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError

from ..vectors import FloatArray, finite_points, finite_vector, read_only

_DEGREES = (3, 5)


@dataclass(frozen=True, eq=False)
class RestSpline:
    """All splines of one degree and number of intervals that start and end at rest.

    On 0 <= s <= 1, with clamped uniform knots,

        q(s) = sum_i c_i N_i(s),    i = 0 ... M + p - 1,

    where p is the degree and M the number of intervals.  The first and the last three control points are
    start and goal, which makes velocity and acceleration vanish at both ends; the others are the unknowns.
    Each derivative is a spline again, whose control points are differences of the control points c (C. de
    Boor, A Practical Guide to Splines, 1978), and a spline never leaves the hull of its control points:
    limits that control points keep hold everywhere.  For degree 3, control points of the acceleration are
    its values at knots.

    Attributes:
        start: First state, shape (n,).
        goal: Last state, shape (n,).
        intervals: Number M of intervals, at least 4.
        degree: Degree p, 3 or 5.
    """

    start: FloatArray
    goal: FloatArray
    intervals: int = 20
    degree: int = 3

    def __post_init__(self) -> None:
        """Copy and check the fields.

        Raises:
            InvalidValueError: for vectors that are not finite or differ in length, fewer than 4 intervals, or
                a degree that is neither 3 nor 5.
        """
        start = finite_vector("start", self.start)
        object.__setattr__(self, "start", start)
        object.__setattr__(self, "goal", finite_vector("goal", self.goal, start.size))
        if self.degree not in _DEGREES:
            raise InvalidValueError("degree", self.degree, "3 or 5")
        if isinstance(self.intervals, bool) or not isinstance(self.intervals, int) or self.intervals < 4:
            raise InvalidValueError("intervals", self.intervals, "a whole number of at least 4")

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return int(self.start.size)

    @property
    def size(self) -> int:
        """Number of unknown control points, M + p - 6."""
        return self.intervals + self.degree - 6

    @property
    def knots(self) -> FloatArray:
        """Clamped uniform knots, shape (M + 2 p + 1,)."""
        return _knots(self.intervals, self.degree)

    def control_points(self, unknowns: ArrayLike) -> FloatArray:
        """Return all control points, shape (M + p, n), given the unknown ones, shape (size, n)."""
        return np.concatenate([np.tile(self.start, (3, 1)), unknowns, np.tile(self.goal, (3, 1))])

    def difference(self, order: int) -> FloatArray:
        """Return the matrix from control points to the control points of a derivative by s.

        Args:
            order: Order of the derivative, 0 to the degree.

        Returns:
            Matrix, shape (M + p - order, M + p).
        """
        return differences(self.intervals, self.degree)[order]

    def basis(self, s: ArrayLike, order: int = 0) -> FloatArray:
        """Return the weights of the control points in a derivative by s.

        Args:
            s: Parameters within [0, 1], shape (k,).
            order: Order of the derivative, 0 to the degree.

        Returns:
            Weights, shape (k, M + p); in each row only p + 1 successive weights differ from zero.
        """
        return basis_at(np.asarray(s, dtype=float), self.intervals, self.degree, order)

    def fit(self, states: ArrayLike, smoothness: float = 0.0) -> FloatArray:
        """Return the unknowns whose spline is nearest, in least squares, to states at equidistant parameters.

        Args:
            states: States, shape (k, n), k at least twice the number of intervals; the first and the last one
                are replaced by start and goal.
            smoothness: Weight of the sum of the squared control points of the third derivative by s times the
                number of intervals, relative to the mean squared distance to the states: more cuts corners.

        Returns:
            Unknown control points, shape (size, n).

        Raises:
            InvalidValueError: for too few states, or other than finite numbers.
        """
        points = finite_points("states", states, self.n)
        if len(points) < 2 * self.intervals:
            raise InvalidValueError("states", f"{len(points)} of them", f"at least {2 * self.intervals}")
        weights, inverse, pull = _fit(self.intervals, self.degree, len(points), smoothness)
        ends = self.control_points(np.zeros((self.size, self.n)))
        return np.asarray(inverse @ (points - weights @ ends) - pull @ ends)

    def segments(self, unknowns: ArrayLike, duration: float) -> tuple[FloatArray, FloatArray]:
        """Return the motion over time as piecewise polynomials.

        Args:
            unknowns: Unknown control points, shape (size, n).
            duration: Duration T; time is t = T s.

        Returns:
            Breaks, shape (M + 1,), and coefficients in powers of the time since the last break, constant
            term first, shape (M, p + 1, n).
        """
        control = self.control_points(unknowns)
        factorial, terms = 1.0, []
        for order, weights in enumerate(_at_knots(self.intervals, self.degree)):
            factorial *= max(order, 1)
            terms.append(weights @ control / (factorial * duration**order))
        breaks = np.linspace(0.0, 1.0, self.intervals + 1) * duration
        return read_only(breaks), read_only(np.stack(terms, axis=1))


@lru_cache(maxsize=64)
def differences(intervals: int, degree: int) -> tuple[FloatArray, ...]:
    """Return the matrices from control points to the control points of all derivatives by s."""
    count, knots = intervals + degree, _knots(intervals, degree)
    matrices = [np.eye(count)]
    for order in range(1, degree + 1):
        left = below = degree - order + 1
        inner = knots[order - 1 : knots.size - order + 1]
        span = inner[left + 1 : left + 1 + len(matrices[-1]) - 1] - inner[1 : len(matrices[-1])]
        matrices.append(np.diff(matrices[-1], axis=0) * (below / span)[:, None])
    return tuple(read_only(matrix) for matrix in matrices)


def basis_at(s: FloatArray, intervals: int, degree: int, order: int) -> FloatArray:
    """Return the weights of control points in a derivative by s; see `RestSpline.basis`."""
    return _values(s, intervals, degree - order) @ differences(intervals, degree)[order]


@lru_cache(maxsize=16)
def _fit(intervals: int, degree: int, count: int, smoothness: float) -> tuple[FloatArray, ...]:
    """Return W, P and R such that P (x - W e) - R e are the inner control points nearest to states x.

    W holds the weights of control points at equidistant parameters, e the control points at the ends.
    """
    weights = basis_at(np.linspace(0.0, 1.0, count), intervals, degree, 0)
    rough = differences(intervals, degree)[3] / intervals**3 * np.sqrt(smoothness * count)
    inverse = np.linalg.pinv(np.vstack([weights, rough])[:, 3:-3])
    inner, outer = inverse[:, :count], inverse[:, count:] @ rough
    return read_only(weights), read_only(inner), read_only(outer)


@lru_cache(maxsize=16)
def _at_knots(intervals: int, degree: int) -> tuple[FloatArray, ...]:
    """Return the weights of control points in all derivatives by s at the starts of the intervals."""
    left = np.arange(intervals) / intervals
    return tuple(read_only(basis_at(left, intervals, degree, order)) for order in range(degree + 1))


def _knots(intervals: int, degree: int) -> FloatArray:
    """Return clamped uniform knots, shape (M + 2 p + 1,)."""
    inner = np.linspace(0.0, 1.0, intervals + 1)
    return np.concatenate([np.zeros(degree), inner, np.ones(degree)])


def _values(s: FloatArray, intervals: int, degree: int) -> FloatArray:
    """Return the B-splines of one degree at s, shape (k, M + p): the recursion of Cox and de Boor."""
    knots = _knots(intervals, degree)
    interval = np.clip((s * intervals + 1e-9).astype(int), 0, intervals - 1)
    rows = np.arange(s.size)
    values = np.zeros((s.size, knots.size - 1))
    values[rows, degree + interval] = 1.0
    for p in range(1, degree + 1):
        count = knots.size - 1 - p
        rise, fall = knots[p : p + count] - knots[:count], knots[p + 1 :] - knots[1 : count + 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            up = np.where(rise > 0, (s[:, None] - knots[:count]) / rise, 0.0)
            down = np.where(fall > 0, (knots[p + 1 :] - s[:, None]) / fall, 0.0)
        values = up * values[:, :count] + down * values[:, 1 : count + 1]
    return values
