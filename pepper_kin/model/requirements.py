"""Reserves of motions: a margin of balance, and torque for the servos."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model.joint_vectors import as_real, check_positive, shown

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

Balance: TypeAlias = float | Literal["robot"] | None
"""Distance from the edges of the wheels' triangle [m]; "robot": the robot's own; None: no balance
constraint."""

TorqueScale: TypeAlias = float | Literal["robot"]
"""Fraction of the effort limits in (0, 1]; "robot": the robot's own."""

ROBOT: Literal["robot"] = "robot"

WHEELS = ("WheelFL_link", "WheelB_link", "WheelFR_link")
"""Links of Pepper's wheels on the floor, counter-clockwise seen from above."""

HOLDING_SHARE = 0.95
"""Fraction of a motion's usable effort that holding still may take; the rest is for acceleration."""

ROOM_TO_MOVE = 0.004
"""Balance margin of a path in addition to the required balance, which accelerations may use [m]."""


@dataclass(frozen=True)
class MotionRequirements:
    """Reserves that inverse kinematics, plans, timing and live motion keep, unless a call overrides them.

    Attributes:
        balance: Distance that the zero-moment point, and at rest the center of mass, keeps from the edges of
            the wheels' triangle [m]; None for no balance constraint.
        torque_scale: Fraction of the effort limits that a motion may use; servos correct errors with the
            rest.

    Raises:
        InvalidValueError: for a balance that is not a distance, or a fraction that is not in (0, 1].
    """

    balance: float | None = 0.01
    torque_scale: float = 0.9

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.balance is not None:
            object.__setattr__(self, "balance", checked_distance(self.balance))
        object.__setattr__(self, "torque_scale", checked_share("torque_scale", self.torque_scale))

    @property
    def holding_share(self) -> float:
        """Fraction of the effort limits that holding still may take."""
        return HOLDING_SHARE * self.torque_scale


def as_requirements(requirements: MotionRequirements | str) -> MotionRequirements:
    """Return requirements, which may be given by a name of `NAMED`.

    Raises:
        UnknownNameError: listing the names.
        InvalidValueError: for another type.
    """
    if isinstance(requirements, MotionRequirements):
        return requirements
    if not isinstance(requirements, str):
        allowed = f"MotionRequirements, or one of {', '.join(map(repr, NAMED))}"
        raise InvalidValueError("requirements", shown(requirements), allowed)
    if requirements not in NAMED:
        raise UnknownNameError("requirements", requirements, NAMED)
    return NAMED[requirements]


def kept_torque_scale(pepper: PepperModel, torque_scale: TorqueScale) -> float:
    """Return the fraction of the effort limits that a motion may use.

    Raises:
        InvalidValueError: unless `torque_scale` is in (0, 1], or "robot".
    """
    if isinstance(torque_scale, str) and torque_scale == ROBOT:
        return pepper.requirements.torque_scale
    return checked_share("torque_scale", torque_scale)


def limited_efforts(pepper: PepperModel) -> np.ndarray:
    """Return the indices of the joints that have an effort limit, shape (k,)."""
    return np.flatnonzero(np.isfinite(pepper.effort_limits) & (pepper.effort_limits > 0))


def checked_share(quantity: str, value: float) -> float:
    """Return the usable fraction of a limit, such as `velocity_scale`, as a float.

    Raises:
        InvalidValueError: unless the fraction is in (0, 1].
    """
    share = check_positive(quantity, value)
    if share > 1.0:
        raise InvalidValueError(quantity, value, "a number in (0, 1]")
    return share


def checked_distance(balance: object) -> float:
    """Return a balance as a float [m].

    Raises:
        InvalidValueError: unless the balance is a finite distance of 0 or more.
    """
    if not 0.0 <= as_real(balance) < np.inf:
        allowed = 'a finite distance of 0 or more [m], "robot" for the robot\'s own, or None'
        raise InvalidValueError("balance", shown(balance), allowed)
    return float(balance)  # type: ignore[arg-type]


NAMED = {"reserve": MotionRequirements(), "limits": MotionRequirements(None, 1.0)}
"""Requirements by name: "reserve", default of a robot whose wheels are known; "limits", without reserve."""
