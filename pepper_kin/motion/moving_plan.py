"""Plans that begin in motion: straight to the goal, by joining a planned motion, or after a stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision.loads import loads_of
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, LimitError
from pepper_kin.kernels.working_time import working_time
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector
from pepper_kin.model.wheels import BASE_JOINTS
from pepper_kin.motion.goals import candidates_of, free_joints
from pepper_kin.motion.plan_request import CheckedRequest, PlanOptions, PlanRequest, are_tasks
from pepper_kin.motion.plan_result import Plan, PlanStatus, length_of
from pepper_kin.trajectory import Splice, Trajectory, retime
from pepper_kin.trajectory.splice import MovingStart
from pepper_kin.trajectory.stop import least_clearance

_LINE = 1.0  # duration of the straight motion along which a robot with a known velocity may stop [s]
_ROUNDING = 1e-9  # rounding tolerance, relative to a velocity limit

_WAYS = {
    "straight": "Straight on from motion to the goal.",
    "joined": "The planned way is joined in motion.",
    "after a stop": "The robot stops first: no way on in motion was found.",
}


def way_on(
    moving: MovingStart, goals: Array, search: Callable[[Array], Plan], **limits: Any
) -> tuple[Splice | None, Plan | None]:
    """Return the motion to a goal of a robot in motion, or None, and the plan if one was needed.

    First the straight motion with full accelerations is tried; then joining the motion along a plan from
    where the robot can stop, or from its current position if the stop is obstructed; then a straight motion
    with lower accelerations; then the plan after the stop.

    Args:
        moving: The robot in motion.
        goals: Goal configurations [rad or m], shape (m, n); m = 0 if planning has to find them.
        search: Function that returns a plan from a configuration, shape (n,).
        **limits: Options of `retime` for the planned motion.

    Raises:
        InfeasibleError: if the robot cannot stop, or the plan cannot be timed.
    """
    found = _straight(moving, goals, 1.0)
    if found is not None:
        return found, None
    way = search(moving.state[0] if moving.stopped is None else moving.stopped.end)
    if way.goal is not None:
        if not len(goals):
            found = _straight(moving, way.goal[None], 1.0)
        if found is None and way.curve is None:
            found = moving.after_stop(way.goal)
        elif found is None:
            found = moving.onto(retime(moving.pepper, way, **limits))
        goals = way.goal[None]
    if found is None or found.how == "after a stop":
        found = _straight(moving, goals) or found
    return found, way


def _straight(moving: MovingStart, goals: Array, *least: float) -> Splice | None:
    """Return the shortest straight motion in time to one of the goals, shape (m, n), or None."""
    ways = [way for goal in goals if (way := moving.straight(goal, [], *least)) is not None]
    return min(ways, key=lambda way: way.trajectory.duration, default=None)


def plan_in_motion(asked: PlanRequest, search: Callable[[PlanRequest], Plan]) -> Plan:
    """Plan a motion that begins with a velocity; see `plan`.

    The robot goes straight to the goal if that keeps half the margin, as curves of plans do; else it joins a
    planned motion, as `replan` does; else it stops first.  `Plan.splice` and the message tell which.  If
    nothing keeps half the margin, motions that keep the minimum margin are tried.

    Args:
        asked: The request with `start_velocity`, in a static scene.
        search: Function that plans without velocity.

    Raises:
        InvalidValueError: for options that cannot be combined with `start_velocity`, or that `plan` refuses.
        LimitError: for a start or goal outside the joint limits, or a velocity beyond its limit.
    """
    pepper, goal, options = asked.pepper, asked.goal, asked.options
    joints = options.joints
    for name in ("constraints", "costs", "smooth"):
        if getattr(options, name):
            raise InvalidValueError("start_velocity", f"given with {name}", f"a plan without {name}")
    if set(pepper.resolve_joints(joints)) & set(BASE_JOINTS):
        allowed = f"joints= without {', '.join(BASE_JOINTS)}"
        raise InvalidValueError("start_velocity", "given, while the base may move", allowed)
    request = asked.checked()
    velocity, line = _line(pepper, request.start, options)
    goals = np.empty((0, pepper.n)) if are_tasks(goal) else candidates_of(pepper, request.start, goal)
    free = np.union1d(free_joints(pepper, joints, request.start, goals), np.flatnonzero(velocity))
    ends = goals if len(goals) else request.start[None]
    kept, kept_self = request.checks.margins(request.start, ends, free, options.margin)
    names = ("torque_scale", "balance", "payload")
    limits: dict[str, Any] = {name: getattr(options, name) for name in names}
    least = options.least_margin
    plans: list[Plan] = []
    world = request.checks.exact.scene

    def planned(q: Array) -> Plan:
        if not plans:
            still = asked.with_options(start_velocity=None, timeout=request.left())
            plans.append(search(replace(still, start=q)))
        return plans[0]

    why = _no_room(pepper, request.start, velocity)
    if why:
        return request.ended(PlanStatus.START_TOO_FAST, why)
    why = "Something is in the way of a stop, or it is too heavy, and no other way on was found."
    for margins in ((max(kept / 2, least), kept_self / 2), (least, 0.0)):
        moving = MovingStart(pepper, line, 0.0, world, margins=margins, **limits)
        try:
            found, way = way_on(moving, goals, planned, **limits)
        except InfeasibleError as error:  # it cannot stop, or the way cannot be timed
            found, way, why = None, None, f"{error}."
        if found is not None:
            return _solved(request, found, way)
        if way is not None and not way.success:
            where = "" if moving.stopped is None else "From where the robot would stop: "
            return replace(way, message=where + way.message, time=_since(request))
    return request.ended(PlanStatus.START_TOO_FAST, why)


def _line(pepper: PepperModel, start: Array, options: PlanOptions) -> tuple[Array, Trajectory]:
    """Return the start's velocity, shape (n,), and a motion from the start with constant velocity."""
    assert options.start_velocity is not None
    velocity = np.array(as_joint_vector(pepper, options.start_velocity, "start_velocity"))
    most = pepper.velocity_limits
    over = np.abs(velocity) > most * (1 + _ROUNDING)
    if over.any():
        j = int(np.argmax(np.abs(velocity) / most))
        unit = f"{pepper.joint_units[j]}/s"
        raise LimitError("start_velocity", pepper.joint_names[j], velocity[j], -most[j], most[j], unit)
    if options.joints is not None:
        may = set(pepper.resolve_joints(options.joints))
        locked = [pepper.joint_names[j] for j in np.flatnonzero(velocity) if pepper.joint_names[j] not in may]
        if locked:
            raise InvalidValueError("start_velocity", f"one of {', '.join(locked)}", "0: they may not move")
    rows = np.stack([start, velocity])[None]
    return velocity, Trajectory(pepper.joint_names, np.array([0.0, _LINE]), rows, pepper.joint_units)


def _no_room(pepper: PepperModel, start: Array, velocity: Array) -> str:
    """Return a sentence on a joint that cannot stop within its position limits; empty if all can."""
    room = np.where(velocity > 0.0, pepper.upper_limits - start, start - pepper.lower_limits)
    needed = velocity**2 / (2.0 * pepper.acceleration_limits)
    j = int(np.argmax(needed - room))
    if needed[j] <= room[j] + _ROUNDING:
        return ""
    name, unit = pepper.joint_names[j], pepper.joint_units[j]
    return f"{name} takes {needed[j]:.3g} {unit} to stop, and is {room[j]:.3g} {unit} from its limit."


def _since(request: CheckedRequest) -> float:
    return working_time() - request.ended.begin


def _solved(request: CheckedRequest, found: Splice, way: Plan | None) -> Plan:
    """Return the plan with the motion found, based on the plan without velocity if there was one."""
    pepper, scene, motion = request.checks.pepper, request.checks.exact.scene, found.trajectory
    path = read_only(np.concatenate([motion(motion.breaks[:-1]).position, motion.end[None]]))
    base = request.ended(PlanStatus.SOLVED, "") if way is None else way
    message = f"{_WAYS[found.how]} {base.message}".rstrip()
    return replace(
        base, message=message, path=path, goal=path[-1], curve=None, length=length_of(path),
        loads=loads_of(pepper, scene), trajectory=motion, splice=found, time=_since(request),
        evidence=partial(least_clearance, pepper, motion, scene, 0.0), proof=None,
    )  # fmt: skip
