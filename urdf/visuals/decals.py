"""Thin plates that follow a surface: eyes, windows, seams, caps, bands.

A decal gives a part of a shell another color without cutting the shell underneath: its visible side lies a
fraction of a millimeter above the shell, its hidden side below, its border dips into the shell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .loft import Loft
from .mesh import Mesh
from .stitching import disc, hoop, plate

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Projector:
    """Parallel rays onto a surface, as from a slide projector inside it.

    Attributes:
        origin: Point inside the surface from which the middle ray starts [m], shape (3,).
        right: Unit vector to the right as seen from outside, shape (3,).
        up: Unit vector upward as seen from outside, shape (3,); rays run along right x up.
    """

    origin: Array
    right: Array
    up: Array

    @classmethod
    def toward(cls, origin: ArrayLike, direction: ArrayLike) -> Projector:
        """Return the projector along a direction, its upward vector as near to z as can be.

        Args:
            origin: Where slide coordinates are zero [m], shape (3,).
            direction: Where rays go, shape (3,), of any length, not parallel to z.
        """
        along = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
        right = np.cross([0.0, 0.0, 1.0], along)
        right /= np.linalg.norm(right)
        return cls(np.asarray(origin, dtype=float), right, np.cross(along, right))

    @property
    def direction(self) -> Array:
        """Unit vector along the rays, shape (3,)."""
        return np.asarray(np.cross(self.right, self.up), dtype=float)

    def onto(self, surface: Loft, across: ArrayLike, upward: ArrayLike) -> Array:
        """Return where rays meet the surface [m], shape (..., 3).

        Args:
            surface: The surface.
            across: Slide coordinate to the right [m], shape (...).
            upward: Slide coordinate upward [m], broadcast with `across`.
        """
        one, two = np.asarray(across, dtype=float)[..., None], np.asarray(upward, dtype=float)[..., None]
        return surface.hit(self.origin + one * self.right + two * self.up, self.direction)


@dataclass(frozen=True)
class Relief:
    """How a decal stands on its shell.

    Attributes:
        lift: Height of the middle above the shell [m]; negative is allowed for a recessed middle.
        sink: Depth of the border below the shell [m].
        depth: Depth of the hidden side below the shell [m], more than `sink`.
        edge: Steepness of the rim: 2 is a dome, 8 a plateau with a rounded rim.
    """

    lift: float = 0.0008
    sink: float = 0.0010
    depth: float = 0.003
    edge: float = 8.0

    def height(self, fraction: ArrayLike) -> Array:
        """Return the height [m] at fractions of the way from the middle, 0, to the border, 1, shape (...)."""
        way = np.clip(np.abs(np.asarray(fraction, dtype=float)), 0.0, 1.0)
        return np.asarray(self.lift - (self.lift + self.sink) * way**self.edge)


FLAT = Relief()


def _rim_fractions(rings: int) -> Array:
    """Return fractions from 0 to 1 that are denser toward the border, shape (rings,)."""
    return np.sin(np.linspace(0.0, np.pi / 2.0, rings))


def _outline(size: tuple[float, float], exponent: float, segments: int) -> Array:
    """Return a superellipse [m], shape (2, segments), with most of its corners where it bends most.

    The points are (a |cos t|^(2/n) sgn cos t, b |sin t|^(2/n) sgn sin t) at even steps of t.
    """
    t = (np.arange(segments) + 0.5) * (2.0 * np.pi / segments)
    power = 2.0 / exponent
    return np.stack(
        [
            size[0] * np.sign(np.cos(t)) * np.abs(np.cos(t)) ** power,
            size[1] * np.sign(np.sin(t)) * np.abs(np.sin(t)) ** power,
        ]
    )


def spot(
    surface: Loft,
    projector: Projector,
    size: tuple[float, float],
    *,
    relief: Relief = FLAT,
    exponent: float = 2.0,
    segments: int = 36,
    rings: int = 4,
) -> Mesh:
    """Return a filled superellipse that lies on a surface.

    Args:
        surface: What it lies on.
        projector: Where it lies.
        size: Half width and half height [m].
        relief: How it stands out.
        exponent: 2 for an ellipse, more for a rounded rectangle.
        segments: Corners around.
        rings: Rings from the middle to the border.
    """
    outline = _outline(size, exponent, segments)
    fraction = _rim_fractions(rings + 1)[1:, None]
    on = projector.onto(surface, fraction * outline[0], fraction * outline[1])
    middle = projector.onto(surface, 0.0, 0.0)
    along = projector.direction
    outer = on + relief.height(fraction)[..., None] * along
    return disc(
        outer, on[-1] - relief.depth * along, middle + relief.lift * along, middle - relief.depth * along
    )


def ring(
    surface: Loft,
    projector: Projector,
    size: tuple[float, float],
    width: float,
    *,
    relief: Relief = FLAT,
    exponent: float = 2.0,
    segments: int = 40,
    rows: int = 3,
) -> Mesh:
    """Return a ring of constant width that lies on a surface.

    Args:
        surface: What it lies on.
        projector: Where its middle lies.
        size: Outer half width and half height [m].
        width: Width of the ring [m].
        relief: How it stands out.
        exponent: 2 for an ellipse, more for a rounded rectangle.
        segments: Corners around.
        rows: Points across the ring.
    """
    across = np.linspace(-1.0, 1.0, rows)[:, None]
    inside = _outline((size[0] - width, size[1] - width), exponent, segments)
    outside = _outline(size, exponent, segments)
    way = 0.5 * (across + 1.0)
    on = projector.onto(
        surface,
        inside[0] + way * (outside[0] - inside[0]),
        inside[1] + way * (outside[1] - inside[1]),
    )
    along = projector.direction
    return hoop(on + relief.height(across)[..., None] * along, on - relief.depth * along)


def band(
    surface: Loft,
    low: float,
    high: float,
    *,
    relief: Relief = FLAT,
    segments: int = 64,
    rows: int = 4,
) -> Mesh:
    """Return a band around a surface between two positions along its axis.

    Args:
        surface: What it goes around.
        low: Where it begins [m].
        high: Where it ends [m].
        relief: How it stands out.
        segments: Corners around.
        rows: Points across the band.
    """
    across = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows))[::-1, None]
    s = 0.5 * (low + high) + 0.5 * (high - low) * across
    phi = np.arange(segments) * (2.0 * np.pi / segments)
    lifted = surface.points(phi, s, relief.height(across))
    return hoop(lifted, surface.points(phi, s, np.full_like(across, -relief.depth)))


def strip(
    surface: Loft,
    origins: ArrayLike,
    directions: ArrayLike,
    *,
    relief: Relief = FLAT,
) -> Mesh:
    """Return a plate where a grid of rays meets a surface.

    Args:
        surface: What it lies on.
        origins: Starts of the rays inside the surface [m], shape (m, n, 3); seen from outside, columns run
            right and rows run up.
        directions: Unit vectors, shape (m, n, 3).
        relief: How it stands out.
    """
    along = np.asarray(directions, dtype=float)
    on = surface.hit(origins, along)
    m, n = on.shape[:2]
    way = np.maximum(np.abs(np.linspace(-1.0, 1.0, m))[:, None], np.abs(np.linspace(-1.0, 1.0, n))[None, :])
    hub = np.mean(np.asarray(origins, dtype=float), axis=(0, 1))
    return plate(on + relief.height(way)[..., None] * along, on - relief.depth * along, hub)
