"""Objects of a scene: obstacles in the world and objects attached to the robot."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.collision.mesh_file import read_mesh
from pepper_kin.collision.solids import (
    ConvexMesh,
    HalfSpace,
    PointCloud,
    SceneGeometry,
    TriangleMesh,
    not_negative,
    padding,
    within_world,
)
from pepper_kin.collision.uniform_solid import uniform_solid
from pepper_kin.dynamics.load import Load
from pepper_kin.exceptions import InvalidValueError, suspect_millimeters
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, Sphere
from pepper_kin.model.joint_vectors import as_finite, check_positive, refuse_degrees
from pepper_kin.model.shapes import transform

Color = tuple[float, float, float, float]
WOOD: Color = (0.72, 0.53, 0.36, 1.0)
PALETTE: tuple[Color, ...] = (
    WOOD,
    (0.47, 0.68, 0.36, 1.0),
    (0.32, 0.55, 0.75, 1.0),
    (0.88, 0.66, 0.22, 1.0),
    (0.58, 0.46, 0.72, 1.0),
    (0.28, 0.62, 0.60, 1.0),
    (0.80, 0.50, 0.58, 1.0),
    (0.62, 0.62, 0.66, 1.0),
)
"""Default colors of objects, used in turn; none of them is the red of contacts."""
PLASTER: Color = (0.85, 0.86, 0.87, 1.0)
"""Color of floors and walls."""

RIGID_TOLERANCE = 1e-6

AT_REST = read_only(np.zeros(3))


class ObjectPath(Protocol):
    """Pose of an obstacle as a function of time."""

    @property
    def speed(self) -> float:
        """A bound on the speed of its points [m/s]."""

    def poses(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return transform_object_to_world at times of the scene [s], shape (T, 4, 4)."""

    def later(self, time: float) -> ObjectPath:
        """Return the path for a scene that starts later by a time [s]."""


@dataclass(frozen=True, eq=False)
class SceneObject(FrozenArrays):
    """One obstacle.

    Attributes:
        name: Unique name in its scene.
        geometry: Geometry of the obstacle.
        transform_object_to_world: (4, 4), read-only.
        color: Red, green, blue and opacity, 0 to 1.
        velocity: Constant velocity from time 0 of the scene on [m/s], shape (3,), read-only.
        uncertainty: Rate at which the distance to keep from it grows with time [m/s].
        path: Pose at each time, instead of a velocity, for a part of a moving robot; None for none.
    """

    name: str
    geometry: SceneGeometry
    transform_object_to_world: NDArray[np.float64]
    color: Color = WOOD
    velocity: NDArray[np.float64] = field(default_factory=lambda: AT_REST)
    uncertainty: float = 0.0
    path: ObjectPath | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "geometry", _checked(self.name, self.geometry))
        pose = as_rigid(self.transform_object_to_world, f"transform_object_to_world of {self.name!r}")
        within_world(f"position of {self.name!r}", pose[:3, 3])
        object.__setattr__(self, "transform_object_to_world", pose)
        object.__setattr__(self, "color", _color(self.name, self.color))
        if self.velocity is not AT_REST:
            velocity = as_finite(self.velocity, f"velocity of {self.name!r}", (3,))
            object.__setattr__(self, "velocity", read_only(velocity) if velocity.any() else AT_REST)
        slack = not_negative(f"uncertainty of {self.name!r}", self.uncertainty)
        object.__setattr__(self, "uncertainty", slack)
        if self.moves and isinstance(self.geometry, HalfSpace):
            raise InvalidValueError(f"velocity of {self.name!r}", "a half-space", "a bounded shape")

    @property
    def moves(self) -> bool:
        """Whether the obstacle has a velocity, a path or an uncertainty."""
        return self.path is not None or bool(self.velocity.any()) or self.uncertainty > 0.0

    @property
    def speed(self) -> float:
        """Bound on the speed of the obstacle's points [m/s]."""
        return float(np.linalg.norm(self.velocity)) if self.path is None else self.path.speed

    def poses(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return transform_object_to_world at times of the scene [s], shape (T, 4, 4)."""
        if self.path is not None:
            return self.path.poses(times)
        found = np.tile(self.transform_object_to_world, (len(times), 1, 1))
        found[:, :3, 3] += np.outer(times, self.velocity)
        return found

    def at(self, time: float, enlarged: bool = True) -> SceneObject:
        """Return the object after a time [s]: moved, and if `enlarged`, grown as by `Scene.padded`."""
        found = self.moved_to(read_only(self.poses(np.array([time]))[0]))
        if self.path is not None:
            found.__dict__["path"] = self.path.later(time)
        if enlarged and self.uncertainty > 0.0:
            found.__dict__["geometry"] = grown(self.geometry, time * self.uncertainty)
        return found

    def moved_to(self, pose: NDArray[np.float64]) -> SceneObject:
        """Return the object at another pose, which is neither copied nor checked, without its path.

        It is meant for objects that move in every step: a check takes ten times as long.

        Args:
            pose: transform_object_to_world, shape (4, 4), rigid; it must not change afterwards.
        """
        moved = object.__new__(type(self))
        moved.__dict__.update(self.__dict__, transform_object_to_world=pose, path=None)
        return moved


@dataclass(frozen=True, eq=False)
class AttachedObject(FrozenArrays):
    """An object that moves with the robot, such as a cup in a hand.

    Attributes:
        name: Unique name in its scene.
        geometry: Geometry of the object.
        frame: Link or frame of the robot to which it is attached.
        transform_object_to_frame: (4, 4), read-only.
        touch_links: Links that it may touch, in addition to those that move with the frame and its fingers.
        color: Red, green, blue and opacity, 0 to 1.
        mass: Mass [kg]; 0 if it does not count.
        center_of_mass: Center of mass in its own frame [m], shape (3,), read-only; None: its centroid.
        load: Load for the dynamics: a solid of uniform density, shifted to the center of mass; None without a
            mass.
    """

    name: str
    geometry: SceneGeometry
    frame: str
    transform_object_to_frame: NDArray[np.float64]
    touch_links: tuple[str, ...] = ()
    color: Color = WOOD
    mass: float = 0.0
    center_of_mass: NDArray[np.float64] | None = None
    load: Load | None = field(init=False, default=None, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "geometry", _checked(self.name, self.geometry))
        if isinstance(self.geometry, HalfSpace):
            raise InvalidValueError(
                f"geometry of {self.name!r}", "HalfSpace", "a bounded shape where it is attached to the robot"
            )
        if not isinstance(self.frame, str):
            raise InvalidValueError(f"frame of {self.name!r}", repr(self.frame), "the name of a frame")
        pose = as_rigid(self.transform_object_to_frame, f"transform_object_to_frame of {self.name!r}")
        within_world(f"position of {self.name!r}", pose[:3, 3])
        object.__setattr__(self, "transform_object_to_frame", pose)
        links = (self.touch_links,) if isinstance(self.touch_links, str) else tuple(self.touch_links)
        if not all(isinstance(link, str) for link in links):
            raise InvalidValueError(f"touch_links of {self.name!r}", links, "names of links")
        object.__setattr__(self, "touch_links", links)
        object.__setattr__(self, "color", _color(self.name, self.color))
        object.__setattr__(self, "load", self._as_load())

    def __str__(self) -> str:
        weight = f", {self.mass:.4g} kg" if self.mass else ""
        return f"{self.name} on {self.frame}{weight}"

    def _as_load(self) -> Load | None:
        """Check mass and center of mass, and return the object as a load of its frame."""
        if self.center_of_mass is not None:
            center = as_finite(self.center_of_mass, f"center_of_mass of {self.name!r}", (3,))
            within_world(f"center_of_mass of {self.name!r}", center)
            object.__setattr__(self, "center_of_mass", read_only(center))
        weightless = not isinstance(self.mass, bool) and self.mass == 0
        mass = 0.0 if weightless else check_positive(f"mass of {self.name!r}", self.mass, "[kg], or 0")
        object.__setattr__(self, "mass", mass)
        if weightless:
            return None
        solid = uniform_solid(self.name, self.geometry)
        turn, origin = self.transform_object_to_frame[:3, :3], self.transform_object_to_frame[:3, 3]
        own = solid.center if self.center_of_mass is None else self.center_of_mass
        x, y, z = (turn @ own + origin).tolist()
        tensor = mass * (turn @ solid.inertia @ turn.T)
        xx, xy, xz, yy, yz, zz = ((tensor + tensor.T) / 2)[np.triu_indices(3)].tolist()
        return Load(self.frame, mass, (x, y, z), (xx, xy, xz, yy, yz, zz), self.name)

    @property
    def extent(self) -> float:
        """Upper bound of the distance of the object's points from the frame's origin [m]."""
        pose, shape = self.transform_object_to_frame, self.geometry
        if isinstance(shape, Mesh):
            shape = TriangleMesh(*read_mesh(shape.path, shape.scale))
        if isinstance(shape, ConvexMesh | TriangleMesh | PointCloud):
            points = shape.points if isinstance(shape, PointCloud) else shape.vertices
            reach = np.linalg.norm(points @ pose[:3, :3].T + pose[:3, 3], axis=1).max(initial=0.0)
            return float(reach) + padding(shape)
        return float(np.linalg.norm(pose[:3, 3])) + _radius(shape)


def grown(geometry: SceneGeometry, margin: float) -> SceneGeometry:
    """Return a shape that contains all points within `margin` [m] of a given one.

    Boxes and cylinders keep their sharp edges, so they grow by more there; meshes get a padding.
    """
    match geometry:
        case Box():
            x, y, z = (length + 2 * margin for length in geometry.size)
            return Box((x, y, z))
        case Sphere():
            return Sphere(geometry.radius + margin)
        case Cylinder():
            return Cylinder(geometry.radius + margin, geometry.length + 2 * margin)
        case Capsule():
            return Capsule(geometry.radius + margin, geometry.length)
        case HalfSpace():
            return HalfSpace(geometry.offset + margin)
        case PointCloud():
            return PointCloud(geometry.points, geometry.radius + margin)
        case ConvexMesh():
            return ConvexMesh(geometry.vertices, geometry.padding + margin)
        case TriangleMesh():
            return TriangleMesh(geometry.vertices, geometry.faces, geometry.padding + margin)
        case Mesh():
            return TriangleMesh(*read_mesh(geometry.path, geometry.scale), margin)


def same_item(a: SceneObject | AttachedObject, b: SceneObject | AttachedObject) -> bool:
    """Return whether two objects are equal to the last bit."""
    if (a.name, a.color) != (b.name, b.color) or not same_geometry(a.geometry, b.geometry):
        return False
    if isinstance(a, SceneObject) and isinstance(b, SceneObject):
        same = np.array_equal(a.velocity, b.velocity) and a.uncertainty == b.uncertainty and a.path is b.path
        return same and np.array_equal(a.transform_object_to_world, b.transform_object_to_world)
    if isinstance(a, AttachedObject) and isinstance(b, AttachedObject):
        same = (a.frame, a.touch_links, a.mass, a.load) == (b.frame, b.touch_links, b.mass, b.load)
        return same and np.array_equal(a.transform_object_to_frame, b.transform_object_to_frame)
    return False


def same_geometry(a: SceneGeometry, b: SceneGeometry) -> bool:
    """Return whether two shapes are equal to the last bit."""
    if isinstance(a, ConvexMesh) and isinstance(b, ConvexMesh):
        return a.padding == b.padding and np.array_equal(a.vertices, b.vertices)
    if isinstance(a, TriangleMesh) and isinstance(b, TriangleMesh):
        same = np.array_equal(a.vertices, b.vertices) and np.array_equal(a.faces, b.faces)
        return same and a.padding == b.padding
    if isinstance(a, PointCloud) and isinstance(b, PointCloud):
        return a.radius == b.radius and np.array_equal(a.points, b.points)
    return bool(a == b)


def as_rigid(value: ArrayLike, quantity: str) -> NDArray[np.float64]:
    """Return a read-only copy of a transform, shape (4, 4).

    Raises:
        InvalidValueError: for NaN, a wrong shape, or a matrix that is not a rotation and a translation.
    """
    pose = as_finite(value, quantity, (4, 4))
    # Plain floats: for so few numbers NumPy would take ten times as long.
    (a, b, c, _), (d, e, f, _), (g, h, i, _), (x, y, z, one) = pose.tolist()
    lengths = (a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i, one)
    products = (a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i, x, y, z)
    off = max(*(abs(length - 1.0) for length in lengths), *map(abs, products))
    volume = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
    if not (volume > 0.0 and off <= RIGID_TOLERANCE):
        raise InvalidValueError(
            quantity, "a matrix that is not rigid", "a rotation, a translation and the row 0 0 0 1"
        )
    return read_only(pose)


def _checked(name: str, geometry: SceneGeometry) -> SceneGeometry:
    """Return a geometry after a check of its type and size, the path of a mesh file made absolute."""
    if not isinstance(geometry, SceneGeometry):
        raise InvalidValueError(
            f"geometry of {name!r}",
            type(geometry).__name__,
            "Box, Sphere, Cylinder, Capsule, Mesh, HalfSpace, ConvexMesh, TriangleMesh or PointCloud",
        )
    if isinstance(geometry, Box | Sphere | Cylinder | Capsule):
        lengths = geometry.size if isinstance(geometry, Box) else tuple(vars(geometry).values())
        within_world(f"size of {name!r}", np.array(lengths))
    if not isinstance(geometry, Mesh):
        return geometry
    return replace(geometry, path=Path(geometry.path).absolute())


def _radius(shape: SceneGeometry) -> float:
    """Return the radius of the sphere about its own origin that encloses a primitive shape [m]."""
    match shape:
        case Box():
            return float(np.linalg.norm(shape.size)) / 2
        case Sphere():
            return shape.radius
        case Capsule():
            return shape.radius + shape.length / 2
        case Cylinder():
            return float(np.hypot(shape.radius, shape.length / 2))
    return float("inf")


def _color(name: str, color: Color) -> Color:
    """Return a color as four floats after a check that they are from 0 to 1."""
    if any(color is known for known in PALETTE):
        return color
    numbers = as_finite(color, f"color of {name!r}", (4,))
    if not ((numbers >= 0) & (numbers <= 1)).all():
        raise InvalidValueError(f"color of {name!r}", color, "numbers in [0, 1]: r, g, b, opacity")
    red, green, blue, opacity = numbers.tolist()
    return (red, green, blue, opacity)


def checked_pairs(allowed: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return pairs of names that may touch, each pair sorted."""
    pairs = []
    for pair in [allowed] if isinstance(allowed, str | bytes) else allowed:
        names = tuple(pair) if isinstance(pair, list | tuple) else ()
        if len(names) != 2 or not all(isinstance(name, str) for name in names):
            raise InvalidValueError("allowed", repr(pair), "pairs of names of objects or links")
        pairs.append(sorted_pair(*names))
    return pairs


def sorted_pair(a: str, b: str) -> tuple[str, str]:
    """Return two names, sorted."""
    return (a, b) if a <= b else (b, a)


def placed(name: str, position: ArrayLike, rpy: ArrayLike) -> NDArray[np.float64]:
    """Return the transform to the world, shape (4, 4), from an object's position [m] and rpy [rad].

    Raises:
        InvalidValueError: for NaN, another shape, or angles of more than a whole turn.

    Warns:
        UserWarning: for a position beyond 50 m, which suggests millimeters.
    """
    refuse_degrees(angles := as_finite(rpy, f"rpy of {name!r}", (3,)), f"rpy of {name!r}")
    found = transform(as_finite(position, f"position of {name!r}", (3,)), angles)
    if question := suspect_millimeters(float(np.abs(found[:3, 3]).max())):
        warnings.warn(f"position of {name!r}: {question}", UserWarning, stacklevel=4)
    return found


def number_of(name: str, what: str, value: float) -> float:
    """Return a finite parameter of an object, such as its radius [m]."""
    return float(as_finite(value, f"{what} of {name!r}", ()))
