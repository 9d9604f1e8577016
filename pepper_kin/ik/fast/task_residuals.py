"""The residual of each kind of task, and its derivative, as expressions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from pepper_kin.ik.fast.residuals import direction_residual, rotation_residual, skew, turn_between
from pepper_kin.ik.fast.structure import Structure
from pepper_kin.ik.problem import generic_configurations
from pepper_kin.ik.tasks import CenterOfMassOverWheels
from pepper_kin.ik.tasks.direction import sideways_basis
from pepper_kin.ik.tasks.look_at import NEAREST
from pepper_kin.ik.tasks.relative_motion import relative_jacobian
from pepper_kin.ik.tasks.task import Array
from pepper_kin.model import PepperModel

MASS_KINDS = ("CenterOfMass", "CenterOfMassOverWheels")
"""Kinds that need the center of mass."""

LARGEST_KINDS = ("JointPosture", "CenterOfMassOverWheels", "Expression")
"""Kinds whose error is the largest component of the residual, not its length."""


class Motion(NamedTuple):
    """What the residuals are written in.

    Attributes:
        q: Joint positions, shape (n,).
        frames: Pose (3, 4) and Jacobian (6, n) of each frame.
        center: The center of mass (3) and its Jacobian (3, n); empty where no task needs it.
    """

    q: Any
    frames: Mapping[str, tuple[Any, Any]]
    center: tuple[Any, ...]


def task_residual(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    """Return r and dr/dq as the task's class defines them.

    Args:
        pepper: The robot.
        task: The structure.
        motion: Frames and center of mass of the robot.
        target: The numbers that describe the target.
    """
    return _RESIDUALS[task.kind](pepper, task, motion, target)


def joints_of_relative(pepper: PepperModel, task: Structure) -> np.ndarray:
    """Return which joints move what a task sees from its reference, shape (n,).

    Joints on the way to both frames carry them alike; what is left of their columns is rounding.
    """
    used = np.zeros(pepper.n, dtype=bool)
    wheels = None
    if task.kind == "CenterOfMassOverWheels":
        contacts = np.reshape(task.corners, (-1, 2))
        wheels = CenterOfMassOverWheels(-1.0, contacts=contacts, base_frame=task.reference)
    for q in generic_configurations(pepper):
        if wheels is not None:
            change = wheels.dependence(pepper, q)
        else:
            change = relative_jacobian(pepper, q, task.frame, task.reference)
        used |= np.abs(change).max(axis=0) > 1e-9
    return used


def _frame_position(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    pose, jacobian = motion.frames[task.frame]
    return pose[:, 3] - target, jacobian[:3, :]


def _frame_in_plane(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    distance, jacobian = _frame_position(pepper, task, motion, target)
    normal = np.array([task.axis])
    return normal @ distance, normal @ jacobian


def _frame_orientation(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    import casadi

    pose, jacobian = motion.frames[task.frame]
    wanted = casadi.reshape(target, 3, 3)  # row-major numbers: this is R_t^T
    residual, inverse = rotation_residual(pose[:, :3] @ wanted)
    return residual, inverse @ jacobian[3:, :]


def _axis_alignment(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    pose, jacobian = motion.frames[task.frame]
    axis, turn = np.array(task.axis), pose[:, :3].T
    residual, slope = direction_residual(axis, sideways_basis(axis), turn @ target)
    return residual, (slope @ turn @ skew(target)) @ jacobian[3:, :]


def _look_at(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    pose, jacobian = motion.frames[task.frame]
    axis, turn = np.array(task.axis), pose[:, :3].T
    sight, distance = _direction(target - pose[:, 3])
    residual, slope = direction_residual(axis, sideways_basis(axis), turn @ sight)
    ahead = slope @ turn
    across = (ahead - (ahead @ sight) @ sight.T) / distance
    return residual, (ahead @ skew(sight)) @ jacobian[3:, :] - across @ jacobian[:3, :]


def _line_through_point(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    pose, jacobian = motion.frames[task.frame]
    start, other = motion.frames[task.reference]
    along, length = _direction(pose[:, 3] - start[:, 3])
    sight, distance = _direction(target - pose[:, 3])
    residual, by_along, by_sight = turn_between(along, sight)
    swing = (by_along - (by_along @ along) @ along.T) / length
    across = (by_sight - (by_sight @ sight) @ sight.T) / distance
    return residual, (swing - across) @ jacobian[:3, :] - swing @ other[:3, :]


def _direction(line: Any) -> tuple[Any, Any]:
    """Return the unit vector of a line and its length, x where it is nothing, as the tasks' classes do."""
    import casadi

    length = casadi.sqrt(casadi.sumsqr(line))
    distance, near = casadi.fmax(length, NEAREST), length < NEAREST
    return (1 - near) * line / distance + near * np.array([1.0, 0.0, 0.0]), distance


def _joint_posture(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    rows = [pepper.joint_index(name) for name in task.joints or pepper.joint_names]
    return motion.q[rows] - target, _selection(pepper, rows)


def _base_yaw(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    import casadi

    turn, selection = _joint_posture(pepper, task, motion, target)
    return turn - 2 * math.pi * casadi.floor(turn / (2 * math.pi) + 0.5), selection


def _relative_position(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    pose, jacobian = motion.frames[task.frame]
    relative_to, other = motion.frames[task.reference]
    turn, line = relative_to[:, :3].T, pose[:, 3] - relative_to[:, 3]
    change = jacobian[:3, :] - other[:3, :] + skew(line) @ other[3:, :]
    return turn @ line - target, _without_common(pepper, task, turn @ change)


def _relative_orientation(
    pepper: PepperModel, task: Structure, motion: Motion, target: Any
) -> tuple[Any, Any]:
    import casadi

    pose, jacobian = motion.frames[task.frame]
    relative_to, other = motion.frames[task.reference]
    turn = relative_to[:, :3].T
    residual, inverse = rotation_residual(turn @ pose[:, :3] @ casadi.reshape(target, 3, 3))
    change = (inverse @ turn) @ (jacobian[3:, :] - other[3:, :])
    return residual, _without_common(pepper, task, change)


def _center_of_mass(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    center, jacobian = motion.center
    return center[:2] - target, jacobian[:2, :]


def _center_of_mass_over_wheels(
    pepper: PepperModel, task: Structure, motion: Motion, target: Any
) -> tuple[Any, Any]:
    import casadi

    wheels = CenterOfMassOverWheels(
        -1.0, contacts=np.reshape(task.corners, (-1, 2)), base_frame=task.reference
    )
    center, jacobian = motion.center
    base, other = motion.frames[task.reference]
    turn, line = base[:, :3].T, center - base[:, 3]
    place = (turn @ line)[:2]
    inward = casadi.DM(wheels.normals)
    lack = target - (inward @ place - casadi.DM((wheels.normals * wheels.contacts).sum(axis=1)))
    change = (turn @ (jacobian - other[:3, :] + skew(line) @ other[3:, :]))[:2, :]
    slopes = -(inward @ _without_common(pepper, task, change))
    rows = [casadi.if_else(lack[k] > 0, 1.0, 0.0) * slopes[k, :] for k in range(len(wheels.normals))]
    return casadi.fmax(lack, 0.0), casadi.vertcat(*rows)


def _expression(pepper: PepperModel, task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
    import casadi

    values = casadi.Function.deserialize(task.source)(motion.q)
    slopes, (lower, upper) = casadi.jacobian(values, motion.q), casadi.vertsplit(target, values.numel())
    beyond = casadi.if_else(casadi.logic_or(values <= lower, values >= upper), 1.0, 0.0)
    rows = [beyond[k] * slopes[k, :] for k in range(values.numel())]
    return casadi.fmax(values - upper, 0.0) + casadi.fmin(values - lower, 0.0), casadi.vertcat(*rows)


def _selection(pepper: PepperModel, rows: list[int]) -> Any:
    import casadi

    return casadi.SX(casadi.sparsify(casadi.DM(np.eye(pepper.n)[rows])))


def _without_common(pepper: PepperModel, task: Structure, change: Any) -> Any:
    """Return a relative Jacobian with structural zeros for the joints that move neither side by itself."""
    import casadi

    kept: Array = joints_of_relative(pepper, task)
    columns = [change[:, k] if kept[k] else casadi.SX(change.shape[0], 1) for k in range(pepper.n)]
    return casadi.horzcat(*columns)


_RESIDUALS: dict[str, Callable[[PepperModel, Structure, Motion, Any], tuple[Any, Any]]] = {
    "FramePosition": _frame_position,
    "FrameInPlane": _frame_in_plane,
    "FrameOrientation": _frame_orientation,
    "AxisAlignment": _axis_alignment,
    "LookAt": _look_at,
    "LineThroughPoint": _line_through_point,
    "JointPosture": _joint_posture,
    "RelativePosition": _relative_position,
    "RelativeOrientation": _relative_orientation,
    "CenterOfMass": _center_of_mass,
    "CenterOfMassOverWheels": _center_of_mass_over_wheels,
    "BasePosition": _joint_posture,
    "BaseYaw": _base_yaw,
    "Expression": _expression,
}
