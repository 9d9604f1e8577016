"""Tasks along a whole path: a hand along curves at a given speed, with other tasks at the same time."""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin import ik
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.exceptions import CallError, InvalidValueError
from pepper_kin.ik.problem import movable_joints
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kernels.working_time import working_time
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_joint_vector,
    check_positive,
    check_whole,
    check_within_limits,
)
from pepper_kin.model.requirements import ROBOT
from pepper_kin.motion.curves import HandCurve, Route
from pepper_kin.motion.follow_result import Followed, FollowStatus, NotFollowedError
from pepper_kin.motion.problem import checked_margin
from pepper_kin.motion.task_path import TaskPath, TasksAlong
from pepper_kin.motion.whole_path import WholePath
from pepper_kin.trajectory.limits import motion_limits

_OF_LIMITS = ("velocity_scale", "acceleration_scale", "torque_scale", "torque", "balance", "payload")
_OTHERS = 3  # number of random sets of joint weights tried if equal weights fail
_FINAL = (FollowStatus.START_INVALID, FollowStatus.OUT_OF_REACH)
_OF_RETIME = (*_OF_LIMITS, "gridpoints")


def follow(
    pepper: PepperModel,
    start: ArrayLike | None,
    tasks: str | TasksAlong,
    over: HandCurve | Sequence[HandCurve] | Route | float,
    *,
    speed: float | None = None,
    ramps: bool = True,
    laps: int = 1,
    joints: str | Sequence[str] | None = None,
    scene: Scene | None = None,
    margin: float = 0.0,
    timeout: float = 2.0,
    **limits: Any,
) -> Followed:
    """Follow tasks along a whole path with minimum accelerations, at a given speed.

    Joint positions at all nodes of the path are one optimization problem, see
    `pepper_kin.motion.least_acceleration`: tasks are equations at every node, the accelerations of all joints
    are minimized, and nodes are added until the tasks are met between them.  The curve is proven to touch
    nothing, and timed by `retime`: from rest to rest, with ramps within the limits, and at `speed` between.
    The motion stops at corners.  Closed routes end in the posture in which they begin.  Joints that no task
    moves rest unless they have to avoid collisions; the message names those that move.

    Args:
        pepper: The robot.
        start: Initial joint positions [rad or m], shape (n,), which meet the tasks at the path's beginning;
            None: one of several such postures, from which the whole path is possible.
        tasks: "left" or "right" for the position of that hand along the curves, or a function of values of
            the parameter, shape (K,), that returns IK tasks with K targets each, or one for all, such as
            `lambda s: [HandPosition("left", route(s)), LookAt(route(s))]`.  Tasks with an infinite tolerance
            are preferences.  If not all other tasks can be met, the last one that is not hard is relaxed,
            then the one before it.
        over: Curves of the hand from its position at the start; or a `Route`, whose parameter is its length
            [m]; or the maximum value of a parameter that begins at 0.
        speed: Speed along the path [m/s], or rate of the parameter [1/s]; None: as fast as limits allow.
        ramps: Whether the motion begins and ends at rest.  If not, it begins and ends at `speed`; tasks that
            are functions of time [s] may need that, with a speed of 1.0.
        laps: Number of rounds on a closed route.
        joints: Joints that may move, by names of joints and groups; None for all.
        scene: The world around the robot, without moving obstacles; collisions of the robot with itself are
            always checked.
        margin: Distance to keep to the scene [m].
        timeout: Time after which no further starts and weights of the joints' accelerations are tried [s].
        limits: Options `velocity_scale`, `acceleration_scale`, `torque_scale`, `torque`, `balance`, `payload`
            and `gridpoints`, as `retime` takes them.

    Returns:
        The motion, or the reason.

    Raises:
        InvalidValueError: for NaN, no curve, tasks with a wrong number of targets, or options out of range.
        UnknownNameError: for an unknown hand, joint or group.
        LimitError: for a start outside the joint limits.
    """
    begin = working_time()
    unknown = sorted(set(limits) - set(_OF_RETIME))
    if unknown:
        known = [*inspect.signature(follow).parameters][:-1] + list(_OF_RETIME)
        raise CallError(f"follow() takes no argument {unknown[0]!r}", unknown[0], known)
    if not ramps and speed is None:
        raise InvalidValueError("speed", "None", "a number, without ramps")
    asked = None if speed is None else check_positive("speed", speed)
    allowed_time = check_positive("timeout", timeout, "s")
    moving = np.ones(pepper.n, bool) if joints is None else movable_joints(pepper, joints)
    world, q = checked_world(scene) or Scene(), None if start is None else _checked_start(pepper, start)
    if world.movers:
        raise InvalidValueError(
            "scene", f"{world.movers[0].name!r} moving", "obstacles that stand, as of scene.at(time)"
        )
    allowed = motion_limits(
        pepper, scene=world,
        **{"balance": ROBOT, "torque_scale": ROBOT, **{k: v for k, v in limits.items() if k in _OF_LIMITS}},
    )  # fmt: skip
    if isinstance(tasks, str):
        hand, route = tasks, over if isinstance(over, Route) else _route_of(pepper, tasks, q, over)
        path = TaskPath(pepper, lambda s: _hand_at(hand, route(s)), route, moving, world)
    elif isinstance(over, HandCurve | list | tuple):
        raise InvalidValueError("over", over, "Route.of(begin, curves), or a number, for a function of tasks")
    else:
        path = TaskPath(pepper, tasks, over, moving, world)  # type: ignore[arg-type]
    if check_whole("laps", laps, 1) > 1 and not path.closed:
        raise InvalidValueError("laps", laps, "1: the path does not end where it begins")
    whole = WholePath(path, checked_margin(margin), asked, allowed, limits)
    best: Followed | None = None
    for weights, posture in itertools.product(_weights(pepper.n), path.starts() if q is None else [q]):
        try:
            found = whole.followed(posture, weights, ramps=ramps, laps=laps, deadline=begin + allowed_time)
        except NotFollowedError as error:
            found = error.result
        if best is None or found.success or found.reached > best.reached:
            best = found
        if best.success or working_time() - begin > allowed_time:
            break
        if q is not None and found.status in _FINAL:
            break
    if best is None:
        status, reason = path.unreachable(pepper.neutral(), path.at_one(0.0))
        best = Followed(status, f"No posture begins the path: {reason}")
    if not best.success and best.status is not FollowStatus.IN_COLLISION:
        lacking = path.lacking_joints(pepper.neutral() if q is None else q, best.reached)
        best = replace(best, message=f"{best.message} {lacking}".rstrip())
    return replace(best, time=working_time() - begin)


def _weights(n: int) -> Iterator[Array]:
    """Yield weights of the joints, shape (n,): equal ones, then random ones with a fixed seed."""
    yield np.ones(n)
    drawn = np.random.default_rng(0)
    for _ in range(_OTHERS):
        yield np.exp(drawn.normal(0.0, 1.0, n))


def _checked_start(pepper: PepperModel, start: ArrayLike) -> Array:
    q = as_joint_vector(pepper, start, "start")
    check_within_limits(pepper, q, "start")
    return np.clip(q, pepper.lower_limits, pepper.upper_limits)


def _route_of(pepper: PepperModel, hand: str, start: Array | None, curves: Any) -> Route:
    """Return the route along curves from the hand's position at joint positions `start`."""
    frame = ik.HandPosition(hand, np.zeros(3)).frame or ""
    if start is None:
        raise InvalidValueError("start", "None", "joint positions, or a Route: curves begin at the hand")
    return Route.of(frame_pose(pepper, start, frame)[:3, 3], curves)


def _hand_at(hand: str, points: Array) -> list[Task]:
    return [ik.HandPosition(hand, points)]
