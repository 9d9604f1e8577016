"""A smooth path: a piecewise cubic curve with continuous curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError

from .vectors import FloatArray, finite_vector, read_only

_FACTORS = ((1.0, 1.0, 1.0, 1.0), (1.0, 2.0, 3.0), (2.0, 6.0), (6.0,))  # p! / (p - derivative)!


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """A piecewise cubic curve of states.

    On piece i, where ``breaks[i] <= s <= breaks[i + 1]``, it is
    ``q(s) = sum_p coefficients[i, p] (s - breaks[i])^p``.

    The parameter s runs from 0 to `length`.  Paths made by `smooth` run at no more than unit speed,
    ``|w dq/ds| <= 1`` (exactly 1 on straight parts), and are twice continuously differentiable.

    Attributes:
        breaks: Ends of the pieces, shape (k + 1,), rising from 0.
        coefficients: Power-basis coefficients, constant term first, shape (k, 4, n).
        goal: The exact last state, shape (n,), which the last polynomial meets up to rounding.
    """

    breaks: FloatArray
    coefficients: FloatArray
    goal: FloatArray

    def __post_init__(self) -> None:
        """Copy and check the fields.

        Raises:
            InvalidValueError: A shape is wrong, a value is not finite, the breaks do not rise from 0, or the
                last piece does not end at the goal.
        """
        breaks = finite_vector("breaks", self.breaks)
        coefficients = np.array(self.coefficients, dtype=np.float64, order="C")
        if breaks.size < 2 or breaks[0] != 0.0 or np.any(np.diff(breaks) <= 0.0):
            raise InvalidValueError("breaks", breaks, "two or more numbers that rise from 0")
        if coefficients.ndim != 3 or coefficients.shape[:2] != (breaks.size - 1, 4) or coefficients.size == 0:
            raise InvalidValueError(
                "coefficients", f"shape {coefficients.shape}", f"shape ({breaks.size - 1}, 4, n)"
            )
        if not np.all(np.isfinite(coefficients)):
            raise InvalidValueError("coefficients", "NaN or infinity", "finite numbers")
        goal = finite_vector("goal", self.goal, coefficients.shape[2])
        object.__setattr__(self, "breaks", breaks)
        object.__setattr__(self, "coefficients", read_only(coefficients))
        object.__setattr__(self, "goal", goal)
        end = self._evaluate(breaks[-1:], 0)[0]
        if not (np.abs(end - goal) <= 1e-9 * (1.0 + np.abs(goal))).all():
            raise InvalidValueError("goal", goal, f"the end of the last piece, {end}")

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return int(self.coefficients.shape[2])

    @property
    def length(self) -> float:
        """Last parameter value; no less than the curve's length [length unit of the metric]."""
        return float(self.breaks[-1])

    @property
    def start(self) -> FloatArray:
        """The first state, shape (n,)."""
        return self.coefficients[0, 0]

    def __call__(self, s: ArrayLike, derivative: int = 0) -> FloatArray:
        """Return the states, or derivatives with respect to s, at given parameters.

        Args:
            s: Parameters within [0, length], shape (...).
            derivative: Order of the derivative, 0 to 3; the third one is constant on a piece, and taken from
                the later piece at a break.

        Returns:
            Shape (..., n); exactly `start` at 0 and `goal` at `length` for derivative 0.

        Raises:
            InvalidValueError: A parameter is NaN or outside [0, length], or the order is not 0 to 3.
        """
        if derivative not in (0, 1, 2, 3):
            raise InvalidValueError("derivative", derivative, "0, 1, 2 or 3")
        values = np.asarray(s, dtype=np.float64)
        slack = 1e-12 * self.length
        if not np.all((values >= -slack) & (values <= self.length + slack)):
            raise InvalidValueError("s", s, f"parameters within [0, {self.length:g}]")
        values = np.clip(values, 0.0, self.length)
        states = self._evaluate(values, derivative)
        return np.where((values == self.length)[..., None], self.goal, states) if derivative == 0 else states

    def sample(self, spacing: float) -> FloatArray:
        """Return states no further apart than a spacing in the parameter, on each piece equally spaced.

        Args:
            spacing: Greatest step of s.

        Returns:
            Shape (m, n), from start to goal, breaks included.

        Raises:
            InvalidValueError: The spacing is not above zero.
        """
        if not spacing > 0.0:
            raise InvalidValueError("spacing", spacing, "a number above 0")
        pieces = [
            np.linspace(a, b, max(1, int(np.ceil((b - a) / spacing))), endpoint=False)
            for a, b in zip(self.breaks[:-1], self.breaks[1:], strict=True)
        ]
        return self(np.concatenate((*pieces, self.breaks[-1:])))

    def _evaluate(self, s: FloatArray, derivative: int) -> FloatArray:
        piece = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.coefficients) - 1)
        local = (s - self.breaks[piece])[..., None]
        chosen = self.coefficients[piece]
        value = np.zeros(chosen.shape[:-2] + chosen.shape[-1:])
        for power in range(3, derivative - 1, -1):  # Horner
            value = value * local + _FACTORS[derivative][power - derivative] * chosen[..., power, :]
        return value
