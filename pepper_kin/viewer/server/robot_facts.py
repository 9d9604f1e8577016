"""Static data of the robot for a page: joints with their limits, groups, postures and layers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pepper_kin.dynamics.support_polygon import support_polygon
from pepper_kin.model import PepperModel
from pepper_kin.viewer.server.layers import LAYERS

_ENDS_WITHOUT_LIMITS = (-10.0, 10.0)
"""Ends of the slider of a joint without limits [rad or m]."""


def robot_facts(pepper: PepperModel, layers: Sequence[str]) -> dict[str, Any]:
    """Return name, joints, groups, whether it has wheels for balance, postures and layers, for JSON.

    Args:
        pepper: Model of the robot.
        layers: Names of the robot's layers.
    """
    low, high = _ENDS_WITHOUT_LIMITS
    lower = np.where(np.isfinite(pepper.lower_limits), pepper.lower_limits, low).tolist()
    upper = np.where(np.isfinite(pepper.upper_limits), pepper.upper_limits, high).tolist()
    joints = zip(pepper.joint_names, pepper.joint_units, lower, upper, strict=True)
    groups = {name: list(pepper.joint_group(name)) for name in pepper.group_names}
    return {
        "name": pepper.name,
        "joints": [dict(zip(("name", "unit", "lower", "upper"), joint, strict=True)) for joint in joints],
        "groups": {name: joints_of for name, joints_of in groups.items() if joints_of},
        "balance": support_polygon(pepper) is not None,
        "postures": list(pepper.posture_names),
        "layers": [{"name": name, "title": LAYERS[name]} for name in layers],
    }
