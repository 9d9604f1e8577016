"""Interface of the optimizer to sampled states: values and derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from ..vectors import FloatArray


@dataclass(frozen=True, eq=False)
class Rows:
    """Values at K states, R of each state, and their derivatives.

    Attributes:
        value: Shape (K, R).
        by_position: Derivatives by the positions, shape (K, R, n).
        by_velocity: By the velocities; None where the values do not depend on them.
        by_acceleration: By the accelerations; None where the values do not depend on them.
    """

    value: FloatArray
    by_position: FloatArray
    by_velocity: FloatArray | None = None
    by_acceleration: FloatArray | None = None


class BarrierBound(Enum):
    """Which values of a constraint's rows are allowed.

    ABOVE_ZERO: above 0; from 1 on they are far from the wall and no longer matter.
    WITHIN_ONE: between -1 and 1.
    """

    ABOVE_ZERO = "above_zero"
    WITHIN_ONE = "within_one"

    def barrier(self, values: FloatArray) -> float:
        """Return the sum of -log(distance to the wall); inf where a value is not allowed."""
        workspace = 1.0 - values**2 if self is BarrierBound.WITHIN_ONE else np.minimum(values, 1.0)
        if workspace.size and not workspace.min() > 0.0:
            return float("inf")
        return -float(np.log(workspace).sum())


class Term(Protocol):
    """A function of the states of a motion, evaluated for all samples at once.

    A constraint keeps its values on the right side of its wall.  A cost adds the integral of its values'
    squares over time.
    """

    @property
    def per_interval(self) -> int:
        """Number of samples in each of the spline's intervals, the first at the interval's start."""

    @property
    def barrier_bound(self) -> BarrierBound:
        """Which values are allowed; costs do not look at it."""

    def values(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the values, shape (K, R), at positions, velocities and accelerations, shape (K, n)."""

    def rows(self, q: FloatArray, v: FloatArray, a: FloatArray) -> Rows:
        """Return the values and their derivatives."""


@dataclass(frozen=True, eq=False)
class Weights:
    """What a motion costs, besides what its terms cost.

        time T + jerk * integral of |jerk / jerk_scale|^2 dt

    Attributes:
        time: Of the duration [1/s].
        jerk: Of the squared jerk, in units of `jerk_scale`.
        jerk_scale: Jerk of each coordinate that counts as 1, shape (n,).
    """

    time: float
    jerk: float
    jerk_scale: FloatArray
