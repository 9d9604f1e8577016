"""What of a task is fixed in compiled code, and what may change from call to call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks import (
    AxisAlignment,
    BasePosition,
    BaseYaw,
    CenterOfMass,
    CenterOfMassOverWheels,
    FrameInPlane,
    FrameOrientation,
    FramePosition,
    JointPosture,
    LookAt,
    RelativeOrientation,
    RelativePosition,
    Task,
)
from pepper_kin.ik.tasks.task import Array

KINDS = (
    "FramePosition",
    "FrameInPlane",
    "FrameOrientation",
    "AxisAlignment",
    "LookAt",
    "JointPosture",
    "RelativePosition",
    "RelativeOrientation",
    "CenterOfMass",
    "CenterOfMassOverWheels",
    "BasePosition",
    "BaseYaw",
)
"""The tasks that the fast solver knows; everyday names such as `HandPosition` are among them."""


class Structure(NamedTuple):
    """The part of a task that code is compiled for.

    Attributes:
        kind: One of `KINDS`.
        frame: Name of the frame; empty where the task acts on joints.
        axis: Axis in the frame, or normal in the world, for tasks that have one.
        joints: Names of the joints, for a posture; empty for all.
        target_size: Numbers that describe the target.
        reference: Name of the frame that `frame` or the centre of mass is seen from; empty for the world.
        corners: Corners of the polygon of contacts, x and y in turn, for a task that has one.
        hard: Whether the task is hard.
    """

    kind: str
    frame: str
    axis: tuple[float, ...]
    joints: tuple[str, ...]
    target_size: int
    reference: str = ""
    corners: tuple[float, ...] = ()
    hard: bool = False


def structure_of(task: Task) -> Structure:
    """Return the structure of a task, worked out once per task and kept with it.

    Raises:
        InvalidValueError: for a kind of task that the fast solver lacks, naming those that it has.
    """
    found: Structure | None = task.__dict__.get("_fast_structure")
    if found is None:
        found = _structure(task)._replace(hard=task.hard)
        object.__setattr__(task, "_fast_structure", found)
    return found


def target_of(task: Task) -> Array:
    """Return the numbers that describe a task's target, flat."""
    kept: Array | None = task.__dict__.get("_fast_target")
    if kept is None:
        kept = np.ravel(task.direction if isinstance(task, AxisAlignment) else task.target)  # type: ignore[attr-defined]
        object.__setattr__(task, "_fast_target", kept)
    return kept


def structures_of(tasks: Sequence[Task]) -> tuple[Structure, ...]:
    """Return the structure of each task."""
    return tuple([structure_of(task) for task in tasks])


def _structure(task: Task) -> Structure:
    if isinstance(task, FramePosition):
        return Structure("FramePosition", task.frame, (), (), 3)
    if isinstance(task, FrameInPlane):
        return Structure("FrameInPlane", task.frame, tuple(task.normal.tolist()), (), 3)
    if isinstance(task, FrameOrientation):
        return Structure("FrameOrientation", task.frame, (), (), 9)
    if isinstance(task, AxisAlignment):
        return Structure("AxisAlignment", task.frame, tuple(task.axis.tolist()), (), 3)
    if isinstance(task, LookAt):
        return Structure("LookAt", task.frame, tuple(task.axis.tolist()), (), 3)
    if isinstance(task, JointPosture):
        return Structure("JointPosture", "", (), task.joints or (), task.target.shape[-1])
    if isinstance(task, RelativePosition):
        return Structure("RelativePosition", task.frame, (), (), 3, task.reference)
    if isinstance(task, RelativeOrientation):
        return Structure("RelativeOrientation", task.frame, (), (), 9, task.reference)
    if isinstance(task, CenterOfMass):
        return Structure("CenterOfMass", "", (), (), 2)
    if isinstance(task, CenterOfMassOverWheels):
        corners = tuple(task.contacts.ravel().tolist())
        return Structure("CenterOfMassOverWheels", "", (), (), 1, task.base_frame, corners)
    if isinstance(task, BasePosition):
        return Structure("BasePosition", "", (), task.joints, 2)
    if isinstance(task, BaseYaw):
        return Structure("BaseYaw", "", (), task.joints, 1)
    raise InvalidValueError(
        "solver",
        "'fast'",
        f"'placo' or 'proxsuite' for {type(task).__name__}; 'fast' knows {', '.join(KINDS)}",
    )
