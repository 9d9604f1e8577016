"""Obstacles that the panel edits: a scene in, a scene out."""

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
"""Default position of a new obstacle [m]: before the robot, within reach."""
LEAST, MOST = 0.005, 5.0
"""Lengths that an obstacle may have [m]."""

COLORS = PALETTE[1:]
"""Colors of obstacles that are added in the page: others than a table's."""

MOST_OBSTACLES = 100
"""Objects in a scene to which pages may still add one."""

_SIZES = {"box": (0.15, 0.15, 0.15), "ball": (0.08,), "cylinder": (0.06, 0.3)}


def size_names(kind: str) -> tuple[str, ...]:
    """Return what the numbers of a size are: lengths, radius, height."""
    return {"box": ("x", "y", "z"), "ball": ("radius",), "cylinder": ("radius", "height")}[kind]


def added(
    scene: Scene, kind: str, position: NDArray[np.float64] | None, size: NDArray[np.float64] | None
) -> tuple[Scene, str]:
    """Return a scene with one obstacle more, and its name.

    Args:
        scene: The scene.
        kind: One of `KINDS`.
        position: Of the obstacle's origin in the world [m], shape (3,); `PLACE` if None.
        size: Its lengths [m], shape (3,) for a box, (1,) for a ball, (2,) for a cylinder, see `size_names`;
            None for the default.

    Raises:
        InvalidValueError: for a size of the wrong count of numbers, or too small or large a one, or for a
            scene that is full.
        UnknownNameError: for another kind.
    """
    if kind not in KINDS:
        raise UnknownNameError("kind of obstacle", kind, KINDS)
    if len(scene.names) >= MOST_OBSTACLES:
        raise InvalidValueError("obstacles", len(scene.names), f"at most {MOST_OBSTACLES}: remove one first")
    number = next(k for k in range(1, len(scene.names) + 2) if f"{kind} {k}" not in scene.names)
    name = f"{kind} {number}"
    geometry = _geometry(name, kind, np.array(_SIZES[kind]) if size is None else size)
    taken = [thing.color for thing in scene.objects.values()]
    color = min(COLORS, key=taken.count)  # the first that is used least
    return scene.add(name, geometry, PLACE if position is None else position, color=color), name


def changed(
    scene: Scene,
    name: str,
    position: NDArray[np.float64] | None,
    size: NDArray[np.float64] | None,
    color: NDArray[np.float64] | None = None,
) -> Scene:
    """Return a scene with one obstacle elsewhere, of another size or color; its orientation stays.

    Args:
        scene: The scene.
        name: The obstacle's name.
        position: Of its origin in the world [m], shape (3,); None for where it is.
        size: Its lengths [m], shape (3,) for a box, (1,) for a ball, (2,) for a cylinder, see `size_names`;
            None for what it has.
        color: Red, green, blue, shape (3,); None for what it has.

    Raises:
        UnknownNameError: for an unknown obstacle.
        InvalidValueError: for a size or a color (red, green, blue in [0, 1]) that it cannot have.
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
    """Return "box", "ball", "cylinder" or "fixed", which is anything else."""
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
