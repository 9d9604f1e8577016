"""Sequences of commands of industrial robots: PTP, LIN, CIRC."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin import ik
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.collision.curve_checks import curve_checks_for
from pepper_kin.collision.curve_examination import is_clear_along
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, check_within_limits
from pepper_kin.motion.curves import HandCurve, Route
from pepper_kin.motion.follow_result import Followed, FollowStatus, words_for_aside
from pepper_kin.motion.following import follow
from pepper_kin.motion.validation import validate
from pepper_kin.trajectory import Trajectory, retime
from pepper_kin.trajectory.path import as_cubic_path


@dataclass(frozen=True, eq=False)
class PTP:
    """Straight motion of all joints to a goal at the same time ("point to point").

    Attributes:
        to: Goal positions [rad or m], shape (n,), or by name, with the other joints at rest; or IK tasks.
    """

    to: ArrayLike | Mapping[str, float] | Sequence[Task]


def sequence(
    pepper: PepperModel,
    start: ArrayLike,
    hand: str,
    moves: Sequence[PTP | HandCurve],
    *,
    speed: float | None = None,
    tasks: Callable[[Array], Iterable[Task]] | None = None,
    scene: Scene | None = None,
    margin: float = 0.0,
    timeout: float = 2.0,
    **limits: Any,
) -> Followed:
    """Execute a sequence of commands: `PTP` as fast as limits allow, curves of a hand by `follow`.

    The motion stops before and after each `PTP`, and at corners of curves that are not blended.

    Args:
        pepper: The robot.
        start: Initial joint positions [rad or m], shape (n,).
        hand: "left" or "right".
        moves: The commands.
        speed: Speed of the hand along curves [m/s]; None: as fast as limits allow.
        tasks: Further tasks along curves: a function of the hand's positions [m], shape (K, 3), such as
            `lambda points: [LookAt(points)]`.
        scene: The world around the robot, without moving obstacles.
        margin: Distance to keep to the scene along curves [m].
        timeout: Time after which `follow` tries no further starts and weights, for each run of curves [s].
        limits: Further options, as `follow` takes them.

    Returns:
        The motion, or the reason why one of the commands is not possible; `reached` is the fraction of
        completed commands.

    Raises:
        InvalidValueError: for no command, another type, or an argument that `follow` refuses.
        UnknownNameError: for an unknown hand, joint or group.
        LimitError: for a start or goal outside the joint limits.
    """
    begin, world = time.perf_counter(), checked_world(scene) or Scene()
    if world.movers:
        raise InvalidValueError(
            "scene", f"{world.movers[0].name!r} moving", "obstacles that stand, as of scene.at(time)"
        )
    if not moves or not all(isinstance(move, PTP | HandCurve) for move in moves):
        raise InvalidValueError("moves", repr(moves), "PTP, LIN, CIRC, Arc or SPLINE, one or more")
    q, parts, slowest, done = np.array(as_joint_vector(pepper, start, "start")), list[Trajectory](), 1.0, 0
    frame = ik.HandPosition(hand, np.zeros(3)).frame or ""
    errors, aside = dict[str, float](), dict[str, None]()
    for is_curve, group in groupby(moves, lambda move: isinstance(move, HandCurve)):
        commands: list[Any] = list(group)
        if is_curve:
            route = Route.of(frame_pose(pepper, q, frame)[:3, 3], commands)
            along = functools.partial(_tasks_on, hand, route, tasks)
            found = follow(
                pepper, q, along, route, speed=speed, scene=scene, margin=margin, timeout=timeout, **limits
            )
            if found.success:
                slowest, aside = min(slowest, found.slowest), aside | dict.fromkeys(found.aside)
                for name, error in zip(found.tasks, found.errors, strict=True):
                    errors[name] = max(errors.get(name, 0.0), float(error))
            runs = [found]
        else:
            runs, here = list[Followed](), q
            for command in commands:
                runs.append(_straight(pepper, here, command, world, limits))
                if runs[-1].trajectory is None:
                    break
                here = runs[-1].trajectory.end
        for run in runs:
            if run.trajectory is None:
                message = f"Command {done + 1} of {len(moves)}: {run.message}"
                return Followed(
                    run.status, message, reached=done / len(moves), time=time.perf_counter() - begin
                )
            parts.append(run.trajectory)
            q = run.trajectory.end
            done += len(commands) if is_curve else 1
    whole = functools.reduce(Trajectory.then, parts)
    return Followed(
        FollowStatus.DONE, f"{len(moves)} commands in {whole.duration:.2f} s.{words_for_aside(aside)}", whole,
        tasks=tuple(errors), errors=np.array(list(errors.values())), slowest=slowest, reached=1.0,
        time=time.perf_counter() - begin, aside=tuple(aside),
    )  # fmt: skip


def _tasks_on(
    hand: str, route: Route, more: Callable[[Array], Iterable[Task]] | None, s: Array
) -> list[Task]:
    """Return the tasks of a hand on a route at distances, shape (K,), and further ones."""
    points = route(s)
    return [ik.HandPosition(hand, points), *(() if more is None else more(points))]


def _straight(
    pepper: PepperModel, q: Array, command: PTP, world: Scene, limits: Mapping[str, Any]
) -> Followed:
    """Return the straight motion of all joints to a goal, from joint positions q [rad or m], shape (n,)."""
    goal = command.to
    if isinstance(goal, Mapping):
        goal = pepper.joint_vector(goal, rest=q)
    elif isinstance(goal, Sequence) and goal and all(isinstance(task, Task) for task in goal):
        found = ik.solve(pepper, goal, start=q, scene=world)  # type: ignore[arg-type]
        if not found.success:
            said = "; ".join(error.shortfall for error in found.errors if not error.met)
            return Followed(FollowStatus.OUT_OF_REACH, f"{said}.")
        goal = found.q
    end = as_joint_vector(pepper, goal, "goal of PTP")  # type: ignore[arg-type]
    check_within_limits(pepper, end, "goal of PTP")
    ends = np.stack([q, np.clip(end, pepper.lower_limits, pepper.upper_limits)])
    try:
        motion = retime(pepper, ends, scene=world, **limits)
    except InfeasibleError as error:
        return Followed(FollowStatus.NOT_HELD, f"{error.reason}.")
    if not is_clear_along(curve_checks_for(pepper, world), as_cubic_path(pepper, ends), held=False):
        return Followed(FollowStatus.IN_COLLISION, validate(pepper, motion, world).message)
    return Followed(FollowStatus.DONE, "", motion, reached=1.0)
