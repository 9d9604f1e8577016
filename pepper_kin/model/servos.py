"""Gains of the joints' position servos, for the twin and the MJCF export."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

FULL_TORQUE_ERROR = 0.005
"""Position error at which a generic servo gives its full torque [rad or m]."""
_FREE_FREQUENCY = 50.0
"""Natural frequency of a generic servo without a torque limit [rad/s]."""


class ServoGains(NamedTuple):
    """Gains of a robot's position servos.

    Attributes:
        stiffness: Kp [N m/rad or N/m], shape (n,).
        damping: Kd [N m s/rad or N s/m], shape (n,).
        torque_limit: Effort limits of the description [N m or N], shape (n,); inf for none.
        sources: Source of each joint's gains, or "assumed: ...".
    """

    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    torque_limit: NDArray[np.float64]
    sources: tuple[str, ...]


def servo_gains(pepper: PepperModel, inertia: NDArray[np.float64]) -> ServoGains:
    """Return the gains of a robot's servos.

    Pepper's come from `data/actuators.json`.  Any other joint gets a generic servo: full torque at 5 mrad
    (5 mm) of error, or 50 rad/s where the torque is unlimited, and critical damping, Kd = 2 sqrt(Kp I).

    Args:
        pepper: The robot.
        inertia: I, diagonal of the mass matrix in the neutral posture [kg m^2 or kg], shape (n,).
    """
    effort = pepper.effort_limits
    stiffness = np.where(np.isfinite(effort), effort / FULL_TORQUE_ERROR, inertia * _FREE_FREQUENCY**2)
    damping = 2.0 * np.sqrt(stiffness * inertia)
    sources = ["assumed: full torque at 0.005 rad or m, critical damping"] * pepper.n
    for name, row in known_actuators(pepper).items():
        if name in pepper.joint_names:
            j = pepper.joint_index(name)
            stiffness[j], damping[j], sources[j] = row["stiffness"], row["damping"], row["source"]
    return ServoGains(stiffness, damping, np.where(effort > 0, effort, np.inf), tuple(sources))


def known_actuators(pepper: PepperModel) -> dict[str, dict[str, Any]]:
    """Return the rows of `data/actuators.json` by joint; empty for robots other than Pepper."""
    return dict(actuator_data()["joints"]) if pepper.name.lower().startswith("pepper") else {}


@cache
def actuator_data() -> dict[str, Any]:
    """Return the contents of `data/actuators.json`."""
    text = (files("pepper_kin.model") / "data" / "actuators.json").read_text(encoding="utf-8")
    return dict(json.loads(text))
