"""The types of `almath`: positions, velocities, poses, quaternions, rotations, transforms and maps.

Numbers have double precision (on the robot single). Positions are in m, angles in rad.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model import rotation_from_rpy
from pepper_kin.model.poses import quaternions_of, rpy_of

SPACE = ("x", "y", "z", "wx", "wy", "wz")
"""Components of a 6D pose: x, y, z [m], and rotations Rz(wz) Ry(wy) Rx(wx) [rad]."""


class vectorFloat(list[Any]):
    """A list with two methods of C++'s vectors."""

    push_back, size = list.append, list.__len__


class Numbers:
    """A vector of named numbers, with addition and scaling.

    Attributes:
        names: Names of the numbers.
        start: Default values.
        counted: Numbers that count for the norm.
        apart: Numbers that count for the distance.
        shortest: Minimum norm that can be normalized.
    """

    names: ClassVar[tuple[str, ...]] = ()
    start: ClassVar[Array]
    counted: ClassVar[slice] = slice(None)
    apart: ClassVar[slice] = slice(None)
    shortest: ClassVar[float] = 1e-300

    def __init_subclass__(cls, names: str = "", start: Array | None = None) -> None:
        cls.names = tuple(names.split()) or cls.names
        cls.start = np.zeros(len(cls.names)) if start is None else start.ravel()
        for place, name in enumerate(cls.names):
            setattr(cls, name, property(partial(_read, place), partial(_write, place)))

    def __init__(self, *values: Any) -> None:
        self.values: Array = self.start.copy()
        listed = len(values) == 1 and isinstance(values[0], Iterable)
        given = [float(value) for value in (values[0] if listed else values)]
        if not self._take(given, listed):
            message = f"{type(self).__name__} of {len(given)} numbers; it has {len(self.names)}"
            if not listed:
                raise TypeError(message)
            print(f"ALMath: WARNING: {message}, and keeps its default", file=sys.stderr)

    def _take(self, given: list[float], listed: bool) -> bool:
        """Set all numbers from a full list, one number for all, or none; return whether the count fits."""
        fits = len(given) == len(self.names) or (not listed and len(given) in (0, 1))
        if fits and given:
            self.values[:] = given
        return fits

    def of(self, values: Any) -> Self:
        """Return a new object of this type with other values."""
        other = type(self)()
        other.values[:] = values
        return other

    def become(self, other: Numbers) -> Self:
        """Copy the numbers of another object of this type."""
        give(self, other)
        return self

    @classmethod
    def of_matrix(cls, matrix: Array) -> Self:
        """Return this type's numbers of a pose, shape (4, 4)."""
        found = dict(zip(SPACE, [*matrix[:3, 3], *rpy_of(matrix[:3, :3])], strict=True))
        return cls([found["wz" if name == "theta" else name] for name in cls.names])

    def to_matrix(self) -> Array:
        """Return the pose, shape (4, 4); numbers that this type does not have are zero."""
        found, matrix = self.in_space(), np.eye(4)
        matrix[:3, 3] = [found[name] for name in SPACE[:3]]
        matrix[:3, :3] = rotation_from_rpy([found[name] for name in SPACE[3:]])
        return matrix

    def in_space(self) -> dict[str, float]:
        """Return the numbers by the names of `SPACE`, and "theta"."""
        found = {name.removesuffix("d").replace("theta", "wz"): value for name, value in self._items()}
        found = dict.fromkeys(SPACE, 0.0) | found
        return found | {"theta": found["wz"]}

    def _items(self) -> zip[tuple[str, float]]:
        return zip(self.names, self.values.tolist(), strict=True)

    def toVector(self, out: list[float] | None = None) -> list[float] | None:
        """Return the numbers, or write them into a list."""
        if out is None:
            return vectorFloat(self)
        out[:] = self
        return None

    def __iter__(self) -> Iterator[float]:
        return iter(self.values.tolist())

    def __add__(self, other: Numbers) -> Self:
        return self.of(self.values + other.values)

    def __sub__(self, other: Numbers) -> Self:
        return self.of(self.values - other.values)

    def __mul__(self, other: Any) -> Any:
        return self.of(self.values * float(other))

    def __rmul__(self, factor: float) -> Self:
        return self.of(self.values * float(factor))

    def __truediv__(self, divisor: float) -> Self:
        if divisor == 0.0:
            raise RuntimeError(f"{type(self).__name__}: division by zero")
        return self.of(self.values / divisor)

    def __neg__(self) -> Self:
        return self.of(-self.values)

    def __pos__(self) -> Self:
        return self.of(self.values)

    def __iadd__(self, other: Numbers) -> Self:
        return self.become(self + other)

    def __isub__(self, other: Numbers) -> Self:
        return self.become(self - other)

    def __imul__(self, other: Any) -> Self:
        return self.become(self * other)

    def __itruediv__(self, divisor: float) -> Self:
        return self.become(self / divisor)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and bool(np.array_equal(self.values, other.values))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value:g}' for name, value in self._items())})"

    def isNear(self, other: Numbers, epsilon: float = 1e-4) -> bool:
        """Return whether each number differs by at most epsilon from the other object's."""
        return bool(np.abs(self.values - other.values).max() <= epsilon)

    def norm(self) -> float:
        """Return the norm."""
        return float(np.linalg.norm(self.values[self.counted]))

    def normalize(self) -> Self:
        """Return a copy with norm 1."""
        length, other = self.norm(), +self
        if length < self.shortest:
            raise RuntimeError(f"{type(self).__name__}: normalize of a length of {length:g}")
        other.values[self.counted] /= length
        return other

    def distance(self, other: Numbers) -> float:
        """Return the distance [m]."""
        return float(np.linalg.norm((self.values - other.values)[self.apart]))

    def distanceSquared(self, other: Numbers) -> float:
        """Return the square of the distance [m²]."""
        return self.distance(other) ** 2

    def dotProduct(self, other: Numbers) -> float:
        """Return the scalar product."""
        return float(self.values @ other.values)


def _read(place: int, of: Numbers) -> float:
    return float(of.values[place])


def _write(place: int, of: Numbers, value: float) -> None:
    of.values[place] = value


def give(target: Any, result: Any) -> None:
    """Copy a result into an object of its type, or into a list.

    Raises:
        TypeError: if the target has another type, or is a number.
    """
    if isinstance(target, list):
        target[:] = result
    elif isinstance(result, Numbers) and type(target) is type(result):
        target.values[:] = result.values
    else:
        raise TypeError(f"{target!r} cannot become {result!r} in place")


def skew(vector: Iterable[float]) -> Array:
    """Return the matrix of the cross product with a vector, shape (3, 3)."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_of_vector(vector: Iterable[float]) -> Array:
    """Return the rotation matrix of a rotation vector [rad], shape (3, 3) (Rodrigues)."""
    k = skew(vector)
    turns = math.sqrt(float(np.sum(k * k)) / 2.0) / math.pi
    return np.eye(3) + np.sinc(turns) * k + 0.5 * np.sinc(turns / 2.0) ** 2 * k @ k


class Position2D(Numbers, names="x y"):
    """A position x, y [m]."""

    def crossProduct(self, other: Position2D) -> float:
        """Return x1 y2 - y1 x2."""
        return float(self.values[0] * other.values[1] - self.values[1] * other.values[0])

    def getAngle(self) -> float:
        """Return the direction of (x, y) [rad]."""
        return math.atan2(self.values[1], self.values[0])

    @classmethod
    def fromPolarCoordinates(cls, radius: float, angle: float) -> Self:
        """Return the position at a distance [m] in a direction [rad], which is a pose's angle, too."""
        return cls([radius * math.cos(angle), radius * math.sin(angle), angle][: len(cls.names)])


class Position3D(Numbers, names="x y z"):
    """A position x, y, z [m]."""

    def crossProduct(self, other: Position3D) -> Position3D:
        """Return the cross product."""
        return Position3D(np.cross(self.values, other.values))

    def isUnitVector(self, epsilon: float = 1e-4) -> bool:
        """Return whether the length is 1."""
        return abs(1.0 - self.norm()) <= epsilon

    def isOrthogonal(self, other: Position3D, epsilon: float = 1e-4) -> bool:
        """Return whether the scalar product is 0."""
        return abs(self.dotProduct(other)) <= epsilon


class Rotation3D(Numbers, names="wx wy wz"):
    """Rotations about x, y, z [rad]: Rz(wz) Ry(wy) Rx(wx)."""


class Position6D(Numbers, names=" ".join(SPACE)):
    """A pose x, y, z [m], and rotations about x, y, z [rad]; the distance is between the positions."""

    apart = slice(3)


class Velocity3D(Numbers, names="xd yd zd"):
    """Velocities along x, y, z [m/s]."""


class Velocity6D(Numbers, names="xd yd zd wxd wyd wzd"):
    """Linear velocity along [m/s] and angular velocity about x, y, z [rad/s]."""


class PositionAndVelocity(Numbers, names="q dq"):
    """A value and its rate."""


class Pose2D(Position2D, names="x y theta"):
    """A planar pose x, y [m], theta [rad]; products compose; norm and distance are of x, y."""

    counted = apart = slice(2)
    shortest = 1e-4

    def __mul__(self, other: Any) -> Any:
        if not isinstance(other, Position2D):
            return super().__mul__(other)
        x, y, theta = self.values.tolist()
        turned = complex(*other.values[:2]) * complex(math.cos(theta), math.sin(theta))
        return other.of([x + turned.real, y + turned.imag, *(other.values[2:] + theta)])

    def inverse(self) -> Pose2D:
        """Return the inverse."""
        x, y, theta = self.values.tolist()
        return Pose2D(0.0, 0.0, -theta) * Pose2D(-x, -y, 0.0)

    def diff(self, other: Pose2D) -> Pose2D:
        """Return another pose in the frame of this one."""
        return self.inverse() * other


class Quaternion(Numbers, names="w x y z", start=np.eye(1, 4)):
    """A unit quaternion w, x, y, z; q and -q are the same rotation."""

    @classmethod
    def of_matrix(cls, matrix: Array) -> Self:
        x, y, z, w = quaternions_of(matrix[:3, :3]).tolist()
        return cls(w, x, y, z) * math.copysign(1.0, w)

    def to_matrix(self) -> Array:
        k, matrix = skew(self.values[1:]), np.eye(4)
        matrix[:3, :3] += 2.0 * self.values[0] * k + 2.0 * k @ k
        return matrix

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Position3D):
            return Position3D(self.to_matrix()[:3, :3] @ other.values)
        if not isinstance(other, Quaternion):
            return super().__mul__(other)
        (w, a), (v, b) = ((q.values[0], q.values[1:]) for q in (self, other))
        return Quaternion([w * v - a @ b, *(w * b + v * a + np.cross(a, b))])

    def isNear(self, other: Numbers, epsilon: float = 1e-4) -> bool:
        """Return whether each number of q or of -q differs by at most epsilon from the other's."""
        return super().isNear(other, epsilon) or super().isNear(-other, epsilon)

    def inverse(self) -> Quaternion:
        """Return the inverse of a unit quaternion."""
        return self.of(self.values * (1.0, -1.0, -1.0, -1.0))

    @classmethod
    def fromAngleAndAxisRotation(cls, angle: float, x: float, y: float, z: float) -> Self:
        """Return the rotation by an angle [rad] about an axis of length 1."""
        sine = math.sin(0.5 * angle)
        return cls(math.cos(0.5 * angle), x * sine, y * sine, z * sine)


class Matrix(Numbers):
    """A rotation matrix with or without a translation; `r1_c2` is row 1, column 2."""

    columns: ClassVar[int] = 0

    @classmethod
    def of_matrix(cls, matrix: Array) -> Self:
        return cls().of(np.asarray(matrix)[:3, : cls.columns].ravel())

    def to_matrix(self) -> Array:
        matrix = np.eye(4)
        matrix[:3, : self.columns] = self.values.reshape(3, self.columns)
        return matrix

    def __mul__(self, other: Any) -> Any:
        matrix = self.to_matrix()
        if isinstance(other, type(self)):
            return self.of_matrix(matrix @ other.to_matrix())
        if not isinstance(other, Position2D | Position3D | Velocity3D):
            return NotImplemented
        kind = Velocity3D if isinstance(other, Velocity3D) else Position3D
        return kind(matrix[:3, : len(other.names)] @ other.values + matrix[:3, 3])

    def __repr__(self) -> str:
        name = type(self).__name__
        return f"{name}([{self._rows(chr(10) + ' ' * (len(name) + 2))}])"

    def __str__(self) -> str:
        return f"[[{self._rows(']' + chr(10) + ' [')}]]"

    def _rows(self, between: str) -> str:
        rows = self.values.reshape(3, self.columns).tolist()
        return between.join(", ".join(f"{value:g}" for value in row) for row in rows)

    def determinant(self) -> float:
        """Return the determinant of the rotation."""
        return float(np.linalg.det(self.to_matrix()[:3, :3]))

    def is_rotation(self, epsilon: float = 1e-4) -> bool:
        """Return whether the rotation part is a rotation matrix."""
        turn = self.to_matrix()[:3, :3]
        return (
            bool(np.abs(turn.T @ turn - np.eye(3)).max() <= epsilon)
            and abs(self.determinant() - 1.0) <= epsilon
        )

    def make_rotation(self) -> None:
        """Orthonormalize the rotation part: z keeps its direction, x is normal to y and z."""
        matrix = self.to_matrix()
        _, y, z = matrix[:3, :3].T
        x = np.cross(y, z)
        if min(np.linalg.norm(z), np.linalg.norm(x)) < 1e-4:
            matrix[:3, :3] = np.eye(3)
        else:
            x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
            matrix[:3, :3] = np.array([x, np.cross(z, x), z]).T
        self.become(self.of_matrix(matrix))

    def inverse(self) -> Self:
        """Return the inverse."""
        matrix = self.to_matrix()
        matrix[:3, :3] = matrix[:3, :3].T
        matrix[:3, 3] = -matrix[:3, :3] @ matrix[:3, 3]
        return self.of_matrix(matrix)

    @classmethod
    def from3DRotation(cls, wx: float, wy: float, wz: float) -> Self:
        """Return Rz(wz) Ry(wy) Rx(wx) [rad]."""
        return cls.of_matrix(Rotation3D(wx, wy, wz).to_matrix())


def cells(columns: int) -> str:
    """Return the names of a matrix's numbers, three rows."""
    return " ".join(f"r{row}_c{column + 1}" for row in (1, 2, 3) for column in range(columns))


class Rotation(Matrix, names=cells(3), start=np.eye(3)):
    """A rotation matrix, also built from the 12 or 16 numbers of a transform."""

    columns = 3
    isRotation, normalizeRotation, transpose = Matrix.is_rotation, Matrix.make_rotation, Matrix.inverse

    def _take(self, given: list[float], listed: bool) -> bool:
        if listed and len(given) in (12, 16):
            given = [given[4 * row + column] for row in range(3) for column in range(3)]
        return super()._take(given, listed)

    @classmethod
    def fromQuaternion(cls, *quaternion: Any) -> Rotation:
        """Return the rotation of w, x, y, z, or of a `Quaternion`."""
        return cls.of_matrix(Quaternion(*quaternion).to_matrix())

    @classmethod
    def fromAngleDirection(cls, angle: float, *axis: Any) -> Rotation:
        """Return the rotation by an angle [rad] about an axis of length 1."""
        vector = Position3D(*axis)
        if not vector.isUnitVector(5e-6):
            raise RuntimeError(
                f"rotationFromAngleDirection: the axis has a length of {vector.norm():g}, not 1"
            )
        return cls(rotation_of_vector(vector.values * angle).ravel())


class Transform(Matrix, names=cells(4), start=np.eye(3, 4)):
    """A transform, from x, y, z [m] or a list of 12 or 16 numbers; its norm is the length of x, y, z."""

    columns = 4
    counted = apart = slice(3, None, 4)
    isTransform, normalizeTransform = Matrix.is_rotation, Matrix.make_rotation

    def _take(self, given: list[float], listed: bool) -> bool:
        if listed and len(given) in (12, 16):
            self.values[:] = given[:12]
            if not self.is_rotation():
                self.make_rotation()
        elif not listed and len(given) == 3:
            self.values[self.apart] = given
        return len(given) in ((12, 16) if listed else (0, 3))

    def __iter__(self) -> Iterator[float]:
        return iter(self.to_matrix().ravel().tolist())

    def diff(self, other: Transform) -> Transform:
        """Return another transform in the frame of this one."""
        return self.inverse() * other

    @classmethod
    def fromPosition(cls, x: float, y: float, z: float, *rotations: float) -> Self:
        """Return the transform of a position [m] and, optionally, three rotations [rad]."""
        result = cls.from3DRotation(*rotations) if rotations else cls()
        result.values[cls.apart] = (x, y, z)
        return result


class Pair:
    """A pair of other types, with attributes of one letter."""

    kinds: ClassVar[dict[str, type[Numbers]]] = {}

    def __init__(self, *parts: Any) -> None:
        for name, part in zip(self.kinds, parts or [kind() for kind in self.kinds.values()], strict=True):
            setattr(self, name, part)

    def isNear(self, other: Pair, epsilon: float = 1e-4) -> bool:
        """Return whether both parts differ by at most epsilon from the other pair's."""
        return all(getattr(self, name).isNear(getattr(other, name), epsilon) for name in self.kinds)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in self.kinds)})"


class TransformAndVelocity6D(Pair):
    """A transform T and a velocity V."""

    kinds: ClassVar = {"T": Transform, "V": Velocity6D}


class Displacement(Pair):
    """A position P and a quaternion Q; products compose."""

    kinds: ClassVar = {"P": Position3D, "Q": Quaternion}
    P: Position3D
    Q: Quaternion

    @classmethod
    def of_matrix(cls, matrix: Array) -> Self:
        """Return the displacement of a pose, shape (4, 4)."""
        return cls(Position3D.of_matrix(matrix), Quaternion.of_matrix(matrix))

    def to_matrix(self) -> Array:
        """Return the pose, shape (4, 4)."""
        return np.asarray(self.P.to_matrix() @ self.Q.to_matrix())

    def __mul__(self, other: Displacement) -> Displacement:
        return Displacement(self.P + self.Q * other.P, self.Q * other.Q)


def _about(axis: str, angle: float | None = None) -> Any:
    """Return a class method as `fromRotX`, with the angle [rad] of the call or a fixed one."""

    def turn(cls: type[Matrix], *turned: float) -> Matrix:
        by = turned[0] if angle is None else angle
        return cls.from3DRotation(*(by if name == axis else 0.0 for name in "XYZ"))

    return classmethod(turn)


for _axis in "XYZ":
    setattr(Matrix, f"fromRot{_axis}", _about(_axis))
    setattr(Rotation, f"fromRot{_axis}Pi", _about(_axis, math.pi))
Rotation.fromRotZHalfPi = _about("Z", math.pi / 2.0)  # type: ignore[attr-defined]
