"""Acceleration limits for joints without them in the description: URDF itself does not define any."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.model.xml_text import own_child

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pepper_kin.model.urdf_document import UrdfDocument

LimitsLike: TypeAlias = "float | Mapping[str, float]"
QUANTITY = "acceleration_limits"


def completed_limits(
    names: Sequence[str], limits: NDArray[np.float64], user_limits: LimitsLike
) -> NDArray[np.float64]:
    """Return acceleration limits completed by a user's, shape (n,) [rad/s^2 or m/s^2].

    Args:
        names: Names of the joints.
        limits: Limits of the description, inf for an unknown one, shape (n,) [rad/s^2 or m/s^2].
        user_limits: One number for all joints that lack a limit, or limits by name, which replace known ones
            [rad/s^2 or m/s^2].

    Raises:
        UnknownNameError: for an unknown joint.
        InvalidValueError: for a limit that is not above zero.
    """
    if not isinstance(user_limits, Mapping):
        number = np.inf if _is_infinite(user_limits) else check_positive(QUANTITY, user_limits)
        return np.where(np.isfinite(limits), limits, number)
    found = np.array(limits, dtype=float)
    for name, value in user_limits.items():
        if name not in names:
            raise UnknownNameError("joint", name, names)
        number = np.inf if _is_infinite(value) else check_positive(f"{QUANTITY} of {name}", value)
        found[names.index(name)] = number
    return found


def with_acceleration_limits(document: UrdfDocument, user_limits: LimitsLike) -> UrdfDocument:
    """Return a document with acceleration limits, in the attribute that this library reads.

    Args:
        document: The robot.
        user_limits: One number for all joints that lack a limit, or limits by name [rad/s^2 or m/s^2]; joints
            that follow others need none.

    Raises:
        UnknownNameError: for an unknown joint.
        InvalidValueError: for a limit that is not above zero.
    """
    leading = [joint for joint in document.joints if joint.type != "fixed" and joint.mimic is None]
    names = [joint.name for joint in leading]
    limits = completed_limits(names, np.array([joint.acceleration for joint in leading]), user_limits)
    values = {name: float(limit) for name, limit in zip(names, limits, strict=True) if np.isfinite(limit)}
    root = document.copied_tree()
    for element in root.findall("joint"):
        if element.get("name") in values:
            own_child(element, "limit").set("acceleration", repr(values[element.get("name", "")]))
    joints = tuple(replace(j, acceleration=values.get(j.name, j.acceleration)) for j in document.joints)
    return replace(document, text=ET.tostring(root, encoding="unicode"), joints=joints)


def _is_infinite(value: object) -> bool:
    return isinstance(value, (int, float)) and value == np.inf
