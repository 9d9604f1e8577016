"""Tasks of the environments by name."""

from __future__ import annotations

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.learning.balance_task import BalanceTask
from pepper_kin.learning.clear_task import ClearTask
from pepper_kin.learning.drive_task import DriveTask
from pepper_kin.learning.push_task import PushTask
from pepper_kin.learning.reach_task import CarryTask, FollowTask, ReachTask
from pepper_kin.learning.task import RobotTask

TASKS: dict[str, RobotTask] = {
    task.name: task
    for task in (
        ReachTask("Reach"),
        ReachTask("ReachBoth", hands=("left", "right")),
        ReachTask("GazeReach", gaze=True),
        ClearTask("ReachClear"),
        FollowTask("Follow"),
        CarryTask("Carry"),
        PushTask("Push"),
        BalanceTask("Balance"),
        DriveTask("Drive"),
    )
}
"""Tasks by name."""


def task_named(task: str | RobotTask) -> RobotTask:
    """Return a task, given by its name or as an object.

    Raises:
        UnknownNameError: for an unknown name, listing the tasks.
        InvalidValueError: for anything but a name or a task.
    """
    if isinstance(task, RobotTask):
        return task
    if not isinstance(task, str):
        raise InvalidValueError("task", repr(task), f"a RobotTask, or one of {', '.join(TASKS)}")
    if task not in TASKS:
        raise UnknownNameError("task", task, TASKS)
    return TASKS[task]
