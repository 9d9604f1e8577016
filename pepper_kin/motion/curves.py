"""Curves that a hand follows: straight lines and arcs, by arc length."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite


class HandCurve(FrozenArrays, ABC):
    """One piece of the way of a hand; it begins where the piece before ends."""

    @abstractmethod
    def placed(self, begin: Array) -> PlacedCurve:
        """Return the curve that begins at a point [m], shape (3,)."""


@dataclass(frozen=True, eq=False)
class PlacedCurve:
    """A curve with its beginning.

    Attributes:
        begin: Where it begins [m], shape (3,).
        length: Its length [m].
        end: Where it ends [m], shape (3,).
        center: Of an arc [m], shape (3,); None for a line.
        axis: Unit vector about which an arc turns, shape (3,); None for a line.
    """

    begin: Array
    length: float
    end: Array
    center: Array | None = None
    axis: Array | None = None

    def at(self, distance: ArrayLike) -> Array:
        """Return the points at distances along the curve [m], shape (..., 3)."""
        part = np.asarray(distance, dtype=float)[..., None] / (self.length or 1.0)
        if self.center is None or self.axis is None:
            return np.asarray(self.begin + part * (self.end - self.begin))
        radius = self.begin - self.center
        along = (radius @ self.axis) * self.axis
        across = radius - along
        angle = part * self.length / np.linalg.norm(across)
        turned = np.cos(angle) * across + np.sin(angle) * np.cross(self.axis, across)
        return np.asarray(self.center + along + turned)


@dataclass(frozen=True, eq=False)
class Line(HandCurve):
    """A straight line.

    Attributes:
        to: Where it ends in the world, or with `relative` how far from its beginning [m], shape (3,).
        relative: Whether `to` is a difference.
    """

    to: Array
    relative: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        """Check and copy.

        Raises:
            InvalidValueError: for a point of wrong shape, or with NaN or infinity.
        """
        object.__setattr__(self, "to", read_only(as_finite(self.to, "to", (3,))))

    def placed(self, begin: Array) -> PlacedCurve:
        """Return the line from a point [m], shape (3,)."""
        end = begin + self.to if self.relative else self.to
        return PlacedCurve(begin, float(np.linalg.norm(end - begin)), end)


@dataclass(frozen=True, eq=False)
class Arc(HandCurve):
    """A circular arc about an axis.

    Attributes:
        center: A point on the axis, in the world [m], shape (3,).
        axis: Direction of the axis, shape (3,), of any length but zero.
        angle: How far to turn, counter-clockwise seen from the tip of the axis [rad].
    """

    center: Array
    axis: Array
    angle: float

    def __post_init__(self) -> None:
        """Check and copy.

        Raises:
            InvalidValueError: for a vector of wrong shape, with NaN or infinity, or an axis of no length.
        """
        axis = as_finite(self.axis, "axis", (3,))
        norm = float(np.linalg.norm(axis))
        if norm < 1e-9:
            raise InvalidValueError("axis", axis, "a vector that is not zero")
        object.__setattr__(self, "center", read_only(as_finite(self.center, "center", (3,))))
        object.__setattr__(self, "axis", read_only(axis / norm))
        object.__setattr__(self, "angle", float(as_finite(self.angle, "angle", ())))

    def placed(self, begin: Array) -> PlacedCurve:
        """Return the arc from a point [m], shape (3,); of no length where the point is on the axis."""
        axis = self.axis if self.angle >= 0 else -self.axis
        across = begin - self.center - ((begin - self.center) @ axis) * axis
        length = abs(self.angle) * float(np.linalg.norm(across))
        if length < 1e-12:
            return PlacedCurve(begin, 0.0, begin)
        whole = PlacedCurve(begin, length, begin, self.center, axis)
        return PlacedCurve(begin, length, whole.at(length), self.center, axis)


@dataclass(frozen=True, eq=False)
class Route:
    """Curves one after the other.

    Attributes:
        curves: The curves in order.
        begins: Length before each curve [m], shape (k,).
        length: Length of all [m].
    """

    curves: tuple[PlacedCurve, ...]
    begins: Array
    length: float

    @classmethod
    def of(cls, begin: Array, curves: tuple[HandCurve, ...]) -> Route:
        """Return the route from a point [m], shape (3,)."""
        placed: list[PlacedCurve] = []
        for curve in curves:
            placed.append(curve.placed(placed[-1].end if placed else begin))
        ends = np.cumsum([0.0] + [curve.length for curve in placed])
        return cls(tuple(placed), ends[:-1], float(ends[-1]))

    def stops(self, step: float) -> Array:
        """Return distances from 0 to the length, at most `step` apart, every curve's end among them [m]."""
        parts = [np.zeros(1)]
        for begin, curve in zip(self.begins, self.curves, strict=True):
            count = max(1, math.ceil(curve.length / step - 1e-9)) if curve.length else 0
            parts.append(begin + curve.length * np.arange(1, count + 1) / max(count, 1))
        return np.concatenate(parts)

    def at(self, distances: Array) -> Array:
        """Return the points at distances along the route [m], shape (k, 3)."""
        index = np.clip(np.searchsorted(self.begins, distances, side="left") - 1, 0, len(self.curves) - 1)
        return np.array(
            [self.curves[i].at(d - self.begins[i]) for i, d in zip(index, distances, strict=True)]
        )
