"""Joint velocities that a task or a twist demands at one tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from pepper_kin.arrays import Array
from pepper_kin.core.braking import JointLimits
from pepper_kin.ik.tasks.task import Task
from pepper_kin.model import PepperModel


class Demand(NamedTuple):
    """Wanted: J v = rate, or an approach J v = -s r with a rate s that lets every joint brake in time.

    Attributes:
        jacobian: J, shape (m, n).
        wanted: The residual r of a task [m or rad], or the rate of a twist [m/s or rad/s], shape (m,).
        drift: How fast a moving target changes the residual by itself [m/s or rad/s], shape (m,); None for
            one that rests.
        weight: Weight in the sum of squares.
        label: What moves, in words.
        is_task: Whether it is a task.
        is_curved: Whether J changes as joints move.
        error: The task's error [m or rad]; 0 for a twist.
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
    """How demands are turned into velocities.

    Attributes:
        gain: Greatest share of an error that is removed per second [1/s].
        singularity: Slope [m/rad] under which motion slows down.
        dt: Length of a tick [s].
        limits: Of the joints.
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
        drift: How fast a moving target changes the residual by itself [m/s or rad/s], shape (m,); None for a
            target that rests.
        residual: The task's residual at q [m or rad], shape (m,), where it is known.
    """
    residual = task.residual(pepper, q) if residual is None else residual
    # A task on the joints themselves is linear.
    is_curved = task.frame is not None
    jacobian, error = task.jacobian(pepper, q), task.size(residual)
    return Demand(jacobian, residual, drift, task.weight, task.label, True, is_curved, error)
