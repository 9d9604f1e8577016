"""Scenes as JSON files: one file holds a complete scene, and numbers round-trip to the last bit.

    {
      "format": "pepper_kin scene",
      "version": 1,
      "units": "m; rpy in rad; rotation maps object to world (or to the frame of an attached object)",
      "objects": [
        {"name": "table", "kind": "box", "size": [0.6, 1.0, 0.04], "position": [0.55, 0, 0.7], ...}
      ],
      "attached": [...],
      "allowed": [["floor", "Tibia"]]
    }

Objects may have a `velocity` and an `uncertainty` [m/s], attached ones a `mass` [kg] and a `center_of_mass`
in their own frame [m].  An object's orientation is a 3 x 3 `rotation`, or `rpy`, which is easier to write by
hand; omit both for no rotation.
Meshes and clouds are lists of numbers in the same file, so that a scene is replaced atomically.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pepper_kin.collision.scene_object import WOOD, AttachedObject, SceneObject
from pepper_kin.collision.solids import (
    ConvexMesh,
    HalfSpace,
    PointCloud,
    SceneGeometry,
    TriangleMesh,
)
from pepper_kin.exceptions import FileFormatError, InvalidValueError, PepperKinError, shortened
from pepper_kin.file_access import atomic_file
from pepper_kin.file_access.reading import read_json
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, Sphere
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.model.shapes import transform

FORMAT = "pepper_kin scene"
VERSION = 1
UNITS = "m; rpy in rad; rotation maps object to world (or to the frame of an attached object)"

_KINDS: dict[str, tuple[type, tuple[str, ...], tuple[str, ...]]] = {
    "box": (Box, ("size",), ()),
    "sphere": (Sphere, ("radius",), ()),
    "cylinder": (Cylinder, ("radius", "length"), ()),
    "capsule": (Capsule, ("radius", "length"), ()),
    "half-space": (HalfSpace, (), ("offset",)),
    "convex mesh": (ConvexMesh, ("vertices",), ("padding",)),
    "triangle mesh": (TriangleMesh, ("vertices", "faces"), ("padding",)),
    "point cloud": (PointCloud, ("points", "radius"), ()),
    "mesh file": (Mesh, ("path", "scale"), ()),
}
"""Kind -> class, required fields, and optional fields."""
_ARRAYS = ("vertices", "points")
_PLACE = ("name", "kind", "position", "rotation", "rpy", "color")


Made = TypeVar("Made")


class _FaultError(Exception):
    """Fault in a part of the file, to be reported with its place."""


def save_scene(scene: Any, path: str | os.PathLike[str]) -> Path:
    """Write a scene as a JSON file, whole or not at all.

    Args:
        scene: The scene.
        path: The file; its folder must exist.

    Returns:
        The path.

    Raises:
        FileFormatError: naming the path and why it cannot be written.
    """
    return atomic_file.write_text(path, _written(scene_as_dict(scene)) + "\n")


def scene_as_dict(scene: Any) -> dict[str, Any]:
    """Return the content of a scene file as plain values."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "units": UNITS,
        "objects": [
            _described(item, item.transform_object_to_world, _motion(item)) for item in scene.objects.values()
        ],
        "attached": [
            _described(
                item,
                item.transform_object_to_frame,
                {"frame": item.frame, "touch_links": list(item.touch_links), **_weight(item)},
            )
            for item in scene.attached.values()
        ],
        "allowed": [list(pair) for pair in sorted(scene.allowed)],
    }


def scene_from_dict(content: Any, source: object, make: Callable[..., Made]) -> Made:
    """Return the scene of plain values, see `load_scene`; errors name `source` as the file."""
    try:
        return make(*_parts_of(content))
    except (_FaultError, PepperKinError) as fault:
        raise FileFormatError(source, str(fault)) from None


def load_scene(path: str | os.PathLike[str], make: Callable[..., Made]) -> Made:
    """Read a scene from a JSON file.

    Args:
        path: The file.
        make: Called with objects, attached objects and allowed pairs: `Scene`.

    Returns:
        The scene.

    Raises:
        FileFormatError: for a file that cannot be read, is not JSON (with the line), is not a scene or one of
            another version, or holds a wrong object (naming it and what is wrong).
    """
    return scene_from_dict(read_json(path)[0], path, make)


def _described(item: Any, pose: np.ndarray, more: dict[str, Any]) -> dict[str, Any]:
    """Return an object as a dictionary of plain values, with its pose, shape (4, 4), translation in [m]."""
    kind = next(name for name, (cls, _, _) in _KINDS.items() if type(item.geometry) is cls)
    _, needed, optional = _KINDS[kind]
    result: dict[str, Any] = {"name": item.name, "kind": kind, **more}
    for name in (*needed, *optional):
        value = getattr(item.geometry, name)
        result[name] = str(value) if isinstance(value, Path) else np.asarray(value).tolist()
    result["position"] = pose[:3, 3].tolist()
    if not np.array_equal(pose[:3, :3], np.eye(3)):
        result["rotation"] = pose[:3, :3].tolist()
    return {**result, "color": list(item.color)}


def _motion(item: SceneObject) -> dict[str, Any]:
    """Return velocity and uncertainty of an obstacle if they are not zero."""
    if item.path is not None:
        raise InvalidValueError("scene", f"{item.name!r} along a trajectory", "obstacles without one")
    velocity = {"velocity": item.velocity.tolist()} if item.velocity.any() else {}
    return {**velocity, **({"uncertainty": item.uncertainty} if item.uncertainty else {})}


def _weight(item: AttachedObject) -> dict[str, Any]:
    """Return mass and center of mass of an attached object if they are set."""
    mass = {"mass": item.mass} if item.mass else {}
    center = {} if item.center_of_mass is None else {"center_of_mass": item.center_of_mass.tolist()}
    return {**mass, **center}


def _written(value: Any, indent: str = "") -> str:
    """Return JSON with one field per line; lists of numbers and of texts stay on one line."""
    deeper = indent + "  "
    if isinstance(value, dict):
        fields = [f"{deeper}{json.dumps(k)}: {_written(v, deeper)}" for k, v in value.items()]
        return "{\n" + ",\n".join(fields) + f"\n{indent}}}"
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return "[\n" + ",\n".join(deeper + _written(v, deeper) for v in value) + f"\n{indent}]"
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


def _parts_of(
    content: Any,
) -> tuple[dict[str, SceneObject], dict[str, AttachedObject], list[tuple[str, str]]]:
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise _FaultError(f'is not a scene: it lacks "format": "{FORMAT}"')
    if content.get("version") != VERSION or type(content.get("version")) is not int:
        found = shortened(repr(content.get("version")))
        raise _FaultError(f"is a scene of version {found}; this library reads version {VERSION}")
    _check_fields(content, ("objects",), ("format", "version", "units", "attached", "allowed"), "the scene")
    if content.get("units", UNITS) not in (UNITS, "m"):  # "m" is for files written by hand
        raise _FaultError(f'units: {shortened(repr(content["units"]))} is neither "m" nor "{UNITS}"')
    objects: dict[str, SceneObject] = {}
    attached: dict[str, AttachedObject] = {}
    for key in ("objects", "attached"):
        parts = content.get(key, [])
        if not isinstance(parts, list):
            raise _FaultError(f"{key} is {type(parts).__name__}, not a list")
        for number, part in enumerate(parts):
            place = f"{key}[{number}]"
            if not isinstance(part, dict) or not isinstance(part.get("name"), str) or not part["name"]:
                raise _FaultError(f"{place} is not an object with a name")
            name = part["name"]
            place += f" ({shortened(name)!r})"
            if name in objects or name in attached:
                raise _FaultError(f"{place}: the name is taken")
            if key == "objects":
                objects[name] = _built(_standing, part, place)
            else:
                attached[name] = _built(_hanging, part, place)
    allowed = content.get("allowed", [])
    named = {*objects, *attached}
    for number, pair in enumerate(allowed if isinstance(allowed, list) else [allowed]):
        if not (isinstance(pair, list) and len(pair) == 2 and all(isinstance(n, str) for n in pair)):
            raise _FaultError(f"allowed[{number}] is {shortened(repr(pair))}, not two names")
        if not named & set(pair) or pair[0] == pair[1]:
            found = shortened(repr(pair))
            raise _FaultError(
                f"allowed[{number}] is {found}, but one must be an object of the scene, not both the same"
            )
    return objects, attached, [(a, b) for a, b in allowed]


def _built(build: Callable[[dict[str, Any], str], Any], part: dict[str, Any], place: str) -> Any:
    """Return a part of the scene built by a function; errors name its place in the file."""
    try:
        return build(part, place)
    except PepperKinError as error:
        raise _FaultError(f"{place}: {error}") from None


def _standing(part: dict[str, Any], place: str) -> SceneObject:
    """Return an obstacle of the world from its fields."""
    geometry = _geometry(part, (), ("velocity", "uncertainty"), place)
    motion = {name: part[name] for name in ("velocity", "uncertainty") if name in part}
    return SceneObject(part["name"], geometry, _pose(part, place), part.get("color", WOOD), **motion)


def _hanging(part: dict[str, Any], place: str) -> AttachedObject:
    """Return an attached object from its fields."""
    geometry = _geometry(part, ("frame",), ("touch_links", "mass", "center_of_mass"), place)
    links = part.get("touch_links", [])
    if not isinstance(links, list):
        raise _FaultError(f"{place}: touch_links is {shortened(repr(links))}, not a list of links")
    return AttachedObject(
        part["name"], geometry, part["frame"], _pose(part, place), tuple(links), part.get("color", WOOD),
        part.get("mass", 0.0), part.get("center_of_mass"),
    )  # fmt: skip


def _geometry(
    part: dict[str, Any], needed: tuple[str, ...], optional: tuple[str, ...], place: str
) -> SceneGeometry:
    """Return the geometry of an object from its fields, after a check of their names."""
    kind = part.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise _FaultError(f"{place}: kind is {shortened(repr(kind))}, not one of {', '.join(_KINDS)}")
    cls, must, may = _KINDS[kind]
    _check_fields(part, (*must, *needed), (*may, *optional, *_PLACE), place)
    values: dict[str, Any] = {name: part[name] for name in (*must, *may) if name in part}
    for name, value in values.items():
        if name == "path":
            if not isinstance(value, str):
                raise _FaultError(f"{place}: path is {shortened(repr(value))}, not a text")
            values[name] = Path(value)
        elif name == "faces":
            values[name] = _whole_numbers(value, place)
        elif name in _ARRAYS:
            values[name] = as_finite(value if value else np.empty((0, 3)), name, (None, 3))
        elif name in ("size", "scale"):
            values[name] = tuple(as_finite(value, name, (3,)).tolist())
        else:
            values[name] = float(as_finite(value, name, ()))
    return cls(**values)


def _whole_numbers(value: Any, place: str) -> Any:
    """Return faces as an array of integers, shape (f, 3)."""
    rows = value if isinstance(value, list) else [None]
    if not all(isinstance(row, list) and len(row) == 3 and all(type(k) is int for k in row) for row in rows):
        raise _FaultError(f"{place}: faces are not rows of three whole numbers")
    try:
        return np.array(rows, dtype=np.int64).reshape(-1, 3)
    except OverflowError:
        raise _FaultError(f"{place}: faces are not rows of three whole numbers") from None


def _pose(part: dict[str, Any], place: str) -> np.ndarray:
    """Return the pose of an object from its fields, shape (4, 4)."""
    if "rotation" in part and "rpy" in part:
        raise _FaultError(f"{place}: has both a rotation and an rpy")
    pose = transform(rpy=as_finite(part["rpy"], "rpy", (3,))) if "rpy" in part else np.eye(4)
    if "rotation" in part:
        pose[:3, :3] = as_finite(part["rotation"], "rotation", (3, 3))
    if "position" in part:
        pose[:3, 3] = as_finite(part["position"], "position", (3,))
    return pose


def _check_fields(part: dict[str, Any], needed: tuple[str, ...], known: tuple[str, ...], place: str) -> None:
    """Refuse a part of the file that lacks a needed field or has an unknown one."""
    for name in needed:
        if name not in part:
            raise _FaultError(f"{place}: lacks {name!r}")
    for name in part:
        if name not in needed and name not in known:
            listed = ", ".join((*needed, *known))
            raise _FaultError(f"{place}: has a field {shortened(name)!r} that is not known; known: {listed}")
