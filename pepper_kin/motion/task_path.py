"""IK tasks along a parameter: the length of a hand's route [m], or any other, such as time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeAlias

import numpy as np

from pepper_kin import ik
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.collision.loads import loads_of
from pepper_kin.exceptions import InvalidValueError, suspect_millimeters
from pepper_kin.ik.problem import flatten_tasks
from pepper_kin.ik.result import listed
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.task import Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.motion.curves import Route
from pepper_kin.motion.follow_result import FollowStatus

TasksAlong: TypeAlias = Callable[[Array], Task | TaskGroup | Iterable[Task | TaskGroup]]

_NODE_EVERY = 0.04  # minimum distance between first nodes on routes of several curves [m]
_LEAST_NODES = 16
_START_COUNT = 8
_LOOKS = 5  # number of places examined for lacking joints


class TaskPath:
    """Tasks along a parameter s, for joints that may move.

    Args:
        pepper: The robot.
        tasks: The tasks at values of the parameter, shape (K,), with K targets each, or one for all.
        over: The route whose length is the parameter, or the parameter's maximum; the parameter begins at 0.
        moving: Whether each joint may move, shape (n,).
        scene: The world; its attached objects count for the center of mass.

    Attributes:
        length: Maximum value of the parameter.
        corners: Values at which the motion has to stop, shape (m,).
        closed: Whether the path ends where it begins.
        is_route: Whether the parameter is the length of a route.
    """

    def __init__(
        self, pepper: PepperModel, tasks: TasksAlong, over: Route | float, moving: np.ndarray, scene: Scene
    ) -> None:
        self.pepper, self.moving, self.scene, self._tasks = pepper, moving, scene, tasks
        self._loads, self.is_route = loads_of(pepper, scene, None), isinstance(over, Route)
        if isinstance(over, Route):
            self.length, self.corners, self.closed = over.length, over.corners, over.closed
            self._cuts = np.append(over.begins, over.length)
        else:
            self.length, self.corners, self.closed = check_positive("over", over), np.zeros(0), False
            self._cuts = np.array([0.0, self.length])
        if self.length < 1e-9:
            raise InvalidValueError("over", f"{self.length} m", "a path longer than zero")
        moves = zip(pepper.joint_names, moving, strict=True)
        self.joints = None if moving.all() else [name for name, may in moves if may]

    def at(self, s: Array) -> list[Task]:
        """Return the tasks with a target for each value of the parameter, shape (K,), or one for all."""
        parts = flatten_tasks(self.pepper, self._tasks(s), batch=True)
        for task in parts:
            if task.count not in (None, len(s)):
                raise InvalidValueError(f"targets of {task.label}", task.count, f"{len(s)}, or one for all")
        return with_loads(parts, self._loads)

    def at_one(self, s: float) -> list[Task]:
        """Return the tasks at one value of the parameter."""
        return [task.at(0) for task in self.at(np.array([s]))]

    def nodes(self) -> Array:
        """Return the first nodes, shape (K,), including ends of curves, but not the end of a closed path."""
        step = self.length / _LEAST_NODES
        if self.is_route and len(self._cuts) > 2:
            step = max(step, _NODE_EVERY)
        parts = [
            np.linspace(begin, end, max(2, int(np.ceil((end - begin) / step - 1e-9))), endpoint=False)
            for begin, end in zip(self._cuts, self._cuts[1:], strict=False)
        ]
        return np.concatenate(parts if self.closed else [*parts, [self.length]])

    def words(self, s: float) -> str:
        """Return a place in words."""
        if self.is_route:
            return f"after {100 * (s % self.length or s):.1f} of {100 * self.length:.1f} cm"
        return f"at {s:.4g} of {self.length:.4g}"

    def starts(self) -> Array:
        """Return postures that meet the tasks at the beginning, shape (m, n)."""
        tasks = self.at_one(0.0)
        return ik.solutions(self.pepper, tasks, count=_START_COUNT, scene=self.scene, joints=self.joints)

    def lacking_joints(self, start: Array, reached: float) -> str:
        """Return a sentence on tasks that the movable joints cannot meet; empty if all joints may move.

        Args:
            start: Configuration with the positions of the other joints [rad or m], shape (n,).
            reached: Fraction of the path that was reached, 0 to 1; the rest is examined.
        """
        if self.joints is None:
            return ""
        for s in np.linspace(reached, 1.0, _LOOKS) * self.length:
            found = ik.solve(self.pepper, self.at_one(s), start=start, joints=self.joints, collisions=False)
            if not found.success:
                unmet = found.conflict or found.unmet
                help_of = f": {found.hint}" if found.hint else ", nor would all joints"
                return f"The joints that may move cannot meet {listed(unmet)} {self.words(s)}{help_of}."
        return "The joints that may move reach all of it, but not from this start: let more joints move."

    def unreachable(self, before: Array, tasks: Sequence[Task]) -> tuple[FollowStatus, str]:
        """Return status and reason why no posture near another one, shape (n,), meets given tasks."""
        pepper = self.pepper
        before = np.clip(before, pepper.lower_limits, pepper.upper_limits)
        far = ik.solve(pepper, tasks, start=before, joints=self.joints, collisions=False)
        if far.success:
            joint = int(np.argmax(np.abs(far.q - before)))
            change, unit = abs(far.q[joint] - before[joint]), pepper.joint_units[joint]
            return (
                FollowStatus.JUMP,
                f"no posture near the one before does it; in another one, {pepper.joint_names[joint]} is "
                f"{change:.2f} {unit} away.",
            )
        blocked = ", ".join(far.blocking_limits)
        said = "; ".join(error.shortfall for error in far.errors if not error.met)
        status = FollowStatus.BLOCKED_BY_LIMITS if blocked else FollowStatus.OUT_OF_REACH
        question = f" {suspect_millimeters(self.length)}".rstrip() if self.is_route else ""
        return status, said + (f", {blocked} at a limit." if blocked else ".") + question
