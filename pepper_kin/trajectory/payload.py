"""A mass held in a hand: what it asks of the joints and of the floor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.wheels import WHEEL_FRAMES

Array = NDArray[np.float64]

AtFrames: TypeAlias = tuple[tuple[str, float], ...]
"""A positive number for each of some frames."""

HANDS = {"left": "LArm_effector", "right": "RArm_effector"}


def at_frames(pepper: PepperModel, quantity: str, values: Mapping[str, float] | None, unit: str) -> AtFrames:
    """Check numbers given by hand ("left", "right") or frame.

    Raises:
        InvalidValueError: for what is no mapping, or a number that is not positive and finite.
        UnknownNameError: for a frame that the robot lacks.
    """
    if values is None:
        return ()
    if not isinstance(values, Mapping):
        raise InvalidValueError(
            quantity, repr(values), f"a mapping from 'left', 'right' or a frame to [{unit}]"
        )
    found: dict[str, float] = {}
    for name, value in values.items():
        frame = HANDS.get(name, name)
        pepper.frame_id(frame)
        number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
        if not number or not (np.isfinite(value) and value > 0):
            raise InvalidValueError(f"{quantity} at {name}", value, f"a finite number above 0 [{unit}]")
        found[frame] = float(value)
    return tuple(found.items())


def hand_speeds(pepper: PepperModel, hand_speed: float | Mapping[str, float] | None) -> AtFrames:
    """Return greatest speeds by frame [m/s]; a number counts for the effectors of both hands.

    Raises:
        InvalidValueError: for a number that is not positive and finite.
        UnknownNameError: for a frame that the robot lacks.
    """
    if hand_speed is None or isinstance(hand_speed, Mapping):
        return at_frames(pepper, "hand_speed", hand_speed, "m/s")
    return at_frames(pepper, "hand_speed", dict.fromkeys(HANDS, hand_speed), "m/s")


def wheel_speeds(pepper: PepperModel) -> AtFrames:
    """Return the greatest speeds of a differential base's wheels; nothing for other robots [m/s]."""
    wheels = pepper.wheels
    return () if wheels is None or not wheels.differential else tuple((f, wheels.speed) for f in WHEEL_FRAMES)


def payload_torque(pepper: PepperModel, payload: AtFrames, q: Array, v: Array, a: Array) -> Array:
    """Return what point masses m at frames p add to the torques, sum J_p^T m (d2p/dt2 - g).

    Args:
        pepper: The robot.
        payload: Masses by frame [kg].
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        Torques or forces [N m or N], shape (..., n).
    """
    from pepper_kin import kinematics

    total = np.zeros_like(q)
    for frame, mass in payload:
        jacobian = kinematics.frame_jacobian(pepper, q, frame)[..., :3, :]
        force = _force(pepper, frame, mass, q, v, a)
        total = total + np.einsum("...ij,...i->...j", jacobian, force)
    return total


def payload_wrench(pepper: PepperModel, payload: AtFrames, q: Array, v: Array, a: Array) -> Array:
    """Return what the masses add to the wrench of the floor about the world's origin, shape (..., 6)."""
    from pepper_kin import kinematics

    total = np.zeros((*q.shape[:-1], 6))
    for frame, mass in payload:
        place = kinematics.frame_pose(pepper, q, frame)[..., :3, 3]
        force = _force(pepper, frame, mass, q, v, a)
        total = total + np.concatenate([force, np.cross(place, force)], axis=-1)
    return total


def _force(pepper: PepperModel, frame: str, mass: float, q: Array, v: Array, a: Array) -> Array:
    """Return the force that moves and carries a mass [N], shape (..., 3)."""
    from pepper_kin import kinematics

    gravity = np.asarray(pepper.inner_model.gravity.linear)
    return mass * (kinematics.frame_acceleration(pepper, q, v, a, frame)[..., :3] - gravity)
