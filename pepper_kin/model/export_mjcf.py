"""The robot as MJCF, the format of MuJoCo."""

from __future__ import annotations

import math
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import ModelError, ModelWarning
from pepper_kin.model.export_inertia import TINY_INERTIA, TINY_MASS, loadable_bodies
from pepper_kin.model.kinematic_tree import KinematicTree, PlacedJoint, kinematic_tree
from pepper_kin.model.mesh_names import mesh_namer
from pepper_kin.model.mjcf_drive import TIMESTEP, add_drive, interval, light_leaders, mjcf_gains
from pepper_kin.model.mjcf_meshes import why_unreadable
from pepper_kin.model.poses import quaternion_from_rotation
from pepper_kin.model.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from pepper_kin.model.tree_order import leader_of
from pepper_kin.model.xml_text import child, document, number, numbers

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

LEADER_INERTIA = 3e-7
"""Principal moments of a moving body without mass whose joint leads others [kg m^2].

MuJoCo softens a constraint in proportion to the larger of the two sides' mobility, so the fingers of a leader
with a smaller inertia would sag; a larger inertia would show in the mass matrix (tolerance 1e-6).
"""
VISUAL_GROUP, COLLISION_GROUP = "2", "3"


def mjcf_text(
    pepper: PepperModel, mesh_paths: str = "absolute", floor: bool = True, balance_inertias: bool = False
) -> str:
    """Return the robot as an MJCF text.

    Links with shapes, mass or a moving joint become bodies, other frames become sites; both keep their names.
    The root link is the world.  Joints have MuJoCo's limits, damping and friction, mimic joints equality
    constraints, and every coordinate an actuator (see `mjcf_drive`).  Visual meshes are in geom group 2 and
    have no contacts; collision shapes are in group 3, with an <exclude> for each pair of bodies that the SRDF
    disables.  Wheels have no contacts: they have no coordinate, and the base moves by its own joints. Meshes
    that MuJoCo cannot read are left out, with a warning and a comment.

    Args:
        pepper: The robot.
        mesh_paths: "absolute" or "relative".
        floor: Whether to add a plane at z = 0, a light and the ground's texture.
        balance_inertias: Whether to make impossible inertias possible, see `export_inertia.loadable_bodies`.

    Raises:
        ModelError: for inertias that no body can have, or a link "world" that is not the root.

    Warns:
        ModelWarning: naming link, file and reason of each shape that is left out.
    """
    if "world" in pepper.link_names and pepper.document.root != "world":
        raise ModelError("MJCF: the link 'world' hangs on another, and MuJoCo's world has that name")
    tree = kinematic_tree(pepper.document)
    tree = replace(tree, bodies=loadable_bodies(tree, "MJCF", balance_inertias))
    writer = _MjcfWriter(pepper, tree, mesh_namer(pepper.document, mesh_paths))
    root = ET.Element("mujoco", model=pepper.name)
    child(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    child(root, "option", timestep=number(TIMESTEP), integrator="implicitfast", gravity="0 0 -9.81")
    child(child(root, "visual"), "global", offwidth="1280", offheight="960")
    asset, world = child(root, "asset"), child(root, "worldbody")
    if floor:
        _add_floor(asset, world)
    writer.fill(asset, world)
    contact = child(root, "contact")
    for first, second in pepper.semantics.disabled_pairs:
        if first in writer.bodies and second in writer.bodies:
            child(contact, "exclude", body1=first, body2=second)
    add_drive(root, pepper, writer.gains, writer.light, writer.joint_order, writer.sites)
    notes = [f"{pepper.name}: exported by pepper_kin; [m], [rad], [kg]."]
    if writer.left_out:
        notes.append(f"Left out, because MuJoCo cannot read them: {'; '.join(writer.left_out)}")
        for what in writer.left_out:
            warnings.warn(f"MJCF: {what}; the shape is left out", ModelWarning, stacklevel=2)
    return document(root, *notes)


def _add_floor(asset: ET.Element, world: ET.Element) -> None:
    """Add a plane at z = 0, its texture and material, and a light."""
    child(
        asset, "texture", name="floor", type="2d", builtin="checker", width="300", height="300",
        rgb1="0.82 0.84 0.86", rgb2="0.72 0.75 0.78",
    )  # fmt: skip
    child(asset, "material", name="floor", texture="floor", texrepeat="8 8", reflectance="0.1")
    child(world, "light", pos="1 1 3", dir="-0.3 -0.3 -1", diffuse="0.8 0.8 0.8")
    child(world, "geom", name="floor", type="plane", size="4 4 0.1", material="floor")


class _MjcfWriter:
    """Writer of bodies, joints, geoms and sites."""

    def __init__(self, pepper: PepperModel, tree: KinematicTree, mesh_name: Callable[[Path], str]) -> None:
        self.pepper, self.tree, self.mesh_name = pepper, tree, mesh_name
        self.light = light_leaders(pepper, tree)
        self.gains = mjcf_gains(pepper, self.light)
        self.bodies: set[str] = set()
        self.sites: list[str] = []
        self.joint_order: list[str] = []
        self.left_out: list[str] = []
        self.meshes: dict[tuple[Path, tuple[float, float, float]], str] = {}
        self.with_shapes = {s.link for s in (*pepper.visual_shapes, *pepper.collision_shapes)}

    def fill(self, asset: ET.Element, world: ET.Element) -> None:
        """Write the tree into the world and its meshes into the assets."""
        root = self.pepper.document.root
        self._contents(world, root, np.eye(4), "world")
        for (path, scale), name in self.meshes.items():
            child(asset, "mesh", name=name, file=self.mesh_name(path), scale=numbers(scale), inertia="shell")

    def _contents(self, element: ET.Element, link: str, pose: NDArray[np.float64], body: str) -> None:
        """Write a link's shapes, site and children into the element of a body.

        Args:
            element: The body's element.
            link: The link.
            pose: Pose of the link in the body's frame [m], shape (4, 4).
            body: The body's name.
        """
        for group, shapes in (
            (VISUAL_GROUP, self.pepper.visual_shapes),
            (COLLISION_GROUP, self.pepper.collision_shapes),
        ):
            for index, shape in enumerate(s for s in shapes if s.link == link):
                self._geom(element, shape, pose, group, index)
        if body != link:
            self.sites.append(link)
            child(element, "site", name=link, **_pose(pose), group="4", size="0.01")
        for name in self.tree.children(link):
            self._link(element, self.tree.joints[name], pose, body)

    def _link(
        self, element: ET.Element, placed: PlacedJoint, pose: NDArray[np.float64], carrier: str
    ) -> None:
        """Write the child link of a joint as a body, or into its parent's body if it needs none.

        Args:
            element: The element of the parent's body.
            placed: The joint with its placement.
            pose: Pose of the parent link in the frame of the parent's body [m], shape (4, 4).
            carrier: Name of the parent's body.
        """
        link, moving = placed.joint.child, placed.joint.type != "fixed"
        here = pose @ placed.transform_child_to_parent
        if not moving and link not in self.with_shapes and link not in self.tree.bodies:
            self._contents(element, link, here, carrier)
            return
        body = child(element, "body", name=link, gravcomp="1", **_pose(here))
        self.bodies.add(link)
        if moving:
            self._joint(body, placed)
        self._inertial(body, link, moving)
        self._contents(body, link, np.eye(4), link)

    def _joint(self, body: ET.Element, placed: PlacedJoint) -> None:
        """Write a joint into its body, with limits, damping, friction and torque limit."""
        joint = placed.joint
        attributes = {"range": interval(joint.lower, joint.upper)} if math.isfinite(joint.upper) else {}
        damping = joint.damping
        kind = "slide" if joint.type == "prismatic" else "hinge"
        leader = leader_of(self.pepper, joint.name)
        if leader != joint.name and leader in self.light:
            damping += self.gains.damping[self.pepper.joint_index(leader)] / self.light[leader]
        if damping:
            attributes["damping"] = number(damping)
        if joint.friction:
            attributes["frictionloss"] = number(joint.friction)
        if joint.name in self.pepper.joint_names:
            limit = float(self.gains.torque_limit[self.pepper.joint_index(joint.name)])
            if math.isfinite(limit):
                attributes["actuatorfrcrange"] = interval(-limit, limit)
        axis = numbers(placed.axis)
        child(body, "joint", name=joint.name, type=kind, axis=axis, actuatorgravcomp="true", **attributes)
        self.joint_order.append(joint.name)

    def _inertial(self, element: ET.Element, link: str, moving: bool) -> None:
        """Write the inertia of a link, or a tiny one for a moving link without mass."""
        body = self.tree.bodies.get(link)
        if body is not None:
            i = body.inertia
            entries = (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
            child(
                element, "inertial", pos=numbers(body.center), mass=number(body.mass),
                fullinertia=numbers(entries),
            )  # fmt: skip
        elif moving:
            leads = any(j.mimic is not None and j.mimic[0] == self.tree.joints[link].joint.name
                        for j in self.pepper.document.joints if j.type != "fixed")  # fmt: skip
            child(
                element, "inertial", pos="0 0 0", mass=number(TINY_MASS),
                diaginertia=numbers([LEADER_INERTIA if leads else TINY_INERTIA] * 3),
            )  # fmt: skip

    def _geom(
        self, element: ET.Element, shape: Shape, pose: NDArray[np.float64], group: str, index: int
    ) -> None:
        """Write a shape of a link as a geom, if MuJoCo can read it.

        Args:
            element: The body's element.
            shape: The shape.
            pose: Pose of the link in the body's frame [m], shape (4, 4).
            group: VISUAL_GROUP or COLLISION_GROUP.
            index: Index of the shape among the link's shapes of the group, for its name.
        """
        kind = "visual" if group == VISUAL_GROUP else "collision"
        attributes = self._size(shape, kind)
        if not attributes:
            return
        touches = group == COLLISION_GROUP and not shape.link.startswith("Wheel")
        child(
            element, "geom", name=f"{shape.link}_{kind}_{index}", group=group, mass="0",
            contype="1" if touches else "0", conaffinity="1" if touches else "0",
            rgba=numbers(shape.color if kind == "visual" else (0.9, 0.4, 0.2, 0.4)),
            **attributes, **_pose(pose @ shape.transform_shape_to_link),
        )  # fmt: skip

    def _size(self, shape: Shape, kind: str) -> dict[str, str]:
        """Return the attributes of a shape's type and size; empty for a mesh that MuJoCo cannot read."""
        geometry = shape.geometry
        if isinstance(geometry, Mesh):
            reason = why_unreadable(geometry, kind == "collision")
            if reason:
                self.left_out.append(f"{kind} mesh {geometry.path.name} of link {shape.link}: {reason}")
                return {}
            key = (geometry.path, geometry.scale)
            name, count = geometry.path.stem, 2
            while key not in self.meshes and name in self.meshes.values():
                name, count = f"{geometry.path.stem}_{count}", count + 1
            return {"type": "mesh", "mesh": self.meshes.setdefault(key, name)}
        if isinstance(geometry, Box):
            return {"type": "box", "size": numbers(np.array(geometry.size) / 2)}
        if isinstance(geometry, Sphere):
            return {"type": "sphere", "size": number(geometry.radius)}
        kind = "capsule" if isinstance(geometry, Capsule) else "cylinder"
        assert isinstance(geometry, Capsule | Cylinder)
        return {"type": kind, "size": numbers((geometry.radius, geometry.length / 2))}


def _pose(pose: NDArray[np.float64]) -> dict[str, str]:
    """Return a pose [m], shape (4, 4), as attributes: position [m] and quaternion (w, x, y, z)."""
    return {
        "pos": numbers(pose[:3, 3]),
        "quat": numbers(quaternion_from_rotation(pose[:3, :3], order="wxyz")),
    }
