"""Values by hand or frame, such as payloads and speeds, and robots with loads at frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model.digest import kept_for_robot
from pepper_kin.model.pepper_model import PepperModel

pinocchio = lazy_module("pinocchio")

AtFrames: TypeAlias = tuple[tuple[str, float], ...]
"""Pairs of a frame and its positive number."""

AtFrame: TypeAlias = tuple[str, float, tuple[float, ...], tuple[float, ...]]
"""Frame, mass [kg], center of mass in the frame [m], and inertia about it: xx, xy, xz, yy, yz, zz [kg
m^2]."""

HANDS = {"left": "LArm_effector", "right": "RArm_effector"}
"""Frame of each hand."""


def at_frames(pepper: PepperModel, quantity: str, values: Mapping[str, float] | None, unit: str) -> AtFrames:
    """Check numbers given by hand ("left", "right") or frame.

    Raises:
        InvalidValueError: for anything but a mapping, or a number that is not positive and finite.
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
        if frame not in pepper.frame_names:
            hands = (hand for hand, palm in HANDS.items() if palm in pepper.frame_names)
            raise UnknownNameError(f"hand or frame of {quantity}", name, (*hands, *pepper.frame_names))
        number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
        if not number or not (np.isfinite(value) and value > 0):
            raise InvalidValueError(f"{quantity} at {name}", value, f"a finite number above 0 [{unit}]")
        found[frame] = float(value)
    return tuple(found.items())


def carrying(pepper: PepperModel, payload: Mapping[str, float] | None) -> PepperModel:
    """Return a robot with point masses at frames as parts of its links; equal calls return one object.

    Args:
        pepper: The robot.
        payload: Masses at "left", "right" or a frame by name [kg]; None or an empty mapping for the robot
            itself.

    Raises:
        InvalidValueError: for a mass that is not a finite number above 0.
        UnknownNameError: for a frame that the robot lacks.
    """
    none = (0.0, 0.0, 0.0)
    masses = at_frames(pepper, "payload", payload, "kg")
    return with_inertias(pepper, tuple((frame, mass, none, (*none, *none)) for frame, mass in masses))


@kept_for_robot(most=8)
def with_inertias(pepper: PepperModel, inertias: tuple[AtFrame, ...]) -> PepperModel:
    """Return a robot with rigid objects at frames as parts of its links."""
    if not inertias:
        return pepper
    model = pepper.pinocchio_model
    for name, mass, center, (xx, xy, xz, yy, yz, zz) in inertias:
        frame = model.frames[pepper.frame_id(name)]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        inertia = pinocchio.Inertia(mass, np.array(center), tensor)
        model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
    return pepper.with_pinocchio_model(model)
