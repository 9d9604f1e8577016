"""Interface of the optimizer to sampled states: values and derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from ..vectors import FloatArray


@dataclass(frozen=True, eq=False)
class Rows:
    """Values at K states, R per state, and their derivatives.

    Attributes:
        value: Values, shape (K, R).
        by_position: Derivatives by the positions, shape (K, R, n).
        by_velocity: Derivatives by the velocities, shape (K, R, n); None if the values do not depend on
            velocities.
        by_acceleration: Derivatives by the accelerations, shape (K, R, n); None if the values do not depend
            on accelerations.
    """

    value: FloatArray
    by_position: FloatArray
    by_velocity: FloatArray | None = None
    by_acceleration: FloatArray | None = None


class BarrierBound(Enum):
    """Allowed range of a constraint's values.

    ABOVE_ZERO: above 0; values from 1 on are far from the bound and add no barrier.
    WITHIN_ONE: between -1 and 1.
    """

    ABOVE_ZERO = "above_zero"
    WITHIN_ONE = "within_one"

    def barrier(self, values: FloatArray) -> float:
        """Return the sum of -log(distance to the bound); inf if a value is not allowed."""
        workspace = 1.0 - values**2 if self is BarrierBound.WITHIN_ONE else np.minimum(values, 1.0)
        if workspace.size and not workspace.min() > 0.0:
            return float("inf")
        return -float(np.log(workspace).sum())


class Term(Protocol):
    """A function of the states of a motion, evaluated for all samples at once.

    A constraint keeps its values within its barrier bound.  A cost adds the integral of its squared values
    over time.
    """

    @property
    def per_interval(self) -> int:
        """Number of samples in each of the spline's intervals, the first at the interval's start."""

    @property
    def barrier_bound(self) -> BarrierBound:
        """Allowed range of the values; costs ignore it."""

    def values(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the values, shape (K, R), at positions, velocities and accelerations, shape (K, n)."""

    def rows(self, q: FloatArray, v: FloatArray, a: FloatArray) -> Rows:
        """Return the values and their derivatives."""


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of a motion's cost, in addition to the cost of its terms.

        time T + jerk * integral of |jerk / jerk_scale|^2 dt

    Attributes:
        time: Weight of the duration [1/s].
        jerk: Weight of the squared jerk, in units of `jerk_scale`.
        jerk_scale: Jerk of each coordinate that counts as 1, shape (n,).
    """

    time: float
    jerk: float
    jerk_scale: FloatArray
