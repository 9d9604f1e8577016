"""Greatest speeds of hands, frames and wheels."""

from __future__ import annotations

from collections.abc import Mapping

from pepper_kin.collision.loads import HANDS, AtFrames, at_frames
from pepper_kin.model import PepperModel
from pepper_kin.model.wheels import WHEEL_FRAMES


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
