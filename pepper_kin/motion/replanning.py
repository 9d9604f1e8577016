"""A new goal in motion, with a planned way around what stands between."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, check_within_limits
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.motion.moving_plan import way_on
from pepper_kin.motion.plan_result import Plan
from pepper_kin.motion.planning import plan
from pepper_kin.trajectory import Splice, Trajectory
from pepper_kin.trajectory.limits import JerkLike
from pepper_kin.trajectory.splice import MovingStart


def replan(
    pepper: PepperModel,
    trajectory: Trajectory,
    at: float,
    goal: ArrayLike,
    scene: Scene | None = None,
    *,
    torque: bool = True,
    torque_scale: TorqueScale = "robot",
    balance: Balance = "robot",
    margin: float = 0.01,
    seed: int = 0,
    timeout: float = 1.0,
    jerk: JerkLike | None = None,
) -> Splice:
    """Return a motion with a new goal from an instant on, by a planned way where others are not free.

    Straight, as `Trajectory.replaced` does, if that keeps all limits and touches nothing.  Else a path is
    planned from where the motion can stop, or, where something is in the way of that, from where it is; timed
    from rest to rest; and joined in motion, as by `Trajectory.replaced`.  Where no way onto it was found, a
    straight way is tried with lower accelerations; else the robot stops first, and `Splice.how` says so.

    Args:
        pepper: The robot, which gives the limits.
        trajectory: The motion.
        at: The instant [s].
        goal: Joint positions [rad or m], shape (n,).
        scene: The world around the robot, with what it holds; None for the robot alone.
        torque: Whether to keep within the effort limits.
        torque_scale: As in `retime`.
        balance: As in `retime` [m].
        margin: Distance that the planned path keeps to all things [m], as in `plan`.
        seed: Seed of the search.
        timeout: Time that the search may take [s].
        jerk: As in `retime`, for a motion that is to have continuous accelerations.

    Raises:
        InvalidValueError: as for `Trajectory.replaced` and `plan`.
        LimitError: for a goal outside the position limits.
        InfeasibleError: where no path was found, or none that the robot gets onto, saying why.
    """
    world = checked_world(scene)
    goal = np.array(as_joint_vector(pepper, goal, "goal"))
    check_within_limits(pepper, goal, "goal", 1e-9)
    reserve: dict[str, Any] = {"torque_scale": torque_scale, "balance": balance}
    limits = {"torque": torque, "jerk": jerk, **reserve}
    moving = MovingStart(pepper, trajectory, at, world, **limits)

    def search(begin: Array) -> Plan:
        return plan(pepper, begin, goal, world, margin=margin, seed=seed, timeout=timeout, **reserve)

    found, way = way_on(moving, goal[None], search, **limits)
    if found is None and way is not None and not way.success:
        raise InfeasibleError("splice", way.message, way.advice)
    if found is None:
        reason = "something is in the way of a stop, and no way past it was found"
        raise InfeasibleError("splice", reason, "an earlier instant, or stop(how='joints')")
    return found
