"""The metric in which planners measure distances between states."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import FrozenArrays
from pepper_kin.exceptions import InvalidValueError

from .vectors import FloatArray, finite_vector, real_numbers


@dataclass(frozen=True, eq=False)
class Metric(FrozenArrays):
    """Weighted Euclidean metric ``d(a, b) = sqrt(sum_i (w_i (a_i - b_i))^2)``.

    A weight converts the unit of its coordinate into the common unit of length of the problem: with radians
    everywhere and weights of one, a distance is in radians; with lever arms [m/rad] as weights, in meters.

    Attributes:
        weights: w, shape (n,), each above zero [length unit per coordinate unit].
    """

    weights: FloatArray

    def __post_init__(self) -> None:
        """Copy and check the weights.

        Raises:
            InvalidValueError: A weight is not finite or not above zero.
        """
        weights = finite_vector("weights", self.weights)
        if not (weights > 0.0).all():
            i = int(np.argmin(weights > 0.0))
            raise InvalidValueError(f"weights[{i}]", weights[i], "a finite number above 0")
        object.__setattr__(self, "weights", weights)

    @classmethod
    def of(cls, weights: ArrayLike | None, n: int) -> Metric:
        """Return the metric of n coordinates with weights, shape (n,), or with weights of one for None.

        Raises:
            InvalidValueError: There are not n weights, or one is not finite and above zero.
        """
        return cls(np.ones(n) if weights is None else finite_vector("weights", weights, n))

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return int(self.weights.size)

    def distance(self, a: ArrayLike, b: ArrayLike) -> FloatArray:
        """Return d(a, b) [length unit] of states of shape (..., n), broadcast; shape (...,).

        Raises:
            InvalidValueError: for anything but numbers of shapes that can be broadcast, or NaN.
        """
        first, second = real_numbers("a", a), real_numbers("b", b)
        try:
            scaled = (second - first) * self.weights
        except ValueError:
            shapes = f"shapes {first.shape} and {second.shape}"
            raise InvalidValueError("a and b", shapes, f"states of shape (..., {self.n})") from None
        distances: FloatArray = np.sqrt(np.einsum("...i,...i->...", scaled, scaled))
        if np.isnan(distances).any():
            raise InvalidValueError("a and b", math.nan, "finite numbers")
        return distances

    def arc_lengths(self, points: FloatArray) -> FloatArray:
        """Return the length [length unit] of a polyline from its first to each of its points.

        Args:
            points: Waypoints, shape (k, n).

        Returns:
            Arc lengths, shape (k,), starting at 0, never decreasing.

        Raises:
            InvalidValueError: for another shape, or NaN.
        """
        if not isinstance(points, np.ndarray) or points.ndim != 2 or points.shape[1] != self.n:
            raise InvalidValueError("points", points, f"an array of shape (k, {self.n})")
        lengths = np.zeros(len(points))
        scaled = points[1:] - points[:-1]
        scaled *= self.weights
        scaled *= scaled
        np.sqrt(scaled.sum(axis=1)).cumsum(out=lengths[1:])
        if len(lengths) and math.isnan(lengths[-1]):
            raise InvalidValueError("points", math.nan, "finite numbers")
        return lengths
