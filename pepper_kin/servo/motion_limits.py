"""Limits of position, velocity and acceleration of each joint under a servo."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pepper_kin.arrays import read_only
from pepper_kin.core.braking import JointLimits
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.problem import movable_joints
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_real

# Margin of the commands inside the robot's limits, so that rounding cannot exceed them: relative for
# velocity and acceleration, in rad or m for positions.
INSIDE = 1e-9


def motion_limits(
    pepper: PepperModel,
    locked: str | Iterable[str] = (),
    velocity_scale: float = 1.0,
    acceleration_scale: float = 1.0,
) -> JointLimits:
    """Return a robot's limits, or a ratio of them.

    Args:
        pepper: The robot.
        locked: Joints and groups that do not move.
        velocity_scale: Ratio of the velocity limits, above 0 and up to 1.
        acceleration_scale: Ratio of the acceleration limits, above 0 and up to 1.

    Raises:
        UnknownNameError: for an unknown joint or group.
        InvalidValueError: for a ratio out of range, or if all joints are locked.
    """
    movable = ~movable_joints(pepper, locked, allow_none=True)
    if not movable.any():
        raise InvalidValueError("locked", "every joint", "at least one joint left to move")
    velocity = np.where(pepper.velocity_limits > 0, pepper.velocity_limits, np.inf)
    acceleration = np.where(pepper.acceleration_limits > 0, pepper.acceleration_limits, np.inf)
    return JointLimits(
        lower=read_only(pepper.lower_limits + INSIDE),
        upper=read_only(pepper.upper_limits - INSIDE),
        velocity=read_only(velocity * _share("velocity_scale", velocity_scale) * (1 - INSIDE)),
        acceleration=read_only(
            acceleration * _share("acceleration_scale", acceleration_scale) * (1 - INSIDE)
        ),
        movable=movable,
    )


def _share(quantity: str, value: float) -> float:
    """Return a ratio after a check that it is above 0 and at most 1."""
    number = as_real(value)
    if not 0 < number <= 1:
        raise InvalidValueError(quantity, value, "a share above 0 and up to 1")
    return number
