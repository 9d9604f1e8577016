"""The module `almath` of Python scripts: angles, poses in the plane and in space, and transforms."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, ClassVar, Self

import numpy as np

from pepper_kin.model import pose as pose_of
from pepper_kin.model import rpy_from_rotation
from pepper_kin.planners import car_curve

PI = math.pi
PI_2, PI_4, _2_PI_ = PI / 2.0, PI / 4.0, 2.0 * PI
TO_RAD, TO_DEG = PI / 180.0, 180.0 / PI
AXIS_MASK_X, AXIS_MASK_Y, AXIS_MASK_Z = 1, 2, 4
AXIS_MASK_WX, AXIS_MASK_WY, AXIS_MASK_WZ = 8, 16, 32
AXIS_MASK_VEL, AXIS_MASK_ROT, AXIS_MASK_ALL, AXIS_MASK_NONE = 7, 56, 63, 0
AXIS_MASK_XY, AXIS_MASK_XYZ = 3, 7


class _Numbers:
    """Some named numbers that add up and scale."""

    names: ClassVar[tuple[str, ...]] = ()

    def __init__(self, *values: Any) -> None:
        if len(values) == 1 and isinstance(values[0], Iterable | _Numbers):
            values = tuple(values[0])
        elif len(values) == 1 and len(self.names) > 1:
            values = values * len(self.names)
        filled = tuple(values) + (0.0,) * (len(self.names) - len(values))
        for name, value in zip(self.names, filled, strict=True):
            setattr(self, name, float(value))

    def __iter__(self) -> Iterator[float]:
        return iter([getattr(self, name) for name in self.names])

    def toVector(self) -> list[float]:
        """Return the numbers."""
        return list(self)

    def __add__(self, other: Iterable[float]) -> Self:
        return type(self)(*(a + b for a, b in zip(self, other, strict=True)))

    def __sub__(self, other: Iterable[float]) -> Self:
        return type(self)(*(a - b for a, b in zip(self, other, strict=True)))

    def __mul__(self, factor: Any) -> Any:
        return type(self)(*(a * factor for a in self))

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> Self:
        return type(self)(*(a / divisor for a in self))

    def __neg__(self) -> Self:
        return type(self)(*(-a for a in self))

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({', '.join(f'{n}={v:g}' for n, v in zip(self.names, self, strict=True))})"
        )

    def isNear(self, other: Iterable[float], epsilon: float = 1e-4) -> bool:
        """Return whether all numbers are near to those of another."""
        return all(abs(a - b) <= epsilon for a, b in zip(self, other, strict=True))

    def norm(self) -> float:
        """Return the length."""
        return math.sqrt(sum(a * a for a in self))

    def normalize(self) -> Self:
        """Return this with a length of 1."""
        return self / max(self.norm(), 1e-300)


class Position2D(_Numbers):
    """x, y [m]."""

    names = ("x", "y")


class Position3D(_Numbers):
    """x, y, z [m]."""

    names = ("x", "y", "z")


class Rotation3D(_Numbers):
    """Rotations about x, y, z [rad]: Rz(wz) Ry(wy) Rx(wx)."""

    names = ("wx", "wy", "wz")


class Position6D(_Numbers):
    """x, y, z [m] and rotations about x, y, z [rad]."""

    names = ("x", "y", "z", "wx", "wy", "wz")


class Velocity3D(_Numbers):
    """Velocities along x, y, z [m/s]."""

    names = ("xd", "yd", "zd")


class Velocity6D(_Numbers):
    """Velocities along x, y, z [m/s] and about them [rad/s]."""

    names = ("xd", "yd", "zd", "wxd", "wyd", "wzd")


class PositionAndVelocity(_Numbers):
    """A value and its rate."""

    names = ("q", "dq")


class Pose2D(_Numbers):
    """x, y [m] and theta [rad] in the plane; products chain."""

    names = ("x", "y", "theta")

    def __mul__(self, other: Any) -> Pose2D:
        if not isinstance(other, Pose2D):
            return Pose2D(*(a * float(other) for a in self))
        cos, sin = math.cos(self.theta), math.sin(self.theta)  # type: ignore[attr-defined]
        x, y, theta = other
        mine = list(self)
        return Pose2D(mine[0] + cos * x - sin * y, mine[1] + sin * x + cos * y, mine[2] + theta)

    def inverse(self) -> Pose2D:
        """Return the inverse."""
        x, y, theta = self
        cos, sin = math.cos(theta), math.sin(theta)
        return Pose2D(-cos * x - sin * y, sin * x - cos * y, -theta)

    def diff(self, other: Pose2D) -> Pose2D:
        """Return where another pose is as seen from this."""
        return self.inverse() * other

    def getAngle(self) -> float:
        """Return the direction of (x, y) [rad]."""
        x, y, _ = self
        return math.atan2(y, x)

    @staticmethod
    def fromPolarCoordinates(radius: float, angle: float) -> Pose2D:
        """Return the pose at a distance in a direction, turned to it."""
        return Pose2D(radius * math.cos(angle), radius * math.sin(angle), angle)


_CELLS = tuple(f"r{row}_c{column}" for row in (1, 2, 3) for column in (1, 2, 3, 4))


class Transform:
    """A rotation and a translation; `r1_c4` is row 1, column 4."""

    _matrix: np.ndarray

    def __init__(self, *values: Any) -> None:
        matrix = np.eye(4)
        if len(values) == 1 and not isinstance(values[0], str):
            matrix[:3] = np.reshape(list(values[0])[:12], (3, 4))
        elif len(values) == 3:
            matrix[:3, 3] = values
        object.__setattr__(self, "_matrix", matrix)

    def __getattr__(self, name: str) -> float:
        if name not in _CELLS:
            raise AttributeError(name)
        return float(self._matrix[int(name[1]) - 1, int(name[-1]) - 1])

    def __setattr__(self, name: str, value: float) -> None:
        if name not in _CELLS:
            raise AttributeError(name)
        self._matrix[int(name[1]) - 1, int(name[-1]) - 1] = value

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Position3D):
            return Position3D(*(self._matrix[:3, :3] @ list(other) + self._matrix[:3, 3]))
        return of_matrix(self._matrix @ other._matrix)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Transform) and bool(np.array_equal(self._matrix, other._matrix))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Transform({self.toVector()})"

    def __iter__(self) -> Iterator[float]:
        return iter(self.toVector())

    def toVector(self) -> list[float]:
        """Return the 16 numbers, row by row."""
        return [float(x) for x in self._matrix.ravel()]

    def inverse(self) -> Transform:
        """Return the inverse."""
        return of_matrix(np.linalg.inv(self._matrix))

    def diff(self, other: Transform) -> Transform:
        """Return where another transform is as seen from this."""
        return of_matrix(np.linalg.inv(self._matrix) @ other._matrix)

    def norm(self) -> float:
        """Return the length of the translation."""
        return float(np.linalg.norm(self._matrix[:3, 3]))

    def distance(self, other: Transform) -> float:
        """Return the distance of the translations."""
        return float(np.linalg.norm(self._matrix[:3, 3] - other._matrix[:3, 3]))

    def isNear(self, other: Transform, epsilon: float = 1e-4) -> bool:
        """Return whether all numbers are near to those of another."""
        return bool(np.abs(self._matrix - other._matrix).max() <= epsilon)

    @staticmethod
    def fromRotX(angle: float) -> Transform:
        """Return a rotation about x [rad]."""
        return Transform.from3DRotation(angle, 0.0, 0.0)

    @staticmethod
    def fromRotY(angle: float) -> Transform:
        """Return a rotation about y [rad]."""
        return Transform.from3DRotation(0.0, angle, 0.0)

    @staticmethod
    def fromRotZ(angle: float) -> Transform:
        """Return a rotation about z [rad]."""
        return Transform.from3DRotation(0.0, 0.0, angle)

    @staticmethod
    def from3DRotation(wx: float, wy: float, wz: float) -> Transform:
        """Return Rz(wz) Ry(wy) Rx(wx) [rad]."""
        return Transform.fromPosition(0.0, 0.0, 0.0, wx, wy, wz)

    @staticmethod
    def fromPosition(
        x: float, y: float, z: float, wx: float = 0.0, wy: float = 0.0, wz: float = 0.0
    ) -> Transform:
        """Return the transform of a position [m] and rotations [rad]."""
        return of_matrix(pose_of((x, y, z), rpy=(wx, wy, wz)))


# The flat names of methods, which scripts use as well.
Transform_fromRotX = transformFromRotX = rotationFromRotX = Transform.fromRotX
Transform_fromRotY = transformFromRotY = rotationFromRotY = Transform.fromRotY
Transform_fromRotZ = transformFromRotZ = rotationFromRotZ = Transform.fromRotZ
Transform_from3DRotation = transformFrom3DRotation = Transform.from3DRotation
Transform_fromPosition = transformFromPosition = Transform.fromPosition
transformInverse, transformDiff = Transform.inverse, Transform.diff
transformToFloatVector = Transform.toVector
Pose2D_fromPolarCoordinates, pose2DInverse = Pose2D.fromPolarCoordinates, Pose2D.inverse


def of_matrix(matrix: Any) -> Transform:
    """Return the transform of a 4 x 4 matrix."""
    return Transform([float(x) for x in np.asarray(matrix)[:3].ravel()])


def transformFromRotation3D(rotation: Iterable[float]) -> Transform:
    """Return Rz(wz) Ry(wy) Rx(wx) [rad]."""
    return Transform.from3DRotation(*rotation)


def transformFromPosition3D(position: Iterable[float]) -> Transform:
    """Return the translation to a position [m]."""
    return transformFromPosition(*position)


def transformFromPosition6D(position: Iterable[float]) -> Transform:
    """Return the transform of a Position6D."""
    return transformFromPosition(*position)


def transformFromPose2D(pose: Iterable[float]) -> Transform:
    """Return the transform of a pose in the plane."""
    x, y, theta = pose
    return transformFromPosition(x, y, 0.0, 0.0, 0.0, theta)


def position6DFromTransform(transform: Transform) -> Position6D:
    """Return position [m] and rotations [rad] of a transform."""
    matrix = transform._matrix
    return Position6D(*matrix[:3, 3], *rpy_from_rotation(matrix[:3, :3]))


def position3DFromTransform(transform: Transform) -> Position3D:
    """Return the position of a transform [m]."""
    return Position3D(*transform._matrix[:3, 3])


def position3DFromPosition6D(position: Iterable[float]) -> Position3D:
    """Return the position of a Position6D [m]."""
    return Position3D(*list(position)[:3])


def rotation3DFromTransform(transform: Transform) -> Rotation3D:
    """Return the rotations of a transform [rad]."""
    return Rotation3D(*rpy_from_rotation(transform._matrix[:3, :3]))


def pose2DFromTransform(transform: Transform) -> Pose2D:
    """Return the pose in the plane of a transform."""
    matrix = transform._matrix
    return Pose2D(matrix[0, 3], matrix[1, 3], math.atan2(matrix[1, 0], matrix[0, 0]))


def pose2DFromPosition6D(position: Iterable[float]) -> Pose2D:
    """Return the pose in the plane of a Position6D."""
    x, y, _, _, _, wz = position
    return Pose2D(x, y, wz)


def changeRepereTransformToPosition3D(transform: Transform, position: Position3D) -> Position3D:
    """Return a position as seen from outside of a transform."""
    return Position3D(*(transform * position))


def clipData(lower: float, upper: float, value: float) -> float:
    """Return a value within limits."""
    return min(max(value, lower), upper)


def modulo2PI(angle: float) -> float:
    """Return an angle in (-pi, pi] [rad]."""
    turned = math.remainder(angle, 2.0 * PI)
    return PI if turned == -PI else turned


def meanAngle(angles: Iterable[float]) -> float:
    """Return the mean of angles [rad]."""
    values = list(angles)
    return math.atan2(sum(map(math.sin, values)), sum(map(math.cos, values)))


def vectorFloat(values: Iterable[float] = ()) -> list[float]:
    """Return a list."""
    return list(values)


vectorPose2D = vectorPosition6D = vectorPosition2D = vectorFloat


def getDubinsSolutions(target: Pose2D, circleRadius: float) -> list[Pose2D]:
    """Return poses along the shortest way that only turns with a radius; arcs are cut at right angles.

    Args:
        target: Where to arrive, as seen from the start.
        circleRadius: Of the arcs [m].
    """
    curve = car_curve((0.0, 0.0, 0.0), list(target), circleRadius, backward=False)
    ends = [0.0]
    for turn, length in zip(curve.turns, curve.lengths, strict=True):
        parts = max(math.ceil(length / (circleRadius * PI_2)), 1) if turn else 1
        ends += [ends[-1] + length * (k + 1) / parts for k in range(parts)]
    return [Pose2D(*pose) for pose in curve(ends[1:])]
