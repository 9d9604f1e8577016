"""Effectors of NAOqi: their poses, and joint angles for target poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from pepper_kin import ik
from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel, load_pepper, pose, rpy_from_rotation
from pepper_kin.naoqi.body import Body
from pepper_kin.naoqi.errors import NaoqiError, quoted
from pepper_kin.naoqi.joint_names import CHAINS, HANDS
from pepper_kin.naoqi.tables import table

TORSO, WORLD, ROBOT = 0, 1, 2
"""Frames of NAOqi: FRAME_TORSO, FRAME_WORLD, FRAME_ROBOT."""

POSITION_BITS, ROTATION_BITS = 0b000111, 0b111000

WHEEL_CENTER = 0.264
"""Distance from the knee's axis down to the wheels' axles [m] (api_naoqi: TibiaLength)."""

CHAIN_JOINTS = {
    "Head": CHAINS["Head"],
    "LArm": tuple(j for j in CHAINS["LArm"] if j not in HANDS),
    "RArm": tuple(j for j in CHAINS["RArm"] if j not in HANDS),
    "Torso": CHAINS["Leg"],
    "Leg": CHAINS["Leg"],
}
"""Movable effector -> joints that move it."""


@cache
def standing_pepper() -> PepperModel:
    """Return the model for inverse kinematics: the base is fixed, the fingers are locked."""
    return load_pepper()


@dataclass(frozen=True)
class EffectorCandidate:
    """Joint angles for target poses.

    Attributes:
        angles: Joint -> angle [rad].
        reached: Whether the targets are reached.
        message: Reason if the targets are not reached, else "".
    """

    angles: dict[str, float]
    reached: bool
    message: str


def frame_of(name: object, module: str, method: str) -> str:
    """Return the frame of the model for a name of NAOqi.

    Raises:
        NaoqiError: for an unknown name.
    """
    frames: dict[str, str] = table("motion")["frames"]
    if not isinstance(name, str) or name not in frames:
        raise NaoqiError(module, method, f"{quoted(name)} is no effector; known: {', '.join(frames)}")
    return frames[name]


def space_pose(body: Body, space: int, use_sensors: bool, module: str, method: str) -> Array:
    """Return the pose of FRAME_TORSO, FRAME_WORLD or FRAME_ROBOT in the world, shape (4, 4)."""
    if space == WORLD:
        return np.eye(4)
    if space == ROBOT:
        return body.frame_pose("base_footprint", use_sensors)
    if space == TORSO:
        return body.frame_pose("torso_naoqi", use_sensors)
    raise NaoqiError(
        module, method, f"space: got {quoted(space)}, expected 0 (torso), 1 (world) or 2 (robot)"
    )


def position6d(pose: Array) -> list[float]:
    """Return [x, y, z, wx, wy, wz] [m, rad] of a pose, shape (4, 4).

    The rotation is Rz(wz) Ry(wy) Rx(wx).
    """
    return [*map(float, pose[:3, 3]), *map(float, rpy_from_rotation(pose[:3, :3]))]


def as_pose(values: list[float]) -> Array:
    """Return the pose, shape (4, 4), of a Position6D (6 numbers) or a transform by rows (12 or 16)."""
    if len(values) == 6:
        return np.asarray(pose(values[:3], rpy=values[3:]))
    matrix = np.eye(4)
    matrix[:3] = np.reshape(values[:12], (3, 4))
    return matrix


def tasks_for(effector: str, pose: Array, mask: int) -> list[ik.Task]:
    """Return the tasks of an effector with an axis mask, in the frame of the pose, shape (4, 4) [m].

    A single bit of position keeps the origin in a plane; two bits of rotation align the third axis, and one
    bit alone sets the whole orientation.
    """
    frame = table("motion")["frames"][effector]
    point, rotation = pose[:3, 3], pose[:3, :3]
    tasks: list[ik.Task] = []
    if mask & POSITION_BITS == POSITION_BITS:
        tasks.append(ik.FramePosition(frame, point))
    else:
        for axis in range(3):
            if mask & (1 << axis):
                tasks.append(ik.FrameInPlane(frame, point, np.eye(3)[axis]))
    turned = (mask & ROTATION_BITS) >> 3
    free = {0b011: 2, 0b101: 1, 0b110: 0}.get(turned)
    if free is not None:
        tasks.append(ik.AxisAlignment(frame, rotation[:, free], axis=np.eye(3)[free]))
    elif turned:
        tasks.append(ik.FrameOrientation(frame, rotation))
    return tasks


def commanded_posture(body: Body, start: dict[str, float] | None = None) -> tuple[PepperModel, Array]:
    """Return the model for inverse kinematics, and its commanded posture within limits, shape (n,).

    Args:
        body: The simulated body; joints without stiffness may sag beyond the limits.
        start: Joint -> angle in place of the command [rad].
    """
    pepper, given = standing_pepper(), start or {}
    q = pepper.joint_vector({name: given.get(name, body.commanded(name)) for name in pepper.joint_names})
    return pepper, np.clip(q, pepper.lower_limits, pepper.upper_limits)


def find_angles(
    body: Body, targets: dict[str, tuple[Array, int]], start: dict[str, float]
) -> EffectorCandidate:
    """Return joint angles that bring effectors to poses.

    Args:
        body: The simulated body; its other joints stay at their commands.
        targets: Effector -> pose in the world [m], shape (4, 4), and axis mask.
        start: Joint -> initial angle [rad].
    """
    pepper, q = commanded_posture(body, start)
    footprint = np.linalg.inv(body.frame_pose("base_footprint", False))
    joints = [joint for effector in targets for joint in CHAIN_JOINTS[effector]]
    tasks = [
        task
        for effector, (pose, mask) in targets.items()
        for task in tasks_for(effector, footprint @ pose, mask)
    ]
    result = ik.solve(pepper, tasks, q, joints=joints, collisions=False)
    angles = {joint: float(result.q[pepper.joint_index(joint)]) for joint in joints}
    return EffectorCandidate(angles, result.success, "" if result.success else result.advice)
