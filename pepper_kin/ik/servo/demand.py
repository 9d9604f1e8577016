"""What a task or a twist asks of the joint velocities at one tick."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from pepper_kin.ik.servo.braking import stopping_speed
from pepper_kin.ik.servo.motion_limits import MotionLimits
from pepper_kin.ik.tasks.task import Array, Task
from pepper_kin.model import PepperModel

# Share of the acceleration limits that an approach plans its braking with: the rest is for corrections.
RESERVE = 0.7

# Damping of the joint speeds [m/rad]: where a direction moves less than this, the joints are spared.
DAMPING = 3e-3

# Below this slope a direction counts as lost, and a residual as vanished.
LOST = 1e-3
VANISHED = 1e-9


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
        dearness: d, how dear each joint's motion is, shape (n,).
    """

    gain: float
    singularity: float
    dt: float
    limits: MotionLimits
    dearness: Array


def task_demand(
    pepper: PepperModel,
    task: Task,
    q: Array,
    v: Array,
    drift: Array | None,
    pace: Pace,
    residual: Array | None = None,
) -> Demand:
    """Return what a task asks for: dr/dt = -s r, with a rate s that lets every joint brake in time.

    With dq the damped Gauss-Newton step to the target, every joint covers its part of it at the speed
    s |dq_i|.  s is the greatest rate up to the gain at which no joint exceeds its velocity limit or the speed
    from which it can stop within |dq_i|; singularities lower it further, see `_pull_and_share`.

    Args:
        pepper: The robot.
        task: The task.
        q: Joint positions [rad or m], shape (n,).
        v: The last velocity [rad/s or m/s], shape (n,).
        drift: How fast a moving target changes the residual by itself; None for a target that rests.
        pace: How fast to go.
        residual: The task's residual at q, where it is known.
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
    """Return the demand of a commanded rate (a twist), slowed down near singularities."""
    share = _rates(jacobian, rate, pace)[1]
    damping = curvature_damping(share * rate, jacobian @ v, weight, pace.dt)
    return Demand(jacobian, share * rate, weight, label, share, damping, 0.0)


def curvature_damping(rate: Array, motion: Array, weight: float, dt: float) -> float:
    """Return the damping that keeps a robot from trembling that is pulled in vain.

    Where a direction is lost, at a stretched arm or at an obstacle, its slope is about R x, with x how far a
    joint is from there and R a lever arm.  Pulled at a speed p without yielding, the joint obeys
    dx/dt = -R p x / lambda^2, which in steps of dt swings unless lambda^2 > R p dt / 2.  This is 2 p dt, for
    an R of a metre, with p the part of the wanted rate that the last velocity failed to deliver.

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
    limits = pace.limits
    pull, share = _pull_and_share(
        np.ascontiguousarray(jacobian), wanted, pace.dearness, limits.movable, limits.velocity,
        limits.acceleration, pace.dt, pace.gain, pace.singularity,
    )  # fmt: skip
    return float(pull), float(share)


@njit(cache=True, nogil=True, error_model="numpy")
def _pull_and_share(
    jacobian: Array, wanted: Array, dearness: Array, movable: np.ndarray, velocity: Array,
    acceleration: Array, dt: float, gain: float, singularity: float,
) -> tuple[float, float]:  # fmt: skip
    """Return the rate of approach, and the share of speed that singularities leave.

    With J D^-1 = U S V^T (D scales the joints; locked ones are left out) and e the unit vector of what is
    wanted, g = |S^-1 U^T e| is the joint speed that one unit of it costs.  The share is
    min(1, 1 / (g sigma)) with sigma the threshold: 1 where the direction is easy, falling to zero with the
    singular value of a direction that is being lost; the direction itself is kept.
    """
    size = math.sqrt(wanted @ wanted)
    if size < VANISHED:
        return gain, 1.0
    scaled = np.zeros_like(jacobian)
    for i in range(dearness.size):
        if movable[i]:
            scaled[:, i] = jacobian[:, i] / dearness[i]
    squares, directions = np.linalg.eigh(scaled @ scaled.T)
    along = directions.T @ wanted
    squares = np.maximum(squares, 0.0)
    step = scaled.T @ (directions @ (along / (squares + DAMPING**2)))
    pull = gain
    for i in range(dearness.size):
        if movable[i]:
            distance = max(abs(step[i]) / dearness[i], 1e-12)
            speed = min(stopping_speed(distance, RESERVE * acceleration[i], dt), velocity[i])
            pull = min(pull, speed / distance)
    # More directions than joints: those beyond are lost for good and say nothing about being near to it.
    first = max(0, wanted.size - movable.sum())
    cost = along[first:] / (size * np.maximum(np.sqrt(squares[first:]), LOST))
    effort = math.sqrt(cost @ cost) * singularity
    return pull, 1.0 if effort <= 1.0 else 1.0 / effort
