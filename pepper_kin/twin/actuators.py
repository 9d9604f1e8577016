"""Parameters of the joints' position servos."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.model.shapes import read_only

Array = NDArray[np.float64]

FULL_TORQUE_ERROR = 0.005  # [rad or m] of position error at which a generic servo gives its full torque
_FREE_FREQUENCY = 50.0  # [rad/s] of a generic servo without a torque limit
_STOP_RATIO = 200.0  # a joint stop is this much stiffer than the servo
_STOP_TIME = 0.002  # [s] damping of a joint stop / its stiffness


@dataclass(frozen=True, eq=False)
class ActuatorParameters:
    """Servos tau = clip(stiffness (q_ref - q) + damping (v_ref - v) + feed-forward, +-torque_limit).

    Attributes:
        joint_names: The joints.
        stiffness: Kp [N m/rad or N/m], shape (n,), not below zero.
        damping: Kd [N m s/rad or N s/m], shape (n,), not below zero.
        torque_limit: [N m or N], shape (n,), above zero, inf for none.
        stop_stiffness: Of the joint stops at the position limits [N m/rad or N/m], shape (n,).
        stop_damping: Of the joint stops [N m s/rad or N s/m], shape (n,).
        sources: Where each joint's stiffness and damping come from, or "assumed".
    """

    joint_names: tuple[str, ...]
    stiffness: Array
    damping: Array
    torque_limit: Array
    stop_stiffness: Array
    stop_damping: Array
    sources: tuple[str, ...]

    def __post_init__(self) -> None:
        """Copy and check the fields.

        Raises:
            InvalidValueError: naming joint and quantity, for NaN, infinity, or a value below zero.
        """
        n = len(self.joint_names)
        for quantity in ("stiffness", "damping", "stop_stiffness", "stop_damping"):
            array = as_finite(getattr(self, quantity), quantity, (n,))
            self._refuse(quantity, array, array < 0, "a number of at least 0")
            object.__setattr__(self, quantity, read_only(array))
        limit = np.asarray(self.torque_limit, dtype=float)
        if limit.shape != (n,):
            raise InvalidValueError("torque_limit", f"shape {limit.shape}", f"shape ({n},)")
        self._refuse("torque_limit", limit, ~(limit > 0), "a number above 0, or infinity for none")
        object.__setattr__(self, "torque_limit", read_only(limit))

    def _refuse(self, quantity: str, array: Array, wrong: NDArray[np.bool_], allowed: str) -> None:
        if wrong.any():
            j = int(np.argmax(wrong))
            raise InvalidValueError(f"{quantity} of {self.joint_names[j]}", array[j], allowed)

    def changed(
        self,
        *,
        stiffness: ArrayLike | None = None,
        damping: ArrayLike | None = None,
        torque_limit: ArrayLike | None = None,
    ) -> ActuatorParameters:
        """Return a copy with other values; a single number holds for all joints.

        Raises:
            InvalidValueError: naming joint and quantity, for a value that is not allowed.
        """
        n = len(self.joint_names)
        given = {"stiffness": stiffness, "damping": damping, "torque_limit": torque_limit}
        new: dict[str, Any] = {}
        for quantity, value in given.items():
            if value is None:
                continue
            array = np.asarray(value, dtype=float)
            if array.shape not in ((), (n,)):
                raise InvalidValueError(quantity, f"shape {array.shape}", f"one number or shape ({n},)")
            new[quantity] = np.broadcast_to(array, (n,))
        return replace(self, **new)


def actuator_parameters(pepper: PepperModel) -> ActuatorParameters:
    """Return the servos of a robot.

    Pepper's come from `data/actuators.json`, where each says its source or "assumed".  Any other joint gets
    a generic one: full torque at 5 mrad (5 mm) of error, or 50 rad/s where the torque is unlimited, and
    critical damping for the joint's own inertia in the neutral posture.

    Args:
        pepper: The robot.

    Returns:
        The parameters; torque limits are the URDF's effort limits.
    """
    from pepper_kin import dynamics

    inertia = np.diag(dynamics.mass_matrix(pepper, pepper.neutral()))
    effort = pepper.effort_limits
    stiffness = np.where(np.isfinite(effort), effort / FULL_TORQUE_ERROR, inertia * _FREE_FREQUENCY**2)
    damping = 2.0 * np.sqrt(stiffness * inertia)
    sources = ["assumed: full torque at 0.005 rad or m, critical damping"] * pepper.n
    if pepper.name.lower().startswith("pepper"):
        for name, row in _pepper_rows().items():
            if name in pepper.joint_names:
                j = pepper.joint_index(name)
                stiffness[j], damping[j], sources[j] = row["stiffness"], row["damping"], row["source"]
    stop = _STOP_RATIO * stiffness
    torque_limit = np.where(effort > 0, effort, np.inf)
    return ActuatorParameters(
        pepper.joint_names, stiffness, damping, torque_limit, stop, stop * _STOP_TIME, tuple(sources)
    )


@cache
def _pepper_rows() -> dict[str, dict[str, Any]]:
    text = (files("pepper_kin.twin") / "data" / "actuators.json").read_text(encoding="utf-8")
    return dict(json.loads(text)["joints"])
