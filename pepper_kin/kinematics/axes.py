"""Pepper's axes by name: palms, fingers, cameras, sonars and lasers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.kinematics.frames import frame_poses
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite

_AXES = {
    "+x": (1.0, 0.0, 0.0),
    "+y": (0.0, 1.0, 0.0),
    "+z": (0.0, 0.0, 1.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}

_MEANINGS = (
    ("left palm", "LArm_effector", "-z", "normal of the palm, out of the hand towards the grasped object"),
    ("left fingers", "LArm_effector", "+x", "along the open fingers, and the forearm"),
    ("left thumb", "LArm_effector", "-y", "to the side of the thumb"),
    ("right palm", "RArm_effector", "-z", "normal of the palm, out of the hand towards the grasped object"),
    ("right fingers", "RArm_effector", "+x", "along the open fingers, and the forearm"),
    ("right thumb", "RArm_effector", "+y", "to the side of the thumb"),
    ("top camera", "CameraTop_frame", "+x", "view axis; the picture's right is -y, its top +z"),
    ("bottom camera", "CameraBottom_frame", "+x", "view axis, 40 degrees down; the picture's top is +z"),
    ("depth camera", "CameraDepth_frame", "+x", "view axis; the picture's top is +z"),
    ("front sonar", "SonarFront_frame", "+x", "middle of the cone"),
    ("back sonar", "SonarBack_frame", "+x", "middle of the cone"),
    ("front laser", "SurroundingFrontLaser_frame", "+x", "middle of the fan, parallel to the floor"),
    ("left laser", "SurroundingLeftLaser_frame", "+x", "middle of the fan, parallel to the floor"),
    ("right laser", "SurroundingRightLaser_frame", "+x", "middle of the fan, parallel to the floor"),
    ("shovel laser", "ShovelLaser_frame", "+x", "down to the floor ahead"),
    ("tablet", "Tablet_frame", "+x", "normal of the screen, towards the reader"),
)


@dataclass(frozen=True, eq=False)
class NamedAxis:
    """A named direction of the robot; arrays are read-only.

    Attributes:
        name: Name, such as "left palm".
        frame: Frame to which it is fixed, a name of `pepper.frame_names`.
        axis: Axis of the frame: "+x", "-z", ...
        meaning: Meaning in words.
        in_frame: Unit vector in the frame, shape (3,), as used by `ik.AxisAlignment(axis=)`.
        origin: Origin of the frame in the world [m], shape (3,).
        direction: Unit vector in the world, shape (3,).
    """

    name: str
    frame: str
    axis: str
    meaning: str
    in_frame: Array
    origin: Array
    direction: Array


def named_axes(pepper: PepperModel, q: ArrayLike | None = None) -> dict[str, NamedAxis]:
    """Return the axes of palms, fingers and sensors by name, at a posture.

        palm = pk.kinematics.named_axes(pepper)["left palm"]
        down = pk.ik.AxisAlignment(palm.frame, (0, 0, -1), axis=palm.in_frame)  # a palm on a table

    Optical frames, whose names end in `_optical_frame`, have the same origins as their cameras' and the axes
    of the picture: x to its right, y to its bottom, z the view axis (ROS REP 103).

    Args:
        pepper: The robot; for a robot other than Pepper, axes whose frames it lacks are left out.
        q: Joint positions [rad or m], shape (n,); the neutral posture (Stand) if omitted.

    Returns:
        Name -> axis.

    Raises:
        InvalidValueError: for a q of another shape, or with NaN.
    """
    state = pepper.neutral() if q is None else as_finite(q, "q", (pepper.n,))
    known = [row for row in _MEANINGS if row[1] in pepper.frame_names]
    if not known:
        return {}
    poses = frame_poses(pepper, state, tuple(frame for _, frame, _, _ in known))
    found = {}
    for (name, frame, axis, meaning), pose in zip(known, poses, strict=True):
        vector = np.array(_AXES[axis])
        arrays = (read_only(vector), read_only(pose[:3, 3]), read_only(pose[:3, :3] @ vector))
        found[name] = NamedAxis(name, frame, axis, meaning, *arrays)
    return found
