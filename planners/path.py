"""Path of waypoints joined by straight edges."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError

from .metric import Metric
from .vectors import FloatArray, finite_points, positive_number, read_only, real_numbers


@dataclass(frozen=True, eq=False)
class Path:
    """A polyline, parametrized by its arc length in a weighted metric.

    Attributes:
        points: Waypoints, shape (k, n), k >= 1, read-only.
        weights: Weights of the metric, shape (n,), see `Metric`; ones if omitted.
        metric: The metric, made from the weights.
    """

    points: FloatArray
    weights: FloatArray | None = None
    metric: Metric = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Copy and check the waypoints and weights.

        Raises:
            InvalidValueError: They have the wrong shape or are not finite, or a weight is not above zero.
        """
        points = finite_points("points", self.points)
        metric = Metric.of(self.weights, points.shape[1])
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "weights", metric.weights)
        object.__setattr__(self, "metric", metric)

    @classmethod
    def trusted(cls, points: FloatArray, metric: Metric, arc_lengths: FloatArray | None = None) -> Path:
        """Return the path through waypoints that are known to be valid input, without check or copy.

        Args:
            points: Finite float64 waypoints, shape (k, n), that are not written to afterwards.
            metric: The metric of n coordinates.
            arc_lengths: Arc length at each waypoint, shape (k,); computed if omitted.
        """
        path = cls.__new__(cls)
        path.__dict__.update(points=read_only(points), weights=metric.weights, metric=metric)
        if arc_lengths is not None:
            path.__dict__["arc_lengths"] = read_only(arc_lengths)
        return path

    @cached_property
    def arc_lengths(self) -> FloatArray:
        """Length from the first to each waypoint, shape (k,) [length unit of the metric]."""
        return read_only(self.metric.arc_lengths(self.points))

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return int(self.points.shape[1])

    @property
    def length(self) -> float:
        """Length of the path [length unit of the metric]."""
        return float(self.arc_lengths[-1])

    def __len__(self) -> int:
        """Return the number of waypoints."""
        return len(self.points)

    def __call__(self, s: ArrayLike) -> FloatArray:
        """Return the states at given arc lengths, by linear interpolation.

        Args:
            s: Arc lengths [length unit of the metric] within [0, length], shape (...).

        Returns:
            States, shape (..., n); exactly the first and last waypoint at 0 and at `length`.

        Raises:
            InvalidValueError: An arc length is NaN or outside [0, length].
        """
        lengths = real_numbers("s", s)
        slack = 1e-12 * self.length
        if not np.all((lengths >= -slack) & (lengths <= self.length + slack)):
            raise InvalidValueError("s", s, f"arc lengths within [0, {self.length:g}]")
        if len(self.points) == 1:
            return np.broadcast_to(self.points[0], (*lengths.shape, self.n)).copy()
        lengths = np.clip(lengths, 0.0, self.length)
        edge = self.edge_index(lengths)
        span = self.arc_lengths[edge + 1] - self.arc_lengths[edge]
        fraction = (lengths - self.arc_lengths[edge]) / np.where(span > 0.0, span, 1.0)
        first, last = self.points[edge], self.points[edge + 1]
        # Both ends of an edge are met exactly, despite the rounding of the difference.
        return np.where(fraction[..., None] >= 1.0, last, first + fraction[..., None] * (last - first))

    def edge_index(self, s: FloatArray) -> np.ndarray:
        """Return the edge's index at each arc length: 0 .. k - 2, the later one at a waypoint; shape of s.

        Raises:
            InvalidValueError: for anything but numbers.
        """
        after = np.searchsorted(self.arc_lengths, real_numbers("s", s), side="right")
        return np.clip(after - 1, 0, max(0, len(self.points) - 2))

    def reversed(self) -> Path:
        """Return the path from its end to its start."""
        return Path(self.points[::-1], self.weights)

    def resample(self, spacing: float) -> Path:
        """Return the same polyline with waypoints added, so that no two neighbors are further apart.

        Args:
            spacing: Maximum distance of neighbors [length unit of the metric].

        Returns:
            A path through all waypoints of this one and equally spaced new ones on each edge.

        Raises:
            InvalidValueError: The spacing is not a finite number above zero.
        """
        spacing = positive_number("spacing", spacing)
        segments = [self.points[:1]]
        for a, b, length in zip(self.points[:-1], self.points[1:], np.diff(self.arc_lengths), strict=True):
            # Tolerance for rounding, or resampling twice would split edges of exactly the spacing.
            steps = max(1, math.ceil(length / spacing * (1.0 - 1e-12)))
            fractions = np.arange(1, steps)[:, None] / steps
            segments += [a + fractions * (b - a), b[None, :]]
        return Path(np.concatenate(segments), self.weights)

    def merged(self, tolerance: float) -> Path:
        """Return the path without waypoints that nearly repeat their predecessor; both ends are kept.

        Args:
            tolerance: Distance from the last kept waypoint up to which others are dropped [length unit].

        Returns:
            A path of one or more waypoints; of one only if all lie within the tolerance of the first one.

        Raises:
            InvalidValueError: The tolerance is not a finite number above zero.
        """
        tolerance = positive_number("tolerance", tolerance)
        kept = [0]
        for i in range(1, len(self.points)):
            if float(self.metric.distance(self.points[kept[-1]], self.points[i])) > tolerance:
                kept.append(i)
        if len(kept) > 1:
            kept[-1] = len(self.points) - 1 if self._near_end(kept[-1], tolerance) else kept[-1]
            if kept[-1] != len(self.points) - 1:
                kept.append(len(self.points) - 1)
        return Path(self.points[kept], self.weights)

    def _near_end(self, index: int, tolerance: float) -> bool:
        return float(self.metric.distance(self.points[index], self.points[-1])) <= tolerance
