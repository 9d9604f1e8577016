"""Tolerant reading of a URDF: malformed parts become faults in a list, not errors."""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import ModelError, shortened
from pepper_kin.model.kinematic_tree import MOMENTS, tensor_of
from pepper_kin.model.plain_number import plain_number
from pepper_kin.model.shapes import transform
from pepper_kin.model.urdf_document import MOVING_TYPES
from pepper_kin.model.urdf_shapes import resolve_mesh
from pepper_kin.model.urdf_version import to_version_1_0
from pepper_kin.model.xml_source import MOST, parse_xml, unbound_prefixes, with_bound_prefixes

SIZES = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}
JOINT_TYPES = (*MOVING_TYPES, "fixed")


@dataclass(frozen=True)
class Fault:
    """One fault of a description.

    Attributes:
        kind: "xml", "structure", "number", "mass", "inertia", "limits", "mimic", "mesh" or "geometry".
        where: The element, such as "joint HeadYaw".
        message: Description of the fault, with numbers.
    """

    kind: str
    where: str
    message: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.where}: {self.message}"


@dataclass
class ShapeFacts:
    """A visual or collision shape: kind, sizes, pose in the link, shape (4, 4) [m], and file of a mesh."""

    kind: str
    sizes: dict[str, tuple[float, ...]]
    pose: NDArray[np.float64]
    path: Path | None = None


@dataclass
class LinkFacts:
    """A link: mass [kg], center of mass [m], inertia about it in link axes [kg m^2], shapes."""

    name: str
    mass: float | None = None
    center: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    inertia: NDArray[np.float64] | None = None
    shapes: list[ShapeFacts] = field(default_factory=list)


@dataclass
class JointFacts:
    """A joint: type, links, origin, axis, and the stated limits and mimic (leader, multiplier, offset)."""

    name: str
    type: str
    parent: str
    child: str
    origin: NDArray[np.float64]
    axis: NDArray[np.float64]
    limits: dict[str, float]
    mimic: tuple[str, float, float] | None


@dataclass
class UrdfFacts:
    """Readable contents of a URDF, and the faults."""

    name: str = "(unreadable)"
    links: dict[str, LinkFacts] = field(default_factory=dict)
    joints: dict[str, JointFacts] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)


def read_tolerantly(text: str, package_dirs: Sequence[Path] = ()) -> UrdfFacts:
    """Read a URDF text and collect its faults.

    For document types, entities and malformed XML, the result has one fault and nothing else.
    """
    facts = UrdfFacts()
    try:
        root = parse_xml(with_bound_prefixes(text), "URDF")
        to_version_1_0(root)
    except ModelError as error:
        facts.faults.append(Fault("xml", "the file", str(error).removeprefix("URDF: ")))
        return facts
    facts.faults += [
        Fault("xml", "the file", f"the prefix {prefix!r} is not declared")
        for prefix in unbound_prefixes(text)
    ]
    facts.name = root.get("name", "(no name)")
    reader = _UrdfReader(facts.faults, package_dirs)
    for element in root.findall("link"):
        link = reader.link(element)
        if link.name in facts.links:
            reader.fault("structure", f"link {link.name}", "two links have this name")
        facts.links.setdefault(link.name, link)
    for element in root.findall("joint"):
        joint = reader.joint(element)
        if joint.name in facts.joints:
            reader.fault("structure", f"joint {joint.name}", "two joints have this name")
        facts.joints.setdefault(joint.name, joint)
    return facts


class _UrdfReader:
    """Reader of elements that appends faults to a list."""

    def __init__(self, faults: list[Fault], package_dirs: Sequence[Path]) -> None:
        self.faults, self.package_dirs = faults, package_dirs

    def fault(self, kind: str, where: str, message: str) -> None:
        """Append a fault."""
        self.faults.append(Fault(kind, where, message))

    def vector(
        self, element: ET.Element | None, name: str, default: tuple[float, ...], where: str
    ) -> NDArray[np.float64]:
        """Return the numbers of an attribute; the default if it is absent or malformed."""
        text = None if element is None else element.get(name)
        if text is None:
            return np.array(default)
        values = np.array([plain_number(v) for v in text.split()])
        if values.shape != (len(default),) or not (np.abs(values) <= MOST).all():
            self.fault("number", where, f"{name}={shortened(text)!r} is not {len(default)} finite numbers")
            return np.array(default)
        return values

    def number(self, element: ET.Element | None, name: str, where: str) -> float | None:
        """Return the number of an attribute; None if it is absent or malformed."""
        text = None if element is None else element.get(name)
        if text is None:
            return None
        value = plain_number(text)
        if not abs(value) <= MOST:
            self.fault("number", where, f"{name}={shortened(text)!r} is not a finite number")
            return None
        return value

    def pose(self, element: ET.Element, where: str) -> NDArray[np.float64]:
        """Return the transform of an element's origin [m], shape (4, 4); the identity without an origin."""
        origin = element.find("origin")
        xyz = self.vector(origin, "xyz", (0.0, 0.0, 0.0), f"origin of {where}")
        return transform(xyz, self.vector(origin, "rpy", (0.0, 0.0, 0.0), f"origin of {where}"))

    def link(self, element: ET.Element) -> LinkFacts:
        """Return the readable facts of a link; faults are noted."""
        link = LinkFacts(element.get("name", ""))
        where = f"link {link.name}"
        if not link.name:
            self.fault("structure", "a link", "it has no name")
        inertial = element.find("inertial")
        if inertial is not None:
            self._inertial(inertial, link, where)
        for kind in ("visual", "collision"):
            for index, item in enumerate(element.findall(kind)):
                shape = self._shape(item, f"{kind} {item.get('name', index)} of {where}")
                if shape is not None:
                    link.shapes.append(shape)
        return link

    def _inertial(self, inertial: ET.Element, link: LinkFacts, where: str) -> None:
        """Read a link's mass, center of mass and inertia; faults are noted."""
        pose = self.pose(inertial, f"inertial of {where}")
        link.center = pose[:3, 3]
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        link.mass = self.number(mass, "value", where)
        if mass is None or mass.get("value") is None:
            self.fault("mass", where, "its <inertial> states no mass")
        entry = {key: self.number(inertia, key, f"inertia of {where}") for key in MOMENTS}
        if inertia is None or any(value is None for value in entry.values()):
            if link.mass:
                self.fault("inertia", where, f"a mass of {link.mass:g} kg without a complete inertia")
            return
        tensor = tensor_of([value for value in entry.values() if value is not None])
        link.inertia = pose[:3, :3] @ tensor @ pose[:3, :3].T

    def _shape(self, element: ET.Element, where: str) -> ShapeFacts | None:
        """Return the readable facts of a shape, or None; faults are noted."""
        geometry = element.find("geometry")
        item = None if geometry is None or len(geometry) == 0 else geometry[0]
        if item is None:
            self.fault("geometry", where, "it has no geometry")
            return None
        pose = self.pose(element, where)
        if item.tag == "mesh":
            name = item.get("filename", "")
            path = resolve_mesh(name, self.package_dirs)
            if not name or not os.path.isfile(path):
                missing = f"{shortened(name)!r} is not there" if name else "the mesh has no file name"
                self.fault("mesh", where, missing)
            scale = self.vector(item, "scale", (1.0, 1.0, 1.0), where)
            return ShapeFacts("mesh", {"scale": tuple(scale)}, pose, path)
        if item.tag not in SIZES:
            self.fault("geometry", where, f"unknown geometry <{shortened(item.tag)}>")
            return None
        sizes = {}
        for key in SIZES[item.tag]:
            default = (0.0, 0.0, 0.0) if key == "size" else (0.0,)
            sizes[key] = tuple(float(v) for v in self.vector(item, key, default, where))
            if min(sizes[key]) <= 0:
                value = shortened(item.get(key))
                self.fault("geometry", where, f"{item.tag}: {key}={value!r} is not above zero")
                return None
        return ShapeFacts(item.tag, sizes, pose)

    def joint(self, element: ET.Element) -> JointFacts:
        """Return the readable facts of a joint; faults are noted."""
        name, kind = element.get("name", ""), element.get("type", "")
        where = f"joint {name}"
        if not name:
            self.fault("structure", "a joint", "it has no name")
        if kind not in JOINT_TYPES:
            known = ", ".join(JOINT_TYPES)
            self.fault("structure", where, f"type {shortened(kind)!r} is none of {known}")
        ends = {}
        for tag in ("parent", "child"):
            end = element.find(tag)
            ends[tag] = "" if end is None else end.get("link", "")
            if not ends[tag]:
                self.fault("structure", where, f"it has no {tag} link")
        axis = self.vector(element.find("axis"), "xyz", (1.0, 0.0, 0.0), f"axis of {where}")
        length = float(np.linalg.norm(axis))
        if kind in MOVING_TYPES and length < 1e-9:
            self.fault("structure", where, "its axis is zero")
        limit, mimic = element.find("limit"), element.find("mimic")
        limits = {}
        for key in ("lower", "upper", "velocity", "effort", "acceleration"):
            value = self.number(limit, key, f"limit of {where}")
            if value is not None:
                limits[key] = value
        following = None
        if mimic is not None:
            gain, shift = (self.number(mimic, key, f"mimic of {where}") for key in ("multiplier", "offset"))
            following = (mimic.get("joint", ""), 1.0 if gain is None else gain, shift or 0.0)
        return JointFacts(
            name, kind, ends["parent"], ends["child"], self.pose(element, where),
            axis / length if length > 1e-9 else axis, limits, following,
        )  # fmt: skip


def rotation_angle(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the angle between two rotations, each (3, 3) [rad]."""
    relative = first.T @ second
    vector = np.array(
        [
            relative[2, 1] - relative[1, 2],
            relative[0, 2] - relative[2, 0],
            relative[1, 0] - relative[0, 1],
        ]
    )
    return float(math.atan2(np.linalg.norm(vector), np.trace(relative) - 1.0))
