"""The robot as SDF, the format of Gazebo."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import ModelError, shortened
from pepper_kin.model.export_inertia import TINY_INERTIA, TINY_MASS, loadable_bodies
from pepper_kin.model.kinematic_tree import KinematicTree, PlacedJoint, kinematic_tree
from pepper_kin.model.mesh_names import mesh_namer
from pepper_kin.model.poses import rpy_of
from pepper_kin.model.shapes import Box, Capsule, Cylinder, Geometry, Shape, Sphere
from pepper_kin.model.tree_order import coupling_of
from pepper_kin.model.xml_text import child, document, number, numbers

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

RESERVED = re.compile(r"world|__.*__|.*::.*")
"""Names that SDF reserves: no model, link, joint or frame may have them."""


def sdf_text(pepper: PepperModel, mesh_paths: str = "absolute", balance_inertias: bool = False) -> str:
    """Return the robot as an SDF text.

    Links with mass and links that move become links; a fixed link without mass becomes a frame of the link
    that carries it, which also takes its shapes. The model's frame is the root link's. A moving link without
    mass gets 1e-12 kg and 1e-9 kg m^2. The version is 1.9, or 1.11 for robots with mimic joints, which
    earlier versions lack.

    Args:
        pepper: The robot.
        mesh_paths: "package" (as `model://`), "absolute" or "relative".
        balance_inertias: Whether to make impossible inertias possible, see `export_inertia.loadable_bodies`.

    Raises:
        ModelError: for inertias that no body can have, or a name that SDF reserves.

    Warns:
        ModelWarning: with `balance_inertias`, naming link and amount.
    """
    _refuse_reserved_names(pepper)
    tree = kinematic_tree(pepper.document)
    tree = replace(tree, bodies=loadable_bodies(tree, "SDF", balance_inertias))
    coupled = any(joint.mimic is not None for joint in pepper.document.joints if joint.type != "fixed")
    root = ET.Element("sdf", version="1.11" if coupled else "1.9")
    writer = _SdfWriter(pepper, tree, mesh_namer(pepper.document, mesh_paths, scheme="model"))
    root.append(writer.model())
    return document(root, f"{pepper.name}: exported by pepper_kin; [m], [rad], [kg].")


def _refuse_reserved_names(pepper: PepperModel) -> None:
    """Refuse a robot whose name, links or joints have names that SDF reserves."""
    joints = [joint.name for joint in pepper.document.joints if joint.type != "fixed"]
    root = pepper.document.root
    links = [link for link in pepper.link_names if (link, root) != ("world", "world")]
    for what, names in (("robot", [pepper.name]), ("link", links), ("joint", joints)):
        for name in names:
            if RESERVED.fullmatch(name):
                reason = "SDF reserves the names 'world', '__...__' and those with '::'"
                raise ModelError(f"SDF: the {what} has the name {shortened(repr(name))}: {reason}")


class _SdfWriter:
    """Writer of one model element."""

    def __init__(self, pepper: PepperModel, tree: KinematicTree, mesh_name: Callable[[Path], str]) -> None:
        self.pepper, self.tree, self.mesh_name = pepper, tree, mesh_name
        self.is_link = {
            name: name in tree.bodies or (name in tree.joints and tree.joints[name].joint.type != "fixed")
            for name in pepper.link_names
        }
        root = pepper.document.root
        first = next((link for link in pepper.link_names if self.is_link[link]), None)
        shapes = (*pepper.visual_shapes, *pepper.collision_shapes)
        # The model's frame moves with its first link, and only links have shapes.
        if first is None or self._moves(first) or any(self.carrier(s.link)[0] is None for s in shapes):
            self.is_link[root] = True
        self.taken = set(pepper.link_names)
        self.link = {link: link for link in pepper.link_names}
        self.link["world"] = self._free("world", "_link")
        self.names = {joint.name: self._free(joint.name, "_joint") for joint in pepper.document.joints}

    def _moves(self, link: str) -> bool:
        """Whether a moving joint is between a link and the root."""
        while link in self.tree.joints:
            joint = self.tree.joints[link].joint
            if joint.type != "fixed":
                return True
            link = joint.parent
        return False

    def _free(self, name: str, ending: str) -> str:
        """Reserve and return an unused name: links, joints and frames share one namespace."""
        while name in self.taken:
            name += ending
        self.taken.add(name)
        return name

    def carrier(self, link: str) -> tuple[str | None, NDArray[np.float64]]:
        """Return the SDF link that carries a URDF link (None: the model) and the URDF link's pose in it."""
        pose = np.eye(4)
        while not self.is_link[link]:
            placed = self.tree.joints.get(link)
            if placed is None:
                return None, pose
            pose, link = placed.transform_child_to_parent @ pose, placed.joint.parent
        return link, pose

    def model(self) -> ET.Element:
        """Return the element of the model with all links, joints and frames."""
        model = ET.Element("model", name=self.pepper.name)
        shapes: dict[str, list[tuple[str, Shape]]] = {}
        for kind, those in (
            ("visual", self.pepper.visual_shapes),
            ("collision", self.pepper.collision_shapes),
        ):
            for shape in those:
                shapes.setdefault(self.carrier(shape.link)[0] or "", []).append((kind, shape))
        for link in self.pepper.link_names:
            if not self.is_link[link]:
                continue
            placed = self.tree.joints.get(link)
            parent, pose = (None, np.eye(4)) if placed is None else self.carrier(placed.joint.parent)
            pose = pose if placed is None else pose @ placed.transform_child_to_parent
            element = child(model, "link", name=self.link[link])
            if parent is None and (placed is None or placed.joint.type == "fixed"):
                _pose(element, pose)
                name = self._free(f"{link}_to_world", "_joint")
                self._joint_element(model, name, "fixed", "world", self.link[link], None)
            elif placed is not None:
                name = self._joint(model, placed, self.link[parent] if parent else "world", link, pose)
                _pose(element, np.eye(4), relative_to=name)
            self._inertial(element, link)
            for kind, shape in shapes.get(link, []):
                self._shape(element, kind, shape)
        for link in self.pepper.link_names:
            if not self.is_link[link] and link != "world":  # SDF has a frame of that name already
                carrier, pose = self.carrier(link)
                attributes = {} if carrier is None else {"attached_to": self.link[carrier]}
                _pose(child(model, "frame", name=link, **attributes), pose)
        return model

    def _joint(
        self, model: ET.Element, placed: PlacedJoint, parent: str, link: str, pose: NDArray[np.float64]
    ) -> str:
        """Write a joint with axis, limits and coupling; return its name.

        Args:
            model: The element of the model.
            placed: The joint with its placement.
            parent: Parent link in SDF, or "world".
            link: Child link.
            pose: Pose of the child link, which is the joint's frame, in the parent's frame [m], shape (4, 4).
        """
        joint = placed.joint
        name = self.names[joint.name]
        element = self._joint_element(model, name, joint.type, parent, link, pose)
        if joint.type == "fixed":
            return name
        axis = child(element, "axis")
        child(axis, "xyz", numbers(placed.axis))
        limit = child(axis, "limit")
        for tag, value in (
            ("lower", joint.lower),
            ("upper", joint.upper),
            ("effort", joint.effort),
            ("velocity", joint.velocity),
        ):
            if math.isfinite(value):
                child(limit, tag, number(value))
        if joint.damping or joint.friction:
            dynamics = child(axis, "dynamics")
            child(dynamics, "damping", number(joint.damping))
            child(dynamics, "friction", number(joint.friction))
        leader, gain, shift = coupling_of(self.pepper, joint.name)
        if leader != joint.name:
            mimic = child(axis, "mimic", joint=self.names[leader])
            child(mimic, "multiplier", number(gain))
            child(mimic, "offset", number(shift))
            child(mimic, "reference", "0")
        return name

    def _joint_element(
        self,
        model: ET.Element,
        name: str,
        kind: str,
        parent: str,
        link: str,
        pose: NDArray[np.float64] | None,
    ) -> ET.Element:
        """Write the element of a joint.

        Args:
            model: The element of the model.
            name: Name of the joint.
            kind: Type of the joint in SDF.
            parent: Parent link, or "world".
            link: Child link.
            pose: Pose of the joint's frame in the parent's frame [m], shape (4, 4); None to leave it out.
        """
        element = child(model, "joint", name=name, type=kind)
        if pose is not None:
            _pose(element, pose, relative_to="__model__" if parent == "world" else parent)
        child(element, "parent", parent)
        child(element, "child", link)
        return element

    def _inertial(self, element: ET.Element, link: str) -> None:
        """Write the inertia of a link, or a tiny one for a moving link without mass."""
        inertial = child(element, "inertial")
        body = self.tree.bodies.get(link)
        inertia = np.eye(3) * TINY_INERTIA if body is None else body.inertia
        if body is not None:
            child(inertial, "pose", numbers((*body.center, 0.0, 0.0, 0.0)))
        child(inertial, "mass", number(TINY_MASS if body is None else body.mass))
        tensor = child(inertial, "inertia")
        for row, column in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            child(tensor, f"i{'xyz'[row]}{'xyz'[column]}", number(inertia[row, column]))

    def _shape(self, element: ET.Element, kind: str, shape: Shape) -> None:
        """Write a visual or collision shape into the element of its SDF link."""
        _, pose = self.carrier(shape.link)
        name = shape.name if self.link[shape.link] == element.get("name") else f"{shape.link}_{shape.name}"
        name = name.replace("::", "_")
        while any(other.get("name") == name for other in element.findall(kind)):
            name += f"_{kind}"
        item = child(element, kind, name=name)
        _pose(item, pose @ shape.transform_shape_to_link)
        self._geometry(child(item, "geometry"), shape.geometry)
        if kind == "visual":
            material = child(item, "material")
            for tag in ("ambient", "diffuse"):
                child(material, tag, numbers(shape.color))

    def _geometry(self, element: ET.Element, geometry: Geometry) -> None:
        """Write the element of a geometry's type with its size."""
        if isinstance(geometry, Box):
            child(child(element, "box"), "size", numbers(geometry.size))
        elif isinstance(geometry, Sphere):
            child(child(element, "sphere"), "radius", number(geometry.radius))
        elif isinstance(geometry, Cylinder | Capsule):
            item = child(element, "capsule" if isinstance(geometry, Capsule) else "cylinder")
            child(item, "radius", number(geometry.radius))
            child(item, "length", number(geometry.length))
        else:
            mesh = child(element, "mesh")
            child(mesh, "uri", self.mesh_name(geometry.path))
            child(mesh, "scale", numbers(geometry.scale))


def _pose(element: ET.Element, pose: NDArray[np.float64], relative_to: str | None = None) -> None:
    """Write a pose [m], shape (4, 4), into an element: position [m] and roll, pitch and yaw [rad]."""
    attributes = {} if relative_to is None else {"relative_to": relative_to}
    child(element, "pose", numbers((*pose[:3, 3], *rpy_of(pose[:3, :3]))), **attributes)
