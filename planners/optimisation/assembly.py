"""Value, gradient and Gauss-Newton matrix of cost and barrier over the control points and the duration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..vectors import FloatArray
from .bordered import BorderedBand
from .rows import Rows, Term, Weights
from .spline import RestSpline

FIXED = 3
"""Control points at either end that start and goal fix."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Limits that hold at every instant, inf where there is none, shape (n,) each.

    Attributes:
        lower: Least positions.
        upper: Greatest positions.
        velocity: Greatest absolute velocities.
        acceleration: Greatest absolute accelerations.
    """

    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class Sampling:
    """Samples of a spline for one term: the same number in each interval."""

    def __init__(self, spline: RestSpline, per_interval: int) -> None:
        self.spline, self.per_interval = spline, per_interval
        count = spline.intervals * per_interval
        s = np.arange(count) / count
        self.basis = tuple(spline.basis(s, order) for order in range(3))
        columns = np.arange(count)[:, None] // per_interval + np.arange(spline.degree + 1)
        self.local = tuple(np.take_along_axis(b, columns, axis=1) for b in self.basis)

    def states(self, control: FloatArray, duration: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return positions, velocities and accelerations at the samples, shape (K, n) each."""
        b0, b1, b2 = self.basis
        return b0 @ control, b1 @ control / duration, b2 @ control / duration**2

    def add(
        self,
        system: BorderedBand,
        rows: Rows,
        state: tuple[FloatArray, FloatArray, FloatArray],
        duration: float,
        slope: FloatArray,
        curvature: FloatArray,
    ) -> None:
        """Add sum(slope_kr d row_kr + curvature_kr (d row_kr)^2 / 2) to a system.

        Args:
            system: Gradient and matrix to add to.
            rows: Rows and their derivatives at the samples.
            state: The samples' states.
            duration: Duration T.
            slope: First derivative by each row, shape (K, R).
            curvature: Second derivative by each row, shape (K, R).
        """
        (_, v, a), (f0, f1, f2) = state, self.local
        parts: list[tuple[FloatArray, FloatArray, FloatArray | None, int]] = [(f0, rows.by_position, None, 0)]
        if rows.by_velocity is not None:
            parts.append((f1 / duration, rows.by_velocity, v, 1))
        if rows.by_acceleration is not None:
            parts.append((f2 / duration**2, rows.by_acceleration, a, 2))
        jacobian: FloatArray | float = 0.0
        by_duration = np.zeros_like(rows.value)
        for weight, part, rate, order in parts:
            jacobian = jacobian + part[:, :, None, :] * weight[:, None, :, None]
            if rate is not None:
                by_duration -= order / duration * np.matmul(part, rate[..., None])[..., 0]
        count, width, n = self.spline.intervals, self.spline.degree + 1, self.spline.n
        flat = np.asarray(jacobian).reshape(count, -1, width * n)
        weighted = flat * curvature.reshape(count, -1, 1)
        matrix = np.matmul(weighted.transpose(0, 2, 1), flat).reshape(count, width, n, width, n)
        vectors = np.stack([slope, curvature * by_duration], axis=-1).reshape(count, -1, 2)
        right = np.matmul(flat.transpose(0, 2, 1), vectors).reshape(count, width, n, 2)
        for i in range(width):
            system.gradient[i : i + count] += right[:, i, :, 0]
            system.border[i : i + count] += right[:, i, :, 1]
            for j in range(i + 1):
                system.blocks[j : j + count, i - j] += matrix[:, i, :, j, :]
        system.slope += float((slope * by_duration).sum())
        system.corner += float((curvature * by_duration**2).sum())


class Objective:
    """Cost plus barrier of a motion.

    Args:
        spline: The family of motions.
        bounds: Limits of positions and rates.
        weights: Weights of the costs.
        constraints: Terms that shall stay above zero.
        costs: Weights and terms whose squares cost.
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
        self._samplings = {m: Sampling(spline, m) for m in {term.per_interval for term in terms}}
        points, gauss = np.polynomial.legendre.leggauss(spline.degree - 2)
        s = ((np.arange(spline.intervals)[:, None] + (points + 1) / 2) / spline.intervals).ravel()
        third = spline.basis(s, 3) * np.sqrt(np.tile(gauss / 2, spline.intervals) / spline.intervals)[:, None]
        self._jerk = third.T @ third
        self._jerk_weight = weights.jerk / weights.jerk_scale**2
        limits = ((1, bounds.velocity), (2, bounds.acceleration))
        self._rates = [(order, spline.difference(order), limit) for order, limit in limits]

    def samples(self, term: Term, control: FloatArray) -> FloatArray:
        """Return the positions at a term's samples, shape (K, n), of control points, shape (C, n)."""
        return self._samplings[term.per_interval].basis[0] @ control

    def states(
        self, term: Term, control: FloatArray, duration: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return positions, velocities and accelerations at a term's samples, shape (K, n) each."""
        return self._samplings[term.per_interval].states(control, duration)

    def cost(self, control: FloatArray, duration: float) -> float:
        """Return the cost without barriers of control points, shape (C, n), and a duration."""
        total = self.weights.time * duration + self._jerk_cost(control, duration)
        for weight, term in self.costs:
            sampling = self._samplings[term.per_interval]
            values = term.values(*sampling.states(control, duration))
            total += weight * duration * float((values**2).sum()) / len(values)
        return total

    def barrier(self, control: FloatArray, duration: float) -> float:
        """Return the sum of -log(slack) over all limits and constraints; inf where one is not kept."""
        total = sum(_logarithms(slack) for slack in self.box_slacks(control, duration))
        for term in self.constraints:
            if not total < np.inf:
                break
            state = self._samplings[term.per_interval].states(control, duration)
            total += term.wall.barrier(term.values(*state))
        return total

    def system(self, control: FloatArray, duration: float, mu: float) -> tuple[BorderedBand, float, float]:
        """Return Newton's equations of cost + mu * barrier, and the two values."""
        spline = self.spline
        system = BorderedBand(spline.intervals + spline.degree, spline.degree, spline.n)
        cost = self.weights.time * duration + self._add_jerk(system, control, duration)
        system.slope += self.weights.time
        walls = self._add_boxes(system, control, duration, mu)
        for term in self.constraints:
            sampling = self._samplings[term.per_interval]
            state = sampling.states(control, duration)
            rows = term.rows(*state)
            walls += term.wall.barrier(rows.value)
            slope, curvature = term.wall.slopes(rows.value)
            sampling.add(system, rows, state, duration, mu * slope, mu * curvature)
        for share, term in self.costs:
            sampling = self._samplings[term.per_interval]
            state = sampling.states(control, duration)
            rows = term.rows(*state)
            weight = 2 * share * duration / len(rows.value)
            part = weight / 2 * float((rows.value**2).sum())
            sampling.add(
                system, rows, state, duration, weight * rows.value, np.full(rows.value.shape, weight)
            )
            system.slope += part / duration
            cost += part
        return system, cost, walls

    def _jerk_cost(self, control: FloatArray, duration: float) -> float:
        return float((self._jerk_weight * control * (self._jerk @ control)).sum()) / duration**5

    def _add_jerk(self, system: BorderedBand, control: FloatArray, duration: float) -> float:
        """Add w |r|^2 with r = jerk T^(1/2); in the duration, r falls as T^(-5/2)."""
        pull = 2 * self._jerk_weight * (self._jerk @ control) / duration**5
        cost = float((pull * control).sum()) / 2
        system.gradient += pull
        system.border -= 2.5 / duration * pull
        system.slope -= 5.0 / duration * cost
        system.corner += 12.5 / duration**2 * cost
        for distance in range(self.spline.degree + 1):
            diagonal = np.diagonal(self._jerk, distance)[:, None]
            part = 2 / duration**5 * diagonal * self._jerk_weight
            system.diagonals[: len(part), distance] += part
        return cost

    def box_slacks(self, control: FloatArray, duration: float) -> list[FloatArray]:
        """Return what is left to the limits of positions and rates, as shares, of control points."""
        inner = control[FIXED:-FIXED]
        lower, upper, width = self._position_box()
        slacks = [(inner - lower) / width, (upper - inner) / width]
        for order, difference, limit in self._rates:
            share = difference @ control / (limit * duration**order)
            slacks += [1.0 - share, 1.0 + share]
        return slacks

    def _position_box(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return bounds and the width that counts as 1; far bounds for coordinates without any."""
        lower, upper = self.bounds.lower, self.bounds.upper
        finite = np.isfinite(upper - lower)
        return np.maximum(lower, -1e6), np.minimum(upper, 1e6), np.where(finite, upper - lower, 1e6)

    def _add_boxes(self, system: BorderedBand, control: FloatArray, duration: float, mu: float) -> float:
        slacks = self.box_slacks(control, duration)
        width = self._position_box()[2]
        below, above = slacks[0], slacks[1]
        system.gradient[FIXED:-FIXED] += mu / width * (1 / above - 1 / below)
        system.diagonals[FIXED:-FIXED, 0] += mu / width**2 * (1 / above**2 + 1 / below**2)
        for (order, difference, limit), up, down in zip(self._rates, slacks[2::2], slacks[3::2], strict=True):
            scale = 1.0 / (limit * duration**order)
            share = 1.0 - up
            slope, curvature = mu * (1 / up - 1 / down), mu * (1 / up**2 + 1 / down**2)
            by_duration = -order / duration * share
            system.gradient += difference.T @ (slope * scale)
            system.border += difference.T @ (curvature * scale * by_duration)
            system.slope += float((slope * by_duration).sum())
            system.corner += float((curvature * by_duration**2).sum())
            count = len(difference)
            curvature *= scale**2
            entries = [np.diagonal(difference, k)[:count, None] for k in range(order + 1)]
            for i in range(order + 1):
                for j in range(i + 1):
                    system.diagonals[j : j + count, i - j] += entries[i] * entries[j] * curvature
        return sum(_logarithms(slack) for slack in slacks)


def _logarithms(slack: FloatArray) -> float:
    """Return -sum(log(slack)); inf where a slack is not above zero."""
    return -float(np.log(slack).sum()) if slack.min(initial=1.0) > 0.0 else float("inf")
