"""Curves that a hand follows: straight lines, arcs and splines, by arc length, with blended corners."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model.joint_vectors import as_finite

interpolate = lazy_module("scipy.interpolate")

_SMOOTH = 1e-6  # difference of directions up to which there is no corner [rad]
_SAME = 1e-9  # distance up to which two points are equal [m]
_CELLS = 64  # number of cells of the arc-length table, for each polynomial
_MOST_OF_CURVE = 0.5  # maximum length of a blend, relative to each curve that it joins


class HandCurve(FrozenArrays, ABC):
    """A curve of a hand's route; it begins where the previous curve ends.

    Attributes:
        blend: Distance from the curve's end [m] at which the route leaves the curve; it joins the next curve
            at the same distance from its beginning, with continuous direction and curvature.  0 for no blend:
            the hand stops if there is a corner.
    """

    blend: float

    @abstractmethod
    def placed(self, begin: Array) -> PlacedCurve:
        """Return the curve that begins at a point [m], shape (3,)."""


@dataclass(frozen=True, eq=False)
class PlacedCurve:
    """A curve with a given first point, a line in this class.

    Attributes:
        begin: First point [m], shape (3,).
        length: Length of the curve [m].
        end: Last point [m], shape (3,).
    """

    begin: Array
    length: float
    end: Array

    def at(self, distance: ArrayLike, derivative: int = 0) -> Array:
        """Return points [m], shape (..., 3), at distances along the curve [m], or a derivative, up to 2."""
        along = np.asarray(distance, dtype=float)[..., None]
        direction = (self.end - self.begin) / (self.length or 1.0)
        if derivative == 0:
            return np.asarray(self.begin + along * direction)
        return np.broadcast_to(direction if derivative == 1 else np.zeros(3), (*along.shape[:-1], 3))


@dataclass(frozen=True, eq=False)
class PlacedArc(PlacedCurve):
    """A circular arc with a given first point.

    Attributes:
        center: A point on the axis [m], shape (3,).
        axis: Axis of rotation, a unit vector, shape (3,).
    """

    center: Array
    axis: Array

    def at(self, distance: ArrayLike, derivative: int = 0) -> Array:
        """Return points [m] or derivatives, shape (..., 3), at distances along the curve [m]."""
        radius = self.begin - self.center
        along = (radius @ self.axis) * self.axis
        across = radius - along
        size = np.linalg.norm(across)
        angle = np.asarray(distance, dtype=float)[..., None] / size + derivative * np.pi / 2
        turned = np.cos(angle) * across + np.sin(angle) * np.cross(self.axis, across)
        return np.asarray(turned / size**derivative + (self.center + along if derivative == 0 else 0.0))


class PlacedPolynomial(PlacedCurve):
    """A polynomial curve, parametrized by arc length with a table.

    Args:
        curve: Points as a polynomial of a parameter u, a BPoly or spline of SciPy with values of shape (3,).
    """

    def __init__(self, curve: Any) -> None:
        ends = curve.x
        cells = np.unique(np.linspace(ends[:-1], ends[1:], _CELLS + 1, axis=1))
        nodes, weights = np.polynomial.legendre.leggauss(5)
        half = np.diff(cells)[:, None] / 2
        slope = curve.derivative()
        speed = np.linalg.norm(slope(cells[:-1, None] + half * (1 + nodes)), axis=-1)
        table = np.concatenate([[0.0], np.cumsum((speed * weights * half).sum(axis=1))])
        super().__init__(curve(ends[0]), float(table[-1]), curve(ends[-1]))
        parameter = interpolate.CubicHermiteSpline(table, cells, 1.0 / np.linalg.norm(slope(cells), axis=-1))
        object.__setattr__(self, "_curves", (curve, slope, slope.derivative(), parameter))

    def at(self, distance: ArrayLike, derivative: int = 0) -> Array:
        """Return points [m] or derivatives, shape (..., 3), at distances along the curve [m]."""
        curve, slope, bend, parameter = vars(self)["_curves"]
        u = parameter(distance)
        if derivative == 0:
            return np.asarray(curve(u))
        first = slope(u)
        square = (first**2).sum(axis=-1, keepdims=True)
        if derivative == 1:
            return np.asarray(first / np.sqrt(square))
        second = bend(u)
        return np.asarray((second - first * (first * second).sum(axis=-1, keepdims=True) / square) / square)


@dataclass(frozen=True, eq=False)
class PartOfCurve(PlacedCurve):
    """A part of a curve, without the ends that blends replace.

    Attributes:
        whole: The whole curve.
        cut: Length that is cut off at the beginning [m].
    """

    whole: PlacedCurve
    cut: float

    @classmethod
    def of(cls, whole: PlacedCurve, begin: float, end: float) -> PlacedCurve:
        """Return a curve without a length at its beginning and a length at its end [m]."""
        if not (begin or end):
            return whole
        length = whole.length - begin - end
        return cls(whole.at(begin), length, whole.at(begin + length), whole, begin)

    def at(self, distance: ArrayLike, derivative: int = 0) -> Array:
        """Return points [m] or derivatives, shape (..., 3), at distances along the curve [m]."""
        return self.whole.at(np.asarray(distance, dtype=float) + self.cut, derivative)


@dataclass(frozen=True, eq=False)
class Line(HandCurve):
    """A straight line, also under the name `LIN`.

    Attributes:
        to: End point in the world, or with `relative` its offset from the beginning [m], shape (3,).
        relative: Whether `to` is an offset.
        blend: Distance from the end at which the route leaves for the next curve [m], see `HandCurve`.
    """

    to: Array
    relative: bool = field(default=False, kw_only=True)
    blend: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        """Check and copy the fields.

        Raises:
            InvalidValueError: for a point of wrong shape, or with NaN or infinity, or a negative blend.
        """
        object.__setattr__(self, "to", read_only(as_finite(self.to, "to", (3,))))
        _check_blend(self)

    def placed(self, begin: Array) -> PlacedCurve:
        """Return the line that begins at a point [m], shape (3,)."""
        end = begin + self.to if self.relative else self.to
        return PlacedCurve(begin, float(np.linalg.norm(end - begin)), end)


@dataclass(frozen=True, eq=False)
class Arc(HandCurve):
    """A circular arc about an axis.

    Attributes:
        center: A point on the axis, in the world [m], shape (3,).
        axis: Direction of the axis, shape (3,), of any length but zero.
        angle: Angle of rotation, counter-clockwise seen from the tip of the axis [rad].
        blend: Distance from the end at which the route leaves for the next curve [m], see `HandCurve`.
    """

    center: Array
    axis: Array
    angle: float
    blend: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        """Check and copy the fields.

        Raises:
            InvalidValueError: for a vector of wrong shape, with NaN or infinity, an axis of no length, or a
                negative blend.
        """
        _check_blend(self)
        axis = as_finite(self.axis, "axis", (3,))
        norm = float(np.linalg.norm(axis))
        if norm < 1e-9:
            raise InvalidValueError("axis", axis, "a vector that is not zero")
        object.__setattr__(self, "center", read_only(as_finite(self.center, "center", (3,))))
        object.__setattr__(self, "axis", read_only(axis / norm))
        object.__setattr__(self, "angle", float(as_finite(self.angle, "angle", ())))

    def placed(self, begin: Array) -> PlacedCurve:
        """Return the arc that begins at a point [m], shape (3,), of length 0 for a point on the axis."""
        axis = self.axis if self.angle >= 0 else -self.axis
        across = begin - self.center - ((begin - self.center) @ axis) * axis
        length = abs(self.angle) * float(np.linalg.norm(across))
        if length < 1e-12:
            return PlacedCurve(begin, 0.0, begin)
        whole = PlacedArc(begin, length, begin, self.center, axis)
        return PlacedArc(begin, length, whole.at(length), self.center, axis)


@dataclass(frozen=True, eq=False)
class CIRC(HandCurve):
    """A circular arc through one point to another.

    Attributes:
        via: Intermediate point in the world, not on the line from beginning to end [m], shape (3,).
        to: End point in the world [m], shape (3,); for a full circle the first point, with `via` opposite to
            it.
        normal: Axis of a full circle, shape (3,); required there, and only there.
        blend: Distance from the end at which the route leaves for the next curve [m], see `HandCurve`.
    """

    via: Array
    to: Array
    normal: Array | None = None
    blend: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        """Check and copy the fields.

        Raises:
            InvalidValueError: for a point of wrong shape, or with NaN or infinity, or a negative blend.
        """
        for name in ("via", "to") if self.normal is None else ("via", "to", "normal"):
            object.__setattr__(self, name, read_only(as_finite(getattr(self, name), name, (3,))))
        _check_blend(self)

    def placed(self, begin: Array) -> PlacedCurve:
        """Return the arc from a point [m], shape (3,).

        Raises:
            InvalidValueError: for points on a line, or a full circle without `normal`.
        """
        first, second = self.via - begin, self.to - begin
        if np.linalg.norm(second) < 1e-9:
            if self.normal is None:
                raise InvalidValueError("normal", "None", "the axis of a circle that ends where it begins")
            return Arc(begin + first / 2, self.normal, 2 * math.pi).placed(begin)
        axis = np.asarray(np.cross(first, second), float)
        square = axis @ axis
        if square < 1e-18 * (first @ first) * (second @ second) or not square:
            raise InvalidValueError("via", self.via, "a point beside the line from begin to end")
        across = (first @ first) * np.cross(second, axis) - (second @ second) * np.cross(first, axis)
        center = begin + across / (2 * square)
        spokes = begin - center, self.to - center
        turn = math.atan2(np.cross(*spokes) @ axis / math.sqrt(square), spokes[0] @ spokes[1])
        return Arc(center, axis, turn % (2 * math.pi)).placed(begin)


@dataclass(frozen=True, eq=False)
class SPLINE(HandCurve):
    """A cubic spline through points, with continuous curvature.

    Attributes:
        through: Points after the beginning, in the world [m], shape (k, 3).
        blend: Distance from the end at which the route leaves for the next curve [m], see `HandCurve`.
    """

    through: Array
    blend: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        """Check and copy the fields.

        Raises:
            InvalidValueError: for points of wrong shape, or with NaN or infinity, or a negative blend.
        """
        object.__setattr__(self, "through", read_only(as_finite(self.through, "through", (None, 3))))
        _check_blend(self)

    def placed(self, begin: Array) -> PlacedCurve:
        """Return the spline that begins at a point [m], shape (3,), with chord-length parameters.

        Raises:
            InvalidValueError: for equal successive points, or no point.
        """
        points = np.concatenate([begin[None], self.through])
        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if not chords.size or chords.min() < 1e-9:
            raise InvalidValueError("through", self.through, "points that differ from those before")
        return PlacedPolynomial(interpolate.CubicSpline(np.concatenate([[0.0], np.cumsum(chords)]), points))


LIN = Line
"""`Line`, by its name in the languages of industrial robots."""


def _check_blend(curve: HandCurve) -> None:
    blend = float(as_finite(curve.blend, "blend", ()))
    if blend < 0.0:
        raise InvalidValueError("blend", blend, "a distance [m], 0 for none")
    object.__setattr__(curve, "blend", blend)


def _blended(before: PlacedCurve, after: PlacedCurve, blend: float) -> PlacedPolynomial:
    """Return the curve of degree 5 from `blend` before the end of a curve to `blend` [m] into the next.

    At its ends, its first two derivatives are those of the curves by arc length, with a parameter range of 2
    blends.
    """
    span = 2 * blend
    places = (before, before.length - blend), (after, blend)
    ends = [[curve.at(s, k) * span**k for k in range(3)] for curve, s in places]
    return PlacedPolynomial(interpolate.BPoly.from_derivatives([0.0, 1.0], ends))


@dataclass(frozen=True, eq=False)
class Route:
    """Curves one after the other; calling it with distances [m] returns points.

    Attributes:
        curves: The curves in order, blends among them.
        begins: Length of the route before each curve [m], shape (k,).
        length: Length of the route [m].
        corners: Distances at which the direction jumps [m], shape (m,); 0 if it jumps from end to beginning.
        closed: Whether the route ends where it begins.
    """

    curves: tuple[PlacedCurve, ...]
    begins: Array
    length: float
    corners: Array
    closed: bool

    @classmethod
    def of(cls, begin: ArrayLike, curves: HandCurve | Sequence[HandCurve]) -> Route:
        """Return the route from a point [m], shape (3,).

        Raises:
            InvalidValueError: for an item that is not a curve, no curve, or a blend longer than half of one
                of the two curves that it joins.
        """
        items = (curves,) if isinstance(curves, HandCurve) else tuple(curves)
        if not items or not all(isinstance(curve, HandCurve) for curve in items):
            raise InvalidValueError("curves", repr(curves), "one LIN, CIRC, Arc or SPLINE or more")
        placed: list[PlacedCurve] = []
        for curve in items:
            placed.append(curve.placed(placed[-1].end if placed else as_finite(begin, "begin", (3,))))
        blends = [0.0, *(curve.blend for curve in items[:-1]), 0.0]
        for k, blend in enumerate(blends[1:-1]):
            least = min(placed[k].length, placed[k + 1].length)
            if blend > _MOST_OF_CURVE * least * (1.0 + 1e-9):
                allowed = f"at most {_MOST_OF_CURVE * least:.4g} m, half of the shorter curve beside it"
                raise InvalidValueError(f"blend of curve {k}", f"{blend:.4g} m", allowed)
        parts: list[PlacedCurve] = []
        for k, whole in enumerate(placed):
            if blends[k]:
                parts.append(_blended(placed[k - 1], whole, blends[k]))
            parts.append(PartOfCurve.of(whole, blends[k], blends[k + 1]))
        parts = [part for part in parts if part.length > 1e-12] or parts[:1]
        ends = np.cumsum([0.0] + [part.length for part in parts])
        corners = [
            end for end, a, b in zip(ends[1:], parts, parts[1:], strict=False)
            if np.linalg.norm(a.at(a.length, 1) - b.at(0.0, 1)) > _SMOOTH
        ]  # fmt: skip
        first, last = parts[0], parts[-1]
        closed = bool(ends[-1]) and bool(np.linalg.norm(first.begin - last.end) < _SAME)
        if closed and np.linalg.norm(last.at(last.length, 1) - first.at(0.0, 1)) > _SMOOTH:
            corners.insert(0, 0.0)
        return cls(tuple(parts), ends[:-1], float(ends[-1]), np.array(corners), closed)

    def stops(self, step: float) -> Array:
        """Return distances from 0 to the length, at most `step` apart and including every curve's end [m]."""
        parts = [np.zeros(1)]
        for begin, curve in zip(self.begins, self.curves, strict=True):
            count = max(1, math.ceil(curve.length / step - 1e-9)) if curve.length else 0
            parts.append(begin + curve.length * np.arange(1, count + 1) / max(count, 1))
        return np.concatenate(parts)

    def __call__(self, distance: ArrayLike) -> Array:
        """Return the points at distances along the route [m], shape (..., 3)."""
        s = np.asarray(distance, dtype=float)
        index = np.clip(np.searchsorted(self.begins, s, side="left") - 1, 0, len(self.curves) - 1)
        found = np.empty((*s.shape, 3))
        for i, curve in enumerate(self.curves):
            here = index == i
            found[here] = curve.at(s[here] - self.begins[i])
        return found
