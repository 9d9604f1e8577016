"""The world around the robot: named obstacles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.model.shapes import Box, Capsule, Cylinder, Geometry, Sphere, read_only, transform


@dataclass(frozen=True, eq=False)
class SceneObject:
    """One obstacle.

    Attributes:
        name: Unique name in its scene.
        geometry: Its shape.
        transform_object_to_world: (4, 4), read-only.
        color: Red, green, blue and opacity, 0 to 1.
    """

    name: str
    geometry: Geometry
    transform_object_to_world: NDArray[np.float64]
    color: tuple[float, float, float, float] = (0.72, 0.53, 0.36, 1.0)


class Scene:
    """Named obstacles, fixed in the world.

    A scene never changes: every method returns a new one, so a planner that holds a scene cannot see a
    half-changed world.

        scene = Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))

    Attributes:
        objects: Name -> `SceneObject`, read-only, in the order of addition.
    """

    objects: Mapping[str, SceneObject]

    def __init__(self, objects: Mapping[str, SceneObject] | None = None) -> None:
        object.__setattr__(self, "objects", MappingProxyType(dict(objects or {})))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("a Scene is frozen: its methods return a new one")

    def __reduce__(self) -> tuple[type[Scene], tuple[dict[str, SceneObject]]]:
        return (Scene, (dict(self.objects),))

    def __repr__(self) -> str:
        return f"Scene({', '.join(self.objects) or 'empty'})"

    def add(
        self,
        name: str,
        geometry: Geometry,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rpy: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Scene:
        """Return a scene with one more obstacle.

        Args:
            name: A name that the scene does not have yet.
            geometry: Its shape.
            position: Position of its centre in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).

        Raises:
            InvalidValueError: for a name that is taken, or a pose with NaN or of wrong length.
        """
        if not isinstance(name, str) or not name or name in self.objects:
            raise InvalidValueError(
                "object name", repr(name), f"a new name; taken: {', '.join(self.objects)}"
            )
        pose = transform(
            as_finite(position, f"position of {name!r}", (3,)), as_finite(rpy, f"rpy of {name!r}", (3,))
        )
        return Scene({**self.objects, name: SceneObject(name, geometry, read_only(pose))})

    def add_box(
        self, name: str, size: ArrayLike, position: ArrayLike, rpy: ArrayLike = (0.0, 0.0, 0.0)
    ) -> Scene:
        """Return a scene with a box of full lengths `size` [m], shape (3,), more; see `add`."""
        lengths = as_finite(size, f"size of {name!r}", (3,))
        return self.add(name, Box((float(lengths[0]), float(lengths[1]), float(lengths[2]))), position, rpy)

    def add_sphere(self, name: str, radius: float, position: ArrayLike) -> Scene:
        """Return a scene with a sphere [m] more; see `add`."""
        return self.add(name, Sphere(float(radius)), position)

    def add_cylinder(
        self, name: str, radius: float, length: float, position: ArrayLike, rpy: ArrayLike = (0.0, 0.0, 0.0)
    ) -> Scene:
        """Return a scene with a cylinder along its z axis [m] more; see `add`."""
        return self.add(name, Cylinder(float(radius), float(length)), position, rpy)

    def add_capsule(
        self, name: str, radius: float, length: float, position: ArrayLike, rpy: ArrayLike = (0.0, 0.0, 0.0)
    ) -> Scene:
        """Return a scene with a capsule along its z axis [m] more; `length` is that of the straight part."""
        return self.add(name, Capsule(float(radius), float(length)), position, rpy)

    def remove(self, name: str) -> Scene:
        """Return a scene without one obstacle.

        Raises:
            UnknownNameError: listing the obstacles.
        """
        self._known(name)
        return Scene({k: v for k, v in self.objects.items() if k != name})

    def move(self, name: str, position: ArrayLike, rpy: ArrayLike = (0.0, 0.0, 0.0)) -> Scene:
        """Return a scene with one obstacle elsewhere; see `add`.

        Raises:
            UnknownNameError: listing the obstacles.
        """
        moved = self._known(name)
        rest = Scene({k: v for k, v in self.objects.items() if k != name})
        return rest.add(name, moved.geometry, position, rpy)

    def padded(self, margin: float) -> Scene:
        """Return a scene whose obstacles are larger by a margin on every side; meshes stay as they are.

        Args:
            margin: Distance added to every side [m].

        Raises:
            InvalidValueError: for a margin that is not a finite number of 0 or more.
        """
        if not (np.isfinite(margin) and margin >= 0):
            raise InvalidValueError("margin", margin, "a finite distance of 0 or more [m]")
        return Scene(
            {
                name: replace(item, geometry=_grown(item.geometry, float(margin)))
                for name, item in self.objects.items()
            }
        )

    def _known(self, name: str) -> SceneObject:
        if name not in self.objects:
            raise UnknownNameError("scene object", name, self.objects)
        return self.objects[name]


def _grown(geometry: Geometry, margin: float) -> Geometry:
    if isinstance(geometry, Box):
        x, y, z = (length + 2 * margin for length in geometry.size)
        return Box((x, y, z))
    if isinstance(geometry, Sphere):
        return Sphere(geometry.radius + margin)
    if isinstance(geometry, Cylinder):
        return Cylinder(geometry.radius + margin, geometry.length + 2 * margin)
    if isinstance(geometry, Capsule):
        return Capsule(geometry.radius + margin, geometry.length)
    return geometry
