"""A URDF text, read and checked without any robotics library, so that each fault can be named."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import ModelError
from pepper_kin.model.shapes import (
    Box,
    Capsule,
    Cylinder,
    Geometry,
    Mesh,
    Shape,
    Sphere,
    rotation_to_axis,
    transform,
)

MOVING_TYPES = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Joint:
    """One joint as the text states it.

    Attributes:
        name: Its name.
        type: revolute, continuous, prismatic or fixed.
        parent: Parent link.
        child: Child link.
        lower: Lower limit [rad or m], -inf where there is none.
        upper: Upper limit [rad or m], inf where there is none.
        velocity: Velocity limit [rad/s or m/s], inf where there is none.
        acceleration: Acceleration limit [rad/s^2 or m/s^2], inf where there is none.
        effort: Effort limit [N m or N], inf where there is none.
        mimic: (leading joint, multiplier, offset) or None.
        damping: Viscous friction [N m s/rad or N s/m], zero where none is given.
        friction: Coulomb friction [N m or N], zero where none is given.
    """

    name: str
    type: str
    parent: str
    child: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    effort: float
    mimic: tuple[str, float, float] | None
    damping: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True)
class UrdfDocument:
    """What a URDF text says: name, links, joints, shapes.

    Attributes:
        name: Name of the robot.
        text: The text itself.
        links: Link names in document order.
        joints: All joints in document order.
        visuals: Visual shapes.
        collisions: Collision shapes; a cylinder and two spheres named NAME_shaft, NAME_start, NAME_end are
            one capsule.
    """

    name: str
    text: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    visuals: tuple[Shape, ...]
    collisions: tuple[Shape, ...]

    @property
    def root(self) -> str:
        """The link that is no joint's child."""
        children = {joint.child for joint in self.joints}
        return next(link for link in self.links if link not in children)


def parse_urdf(text: str, package_dirs: Sequence[Path] = ()) -> UrdfDocument:
    """Read a URDF text.

    Args:
        text: The XML. Document type declarations are refused: entities can hide or multiply content.
        package_dirs: Folders that hold packages, for `package://` file names.

    Returns:
        The document.

    Raises:
        ModelError: naming the element that is malformed, missing, doubled or disconnected.
    """
    refuse_document_types(text, "URDF")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise ModelError(f"URDF: not well-formed XML: {error}") from error
    if root.tag != "robot":
        raise ModelError(f"URDF: the root element is <{root.tag}>, expected <robot>")
    links = tuple(_attribute(element, "name", "link") for element in root.findall("link"))
    joints = tuple(_joint(element) for element in root.findall("joint"))
    _check_tree(links, joints)
    materials = {
        str(m.get("name")): _color(m) for m in root.findall("material") if m.find("color") is not None
    }
    return UrdfDocument(
        name=root.get("name", "robot"),
        text=text,
        links=links,
        joints=joints,
        visuals=tuple(_shapes(root, "visual", materials, package_dirs)),
        collisions=tuple(_merge_capsules(list(_shapes(root, "collision", materials, package_dirs)))),
    )


def refuse_document_types(text: str, what: str) -> None:
    """Refuse XML with a document type or entities, which can read files or multiply content.

    Raises:
        ModelError: naming `what` the text is.
    """
    if re.search(r"<!\s*(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise ModelError(f"{what}: document type declarations and entities are not allowed")


def _attribute(element: ET.Element, name: str, what: str) -> str:
    value = element.get(name)
    if not value:
        raise ModelError(f"URDF: a <{element.tag}> of {what} has no {name!r}")
    return value


def number_of(element: ET.Element, name: str, default: float, what: str) -> float:
    """Return an attribute as a number, or `default` where it is absent.

    Raises:
        ModelError: naming `what` where it is no number.
    """
    text = element.get(name)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise ModelError(f"URDF: {what}: {name}={text!r} is not a number")
    return value


def vector_of(text: str | None, size: int, default: Sequence[float], what: str) -> NDArray[np.float64]:
    """Return a text as `size` finite numbers, or `default` where there is no text.

    Raises:
        ModelError: naming `what` where it is anything else.
    """
    if text is None:
        return np.array(default, dtype=float)
    try:
        values = np.array([float(v) for v in text.split()])
    except ValueError:
        values = np.array([math.nan])
    if values.shape != (size,) or not np.all(np.isfinite(values)):
        raise ModelError(f"URDF: {what}: {text!r} is not {size} finite numbers")
    return values


def _joint(element: ET.Element) -> Joint:
    name = _attribute(element, "name", "the robot")
    kind = _attribute(element, "type", f"joint {name}")
    if kind not in (*MOVING_TYPES, "fixed"):
        raise ModelError(
            f"URDF: joint {name} has type {kind!r}; supported: {', '.join((*MOVING_TYPES, 'fixed'))}"
        )
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise ModelError(f"URDF: joint {name} has no <parent> or no <child>")
    limit = element.find("limit")
    if limit is None:
        limit = ET.Element("limit")
        if kind in ("revolute", "prismatic"):
            raise ModelError(f"URDF: joint {name} is {kind} and has no <limit>")
    bounded = kind != "continuous"
    lower = number_of(limit, "lower", 0.0, f"joint {name}") if bounded else -math.inf
    upper = number_of(limit, "upper", 0.0, f"joint {name}") if bounded else math.inf
    if lower > upper:
        raise ModelError(f"URDF: joint {name}: lower limit {lower} is above upper limit {upper}")
    mimic, dynamics = element.find("mimic"), element.find("dynamics")
    dynamics = ET.Element("dynamics") if dynamics is None else dynamics
    return Joint(
        name=name,
        type=kind,
        parent=_attribute(parent, "link", f"joint {name}"),
        child=_attribute(child, "link", f"joint {name}"),
        lower=lower,
        upper=upper,
        velocity=number_of(limit, "velocity", math.inf, f"joint {name}"),
        acceleration=number_of(limit, "acceleration", math.inf, f"joint {name}"),
        effort=number_of(limit, "effort", math.inf, f"joint {name}"),
        mimic=None
        if mimic is None
        else (
            _attribute(mimic, "joint", f"joint {name}"),
            number_of(mimic, "multiplier", 1.0, f"mimic of {name}"),
            number_of(mimic, "offset", 0.0, f"mimic of {name}"),
        ),
        damping=number_of(dynamics, "damping", 0.0, f"joint {name}"),
        friction=number_of(dynamics, "friction", 0.0, f"joint {name}"),
    )


def _check_tree(links: tuple[str, ...], joints: tuple[Joint, ...]) -> None:
    if not links:
        raise ModelError("URDF: the robot has no link")
    for names, what in ((links, "link"), ([j.name for j in joints], "joint")):
        seen: set[str] = set()
        for name in names:
            if name in seen:
                raise ModelError(f"URDF: two {what}s are named {name!r}")
            seen.add(name)
    known = set(links)
    parent_of: dict[str, str] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in known:
                raise ModelError(f"URDF: joint {joint.name} names an unknown link {end!r}")
        if joint.child in parent_of:
            raise ModelError(f"URDF: link {joint.child!r} has two parent joints")
        parent_of[joint.child] = joint.parent
    roots = [link for link in links if link not in parent_of]
    if len(roots) != 1:
        raise ModelError(
            f"URDF: expected one root link, found {len(roots)}: {', '.join(roots) or '(a loop)'}"
        )
    for link in links:
        steps = 0
        while link in parent_of:
            link, steps = parent_of[link], steps + 1
            if steps > len(links):
                raise ModelError(f"URDF: link {link!r} is part of a loop")
    moving = {joint.name for joint in joints if joint.type != "fixed"}
    for joint in joints:
        if joint.mimic is not None and joint.mimic[0] not in moving:
            raise ModelError(f"URDF: joint {joint.name} mimics an unknown joint {joint.mimic[0]!r}")


def _color(material: ET.Element) -> tuple[float, float, float, float]:
    color = material.find("color")
    rgba = vector_of(None if color is None else color.get("rgba"), 4, (0.8, 0.8, 0.8, 1.0), "a colour")
    return (float(rgba[0]), float(rgba[1]), float(rgba[2]), float(rgba[3]))


def _shapes(
    root: ET.Element,
    kind: str,
    materials: dict[str, tuple[float, float, float, float]],
    package_dirs: Sequence[Path],
) -> list[Shape]:
    shapes = []
    for link in root.findall("link"):
        link_name = link.get("name", "")
        for index, element in enumerate(link.findall(kind)):
            name = element.get("name") or f"{link_name}_{kind}_{index}"
            geometry = element.find("geometry")
            if geometry is None or len(geometry) == 0:
                raise ModelError(f"URDF: {kind} {name} of link {link_name} has no geometry")
            origin = element.find("origin")
            pose = np.eye(4)
            if origin is not None:
                what = f"origin of {kind} {name}"
                pose = transform(
                    vector_of(origin.get("xyz"), 3, (0, 0, 0), what),
                    vector_of(origin.get("rpy"), 3, (0, 0, 0), what),
                )
            color = (0.8, 0.8, 0.8, 1.0)
            material = element.find("material")
            if material is not None:
                named = materials.get(material.get("name", ""), color)
                color = _color(material) if material.find("color") is not None else named
            shapes.append(Shape(name, link_name, _geometry(geometry[0], name, package_dirs), pose, color))
    return shapes


def _geometry(element: ET.Element, name: str, package_dirs: Sequence[Path]) -> Geometry:
    if element.tag == "box":
        size = vector_of(element.get("size"), 3, (0, 0, 0), f"box {name}")
        return Box((float(size[0]), float(size[1]), float(size[2])))
    radius = number_of(element, "radius", 0.0, name)
    if element.tag == "sphere":
        return Sphere(radius)
    if element.tag in ("cylinder", "capsule"):
        length = number_of(element, "length", 0.0, name)
        return Cylinder(radius, length) if element.tag == "cylinder" else Capsule(radius, length)
    if element.tag == "mesh":
        scale = vector_of(element.get("scale"), 3, (1, 1, 1), f"scale of mesh {name}")
        path = resolve_mesh(_attribute(element, "filename", name), package_dirs)
        return Mesh(path, (float(scale[0]), float(scale[1]), float(scale[2])))
    raise ModelError(f"URDF: shape {name} has an unknown geometry <{element.tag}>")


def resolve_mesh(filename: str, package_dirs: Sequence[Path] = ()) -> Path:
    """Turn a `package://`, `file://` or plain file name into a path (which may not exist).

    Packages and relative file names are sought in the folders, the first first.
    """
    if filename.startswith("package://"):
        rest = filename.removeprefix("package://")
        for folder in package_dirs:
            if (folder / rest).exists():
                return folder / rest
        own = "pepper_kin/urdf/"
        if rest.startswith(own):
            from importlib.resources import files

            return Path(str(files("pepper_kin.urdf"))) / rest.removeprefix(own)
        return Path(rest)
    path = Path(filename.removeprefix("file://"))
    found = (folder / path for folder in package_dirs if (folder / path).exists())
    return path if path.is_absolute() else next(found, path)


def _merge_capsules(shapes: list[Shape]) -> list[Shape]:
    """Join NAME_shaft (cylinder), NAME_start and NAME_end (spheres of its radius) to the capsule NAME."""
    by_name = {shape.name: shape for shape in shapes}
    merged: list[Shape] = []
    taken: set[str] = set()
    for shape in shapes:
        stem = shape.name.removesuffix("_shaft")
        ends = [by_name.get(f"{stem}_{end}") for end in ("start", "end")]
        shaft = shape.geometry
        if stem == shape.name or not isinstance(shaft, Cylinder) or any(e is None for e in ends):
            merged.append(shape)
            continue
        a, b = (e.transform_shape_to_link[:3, 3] for e in ends if e is not None)
        if any(e is not None and e.geometry != Sphere(shaft.radius) for e in ends):
            merged.append(shape)
            continue
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation_to_axis(b - a), (a + b) / 2
        capsule = Capsule(shaft.radius, float(np.linalg.norm(b - a)))
        merged.append(Shape(stem, shape.link, capsule, pose, shape.color))
        taken.update((f"{stem}_start", f"{stem}_end"))
    return [shape for shape in merged if shape.name not in taken]
