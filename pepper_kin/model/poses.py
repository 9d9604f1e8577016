"""Poses and rotations from roll, pitch and yaw or from quaternions, and back.

Rotations are matrices R, shape (..., 3, 3), that map coordinates of a frame to those of another, and poses
matrices, shape (..., 4, 4), with R and the frame's origin [m].  Roll, pitch and yaw are URDF's, about fixed
axes: R = Rz(yaw) Ry(pitch) Rx(roll) [rad].  A quaternion's order is always explicit: "xyzw", the scalar last,
as in ROS and SciPy, or "wxyz", the scalar first, as in MuJoCo and Drake.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_batch, check_choice, refuse_degrees
from pepper_kin.model.shapes import rotation_rpy

ORDERS = ("xyzw", "wxyz")

UNIT_TOLERANCE = 1e-3
"""Maximum deviation of a quaternion's length from 1: components may be rounded to three decimals."""

_ROTATION_TOLERANCE = 1e-6


def pose(
    position: ArrayLike = (0.0, 0.0, 0.0),
    *,
    rpy: ArrayLike | None = None,
    quaternion_xyzw: ArrayLike | None = None,
    quaternion_wxyz: ArrayLike | None = None,
    rotation: ArrayLike | None = None,
) -> Array:
    """Return a pose, such as transform_hand_to_world, of a position and an orientation in one of four forms.

        pk.pose((0.4, 0.2, 0.9), rpy=(0.0, 0.0, math.pi / 2))
        pk.pose((0.4, 0.2, 0.9), quaternion_xyzw=(0.0, 0.0, 0.7071, 0.7071))

    Args:
        position: Origin [m], shape (..., 3).
        rpy: Roll, pitch and yaw about fixed axes [rad], shape (..., 3).
        quaternion_xyzw: Unit quaternion, scalar last, shape (..., 4).
        quaternion_wxyz: Unit quaternion, scalar first, shape (..., 4).
        rotation: Rotation matrix, shape (..., 3, 3).

    Returns:
        A new array, shape (..., 4, 4); leading axes of position and orientation are broadcast.

    Raises:
        InvalidValueError: for two orientations, a wrong shape, NaN, a quaternion whose length is not 1 to
            0.001, a matrix that is not a rotation to 1e-6, or angles of more than a whole turn.
    """
    arguments = {
        "rpy": rpy,
        "quaternion_xyzw": quaternion_xyzw,
        "quaternion_wxyz": quaternion_wxyz,
        "rotation": rotation,
    }
    named = [name for name, value in arguments.items() if value is not None]
    if len(named) > 1:
        raise InvalidValueError("orientation", " and ".join(named), f"one of {', '.join(arguments)}")
    origin = as_batch(position, "position", (3,))
    if rpy is not None:
        turn = rotation_from_rpy(rpy)
        refuse_degrees(rpy, "rpy")
    elif quaternion_xyzw is not None:
        turn = rotation_from_quaternion(quaternion_xyzw, order="xyzw")
    elif quaternion_wxyz is not None:
        turn = rotation_from_quaternion(quaternion_wxyz, order="wxyz")
    else:
        turn = np.eye(3) if rotation is None else check_rotations(as_batch(rotation, "rotation", (3, 3)))
    try:
        batch = np.broadcast_shapes(origin.shape[:-1], turn.shape[:-2])
    except ValueError:
        raise InvalidValueError(
            "position and orientation", f"{origin.shape[:-1]} and {turn.shape[:-2]}", "leading axes that fit"
        ) from None
    result = np.zeros((*batch, 4, 4))
    result[..., :3, :3], result[..., :3, 3], result[..., 3, 3] = turn, origin, 1.0
    return result


def rotation_from_rpy(rpy: ArrayLike) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll), shape (..., 3, 3), of roll, pitch, yaw [rad], shape (..., 3).

    Raises:
        InvalidValueError: for another shape, or NaN.
    """
    angles = as_batch(rpy, "rpy", (3,))
    matrices = [rotation_rpy(*each) for each in angles.reshape(-1, 3).tolist()]
    return np.array(matrices).reshape(*angles.shape[:-1], 3, 3)


def rpy_from_rotation(rotation: ArrayLike) -> Array:
    """Return roll, pitch in [-pi/2, pi/2] and yaw [rad], shape (..., 3), of rotations, shape (..., 3, 3).

    At pitch = +-pi/2, where roll and yaw turn about one axis, yaw is zero.

    Raises:
        InvalidValueError: for another shape, or a matrix that is not a rotation to 1e-6.
    """
    turn = check_rotations(as_batch(rotation, "rotation", (3, 3)))
    angles = [rpy_of(each) for each in turn.reshape(-1, 3, 3)]
    return np.array(angles).reshape(*turn.shape[:-2], 3)


def rpy_of(rotation: Array) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of a checked rotation matrix, shape (3, 3)."""
    r = rotation
    pitch = math.atan2(-r[2, 0], math.hypot(r[0, 0], r[1, 0]))
    if math.hypot(r[0, 0], r[1, 0]) < 1e-9:
        return math.atan2(-math.copysign(1.0, r[2, 0]) * r[0, 1], r[1, 1]), pitch, 0.0
    return math.atan2(r[2, 1], r[2, 2]), pitch, math.atan2(r[1, 0], r[0, 0])


def rotation_from_quaternion(quaternion: ArrayLike, *, order: str = "xyzw") -> Array:
    """Return the rotation, shape (..., 3, 3), of a unit quaternion, shape (..., 4).

    Args:
        quaternion: Components, shape (..., 4); q and -q are the same rotation.
        order: "xyzw" (scalar last) or "wxyz" (scalar first).

    Raises:
        InvalidValueError: for another shape or order, NaN, or a length that is not 1 to 0.001; other lengths
            are normalized.
    """
    check_choice("order", order, ORDERS)
    q = as_batch(quaternion, f"quaternion ({order})", (4,))
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    wrong = np.abs(length[..., 0] - 1.0) > UNIT_TOLERANCE
    if wrong.any():
        raise InvalidValueError(
            f"quaternion ({order})",
            f"{q[wrong][0].tolist()} of length {length[wrong][0, 0]:.6g}",
            "a unit quaternion: divide it by its length",
        )
    q = q / length
    x, y, z, w = np.moveaxis(q if order == "xyzw" else np.roll(q, -1, axis=-1), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def quaternion_from_rotation(rotation: ArrayLike, *, order: str = "xyzw") -> Array:
    """Return the unit quaternion, shape (..., 4), with a scalar w >= 0, of rotations, shape (..., 3, 3).

    Args:
        rotation: Rotation matrices, shape (..., 3, 3); `pose[..., :3, :3]` of a pose.
        order: "xyzw" (scalar last) or "wxyz" (scalar first).

    Raises:
        InvalidValueError: for another shape or order, or a matrix that is not a rotation to 1e-6.
    """
    check_choice("order", order, ORDERS)
    q = quaternions_of(check_rotations(as_batch(rotation, "rotation", (3, 3))))
    q = np.where(q[..., 3:] < 0, -q, q)
    return q if order == "xyzw" else np.roll(q, 1, axis=-1)


def quaternions_of(rotations: Array) -> Array:
    """Return quaternions (x, y, z, w) of either sign, shape (..., 4), of checked rotations.

    Each row of 4 q q' is 4 q times one of q's components; the row of the largest component is normalized
    (Shepperd 1978).
    """
    r = np.moveaxis(rotations, (-2, -1), (0, 1))
    x, y, z = r[0, 0], r[1, 1], r[2, 2]
    xy, xz, yz = r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]
    xw, yw, zw = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    products = np.array(
        [
            [1 + x - y - z, xy, xz, xw],
            [xy, 1 - x + y - z, yz, yw],
            [xz, yz, 1 - x - y + z, zw],
            [xw, yw, zw, 1 + x + y + z],
        ]
    )
    products = np.moveaxis(products, (0, 1), (-2, -1))
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    rows = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    return np.asarray(rows / np.linalg.norm(rows, axis=-1, keepdims=True))


def check_rotations(rotations: Array, quantity: str = "rotation") -> Array:
    """Return matrices, shape (..., 3, 3), if they are orthonormal and right-handed to 1e-6.

    Raises:
        InvalidValueError: with the first matrix that is not a rotation.
    """
    skewness = np.abs(rotations @ np.swapaxes(rotations, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    bad = (skewness > _ROTATION_TOLERANCE) | (np.linalg.det(rotations) < 0)
    if bad.any():
        raise InvalidValueError(
            quantity, rotations[bad][0].tolist(), "a rotation matrix: orthonormal, right-handed"
        )
    return rotations
