"""Changes of a scene's obstacles by the panel."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import Scene, SceneObject
from pepper_kin.collision.scene_object import PALETTE
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import Box, Cylinder, Sphere

KINDS = ("box", "ball", "cylinder")
PLACE = (0.55, 0.0, 0.80)
"""Default position of a new obstacle [m]: in front of the robot, within reach."""
LEAST, MOST = 0.005, 5.0
"""Minimum and maximum lengths of an obstacle [m]."""

COLORS = PALETTE[1:]
"""Colors of obstacles that are added on the page, different from a table's."""

MOST_OBSTACLES = 100
"""Maximum number of objects in a scene to which pages add."""

_SIZES = {"box": (0.15, 0.15, 0.15), "ball": (0.08,), "cylinder": (0.06, 0.3)}


def size_names(kind: str) -> tuple[str, ...]:
    """Return the names of a size's numbers: lengths, radius, height."""
    return {"box": ("x", "y", "z"), "ball": ("radius",), "cylinder": ("radius", "height")}[kind]


def added(
    scene: Scene, kind: str, position: NDArray[np.float64] | None, size: NDArray[np.float64] | None
) -> tuple[Scene, str]:
    """Return a scene with an added obstacle, and the obstacle's name.

    Args:
        scene: Scene to change.
        kind: Kind of the obstacle, one of `KINDS`.
        position: Position of the obstacle's origin in the world [m], shape (3,); `PLACE` if None.
        size: Lengths [m], shape (3,) for a box, (1,) for a ball, (2,) for a cylinder, see `size_names`;
            None for the default.

    Raises:
        InvalidValueError: for a size with a wrong count of numbers, or too small or too large, or for a
            full scene.
        UnknownNameError: for an unknown kind.
    """
    if kind not in KINDS:
        raise UnknownNameError("kind of obstacle", kind, KINDS)
    if len(scene.names) >= MOST_OBSTACLES:
        raise InvalidValueError("obstacles", len(scene.names), f"at most {MOST_OBSTACLES}: remove one first")
    number = next(k for k in range(1, len(scene.names) + 2) if f"{kind} {k}" not in scene.names)
    name = f"{kind} {number}"
    geometry = _geometry(name, kind, np.array(_SIZES[kind]) if size is None else size)
    taken = [thing.color for thing in scene.objects.values()]
    color = min(COLORS, key=taken.count)  # the first of the least used colors
    return scene.add(name, geometry, PLACE if position is None else position, color=color), name


def changed(
    scene: Scene,
    name: str,
    position: NDArray[np.float64] | None,
    size: NDArray[np.float64] | None,
    color: NDArray[np.float64] | None = None,
) -> Scene:
    """Return a scene with a changed position, size or color of an obstacle, which keeps its orientation.

    Args:
        scene: Scene to change.
        name: Name of the obstacle.
        position: Position of the origin in the world [m], shape (3,); None for no change.
        size: Lengths [m], shape (3,) for a box, (1,) for a ball, (2,) for a cylinder, see `size_names`;
            None for no change.
        color: Red, green, blue, shape (3,); None for no change.

    Raises:
        UnknownNameError: for an unknown obstacle.
        InvalidValueError: for an invalid size or color (red, green, blue in [0, 1]).
    """
    thing = _standing(scene, name)
    if position is not None:
        pose = np.array(thing.transform_object_to_world)
        pose[:3, 3] = position
        thing = replace(thing, transform_object_to_world=pose)
    if size is not None:
        kind = kind_of(thing)
        if kind not in KINDS:
            raise InvalidValueError(f"size of {name!r}", kind, "a box, ball or cylinder: others keep theirs")
        thing = replace(thing, geometry=_geometry(name, kind, size))
    if color is not None:
        if color.shape != (3,) or not ((color >= 0) & (color <= 1)).all():
            raise InvalidValueError(f"color of {name!r}", color.tolist(), "red, green, blue, each in 0 ... 1")
        red, green, blue = (float(channel) for channel in color)
        thing = replace(thing, color=(red, green, blue, thing.color[3]))
    objects = {key: thing if key == name else value for key, value in scene.objects.items()}
    return Scene(objects, scene.attached, scene.allowed)


def kind_of(thing: SceneObject) -> str:
    """Return the kind of an object: "box", "ball", "cylinder", or "fixed" for any other."""
    kinds: dict[type, str] = {Box: "box", Sphere: "ball", Cylinder: "cylinder"}
    return kinds.get(type(thing.geometry), "fixed")


def as_list(scene: Scene) -> list[dict[str, Any]]:
    """Return the obstacles as values for JSON."""
    return [
        {
            "name": name,
            "kind": kind_of(thing),
            "size": _size(thing),
            "color": [round(channel, 3) for channel in thing.color[:3]],
            "position": np.round(thing.transform_object_to_world[:3, 3], 4).tolist(),
        }
        for name, thing in scene.objects.items()
    ]


def _standing(scene: Scene, name: str) -> SceneObject:
    if name not in scene.objects:
        raise UnknownNameError("obstacle", name, scene.objects)
    return scene.objects[name]


def _size(thing: SceneObject) -> list[float]:
    match thing.geometry:
        case Box(size=size):
            return [float(length) for length in size]
        case Sphere(radius=radius):
            return [float(radius)]
        case Cylinder(radius=radius, length=length):
            return [float(radius), float(length)]
    return []


def _geometry(name: str, kind: str, size: NDArray[np.float64]) -> Box | Sphere | Cylinder:
    """Return the geometry of a size [m], shape (3,) for a box, (1,) for a ball, (2,) for a cylinder."""
    names = size_names(kind)
    if size.shape != (len(names),) or not ((size >= LEAST) & (size <= MOST)).all():
        allowed = f"{' and '.join(names)}, each in {LEAST:g} ... {MOST:g} m"
        raise InvalidValueError(f"size of {name!r}", size.tolist(), allowed)
    lengths = [float(length) for length in size]
    if kind == "box":
        return Box((lengths[0], lengths[1], lengths[2]))
    return Sphere(lengths[0]) if kind == "ball" else Cylinder(lengths[0], lengths[1])
