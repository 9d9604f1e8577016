"""Loads: contributions of attached objects and payloads to joint torques, the floor's wrench and the mass.

A load of mass m, center of mass c and inertia I about it, fixed in a frame of origin p and rotation R, needs

    f = m (d2(p + R c)/dt2 - g),   n = I_w alpha + omega x (I_w omega) + R c x f,   I_w = R I R^T,

force and moment about p (Newton and Euler).  It adds J_v^T f + J_w^T n to the torques of the joints, and
(f, p x f + n) to the wrench of the floor about the world's origin.

Machine code uses the inertial parameters of loads (see `pepper_kin.dynamics.load`), in which torques and
wrenches are linear.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pepper_kin import dynamics, kinematics
from pepper_kin.arrays import Array
from pepper_kin.collision.scene import Scene
from pepper_kin.dynamics.load import PARAMETERS, STATIC_PARAMETERS, Load, Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.at_frames import HANDS, at_frames, with_inertias
from pepper_kin.model.joint_vectors import shown
from pepper_kin.model.moving_tree import moving_tree

if TYPE_CHECKING:
    from pepper_kin.collision.scene import Scene


def loads_of(
    pepper: PepperModel, scene: Scene | None = None, payload: Mapping[str, float] | None = None
) -> Loads:
    """Return all loads of a robot: a payload, and the objects of a scene that are attached with a mass.

    They add up: an object that is attached with its mass must not be named as a payload, too.

    Args:
        pepper: The robot.
        scene: The scene whose attached objects count; None for none.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Raises:
        InvalidValueError: for a mass that is not a finite number above 0, or an invalid scene.
        UnknownNameError: for a frame that the robot lacks.
    """
    if scene is not None and not isinstance(scene, Scene):
        raise InvalidValueError("scene", repr(scene), "a Scene, or None")
    loads = [Load(frame, mass) for frame, mass in at_frames(pepper, "payload", payload, "kg")]
    for item in () if scene is None else scene.attached.values():
        if item.load is not None:
            pepper.frame_id(item.frame)
            loads.append(item.load)
    return tuple(loads)


def checked_loads(pepper: PepperModel, loads: Loads) -> Loads:
    """Return loads as a tuple, after checking them.

    Raises:
        InvalidValueError: for anything but a sequence of `Load`.
        UnknownNameError: for a frame that the robot lacks.
    """
    if not isinstance(loads, (tuple, list)) or not all(isinstance(load, Load) for load in loads):
        raise InvalidValueError("loads", shown(loads), "Loads, such as collision.loads_of(pepper, scene)")
    for load in loads:
        pepper.frame_id(load.frame)
    return tuple(loads)


def carrying(pepper: PepperModel, loads: Loads) -> PepperModel:
    """Return the robot with its loads added to its Pinocchio model, cached."""
    return with_inertias(pepper, tuple((one.frame, one.mass, one.center, one.inertia) for one in loads))


def load_torque(pepper: PepperModel, loads: Loads, q: Array, v: Array, a: Array) -> Array:
    """Return the contribution of loads to the torques of the joints.

    Args:
        pepper: The robot.
        loads: The loads.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        Torques or forces [N m or N], shape (..., n).
    """
    total = np.zeros_like(q)
    for load in loads:
        jacobian = kinematics.frame_jacobian(pepper, q, load.frame)
        force, moment = _wrench_at_frame(pepper, load, q, v, a)
        total = total + np.einsum("...ij,...i->...j", jacobian[..., :3, :], force)
        if moment is not None:
            total = total + np.einsum("...ij,...i->...j", jacobian[..., 3:, :], moment)
    return total


def inverse_dynamics_with(pepper: PepperModel, loads: Loads, q: Array, v: Array, a: Array) -> Array:
    """Return the torques of a robot with loads [N m or N], shape (..., n).

    Args:
        pepper: The robot.
        loads: The loads.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
    """
    torque = np.asarray(dynamics.inverse_dynamics(pepper, q, v, a))
    return torque + load_torque(pepper, loads, q, v, a) if loads else torque


def load_wrench(pepper: PepperModel, loads: Loads, q: Array, v: Array, a: Array) -> Array:
    """Return the contribution of loads to the wrench of the floor about the world's origin.

    Args:
        pepper: The robot.
        loads: The loads.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        Force [N], then moment [N m], in world axes, shape (..., 6).
    """
    total = np.zeros((*q.shape[:-1], 6))
    for load in loads:
        place = kinematics.frame_pose(pepper, q, load.frame)[..., :3, 3]
        force, moment = _wrench_at_frame(pepper, load, q, v, a)
        turning = np.cross(place, force)
        total = total + np.concatenate([force, turning if moment is None else turning + moment], axis=-1)
    return total


def _wrench_at_frame(
    pepper: PepperModel, load: Load, q: Array, v: Array, a: Array
) -> tuple[Array, Array | None]:
    """Return the force [N] and moment [N m], shape (..., 3) each, at a frame's origin that a load needs.

    Args:
        pepper: The robot.
        load: The load.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        Both in world axes; None for the moment of a point mass.
    """
    gravity = np.asarray(pepper.inner_model.gravity.linear)
    acceleration = kinematics.frame_acceleration(pepper, q, v, a, load.frame)
    if load.is_point:
        return load.mass * (acceleration[..., :3] - gravity), None
    turn = kinematics.frame_pose(pepper, q, load.frame)[..., :3, :3]
    omega, alpha = kinematics.frame_velocity(pepper, q, v, load.frame)[..., 3:], acceleration[..., 3:]
    arm = turn @ np.array(load.center)
    center = acceleration[..., :3] + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
    force = load.mass * (center - gravity)
    inertia = turn @ load.tensor @ np.swapaxes(turn, -1, -2)
    spin = np.einsum("...ij,...j->...i", inertia, omega)
    moment = np.einsum("...ij,...j->...i", inertia, alpha) + np.cross(omega, spin) + np.cross(arm, force)
    return force, moment


class LoadParameters(NamedTuple):
    """Inertial parameters of loads for machine code.

    Attributes:
        frames: Frames about whose origins the parameters are, each once.
        values: Inertial parameters of all loads of each frame, shape (frames, PARAMETERS).
    """

    frames: tuple[str, ...]
    values: Array

    @property
    def static(self) -> Array:
        """Parameters that matter at rest, one frame after the other, shape (STATIC_PARAMETERS frames,)."""
        return np.ascontiguousarray(self.values[:, :STATIC_PARAMETERS]).ravel()


@kept_for_robot(most=64)
def load_parameters(pepper: PepperModel, loads: Loads) -> LoadParameters:
    """Return the inertial parameters of loads, summed for each body of the robot.

    Loads on a body that has a hand's end effector are moved there, so that the machine code of payloads in
    hands is reused; other loads stay at their frame, or at the frame of the body's first load.
    """
    tree = moving_tree(pepper)
    anchors: dict[int, str] = {
        tree.frame_joints[frame]: frame for frame in HANDS.values() if frame in tree.frame_joints
    }
    found: dict[str, Array] = {}
    for load in loads:
        pose, anchor = (
            tree.frame_poses[load.frame],
            anchors.setdefault(tree.frame_joints[load.frame], load.frame),
        )
        at = tree.frame_poses[anchor]
        turn, shift = at[:3, :3].T @ pose[:3, :3], at[:3, :3].T @ (pose[:3, 3] - at[:3, 3])
        center = turn @ np.array(load.center) + shift
        tensor = turn @ load.tensor @ turn.T
        second = np.trace(tensor) / 2 * np.eye(3) - tensor + load.mass * np.outer(center, center)
        row = np.concatenate([[load.mass], load.mass * center, second[np.triu_indices(3)]])
        found[anchor] = found.get(anchor, np.zeros(PARAMETERS)) + row
    # Sorted by name: the same frames share machine code.
    frames = tuple(sorted(found))
    return LoadParameters(frames, np.array([found[frame] for frame in frames]).reshape(-1, PARAMETERS))


def center_of_mass_with(pepper: PepperModel, loads: Loads, q: Array) -> Array:
    """Return the center of mass of the robot with its loads, in the world [m], shape (..., 3).

    Args:
        pepper: The robot.
        loads: The loads.
        q: Joint positions [rad or m], shape (..., n).
    """
    mass = dynamics.total_mass(pepper)
    moment, total = mass * dynamics.center_of_mass(pepper, q), mass
    for load in loads:
        pose = kinematics.frame_pose(pepper, q, load.frame)
        moment = moment + load.mass * (pose[..., :3, :3] @ np.array(load.center) + pose[..., :3, 3])
        total += load.mass
    return np.asarray(moment / total)


def center_of_mass_jacobian_with(pepper: PepperModel, loads: Loads, q: Array) -> Array:
    """Return the Jacobian of `center_of_mass_with` [m/rad], shape (..., 3, n).

    Args:
        pepper: The robot.
        loads: The loads.
        q: Joint positions [rad or m], shape (..., n).
    """
    mass = dynamics.total_mass(pepper)
    moment, total = mass * dynamics.center_of_mass_jacobian(pepper, q), mass
    for load in loads:
        jacobian = kinematics.frame_jacobian(pepper, q, load.frame)
        arm = kinematics.frame_pose(pepper, q, load.frame)[..., :3, :3] @ np.array(load.center)
        turning = np.cross(jacobian[..., 3:, :], arm[..., None], axisa=-2, axisb=-2, axisc=-2)
        moment = moment + load.mass * (jacobian[..., :3, :] + turning)
        total += load.mass
    return np.asarray(moment / total)
