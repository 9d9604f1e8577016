"""URDF with joints and masses only, for libraries that cannot read shapes and mimic elements."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from pepper_kin.model.urdf_document import MOVING_TYPES, UrdfDocument
from pepper_kin.model.xml_text import own_child

UNBOUNDED = 1e9
"""Limit written for a joint without one [rad, rad/s or m/s, N m or N]."""


def plain_urdf(document: UrdfDocument) -> str:
    """Return the URDF without shapes and mimic elements, continuous joints as revolute, limits written out.

    Each joint then has one coordinate in Pinocchio, placo and MuJoCo, and no mesh file is needed.

    Args:
        document: The robot.

    Returns:
        Text of the URDF.
    """
    root = document.copied_tree()
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
    for element in root.findall("joint"):
        if element.get("type") in MOVING_TYPES:
            for mimic in element.findall("mimic"):
                element.remove(mimic)
            limit = own_child(element, "limit")
            limit.set("effort", limit.get("effort", f"{UNBOUNDED}"))
            limit.set("velocity", limit.get("velocity", f"{UNBOUNDED}"))
            if element.get("type") == "continuous":
                element.set("type", "revolute")
                limit.set("lower", f"{-UNBOUNDED}")
                limit.set("upper", f"{UNBOUNDED}")
    return ET.tostring(root, encoding="unicode")
