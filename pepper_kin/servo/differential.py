"""Differential inverse kinematics as one plain function."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.collision import Scene
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.collision.loads import loads_of
from pepper_kin.core.braking import JointLimits, stopping_speed
from pepper_kin.exceptions import InvalidValueError, LimitError
from pepper_kin.ik.priorities import balanced
from pepper_kin.ik.problem import flatten_tasks, motion_scale
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.task import Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors, check_positive
from pepper_kin.servo.balance_table import balance_table
from pepper_kin.servo.clearance_guard import ClearanceGuard
from pepper_kin.servo.demand import Pace, task_demand
from pepper_kin.servo.motion_limits import motion_limits
from pepper_kin.servo.servo import GAIN, GAIN_PER_TICK, checked_configuration
from pepper_kin.servo.stepper import Stepper

# Violation of velocity bounds up to which it counts as rounding [rad/s or m/s].
SLACK = 1e-6


@dataclass(frozen=True, eq=False)
class DifferentialStep(FrozenArrays):
    """Result of `differential_step`.

    Attributes:
        v: Velocity for the next dt [rad/s or m/s], shape (n,), read-only.
        q: q + dt v [rad or m], shape (n,), read-only.
        scale: Factor by which singularities reduce the speed, of the task that is reduced most.
        limited_by: Constraints that are active at v, in words.
        relaxed: Constraints that were relaxed for braking, in words; joint limits never are.
        blocked: Whether v only brakes, because no other velocity is known to stop without collision.
    """

    v: Array
    q: Array
    scale: float
    limited_by: tuple[str, ...]
    relaxed: tuple[str, ...]
    blocked: bool


def differential_step(
    pepper: PepperModel,
    q: ArrayLike,
    v: ArrayLike,
    dt: float,
    tasks: Task | TaskGroup | Iterable[Task | TaskGroup],
    *,
    scene: Scene | None = None,
    collisions: bool = True,
    margin: float = 0.005,
    gain: float | None = None,
    locked: str | Iterable[str] = (),
    balance: float | None = None,
    singularity: float = 0.05,
    approach: float = 4.0,
) -> DifferentialStep:
    """Return the joint velocity that best moves towards the tasks during one tick, within every limit.

    With v' the next velocity, r and J residuals and Jacobians of the tasks, s their rate of approach,

        min  sum_i w_i^2 |J_i v' + s_i r_i|^2 + small terms
        |v'| <= v_max,  |v' - v| <= a_max dt,  and v' so low that every joint can brake before its limit
        dd/dt >= -approach (d - margin) for all nearby pairs;  balance.

    Braking at maximum deceleration always satisfies the first line of constraints; violated rows of the
    second are relaxed and named.  `Servo` does the same from tick to tick; use it for loops.

    Args:
        pepper: The robot.
        q: Joint positions within the limits [rad or m], shape (n,).
        v: Velocity of the last tick, from which q can still brake [rad/s or m/s], shape (n,).
        dt: Length of the tick [s].
        tasks: Tasks to move towards.
        scene: The world around the robot, which avoids self-collision in any case; None for none.
        collisions: Whether collisions are checked; False ignores them, and the result states it.
        margin: Distance kept [m].
        gain: Maximum ratio of an error removed per second [1/s]; None: 30, or less for a long dt.
        locked: Joints and groups that do not move.
        balance: Distance that the zero-moment point keeps inside the wheels' triangle [m], whose edges the
            center of mass approaches ever more slowly; None for no balance.
        singularity: Singular value below which motion slows down [m/rad].
        approach: Maximum ratio of the distance to an obstacle that is used up per second [1/s].

    Raises:
        InvalidValueError: for a wrong shape, NaN, infinity or a number that is not allowed.
        LimitError: for a q outside the limits, a v beyond them, or so fast that braking comes too late.
        UnknownNameError: for a frame, joint or group that the robot lacks.
    """
    state, last = checked_configuration(pepper, q, "q"), as_joint_vectors(pepper, v, "v")
    dt = check_positive("dt", dt, "[s]")
    if last.shape != state.shape:
        raise InvalidValueError("v", f"shape {last.shape}", f"shape ({pepper.n},)")
    gain = min(GAIN, GAIN_PER_TICK / dt) if gain is None else check_positive("gain", gain, "[1/s]")
    limits, joint_scale = motion_limits(pepper, locked), motion_scale(pepper, state)
    _check_can_brake(pepper, state, last, limits, dt)
    pace = Pace(min(gain, 1 / dt), check_positive("singularity", singularity, "[m]"), dt, limits, joint_scale)
    free, rate = check_positive("margin", margin, "[m]"), check_positive("approach", approach, "[1/s]")
    world = checked_world(scene, collisions)
    guard = None if world is None else ClearanceGuard(pepper, world, free, rate)
    kept, loads = (
        None if balance is None else float(as_finite(balance, "balance", ())),
        loads_of(pepper, world),
    )
    standing = None if kept is None else balance_table(pepper, kept, loads)
    parts = balanced(with_loads(flatten_tasks(pepper, tasks), loads))
    demands = [task_demand(pepper, task, state, None) for task in parts]
    tick = Stepper(pepper, pace, state, guard, standing).step(state, last, demands)
    return DifferentialStep(
        v=read_only(tick.v),
        q=read_only(state + dt * tick.v),
        scale=tick.scale,
        limited_by=tick.limited_by,
        relaxed=tick.relaxed,
        blocked=tick.blocked,
    )


def _check_can_brake(pepper: PepperModel, q: Array, v: Array, limits: JointLimits, dt: float) -> None:
    """Refuse a velocity beyond its limit, or from which even braking at once would leave the joint limits.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (n,).
        v: The velocity [rad/s or m/s], shape (n,).
        limits: Limits of the joints.
        dt: Length of a tick [s].
    """
    reach = limits.acceleration * dt
    high, low = limits.velocity.copy(), -limits.velocity
    for i, a in enumerate(limits.acceleration):
        high[i] = min(high[i], stopping_speed(max(limits.upper[i] - q[i], 0.0), a, dt) + reach[i])
        low[i] = max(low[i], -stopping_speed(max(q[i] - limits.lower[i], 0.0), a, dt) - reach[i])
    violation = np.maximum(v - high, low - v)
    if violation.max() > SLACK:
        worst = int(np.argmax(violation))
        unit = f"{pepper.joint_units[worst]}/s"
        raise LimitError(
            "v", pepper.joint_names[worst], v[worst], float(low[worst]), float(high[worst]), unit
        )
