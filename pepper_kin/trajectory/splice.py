"""Splices: a motion that gets a new goal on its way, and does not stop for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.core.timing.steering import steer
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, check_within_limits
from pepper_kin.trajectory.limits import motion_limits
from pepper_kin.trajectory.samples import refuse_other_joints
from pepper_kin.trajectory.stop import (
    SHARES,
    checked_instant,
    exceeded_effects,
    joined_phases,
    least_clearance,
    limits_of,
)

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.trajectory.trajectory import Trajectory

_ROUNDING = 1e-12


@dataclass(frozen=True)
class Splice:
    """A motion with a new goal from an instant on.

    Attributes:
        trajectory: The motion until the instant, and from there to rest at the goal.
        time: The instant [s].
        share: Share of the acceleration limits that joints use, but for those that need more to stop
            within their position limits.
        clearance: Least distance between bodies at every millisecond of the new part [m]; None without
            a scene.
    """

    trajectory: Trajectory
    time: float
    share: float
    clearance: float | None = None


def replaced(
    pepper: PepperModel,
    trajectory: Trajectory,
    at: float,
    goal: ArrayLike,
    *,
    scene: Scene | None = None,
    torque: bool = True,
    balance: float | None = None,
) -> Splice:
    """Return a motion with a new goal from an instant on; see `Trajectory.replaced`."""
    refuse_other_joints(pepper, trajectory.joint_names)
    at = checked_instant(trajectory, at)
    goal = np.array(as_joint_vector(pepper, goal, "goal"))
    check_within_limits(pepper, goal, "goal", 1e-9)
    limits = limits_of(pepper, motion_limits(pepper, torque=torque, balance=balance, scene=scene))
    allowed = np.stack([limits.velocity, limits.acceleration])
    if not np.isfinite(allowed).all():
        raise InvalidValueError("limits", "none for some joint", "finite limits of velocity and acceleration")
    now, phases, reasons = trajectory(at), np.empty((pepper.n, 3, 4)), []
    state = np.stack([now.position, now.velocity])
    # A joint passes no position beyond its start, its goal and where it first stops.
    room = np.where(
        now.velocity > 0.0, pepper.upper_limits - now.position, now.position - pepper.lower_limits
    )
    needed = now.velocity**2 / (2 * limits.acceleration * np.maximum(room, 0.0) + _ROUNDING)
    if needed.max() > 1.0:
        name = pepper.joint_names[int(np.argmax(needed))]
        raise InfeasibleError("splice", f"{name} cannot stop within its limits", "splice earlier")
    for share in SHARES:
        allowed[1] = np.maximum(share, needed) * limits.acceleration
        if steer(state, goal, allowed, phases) <= _ROUNDING:
            raise InvalidValueError("goal", "the position where the robot rests", "another one")
        motion, clearance = joined_phases(trajectory, now.position, phases), None
        exceeded = exceeded_effects(pepper, motion, limits)
        if not exceeded and scene is not None:
            clearance = least_clearance(pepper, motion, scene)
            exceeded = () if clearance > 0.0 else ("clearance",)
        if not exceeded:
            whole = motion if at == 0.0 else trajectory.between(0.0, at).then(motion)
            return Splice(whole, at, share, clearance)
        reasons += [name for name in exceeded if name not in reasons]
    raise InfeasibleError(
        "splice", f"straight to the goal it would exceed {', '.join(reasons)}", "stop, and plan from there"
    )
