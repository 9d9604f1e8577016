"""Demands on the joint velocities from a task or a twist at one tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from pepper_kin.arrays import Array
from pepper_kin.core.braking import JointLimits
from pepper_kin.ik.tasks.task import Task
from pepper_kin.model import PepperModel


class Demand(NamedTuple):
    """Demand J v = rate, or J v = -s r with a rate of approach s at which every joint can brake in time.

    Attributes:
        jacobian: J, shape (m, n).
        wanted: Residual r of a task [m or rad], or rate of a twist [m/s or rad/s], shape (m,).
        drift: Rate of the residual due to a moving target [m/s or rad/s], shape (m,); None for a resting one.
        weight: Weight in the sum of squares.
        label: Name of the task or hand in words.
        is_task: Whether it is a task.
        is_curved: Whether J changes as joints move.
        error: Error of the task [m or rad]; 0 for a twist.
    """

    jacobian: Array
    wanted: Array
    drift: Array | None
    weight: float
    label: str
    is_task: bool
    is_curved: bool
    error: float


@dataclass(frozen=True, eq=False)
class Pace:
    """Parameters that convert demands to velocities.

    Attributes:
        gain: Maximum ratio of an error that is removed per second [1/s].
        singularity: Singular value [m/rad] below which motion slows down.
        dt: Length of a tick [s].
        limits: Limits of the joints.
        joint_scale: d of `motion_scale`, greater for joints that carry more, shape (n,).
    """

    gain: float
    singularity: float
    dt: float
    limits: JointLimits
    joint_scale: Array


def task_demand(
    pepper: PepperModel, task: Task, q: Array, drift: Array | None, residual: Array | None = None
) -> Demand:
    """Return the demand of a task.

    Args:
        pepper: The robot.
        task: The task.
        q: Joint positions [rad or m], shape (n,).
        drift: Rate of the residual due to a moving target [m/s or rad/s], shape (m,); None for a resting one.
        residual: Residual of the task at q [m or rad], shape (m,), if it is known.
    """
    residual = task.residual(pepper, q) if residual is None else residual
    # A task on the joints themselves is linear.
    is_curved = task.frame is not None
    jacobian, error = task.jacobian(pepper, q), task.size(residual)
    return Demand(jacobian, residual, drift, task.weight, task.label, True, is_curved, error)
