"""Manipulability: how well a frame can move in all directions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.kinematics.jacobian import frame_jacobian
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_choice

PARTS = {"position": slice(0, 3), "rotation": slice(3, 6), "pose": slice(0, 6)}


def manipulability(
    pepper: PepperModel,
    q: ArrayLike,
    frame: str,
    *,
    joints: str | Sequence[str] | None = None,
    part: str = "position",
) -> NDArray[np.float64]:
    """Return sqrt(det(J J^T)) of a frame: zero at a singularity, where a direction of motion is lost.

    Yoshikawa, Manipulability of robotic mechanisms (1985): the volume of the ellipsoid of velocities that
    joint velocities of norm one can produce, up to a constant factor.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        frame: A name of `pepper.frame_names`.
        joints: Joints that may move: names of joints and groups, such as "left_arm"; all by default.
        part: "position" (three directions), "rotation" (three) or "pose" (six).

    Returns:
        Manipulability, shape (...) [m^3, 1 or m^3 for the three parts, per rad^k].  It is zero if there are
        fewer joints than directions.

    Raises:
        UnknownNameError: for a frame, joint or group that the robot lacks.
        InvalidValueError: for another part, no joint, or a q of wrong length, or with NaN or infinity.
    """
    rows = PARTS[check_choice("part", part, tuple(PARTS))]
    columns = [pepper.joint_index(name) for name in pepper.resolve_joints(joints)]
    jacobian = frame_jacobian(pepper, q, frame)[..., rows, :][..., columns]
    if len(columns) < jacobian.shape[-2]:
        return np.zeros(jacobian.shape[:-2])
    # The product of the singular values is sqrt(det(J J^T)) without squaring their rounding errors.
    return np.asarray(np.prod(np.linalg.svd(jacobian, compute_uv=False), axis=-1))
