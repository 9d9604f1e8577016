"""Conversion of later versions of URDF to version 1.0, which all readers know.

Source: urdfdom 4 to 6: version 1.1 has `quat_xyzw` in <origin>, version 1.2 the geometry <capsule>; an origin
has `rpy` or `quat_xyzw`, and a quaternion is normalized.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from pepper_kin.exceptions import ModelError, shortened
from pepper_kin.model.poses import rotation_from_quaternion, rpy_of
from pepper_kin.model.xml_source import vector_of

VERSIONS = ("1.0", "1", "1.1", "1.2")
_SHORTEST = 1e-6  # minimum length of a quaternion


def to_version_1_0(root: ET.Element) -> bool:
    """Convert a robot's tree to version 1.0 in place; return whether anything changed.

    Raises:
        ModelError: for another version, `quat_xyzw` in version 1.0, whose readers ignore it, an origin with
            both `rpy` and `quat_xyzw`, or a quaternion of length 0.
    """
    version = root.get("version", "1.0").strip()
    if version not in VERSIONS:
        known = ", ".join(VERSIONS)
        raise ModelError(f"URDF: has the version {shortened(repr(version))}; versions {known} are read")
    later, changed = version not in ("1.0", "1"), version != "1.0"
    if changed:
        root.set("version", "1.0")
    for parent in root.iter():
        for origin in parent.findall("origin"):
            text = origin.get("quat_xyzw")
            if text is None:
                continue
            what = f"quat_xyzw={shortened(repr(text))} of a <{parent.tag} name={parent.get('name', '')!r}>"
            if not later:
                raise ModelError(f'URDF: {what} needs <robot version="1.1">: version 1.0 does not have it')
            if origin.get("rpy") is not None:
                raise ModelError(f"URDF: {what} stands beside rpy; an origin has one of them")
            quaternion = vector_of(text, 4, (), what)
            length = float(np.linalg.norm(quaternion))
            if length < _SHORTEST:
                raise ModelError(f"URDF: {what} has the length {length:g}, expected 1")
            del origin.attrib["quat_xyzw"]
            rpy = rpy_of(rotation_from_quaternion(quaternion / length))
            origin.set("rpy", " ".join(repr(angle) for angle in rpy))
    return changed
