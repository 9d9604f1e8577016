"""Shapes of a URDF text."""

from __future__ import annotations

import os
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from pepper_kin.exceptions import InvalidValueError, ModelError, ModelWarning
from pepper_kin.model.expanded_urdf import urdf_folder
from pepper_kin.model.plain_number import plain_number
from pepper_kin.model.shapes import (
    NO_COLOR,
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
from pepper_kin.model.xml_source import attribute_of, number_of, numbers_of


def read_shapes(
    root: ET.Element, package_dirs: Sequence[Path]
) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
    """Return the visual and the collision shapes of a robot.

    Args:
        root: Element of the robot.
        package_dirs: Folders that hold packages, for `package://` file names.

    Raises:
        ModelError: naming the shape that is malformed.

    Warns:
        ModelWarning: naming shapes of size zero, which are left out.
    """
    materials = {
        str(m.get("name")): _color(m) for m in root.findall("material") if m.find("color") is not None
    }
    visuals = _shapes(root, "visual", materials, package_dirs)
    collisions = _shapes(root, "collision", materials, package_dirs)
    return tuple(visuals), tuple(_merge_capsules(collisions))


def _color(material: ET.Element) -> tuple[float, float, float, float]:
    """Return the color of a material: red, green, blue and opacity."""
    color = material.find("color")
    text = None if color is None else color.get("rgba")
    red, green, blue, opacity = numbers_of(text, 4, NO_COLOR, "a color")
    return (red, green, blue, opacity)


def _shapes(
    root: ET.Element,
    kind: str,
    materials: dict[str, tuple[float, float, float, float]],
    package_dirs: Sequence[Path],
) -> list[Shape]:
    """Return the visual or collision shapes of all links."""
    shapes = []
    for link in root.findall("link"):
        link_name = link.get("name", "")
        for index, element in enumerate(link.findall(kind)):
            name = element.get("name") or f"{link_name}_{kind}_{index}"
            geometry = element.find("geometry")
            if geometry is None or len(geometry) == 0:
                raise ModelError(f"URDF: {kind} {name} of link {link_name} has no geometry")
            if not_there := _zero_size(geometry[0]):
                words = f"URDF: {kind} {name} of link {link_name} is left out: {not_there}"
                warnings.warn(words, ModelWarning, stacklevel=2)
                continue
            origin = element.find("origin")
            pose = np.eye(4)
            if origin is not None:
                what = f"origin of {kind} {name}"
                pose = transform(
                    numbers_of(origin.get("xyz"), 3, (0, 0, 0), what),
                    numbers_of(origin.get("rpy"), 3, (0, 0, 0), what),
                )
            color = NO_COLOR
            material = element.find("material")
            if material is not None:
                named = materials.get(material.get("name", ""), color)
                color = _color(material) if material.find("color") is not None else named
            try:
                solid = _geometry(geometry[0], name, package_dirs)
            except InvalidValueError as error:
                raise ModelError(f"URDF: {kind} {name} of link {link_name}: {error}") from error
            shapes.append(Shape(name, link_name, solid, pose, color))
    return shapes


def _zero_size(element: ET.Element) -> str:
    """Return the size of a shape that is zero, which some descriptions write for no shape; "" if none is."""
    for key in ("size", "radius", "length"):
        text = element.get(key)
        sizes = [] if text is None else [plain_number(one) for one in text.split()]
        if 0.0 in sizes and min(sizes) == 0.0 and element.tag in ("box", "sphere", "cylinder"):
            return f"a {element.tag} of {key} {text}"
    return ""


def _geometry(element: ET.Element, name: str, package_dirs: Sequence[Path]) -> Geometry:
    """Return the geometry of an element."""
    if element.tag == "box":
        x, y, z = numbers_of(element.get("size"), 3, (0, 0, 0), f"box {name}")
        return Box((x, y, z))
    radius = number_of(element, "radius", 0.0, name)
    if element.tag == "sphere":
        return Sphere(radius)
    if element.tag in ("cylinder", "capsule"):
        length = number_of(element, "length", 0.0, name)
        return Cylinder(radius, length) if element.tag == "cylinder" else Capsule(radius, length)
    x, y, z = numbers_of(element.get("scale"), 3, (1.0, 1.0, 1.0), f"scale of mesh {name}")
    return Mesh(resolve_mesh(attribute_of(element, "filename", name), package_dirs), (x, y, z))


def resolve_mesh(filename: str, package_dirs: Sequence[Path] = ()) -> Path:
    """Turn a `package://` or `file:` URI or a plain file name into a path (which may not exist).

    Packages and relative file names are searched in the folders in order. In URIs `%20` is a space (RFC
    3986), as in ROS's resource_retriever; a file whose name contains `%20` is found, too.
    """
    if not filename.startswith(("package://", "file:")):
        return _sought(filename, package_dirs)
    decoded = unquote(filename)
    found = _of_uri(decoded, package_dirs)
    if decoded == filename or os.path.exists(found):
        return found
    literal = _of_uri(filename, package_dirs)
    return literal if os.path.exists(literal) else found


def _of_uri(uri: str, package_dirs: Sequence[Path]) -> Path:
    """Return the path of a URI without percent signs."""
    if uri.startswith("package://"):
        rest = uri.removeprefix("package://")
        for folder in package_dirs:
            if os.path.exists(folder / rest):  # Path.exists raises for names that are too long
                return folder / rest
        own = "pepper_kin/urdf/"
        if rest.startswith(own):
            return urdf_folder() / rest.removeprefix(own)
        return Path(rest)
    rest = uri.removeprefix("file:")
    rest = rest.removeprefix("//")
    return _sought(rest.removeprefix("localhost") if rest.startswith("localhost/") else rest, package_dirs)


def _sought(filename: str, package_dirs: Sequence[Path]) -> Path:
    """Return a file name in the first folder that has the file, else the name itself."""
    path = Path(filename)
    found = (folder / path for folder in package_dirs if os.path.exists(folder / path))
    return path if path.is_absolute() else next(found, path)


def _merge_capsules(shapes: list[Shape]) -> list[Shape]:
    """Join NAME_shaft (cylinder), NAME_start and NAME_end (spheres of equal radius) to the capsule NAME."""
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
        length = float(np.linalg.norm(b - a))
        if length == 0.0 or any(e is not None and e.geometry != Sphere(shaft.radius) for e in ends):
            merged.append(shape)
            continue
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation_to_axis(b - a), (a + b) / 2
        capsule = Capsule(shaft.radius, length)
        merged.append(Shape(stem, shape.link, capsule, pose, shape.color))
        taken.update((f"{stem}_start", f"{stem}_end"))
    return [shape for shape in merged if shape.name not in taken]
