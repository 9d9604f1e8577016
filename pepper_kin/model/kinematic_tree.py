"""Tree of a URDF for exports: placements and axes of joints, and inertias of bodies."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.exceptions import ModelError
from pepper_kin.model.shapes import product, rotation_rpy, transform
from pepper_kin.model.urdf_document import Joint, UrdfDocument
from pepper_kin.model.xml_source import number_of, vector_of

MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
"""Attributes of an <inertia> element."""
ROUNDING = 1e-6
"""Relative violation of the triangle inequality that the rounding of published digits explains."""


@dataclass(frozen=True, eq=False)
class TreeBody(FrozenArrays):
    """Mass and inertia of one link.

    Attributes:
        mass: Mass [kg].
        center: (3,) center of mass in the link frame [m].
        inertia: (3, 3) inertia about the center of mass, axes parallel to the link frame [kg m^2].
    """

    mass: float
    center: NDArray[np.float64]
    inertia: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlacedJoint(FrozenArrays):
    """A joint with its placement on the parent link.

    Attributes:
        joint: Type, limits and links of the joint.
        transform_child_to_parent: (4, 4) pose of the child link in the parent link at position zero [m].
        position: (3,) the URDF's xyz [m].
        rpy: (3,) the URDF's rpy [rad], kept so that texts repeat the published digits.
        axis: (3,) unit axis in the child frame; zero for fixed joints.
    """

    joint: Joint
    transform_child_to_parent: NDArray[np.float64]
    position: NDArray[np.float64]
    rpy: NDArray[np.float64]
    axis: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Joints and bodies of a document.

    Attributes:
        document: The URDF.
        joints: Placed joints by the name of their child link.
        bodies: Body of every link that has mass.
    """

    document: UrdfDocument
    joints: dict[str, PlacedJoint]
    bodies: dict[str, TreeBody]

    def children(self, link: str) -> tuple[str, ...]:
        """Return the child links of a link, in document order."""
        return tuple(name for name, placed in self.joints.items() if placed.joint.parent == link)


def kinematic_tree(document: UrdfDocument) -> KinematicTree:
    """Read joint placements and inertias of a document.

    Raises:
        ModelError: naming the joint or link whose numbers are malformed.
    """
    bodies = {}
    for element in document.tree.findall("link"):
        name, inertial = element.get("name", ""), element.find("inertial")
        if inertial is not None:
            body = read_body(inertial, name)
            if body.mass > 0.0:
                bodies[name] = body
    return KinematicTree(document, placed_joints(document), bodies)


def placed_joints(document: UrdfDocument) -> dict[str, PlacedJoint]:
    """Return the joints with their placements, by the name of their child link.

    Raises:
        ModelError: naming the joint whose numbers are malformed.
    """
    elements = {element.get("name"): element for element in document.tree.findall("joint")}
    return {joint.child: _place(joint, elements[joint.name]) for joint in document.joints}


def _place(joint: Joint, element: ET.Element) -> PlacedJoint:
    """Return a joint with its placement and unit axis."""
    what = f"joint {joint.name}"
    origin = element.find("origin")
    position = vector_of(None if origin is None else origin.get("xyz"), 3, (0, 0, 0), f"origin of {what}")
    rpy = vector_of(None if origin is None else origin.get("rpy"), 3, (0, 0, 0), f"origin of {what}")
    axis = np.zeros(3)
    if joint.type != "fixed":
        axis_element = element.find("axis")
        axis = vector_of(
            None if axis_element is None else axis_element.get("xyz"), 3, (1, 0, 0), f"axis of {what}"
        )
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise ModelError(f"URDF: {what}: the axis is zero")
        axis = axis / length
    return PlacedJoint(
        joint, read_only(transform(position, rpy)), read_only(position), read_only(rpy), read_only(axis)
    )


def read_body(inertial: ET.Element, link: str) -> TreeBody:
    """Read an <inertial>, its inertia rotated into the axes of the link.

    Raises:
        ModelError: naming the link whose numbers are malformed.
    """
    what = f"inertial of link {link}"
    origin, mass, inertia = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
    center = vector_of(None if origin is None else origin.get("xyz"), 3, (0, 0, 0), what)
    rpy = vector_of(None if origin is None else origin.get("rpy"), 3, (0, 0, 0), what)
    tensor = tensor_of([0.0 if inertia is None else number_of(inertia, key, 0.0, what) for key in MOMENTS])
    rotation = rotation_rpy(*(float(v) for v in rpy))
    kilograms = 0.0 if mass is None else number_of(mass, "value", 0.0, what)
    return TreeBody(kilograms, read_only(center), read_only(product(product(rotation, tensor), rotation.T)))


def tensor_of(moments: Sequence[float]) -> NDArray[np.float64]:
    """Return the inertia tensor, shape (3, 3), from its six `MOMENTS` [kg m^2]."""
    return np.array(moments)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def impossible_inertia(moments: NDArray[np.floating]) -> str:
    """Return the reason why no real body has the principal moments of inertia; empty if one can have them.

    A real body's moments are above zero, and none is larger than the sum of the other two.

    Args:
        moments: Principal moments in ascending order [kg m^2], shape (3,).
    """
    listed = ", ".join(f"{m:.4g}" for m in moments)
    if moments[0] <= 0.0:
        return f"not positive definite: principal moments {listed} kg m^2"
    margin = (moments[0] + moments[1] - moments[2]) / moments[2]
    if margin < -ROUNDING:
        return f"principal moments {listed} kg m^2 break the triangle inequality by {-margin:.1%}"
    return ""
