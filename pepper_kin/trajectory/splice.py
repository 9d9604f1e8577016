"""Splices: a motion that gets a new goal on its way, and does not stop for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin import collision
from pepper_kin.arrays import Array
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.collision.curve_checks import curve_checks_for
from pepper_kin.collision.curve_examination import is_clear_along
from pepper_kin.core.timing.steering import steer
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, check_within_limits
from pepper_kin.trajectory.limits import Limits, motion_limits
from pepper_kin.trajectory.samples import refuse_other_joints
from pepper_kin.trajectory.sampling import EXAMINED_EVERY, TIME_TOLERANCE, sample_times
from pepper_kin.trajectory.stop import (
    SHARES,
    checked_instant,
    exceeded_effects,
    joined_phases,
    limits_of,
    stop,
)

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.trajectory.trajectory import Trajectory

_ROUNDING = 1e-12
_AT_GOAL = 1e-9  # [rad or m]


@dataclass(frozen=True)
class Splice:
    """A motion with a new goal from an instant on.

    Attributes:
        trajectory: The motion until the instant, and from there to rest at the goal.
        how: "straight"; or "after a stop" along the motion, where joints have to rest before they go there.
        time: The instant [s].
        share: Share of the acceleration limits that joints use, but for those that need more to stop
            within their position limits.
    """

    trajectory: Trajectory
    how: str
    time: float
    share: float


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
    if not np.isfinite([limits.velocity, limits.acceleration]).all():
        raise InvalidValueError("limits", "none for some joint", "finite limits of velocity and acceleration")
    before, now = None if at <= TIME_TOLERANCE else trajectory.between(0.0, at), trajectory(at)
    found = _steered(pepper, trajectory, np.stack([now.position, now.velocity]), goal, limits, scene)
    if isinstance(found, Splice):
        whole = found.trajectory if before is None else before.then(found.trajectory)
        return replace(found, trajectory=whole, time=at)
    stopped = stop(pepper, trajectory, at, torque=torque, balance=balance)
    if scene is None or not _touches(pepper, stopped.trajectory, scene):
        whole = stopped.trajectory if before is None else before.then(stopped.trajectory)
        if np.abs(stopped.end - goal).max() <= _AT_GOAL:
            return Splice(whole, "after a stop", at, 1.0)
        rest = np.stack([stopped.end, np.zeros(pepper.n)])
        after = _steered(pepper, trajectory, rest, goal, limits, scene)
        if isinstance(after, Splice):
            return Splice(whole.then(after.trajectory), "after a stop", at, after.share)
    reason = f"straight to the goal it would exceed {', '.join(found)}, and after a stop too"
    raise InfeasibleError("splice", reason, "stop, and plan from there")


def _steered(
    pepper: PepperModel,
    like: Trajectory,
    state: Array,
    goal: Array,
    limits: Limits,
    scene: Scene | None,
) -> Splice | tuple[str, ...]:
    """Return the straight way from position and velocity, shape (2, n), to rest, or what it would exceed."""
    phases, reasons = np.empty((pepper.n, 3, 4)), []
    position, velocity = state
    # A joint passes no position beyond its start, its goal and where it first stops.
    room = np.where(velocity > 0.0, pepper.upper_limits - position, position - pepper.lower_limits)
    needed = velocity**2 / (2 * limits.acceleration * np.maximum(room, 0.0) + _ROUNDING)
    if needed.max() > 1.0:
        return ("position",)
    for share in SHARES:
        allowed = np.stack([limits.velocity, np.maximum(share, needed) * limits.acceleration])
        if steer(state, goal, allowed, phases) <= _ROUNDING:
            raise InvalidValueError("goal", "the position where the robot rests", "another one")
        motion = joined_phases(like, position, phases)
        exceeded = exceeded_effects(pepper, motion, limits)
        if not exceeded and scene is not None:
            checks = curve_checks_for(pepper, checked_world(scene))
            exceeded = () if is_clear_along(checks, motion, held=False) else ("clearance",)
        if not exceeded:
            return Splice(motion, "straight", 0.0, share)
        reasons += [name for name in exceeded if name not in reasons]
    return tuple(reasons)


def _touches(pepper: PepperModel, motion: Trajectory, scene: Scene) -> bool:
    """Return whether anything touches at a millisecond of a motion of any degree."""
    states = motion(sample_times(motion.duration, EXAMINED_EVERY)).position
    return bool(collision.in_collision(pepper, states, checked_world(scene)).any())
