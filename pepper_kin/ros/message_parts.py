"""Conversion of times, headers, vectors, rotations and poses to and from messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import quaternion_from_rotation, rotation_from_quaternion
from pepper_kin.ros_messages import message_type

TRANSFORM = message_type("geometry_msgs/msg/Transform")
STAMPED_TRANSFORM = message_type("geometry_msgs/msg/TransformStamped")
VECTOR = message_type("geometry_msgs/msg/Vector3")
POINT = message_type("geometry_msgs/msg/Point")
QUATERNION = message_type("geometry_msgs/msg/Quaternion")
HEADER = message_type("std_msgs/msg/Header")
TIME = message_type("builtin_interfaces/msg/Time")
DURATION = message_type("builtin_interfaces/msg/Duration")


def time_message(time: float) -> Any:
    """Convert a time [s] to builtin_interfaces/msg/Time."""
    whole = int(time // 1.0)
    return TIME(sec=whole, nanosec=min(round((time - whole) * 1e9), 999_999_999))


def duration_message(time: float) -> Any:
    """Convert a time [s] to builtin_interfaces/msg/Duration."""
    whole = int(time // 1.0)
    return DURATION(sec=whole, nanosec=min(round((time - whole) * 1e9), 999_999_999))


def header(time: float, frame: str = "") -> Any:
    """Return std_msgs/msg/Header with a time [s] and a frame."""
    return HEADER(stamp=time_message(time), frame_id=frame)


def quaternion(rotation: ArrayLike) -> Any:
    """Convert a rotation matrix, shape (3, 3), to geometry_msgs/msg/Quaternion."""
    x, y, z, w = quaternion_from_rotation(rotation).tolist()
    return QUATERNION(x=x, y=y, z=z, w=w)


def vector(value: ArrayLike) -> Any:
    """Convert a vector, shape (3,), to geometry_msgs/msg/Vector3."""
    x, y, z = np.asarray(value, dtype=float).tolist()
    return VECTOR(x=x, y=y, z=z)


def transforms(time: float, pairs: Sequence[tuple[str, str]], poses: Array) -> list[Any]:
    """Convert poses at a time to a list of geometry_msgs/msg/TransformStamped.

    Args:
        time: Time of the stamps [s].
        pairs: Parent and child frame of each pose, k pairs.
        poses: Poses of the children in their parents, shape (k, 4, 4).
    """
    turns = quaternion_from_rotation(poses[:, :3, :3]).tolist()
    stamp = time_message(time)
    made = []
    for (parent, child), place, turn in zip(pairs, poses[:, :3, 3].tolist(), turns, strict=True):
        moved = TRANSFORM(
            translation=VECTOR(x=place[0], y=place[1], z=place[2]),
            rotation=QUATERNION(x=turn[0], y=turn[1], z=turn[2], w=turn[3]),
        )
        head = HEADER(stamp=stamp, frame_id=parent)
        made.append(STAMPED_TRANSFORM(header=head, child_frame_id=child, transform=moved))
    return made


def pose_message(pose: Array) -> Any:
    """Convert a pose, shape (4, 4), to geometry_msgs/msg/Pose."""
    x, y, z = pose[:3, 3].tolist()
    return message_type("geometry_msgs/msg/Pose")(
        position=POINT(x=x, y=y, z=z), orientation=quaternion(pose[:3, :3])
    )


def planar_pose(pose: ArrayLike) -> Array:
    """Convert a planar pose x, y [m], yaw [rad], shape (3,), to a pose, shape (4, 4)."""
    x, y, yaw = (float(value) for value in np.asarray(pose, dtype=float))
    made = np.eye(4)
    made[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    made[:2, 3] = x, y
    return made


def pose_of(message: Any) -> Array:
    """Convert geometry_msgs/msg/Pose to a pose, shape (4, 4).

    Raises:
        InvalidValueError: for NaN, infinity or a quaternion of length 0.
    """
    p, o = message.position, message.orientation
    made = np.eye(4)
    made[:3, 3] = p.x, p.y, p.z
    length = float(np.hypot(np.hypot(o.x, o.y), np.hypot(o.z, o.w)))
    if not np.isfinite(made).all() or not np.isfinite(length) or length < 1e-6:
        raise InvalidValueError("pose", message, "finite numbers, and a quaternion that is not 0")
    made[:3, :3] = rotation_from_quaternion(np.array([o.x, o.y, o.z, o.w]) / length)
    return made
