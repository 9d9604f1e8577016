"""Targets of a base placement: sets of tasks, one set for each configuration."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.problem import flatten_tasks
from pepper_kin.ik.tasks.joint_posture import JointPosture
from pepper_kin.ik.tasks.task import Task, TaskGroup
from pepper_kin.model import PepperModel

TaskSet: TypeAlias = tuple[Task, ...]
Given: TypeAlias = Task | TaskGroup | Iterable[Task | TaskGroup | Iterable[Task | TaskGroup]]


def task_sets(pepper: PepperModel, tasks: Given) -> tuple[TaskSet, ...]:
    """Return the sets of tasks with groups expanded, checked against the robot.

    Args:
        pepper: The robot.
        tasks: One task, a list of tasks that one configuration meets, or a list of lists of tasks. Tasks with
            N targets stand for N sets.

    Raises:
        InvalidValueError: for no task, anything but tasks, tasks mixed with lists of tasks, or different
            numbers of targets within a set.
        UnknownNameError: for a frame or joint that the robot lacks.
    """
    sets: list[TaskSet] = []
    for group in _groups(tasks):
        parts = tuple(_named(pepper, task) for task in flatten_tasks(pepper, group, batch=True))
        counts = {task.label: task.count for task in parts if task.count is not None}
        if not counts:
            sets.append(parts)
            continue
        if len(set(counts.values())) > 1 or 0 in counts.values():
            found = ", ".join(f"{label}: {count}" for label, count in counts.items())
            raise InvalidValueError("number of targets", found, "the same number N of 1 or more in a set")
        sets.extend(tuple(task.at(row) for task in parts) for row in range(next(iter(counts.values()))))
    return tuple(sets)


def _groups(tasks: Given) -> list[list[Task | TaskGroup]]:
    """Return the lists of tasks of each set, groups not expanded."""
    if isinstance(tasks, (Task, TaskGroup)):
        return [[tasks]]
    if not isinstance(tasks, Iterable) or isinstance(tasks, (str, bytes)):
        raise InvalidValueError("tasks", repr(tasks), "tasks such as HandPosition, or lists of them")
    items = list(tasks)
    single = [item for item in items if isinstance(item, (Task, TaskGroup))]
    if len(single) == len(items):
        return [single]
    if single:
        raise InvalidValueError("tasks", "tasks and lists mixed", "either tasks or lists of tasks")
    groups = []
    for item in items:
        if not isinstance(item, Iterable) or isinstance(item, (str, bytes)):
            raise InvalidValueError("tasks", repr(item), "tasks such as HandPosition, or lists of them")
        groups.append(list(item))
    return groups


def _named(pepper: PepperModel, task: Task) -> Task:
    """Return the task; a posture of all joints gets their names, since the moving robot has more joints."""
    if not isinstance(task, JointPosture) or task.joints is not None:
        return task
    return task.altered(joints=pepper.joint_names)
