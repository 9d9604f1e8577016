"""Joint velocities that a task or a twist demands at one tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.braking import JointLimits, approach_rate
from pepper_kin.ik.tasks.task import Task
from pepper_kin.model import PepperModel


class Demand(NamedTuple):
    """Wanted: J v = rate.

    Attributes:
        jacobian: J, shape (m, n).
        rate: The wanted rate of change [m/s or rad/s], shape (m,).
        weight: Weight in the sum of squares.
        label: What moves, in words.
        scale: Share of the wanted rate that singularities leave, 0 to 1.
        damping: What to add to lambda^2; see `curvature_damping`.
        error: The task's error [m or rad]; 0 for a twist.
    """

    jacobian: Array
    rate: Array
    weight: float
    label: str
    scale: float
    damping: float
    error: float


@dataclass(frozen=True, eq=False)
class Pace:
    """How tasks are turned into velocities.

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
    pepper: PepperModel,
    task: Task,
    q: Array,
    v: Array,
    drift: Array | None,
    pace: Pace,
    residual: Array | None = None,
) -> Demand:
    """Return the demand of a task: dr/dt = -s r, with a rate s that lets every joint brake in time.

    With dq the damped Gauss-Newton step to the target, every joint covers its part of it at the speed
    s |dq_i|.  s is the greatest rate up to the gain at which no joint exceeds its velocity limit or the speed
    from which it can stop within |dq_i|; singularities lower it further, see `core.braking.approach_rate`.

    Args:
        pepper: The robot.
        task: The task.
        q: Joint positions [rad or m], shape (n,).
        v: The last velocity [rad/s or m/s], shape (n,).
        drift: How fast a moving target changes the residual by itself [m/s or rad/s], shape (m,); None for a
            target that rests.
        pace: How fast to go.
        residual: The task's residual at q [m or rad], shape (m,), where it is known.
    """
    residual = task.residual(pepper, q) if residual is None else residual
    jacobian = task.jacobian(pepper, q)
    pull, share = _rates(jacobian, residual, pace)
    rate = -(pull * share) * residual
    wanted = rate if drift is None else rate - drift
    # A task on the joints themselves is linear and needs none.
    damping = 0.0 if task.frame is None else curvature_damping(wanted, jacobian @ v, task.weight, pace.dt)
    return Demand(jacobian, wanted, task.weight, task.label, share, damping, task.size(residual))


def rate_demand(jacobian: Array, rate: Array, v: Array, weight: float, label: str, pace: Pace) -> Demand:
    """Return the demand of a commanded rate (a twist), slowed down near singularities.

    Args:
        jacobian: J, shape (m, n).
        rate: The wanted rate [m/s or rad/s], shape (m,).
        v: The last velocity [rad/s or m/s], shape (n,).
        weight: Weight in the sum of squares.
        label: What moves, in words.
        pace: How fast to go.
    """
    share = _rates(jacobian, rate, pace)[1]
    damping = curvature_damping(share * rate, jacobian @ v, weight, pace.dt)
    return Demand(jacobian, share * rate, weight, label, share, damping, 0.0)


def curvature_damping(rate: Array, motion: Array, weight: float, dt: float) -> float:
    """Return the damping that keeps a robot from trembling that is pulled in vain.

    Where a direction is lost, at a stretched arm or at an obstacle, its slope is about R x, with x how far a
    joint is from there and R a lever arm.  Pulled at a speed p without yielding, the joint obeys
    dx/dt = -R p x / lambda^2, which in steps of dt swings unless lambda^2 > R p dt / 2.  This is 2 p dt, for
    an R of a meter, with p the part of the wanted rate that the last velocity failed to deliver.

    Args:
        rate: The wanted rate [m/s or rad/s], shape (m,).
        motion: J v of the last velocity, shape (m,).
        weight: The task's weight.
        dt: Length of a tick [s].
    """
    short = rate - motion
    missing = min(float(np.sqrt(short @ short)), float(np.sqrt(rate @ rate)))
    return weight**2 * 2.0 * missing * dt


def _rates(jacobian: Array, wanted: Array, pace: Pace) -> tuple[float, float]:
    """Return the rate of approach [1/s] and the share of speed that singularities leave.

    Args:
        jacobian: J, shape (m, n).
        wanted: The residual [m or rad] or the wanted rate [m/s or rad/s], shape (m,).
        pace: How fast to go.
    """
    return approach_rate(
        np.ascontiguousarray(jacobian), wanted, pace.joint_scale, pace.limits, pace.dt, pace.gain,
        pace.singularity,
    )  # fmt: skip
