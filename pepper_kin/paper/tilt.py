"""Joint angles from accelerometers on the links: tilt formulas and observability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import kinematics
from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.kinematic_tree import kinematic_tree
from pepper_kin.model.urdf_document import Joint

GRAVITY = 9.81  # [m/s^2]
ACCELEROMETER_NOISE = 0.05  # standard deviation of accelerometers [m/s^2], assumed
GYROSCOPE_NOISE = 0.005  # standard deviation of gyroscopes [rad/s], assumed
GYROSCOPE_BIAS = 0.01  # standard deviation of gyroscopes' constant offset [rad/s], assumed
BLIND = 0.2
"""Fraction of gravity across a joint's axis below which an accelerometer counts as blind to the joint."""
_DRIFT = 1e-4  # random walk of the bias in the filter [rad/s per sqrt(s)]


def tilt_angles(specific_force: ArrayLike) -> Array:
    """Return roll, pitch and yaw by the tilt formulas from an accelerometer alone.

        roll  = atan2(f_y, sqrt(f_x^2 + f_z^2))
        pitch = atan2(-f_x, sqrt(f_y^2 + f_z^2))
        yaw   = atan2(sqrt(f_x^2 + f_y^2), f_z)

    The first is the rotation about x without rotation about y, and the second the reverse; the third is the
    angle of the z axis to the vertical, never negative, without information on a rotation about the vertical.
    This is the usual form of the formulas (Freescale application note AN3461), with the signs of x forward, z
    up.

    Args:
        specific_force: Measurement of the accelerometer, R^T (a - gravity) [m/s^2], shape (..., 3).

    Returns:
        Angles [rad], shape (..., 3).

    Raises:
        InvalidValueError: for a last axis whose length is not 3.
    """
    force = np.asarray(specific_force, dtype=float)
    if force.shape[-1:] != (3,):
        raise InvalidValueError("specific_force", f"shape {force.shape}", "shape (..., 3)")
    x, y, z = np.moveaxis(force, -1, 0)
    angles = [np.arctan2(y, np.hypot(x, z)), np.arctan2(-x, np.hypot(y, z)), np.arctan2(np.hypot(x, y), z)]
    return np.stack(angles, axis=-1)


@dataclass(frozen=True, eq=False)
class TiltMeasurement(FrozenArrays):
    """Joint angles recovered from sensors on both sides of each joint; arrays are read-only.

    Attributes:
        joint_names: Names of the joints.
        time: Times [s], shape (T,).
        true: Angles of the motion [rad], shape (T, k).
        formulas: Angles by the tilt formulas, the link's about the joint's axis minus its parent's [rad],
            shape (T, k).
        estimate: Angles by the filter [rad], shape (T, k).
        visible: Fraction of gravity across the joint's axis, 0 (blind) to 1, shape (T, k).
    """

    joint_names: tuple[str, ...]
    time: Array
    true: Array
    formulas: Array
    estimate: Array
    visible: Array

    def __post_init__(self) -> None:
        for name in ("time", "true", "formulas", "estimate", "visible"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def formulas_error(self) -> Array:
        """Root mean square error of the formulas [rad], shape (k,)."""
        return np.sqrt(np.mean((self.formulas - self.true) ** 2, axis=0))

    @property
    def estimate_error(self) -> Array:
        """Root mean square error of the filter [rad], shape (k,)."""
        return np.sqrt(np.mean((self.estimate - self.true) ** 2, axis=0))

    @property
    def blind(self) -> NDArray[np.bool_]:
        """Whether gravity is along the joint's axis, to within `BLIND`, at some time, shape (k,)."""
        return np.asarray((self.visible < BLIND).any(axis=0))


def measure_by_tilt(
    pepper: PepperModel,
    time: ArrayLike,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    joints: Sequence[str],
    *,
    noise: bool = True,
    seed: int = 0,
) -> TiltMeasurement:
    """Simulate accelerometers and gyroscopes on the links and recover joint angles from them.

    A revolute joint rotates its link about an axis n of the parent: f_parent = Rot(n, q) f_link, up to the
    acceleration between both origins. Only the part of gravity across n depends on q,

        q = atan2(n . (f_link x f_parent), f_link . f_parent)        (parts across n)

    with the sensors' variance divided by the squared length of that part. If it vanishes the accelerometers
    are blind; the difference of the gyroscopes along n is not, but drifts. A Kalman filter with the states
    angle and bias combines both. It starts from the first tilt, or from the true angle if the accelerometers
    are blind.

    Args:
        pepper: The robot.
        time: Equally spaced times [s], shape (T,).
        q: Positions [rad], shape (T, n).
        v: Velocities [rad/s], shape (T, n).
        a: Accelerations [rad/s^2], shape (T, n).
        joints: Revolute joints to recover.
        noise: Whether the sensors have noise and bias.
        seed: Seed of noise and bias.

    Returns:
        The recovered joint angles.

    Raises:
        UnknownNameError: for an unknown joint.
    """
    time, q, v, a = (np.asarray(x, dtype=float) for x in (time, q, v, a))
    rng = np.random.default_rng(seed)
    places = [pepper.joint_index(name) for name in joints]
    placed = {p.joint.name: p for p in kinematic_tree(pepper.document).joints.values()}
    links = tuple(dict.fromkeys(x for name in joints for x in _sides(placed[name].joint)))
    force, rate = _sensors(pepper, q, v, a, links, rng if noise else None)
    formulas, estimate, visible = (np.empty((len(time), len(places))) for _ in range(3))
    for k, (name, place) in enumerate(zip(joints, places, strict=True)):
        joint, axis = placed[name], placed[name].axis
        parent, child = (links.index(link) for link in _sides(joint.joint))
        turn = joint.transform_child_to_parent[:3, :3]
        main = int(np.argmax(np.abs(axis)))
        tilts = tilt_angles(force[:, child])[:, main] - tilt_angles(force[:, parent] @ turn)[:, main]
        formulas[:, k] = tilts * np.sign(axis[main])
        above, below = force[:, parent] @ turn, force[:, child]
        relative = (rate[:, child] - rate[:, parent] @ turn) @ axis
        angle, length = _turn_about(axis, above, below)
        visible[:, k] = length / GRAVITY
        estimate[:, k] = _filter(time, angle, length, np.linalg.norm(above, axis=1), relative, q[0, place])
    return TiltMeasurement(tuple(joints), time, q[:, places], formulas, estimate, visible)


def _sides(joint: Joint) -> tuple[str, str]:
    """Return the parent and the child link of a joint."""
    return joint.parent, joint.child


def _sensors(
    pepper: PepperModel, q: Array, v: Array, a: Array, links: tuple[str, ...], rng: np.random.Generator | None
) -> tuple[Array, Array]:
    """Return specific forces and angular velocities in the links' axes, shape (T, links, 3) each.

    Args:
        pepper: The robot.
        q: Positions [rad], shape (T, n).
        v: Velocities [rad/s], shape (T, n).
        a: Accelerations [rad/s^2], shape (T, n).
        links: Links with sensors.
        rng: Source of noise and bias; None for none.

    Returns:
        Specific forces [m/s^2] and angular velocities [rad/s].
    """
    force, rate = np.empty((len(q), len(links), 3)), np.empty((len(q), len(links), 3))
    for i, link in enumerate(links):
        turn = kinematics.frame_pose(pepper, q, link)[..., :3, :3]
        acceleration = kinematics.frame_acceleration(pepper, q, v, a, link)[..., :3]
        velocity = kinematics.frame_velocity(pepper, q, v, link)[..., 3:]
        force[:, i] = np.einsum("tji,tj->ti", turn, acceleration + np.array([0.0, 0.0, GRAVITY]))
        rate[:, i] = np.einsum("tji,tj->ti", turn, velocity)
        if rng is not None:
            force[:, i] += rng.normal(0.0, ACCELEROMETER_NOISE, (len(q), 3))
            rate[:, i] += rng.normal(0.0, GYROSCOPE_NOISE, (len(q), 3)) + rng.normal(0.0, GYROSCOPE_BIAS, 3)
    return force, rate


def _turn_about(axis: Array, above: Array, below: Array) -> tuple[Array, Array]:
    """Return the angle about an axis between two vectors' parts across it, and the shorter part's length.

    Args:
        axis: Unit vector, shape (3,).
        above: Specific forces of the parent [m/s^2], shape (T, 3).
        below: Specific forces of the child [m/s^2], shape (T, 3).

    Returns:
        Angle [rad] and length of the shorter part [m/s^2], shape (T,) each.
    """
    above = above - np.outer(above @ axis, axis)
    below = below - np.outer(below @ axis, axis)
    angle = np.arctan2(np.cross(below, above) @ axis, np.sum(below * above, axis=1))
    return angle, np.minimum(np.linalg.norm(above, axis=1), np.linalg.norm(below, axis=1))


def _filter(time: Array, angle: Array, length: Array, whole: Array, rate: Array, start: float) -> Array:
    """Return the angle by a Kalman filter with states (angle, bias of the rate), shape (T,).

    Args:
        time: Times [s], shape (T,).
        angle: Angle from the accelerometers [rad], shape (T,).
        length: Length of the specific force across the axis [m/s^2], shape (T,).
        whole: Length of the specific force [m/s^2], shape (T,).
        rate: Angular velocity from the gyroscopes [rad/s], shape (T,).
        start: Angle at the start if the accelerometers are blind there [rad].
    """
    estimate = np.empty_like(angle)
    sees = length[0] > BLIND * GRAVITY
    x, p = np.array([angle[0] if sees else start, 0.0]), np.diag([1e-4, 2.0 * GYROSCOPE_BIAS**2])
    for k in range(len(time)):
        if k:
            dt = time[k] - time[k - 1]
            move = np.array([[1.0, -dt], [0.0, 1.0]])
            x = move @ x + np.array([0.5 * dt * (rate[k] + rate[k - 1]), 0.0])
            p = move @ p @ move.T + np.diag([2.0 * (GYROSCOPE_NOISE * dt) ** 2, _DRIFT**2 * dt])
        # Links that speed up or slow down are not held by gravity alone: trust them less.
        sigma = (np.sqrt(2.0) * ACCELEROMETER_NOISE + abs(whole[k] - GRAVITY)) / max(length[k], 1e-6)
        gain = p[:, 0] / (p[0, 0] + sigma**2)
        miss = np.angle(np.exp(1j * (angle[k] - x[0])))  # the short way round
        x = x + gain * miss
        p = p - np.outer(gain, p[0])
        estimate[k] = x[0]
    return estimate
