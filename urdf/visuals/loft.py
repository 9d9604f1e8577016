"""A closed surface through measured cross-sections.

Along the main axis s, a section is described by its center c(s), its half widths h(s) along the two other
axes and a radial shape rho(phi, s) in coordinates scaled by the half widths:

    p(phi, s) = c(s) + h(s) * rho(phi, s) * (cos phi, sin phi)

For a superellipse of exponent n, rho = (|cos phi|^n + |sin phi|^n)^(-1/n) (Lame curve in polar coordinates).
Centers and exponents are interpolated by monotone cubics (PCHIP, Fritsch and Carlson 1980), half widths by
monotone cubics of their squares: the square of an ellipsoid's half width is a parabola in s, so round ends
close smoothly where the square reaches zero.  A narrow Gaussian then blurs the jumps in curvature that
monotone cubics leave at every section (they show as bands on a glossy shell).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from pepper_kin.exceptions import InvalidValueError

from .mesh import Mesh
from .stitching import rings_to_mesh

Array = NDArray[np.float64]
Radial = Callable[[Array, Array], Array]
"""Radial shape rho(phi, s), broadcasting."""
Carving = Callable[[Array], Array]
"""Moves points of the surface, (..., 3) -> (..., 3)."""

_AXES = {"x": (0, 1, 2), "y": (1, 2, 0), "z": (2, 0, 1)}
_BISECTIONS = 44
_DENSE = 800
_BEND_SHARE = 0.25
_BLUR = 0.45
_BLUR_NODES, _BLUR_WEIGHTS = np.polynomial.hermite_e.hermegauss(7)
_BLUR_WEIGHTS = _BLUR_WEIGHTS / _BLUR_WEIGHTS.sum()


def superellipse(phi: Array, exponent: Array) -> Array:
    """Return rho(phi) = (|cos phi|^n + |sin phi|^n)^(-1/n) of the unit superellipse, shape (...).

    Args:
        phi: Polar angle in the scaled section [rad], shape (...).
        exponent: n, broadcast with `phi`.
    """
    total = np.abs(np.cos(phi)) ** exponent + np.abs(np.sin(phi)) ** exponent
    return np.asarray(total ** (-1.0 / exponent), dtype=float)


@dataclass(frozen=True, eq=False)
class Loft:
    """Surface through sections along one axis.

    Attributes:
        axis: Main axis, "x", "y" or "z"; the section's axes follow cyclically (z: x, y; x: y, z; y: z, x).
        sections: Rows (s, c1, c2, h1, h2, n), increasing s [m], shape (k, 6).
        start: Where the surface begins [m], at most the first s.
        end: Where it ends [m], at least the last s.
        round_ends: Whether begin and end close like an ellipsoid; otherwise they are flat.
        fillets: Radius [m] by which the edges of flat ends are rounded, (begin, end).
        radial: Radial shape rho(phi, s) in place of the superellipse, or None.
        carve: Moves surface points (dents, sockets), or None.
    """

    axis: str
    sections: Array
    start: float
    end: float
    round_ends: tuple[bool, bool] = (True, True)
    fillets: tuple[float, float] = (0.0, 0.0)
    radial: Radial | None = None
    carve: Carving | None = None

    def __post_init__(self) -> None:
        sections = np.array(self.sections, dtype=float)
        if self.axis not in _AXES:
            raise InvalidValueError("axis", self.axis, "one of x, y, z")
        if sections.ndim != 2 or sections.shape[1] != 6 or not np.all(np.isfinite(sections)):
            raise InvalidValueError("sections", f"shape {sections.shape}", "finite numbers, shape (k, 6)")
        if np.any(np.diff(sections[:, 0]) <= 0.0):
            raise InvalidValueError("sections", sections[:, 0], "increasing positions s")
        if np.any(sections[:, 3:] <= 0.0):
            raise InvalidValueError("sections", sections[:, 3:].min(), "positive half widths and exponents")
        if not (self.start <= sections[0, 0] and sections[-1, 0] <= self.end and self.start < self.end):
            raise InvalidValueError("start, end", (self.start, self.end), "an interval around all sections")
        sections.setflags(write=False)
        object.__setattr__(self, "sections", sections)

    def section(self, s: ArrayLike) -> tuple[Array, Array, Array]:
        """Return center (..., 2) [m], half widths (..., 2) [m] and exponent (...) at s, shape (...) [m]."""
        position = np.clip(np.asarray(s, dtype=float), self.start, self.end)
        knots, values = self._knots()
        sigma = _BLUR * float(np.median(np.diff(knots)))
        around = position[..., None] + sigma * _BLUR_NODES
        inside = np.clip(around, self.start, self.end)
        # Beyond an end the curve goes on point-symmetrically, so that blurring leaves its end values alone.
        curve = PchipInterpolator(knots, values, axis=0)
        sampled = curve(np.clip(2.0 * inside - around, self.start, self.end))
        beyond = (around != inside)[..., None]
        table = np.einsum(
            "k,...kj->...j", _BLUR_WEIGHTS, np.where(beyond, 2.0 * curve(inside) - sampled, sampled)
        )
        center, exponent = table[..., 0:2], table[..., 4]
        half = np.sqrt(np.maximum(table[..., 2:4], 0.0)) - self._inset(position)[..., None]
        return center, np.maximum(half, 0.0), exponent

    def _knots(self) -> tuple[Array, Array]:
        """Add the two ends to the measured sections; columns c1, c2, h1^2, h2^2, n."""
        rows = self.sections.copy()
        rows[:, 3:5] **= 2
        first, last = rows[:1].copy(), rows[-1:].copy()
        first[0, 0], last[0, 0] = self.start, self.end
        if self.round_ends[0]:
            first[0, 3:5] = 0.0
        if self.round_ends[1]:
            last[0, 3:5] = 0.0
        parts = [rows]
        if self.start < rows[0, 0]:
            parts.insert(0, first)
        if self.end > rows[-1, 0]:
            parts.append(last)
        table = np.concatenate(parts)
        return table[:, 0], table[:, 1:]

    def _inset(self, s: Array) -> Array:
        """Return by how much a rounded edge draws the half widths in: f - sqrt(f^2 - (f - d)^2) [m].

        Args:
            s: Positions along the axis [m], shape (...); d is the distance of each from an end.
        """
        inset = np.zeros_like(s)
        for fillet, distance in zip(self.fillets, (s - self.start, self.end - s), strict=True):
            if fillet > 0.0:
                depth = np.clip(fillet - distance, 0.0, fillet)
                inset += fillet - np.sqrt(fillet**2 - depth**2)
        return inset

    def _rho(self, phi: Array, s: Array, exponent: Array) -> Array:
        """Return the radial shape at angles [rad], positions [m] and exponents, broadcast to shape (...)."""
        return superellipse(phi, exponent) if self.radial is None else self.radial(phi, s)

    def _carved(self, points: Array) -> Array:
        """Return surface points [m], shape (..., 3), after carving."""
        return points if self.carve is None else self.carve(points)

    def _assemble(self, s: Array, first: Array, second: Array) -> Array:
        """Put section coordinates into x, y, z order.

        Args:
            s: Positions along the axis [m], broadcast with `first`.
            first: First coordinate in the section [m], shape (...).
            second: Second coordinate, of the same shape.

        Returns:
            Points [m], shape (..., 3).
        """
        points = np.empty((*first.shape, 3))
        main, one, two = _AXES[self.axis]
        points[..., main], points[..., one], points[..., two] = s, first, second
        return points

    def between(
        self, low: float, high: float, fillets: tuple[float, float] = (0.0, 0.0), knots: int = 9
    ) -> Loft:
        """Return the slice of this surface between two positions, with flat ends.

        Args:
            low: Where the slice begins [m].
            high: Where it ends [m].
            fillets: Radius [m] of the edges at its two ends.
            knots: Sections of the new surface.
        """
        s = np.linspace(low, high, knots)
        center, half, exponent = self.section(s)
        rows = np.column_stack([s, center, half, exponent])
        return replace(self, sections=rows, start=low, end=high, round_ends=(False, False), fillets=fillets)

    def stations(self, rings: int) -> Array:
        """Return positions [m] of rings along the outline, denser where it bends, shape (rings,).

        Args:
            rings: How many, at least 3, the two ends included.
        """
        # Cosine spacing follows the outline closely where round ends turn it by a right angle.
        dense = self.start + (self.end - self.start) * 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _DENSE)))
        center, half, _ = self.section(dense)
        outline = np.diff(np.concatenate([center + half, center - half], axis=1), axis=0)
        along = np.diff(dense)[:, None]
        length = np.hypot(along[:, 0], np.abs(outline).max(axis=1))
        bend = np.abs(np.diff(np.arctan2(outline, along), axis=0)).max(axis=1)
        bend = np.convolve(np.concatenate([[0.0], bend]), np.full(_DENSE // 16, 16.0 / _DENSE), mode="same")
        density = (1.0 - _BEND_SHARE) * length / length.sum() + _BEND_SHARE * bend / max(bend.sum(), 1e-9)
        way = np.concatenate([[0.0], np.cumsum(density)])
        s = np.interp(np.linspace(0.0, way[-1], rings), way, dense)
        # Rounded so that noise in the bends, which are second differences, cannot move a ring.
        s[1:-1] = np.round(s[1:-1], 5)
        return np.asarray(s)

    def points(self, phi: ArrayLike, s: ArrayLike, lift: ArrayLike = 0.0) -> Array:
        """Return points of the surface, shape (..., 3) [m].

        Args:
            phi: Polar angle in the scaled section [rad].
            s: Position along the axis [m], broadcast with `phi`.
            lift: How much the half widths grow [m], broadcast with both.
        """
        angle, position, rise = np.broadcast_arrays(
            np.asarray(phi, dtype=float), np.asarray(s, dtype=float), np.asarray(lift, dtype=float)
        )
        center, half, exponent = self.section(position)
        radial = self._rho(angle, position, exponent)
        first = center[..., 0] + np.maximum(half[..., 0] + rise, 0.0) * radial * np.cos(angle)
        second = center[..., 1] + np.maximum(half[..., 1] + rise, 0.0) * radial * np.sin(angle)
        return self._carved(self._assemble(position, first, second))

    def mesh(self, segments: int, rings: int) -> Mesh:
        """Return the surface as a closed mesh.

        Args:
            segments: Corners around a section, at least 3.
            rings: Sections along the axis, at least 3, the two ends included.
        """
        s = self.stations(rings)
        phi = np.arange(segments) * (2.0 * np.pi / segments)
        points = self.points(phi, s[:, None])
        center = self.section(s[[0, -1]])[0]
        poles = self._carved(self._assemble(s[[0, -1]], center[:, 0], center[:, 1]))
        keep = slice(1 if self.round_ends[0] else 0, -1 if self.round_ends[1] else None)
        return rings_to_mesh(points[keep], poles[0], poles[1])

    def gauge(self, points: ArrayLike) -> Array:
        """Return how far out points lie, before carving: below 1 inside, 1 on the surface, above outside.

        Args:
            points: Points [m], shape (..., 3).
        """
        located = np.asarray(points, dtype=float)
        main, one, two = _AXES[self.axis]
        s = located[..., main]
        center, half, exponent = self.section(s)
        scaled = (located[..., [one, two]] - center) / np.maximum(half, 1e-9)
        phi = np.arctan2(scaled[..., 1], scaled[..., 0])
        gauge = np.hypot(scaled[..., 0], scaled[..., 1]) / self._rho(phi, s, exponent)
        return np.where((s < self.start) | (s > self.end), np.inf, gauge)

    def hit(self, origins: ArrayLike, directions: ArrayLike, reach: float = 0.5) -> Array:
        """Return where rays that start inside leave the surface, shape (..., 3) [m], by bisection.

        Args:
            origins: Points inside [m], shape (..., 3).
            directions: Unit vectors, shape (..., 3).
            reach: Length of the rays [m]; their far ends must lie outside.
        """
        begin, along = np.broadcast_arrays(
            np.asarray(origins, dtype=float), np.asarray(directions, dtype=float)
        )
        if np.any(self.gauge(begin) > 1.0):
            raise InvalidValueError("origins", "points outside the surface", "points inside the surface")
        low, high = np.zeros(begin.shape[:-1]), np.full(begin.shape[:-1], reach)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            inside = self.gauge(begin + middle[..., None] * along) <= 1.0
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return self._carved(begin + low[..., None] * along)
