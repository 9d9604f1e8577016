"""Limits on the rate of a smooth time law, as rows of linear programs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.timing.grid import coefficient_states
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.limits import LimitedQuantities, Limits
from pepper_kin.trajectory.path import CubicPath
from pepper_kin.trajectory.smooth_time import SmoothTime

_POINTS = (0.0, 1 / 3, 2 / 3, 1.0)  # of each piece, where limits are kept
_KEEP = 0.65  # share of a limit from which on its row is given to the program at first
_ROUNDS = 6  # programs with rows added that the last one had exceeded
_EXCESS = 1e-7
_LONGEST = 5.0  # [s] for one program, which takes some milliseconds; then the last y is kept


@dataclass(frozen=True, eq=False)
class Rows:
    """Limits at P points on y, whose spline has K + 2 coefficients, three of which act at each point.

    Attributes:
        first: First of the three coefficients at each point, shape (P,).
        basis: Values, first and second derivatives of the three basis functions, shape (3, P, 3).
        linear: Gains on y and y' of quantities that must stay within +-1 (or below 1), shape (P, r, 2).
        offset: Their value at rest, shape (P, r).
        one_sided: Whether only the upper bound counts, shape (r,).
        greatest: Greatest y at each point, shape (P,).
        jerk: Gains on y, y' and y'' of jerk over its limit and sqrt(y), shape (P, j, 3), for the j
            joints with a limit.
        weight: Of each point in integrals over tau, shape (P,).
        to_powers: Gains of the three coefficients on y, y' and y'' at the start of each piece, (K, 3, 3).
    """

    first: NDArray[np.intp]
    basis: Array
    linear: Array
    offset: Array
    one_sided: NDArray[np.bool_]
    greatest: Array
    jerk: Array
    weight: Array
    to_powers: Array

    def duration(self, y: Array) -> float:
        """Return the duration of the motion [s] for coefficients of y, shape (K + 2,), by the 3/8 rule."""
        return float(np.sum(self.weight / np.sqrt(self._at(y)[0])))

    def polynomials(self, y: Array) -> tuple[Array, Array, Array]:
        """Return y, y' and y'' at the start of each piece, shape (K,) each."""
        segments = np.arange(self.to_powers.shape[0])
        at = np.einsum("kdc,kc->dk", self.to_powers, y[segments[:, None] + np.arange(3)])
        return at[0], at[1], at[2]

    def can_rest(self) -> bool:
        """Whether the robot can stand still at every point."""
        low = np.where(self.one_sided, -np.inf, -1.0)
        return bool(np.all((self.offset < 1) & (self.offset > low)))

    def greatest_even_rate(self) -> float:
        """Return the greatest constant y that keeps all limits."""
        gain, rest = self.linear[..., 0], self.offset
        with np.errstate(divide="ignore", invalid="ignore"):
            upper = np.where(gain > 0, (1 - rest) / gain, np.inf)
            lower = np.where((gain < 0) & ~self.one_sided, (-1 - rest) / gain, np.inf)
            jerk = np.abs(self.jerk[..., 0]) ** (-2 / 3)
        bounds = [self.greatest.min(), *(part.min(initial=np.inf) for part in (upper, lower, jerk))]
        return max(float(min(bounds)) * (1 - 1e-9), 1e-6)

    def improved(self, y: Array, trust: float) -> Array | None:
        """Return a faster y near the last one that keeps all limits; None where the program has none.

        Args:
            y: Coefficients of the last one, shape (K + 2,).
            trust: Greatest factor by which each may change.

        Returns:
            Coefficients, shape (K + 2,).
        """
        from scipy.optimize import linprog
        from scipy.sparse import csr_matrix

        at = self._at(y)
        tables, bounds = self._rows(at[0])
        use = np.einsum("prc,pc->pr", tables, y[self._columns()]) / bounds
        kept = use > _KEEP
        cost = np.zeros(y.size)
        np.add.at(cost, self._columns(), -(self.weight * at[0] ** -1.5)[:, None] * self.basis[0])
        for _ in range(_ROUNDS):
            point, row = np.nonzero(kept)
            start = np.arange(0, 3 * point.size + 1, 3)
            scale = 1.0 / bounds[point, row]
            table = csr_matrix(
                ((tables[point, row] * scale[:, None]).ravel(), self._columns()[point].ravel(), start),
                shape=(point.size, y.size),
            )
            box = np.stack([y / trust, y * trust], axis=1)
            found = linprog(
                cost,
                A_ub=table,
                b_ub=np.ones(point.size),
                bounds=box,
                method="highs-ds",
                options={"time_limit": _LONGEST, "presolve": False},  # it finds little, and takes a third
            )
            if found.status != 0:
                return None
            over = np.einsum("prc,pc->pr", tables, found.x[self._columns()]) / bounds > 1 + _EXCESS
            if not (over & ~kept).any():
                break
            kept |= over
        return np.asarray(found.x)

    def _columns(self) -> NDArray[np.intp]:
        return self.first[:, None] + np.arange(3)

    def _at(self, y: Array) -> Array:
        """Return y, y' and y'' at the points, shape (3, P)."""
        return np.einsum("dpc,pc->dp", self.basis, y[self._columns()])

    def _rows(self, y: Array) -> tuple[Array, Array]:
        """Return rows (P, m, 3) and their upper bounds (P, m), with tangents of the jerk limits at y (P,)."""
        b0, b1, b2 = (basis[:, None, :] for basis in self.basis)
        linear = self.linear[..., :1] * b0 + self.linear[..., 1:] * b1
        two = ~self.one_sided
        jerk = self.jerk[..., :1] * b0 + self.jerk[..., 1:2] * b1 + self.jerk[..., 2:] * b2
        # |jerk row| <= 1.5 / sqrt(y) - (the new y) / (2 y^1.5)
        tangent = (0.5 * y**-1.5)[:, None, None] * b0
        level = np.broadcast_to((1.5 * y**-0.5)[:, None], jerk.shape[:2])
        tables = [linear, -linear[:, two], jerk + tangent, -jerk + tangent, b0]
        bounds = [1 - self.offset, 1 + self.offset[:, two], level, level, self.greatest[:, None]]
        return np.concatenate(tables, axis=1), np.maximum(np.concatenate(bounds, axis=1), 1e-9)


def make_rows(pepper: PepperModel, curve: CubicPath, base: SmoothTime, limits: Limits, jerk: Array) -> Rows:
    """Evaluate all limits along a smooth time law; those of jerk [rad/s^3 or m/s^3] have shape (n,)."""
    step = np.diff(base.knots)
    segment = np.repeat(np.arange(step.size), len(_POINTS))
    local = (step[:, None] * np.array(_POINTS)).ravel()
    q, first, second, third = base.derivatives(curve, segment, local)
    quantities = LimitedQuantities(pepper, limits)
    speeds = [np.abs(first) / limits.velocity, quantities.speed(q, first)]
    share = np.concatenate(speeds, axis=1).max(axis=1)
    gains, rests, sides = _linear_limits(quantities, limits, q, first, second)
    powers = _to_powers(base.knots)
    x = local[:, None]
    start, slope, bend = (powers[segment, derivative] for derivative in range(3))
    basis = np.stack([start + x * (slope + x * bend / 2), slope + x * bend, bend])
    finite = np.isfinite(jerk)
    gain = np.stack([third, 1.5 * second, first / 2], axis=-1)[:, finite] / jerk[finite][:, None]
    return Rows(
        segment,
        basis,
        gains,
        rests,
        sides,
        1.0 / np.maximum(share, 1e-6) ** 2,
        gain,
        (step[:, None] * np.array([1, 3, 3, 1]) / 8).ravel(),
        powers,
    )


def _linear_limits(
    quantities: LimitedQuantities, limits: Limits, q: Array, first: Array, second: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return gains on y and y', values at rest, and which rows have an upper bound only.

    Args:
        quantities: What limits look at.
        limits: The limits.
        q: Positions Q [rad or m], shape (P, n).
        first: dQ / d tau [rad/s or m/s], shape (P, n).
        second: d2Q / d tau2 [rad/s^2 or m/s^2], shape (P, n).

    Returns:
        Gains, shape (P, r, 2), values at rest, shape (P, r), and flags, shape (r,).
    """
    finite = np.isfinite(limits.acceleration)
    bound = limits.acceleration[finite]
    gains = [np.stack([second[:, finite] / bound, first[:, finite] / (2 * bound)], axis=-1)]
    rests = [np.zeros((len(q), bound.size))]
    sides = [np.zeros(bound.size, bool)]
    states = np.empty((3, 3 * len(q), q.shape[1]))
    coefficient_states(np.stack([q, first, second]), states)
    if quantities.torque_limit.size:
        finite = np.isfinite(quantities.torque_limit)
        bound = quantities.torque_limit[finite]
        c, a, b = quantities.torque(*states).reshape(3, len(q), -1)[..., finite] / bound
        gains.append(np.stack([b - c, (a - c) / 2], axis=-1))
        rests.append(c)
        sides.append(np.zeros(bound.size, bool))
    if quantities.edges:
        c, a, b = quantities.moments(*states).reshape(3, len(q), quantities.edges)
        weight = np.abs(c).max()  # h >= 0 as 1 - h / weight <= 1
        gains.append(np.stack([c - b, (c - a) / 2], axis=-1) / weight)
        rests.append(1 - c / weight)
        sides.append(np.ones(quantities.edges, bool))
    return np.concatenate(gains, axis=1), np.concatenate(rests, axis=1), np.concatenate(sides)


def _to_powers(knots: Array) -> Array:
    """Return y, y' and y'' at the start of each piece from three coefficients of the quadratic spline.

    The basis is that of B-splines with threefold knots at both ends, so that all coefficients are positive
    values of y's control polygon.

    Args:
        knots: Rising [s], shape (K + 1,).

    Returns:
        Gains of the coefficients on y, y' and y'', shape (K, 3, 3).
    """
    t = np.concatenate([knots[:1], knots[:1], knots, knots[-1:], knots[-1:]])
    k = np.arange(knots.size - 1) + 2  # the piece is [t[k], t[k + 1]]
    h = t[k + 1] - t[k]
    before, after = t[k + 1] - t[k - 1], t[k + 2] - t[k]
    powers = np.zeros((k.size, 3, 3))
    powers[:, 0, 0], powers[:, 0, 1] = h / before, (t[k] - t[k - 1]) / before
    powers[:, 1, 0], powers[:, 1, 1] = -2 / before, 2 / before
    powers[:, 2, 0], powers[:, 2, 2] = 2 / (h * before), 2 / (h * after)
    powers[:, 2, 1] = -powers[:, 2, 0] - powers[:, 2, 2]
    return powers
