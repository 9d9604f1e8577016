"""Geometric shapes of a robot's links and of obstacles."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite, check_positive


def _check_positive(shape: object, *names: str) -> None:
    """Set attributes of a frozen shape to floats above zero.

    Raises:
        InvalidValueError: naming shape and attribute.
    """
    for name in names:
        quantity = f"{type(shape).__name__.lower()} {name}"
        object.__setattr__(shape, name, check_positive(quantity, getattr(shape, name), "[m]"))


def _three(quantity: str, value: ArrayLike, allowed: str) -> tuple[float, float, float]:
    """Return three finite numbers, shape (3,).

    Raises:
        InvalidValueError: for anything but three finite numbers, with the text `allowed`.
    """
    try:
        x, y, z = as_finite(value, quantity, (3,)).tolist()
    except InvalidValueError as error:
        raise InvalidValueError(quantity, value, allowed) from error
    return x, y, z


@dataclass(frozen=True)
class Box:
    """A box centered at its frame.

    Attributes:
        size: Full lengths along x, y and z [m].
    """

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        allowed = "three finite lengths above 0 [m]"
        size = _three("box size", self.size, allowed)
        if not all(v > 0 for v in size):
            raise InvalidValueError("box size", self.size, allowed)
        object.__setattr__(self, "size", size)


@dataclass(frozen=True)
class Sphere:
    """A sphere centered at its frame.

    Attributes:
        radius: Radius [m].
    """

    radius: float

    def __post_init__(self) -> None:
        _check_positive(self, "radius")


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along the z axis, centered at its frame.

    Attributes:
        radius: Radius [m].
        length: Height [m].
    """

    radius: float
    length: float

    def __post_init__(self) -> None:
        _check_positive(self, "radius", "length")


@dataclass(frozen=True)
class Capsule:
    """A capsule along the z axis, centered at its frame: all points within `radius` of a segment.

    Attributes:
        radius: Radius [m].
        length: Length of the segment between the centers of the two hemispheres [m].
    """

    radius: float
    length: float

    def __post_init__(self) -> None:
        _check_positive(self, "radius", "length")


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in a file.

    Attributes:
        path: Path of the file (STL, OBJ or DAE).
        scale: Factors along x, y and z.
    """

    path: Path
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if not isinstance(self.path, str | os.PathLike):
            raise InvalidValueError("mesh path", repr(self.path), "the name of a file")
        object.__setattr__(self, "path", Path(self.path))
        object.__setattr__(self, "scale", _three("mesh scale", self.scale, "three finite factors"))


Geometry: TypeAlias = Box | Sphere | Cylinder | Capsule | Mesh


NO_COLOR = (0.8, 0.8, 0.8, 1.0)
"""Color of shapes whose description names none: red, green, blue and opacity."""


@dataclass(frozen=True, eq=False)
class Shape(FrozenArrays):
    """A geometry fixed to a link.

    Attributes:
        name: Unique name.
        link: The link that carries it.
        geometry: The geometry, in its own frame.
        transform_shape_to_link: Pose of the shape in the link's frame [m], shape (4, 4), read-only.
        color: Red, green, blue and opacity, 0 to 1.
    """

    name: str
    link: str
    geometry: Geometry
    transform_shape_to_link: NDArray[np.float64]
    color: tuple[float, float, float, float] = NO_COLOR

    def __post_init__(self) -> None:
        object.__setattr__(self, "transform_shape_to_link", read_only(self.transform_shape_to_link))


def rotation_rpy(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    """Return Rz(yaw) Ry(pitch) Rx(roll), the rotation of URDF's rpy [rad], shape (3, 3)."""
    return np.array(_rows_rpy(roll, pitch, yaw))


def _rows_rpy(roll: float, pitch: float, yaw: float) -> list[list[float]]:
    """Return the rows of Rz(yaw) Ry(pitch) Rx(roll) [rad]."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]


def transform(position: ArrayLike = (0.0, 0.0, 0.0), rpy: ArrayLike = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    """Return the transform, shape (4, 4), of a position [m] and a URDF rpy [rad], shape (3,) each."""
    roll, pitch, yaw = np.asarray(rpy, dtype=float).tolist()
    rows = _rows_rpy(roll, pitch, yaw)
    for row, value in zip(rows, np.asarray(position, dtype=float).tolist(), strict=True):
        row.append(value)
    return np.array([*rows, [0.0, 0.0, 0.0, 1.0]])


def rotation_to_axis(axis: ArrayLike) -> NDArray[np.float64]:
    """Return a rotation, shape (3, 3), that maps z to the direction of `axis`, shape (3,)."""
    z = np.asarray(axis, dtype=float)
    z = z / np.linalg.norm(z)
    helper = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = cross_product(helper, z)
    x /= np.linalg.norm(x)
    return np.array([x, cross_product(z, x), z]).T.copy()


def product(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the product of a matrix, shape (3, 3), and a matrix or vector, shape (3, k) or (3,).

    Rounding is the same on every processor, as values in machine code require; BLAS's is not.
    """
    terms = first[:, :, np.newaxis] * second.reshape(1, 3, -1)
    return (terms[:, 0] + terms[:, 1] + terms[:, 2]).reshape(second.shape)


def cross_product(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cross product of two vectors, shape (3,) each: `np.cross` takes twenty times as long."""
    (a, b, c), (x, y, z) = first.tolist(), second.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])
