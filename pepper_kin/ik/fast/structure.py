"""Fixed and variable parts of tasks in compiled code."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks import (
    AxisAlignment,
    BasePosition,
    BaseYaw,
    CenterOfMass,
    CenterOfMassOverWheels,
    Expression,
    FrameInPlane,
    FrameOrientation,
    FramePosition,
    JointPosture,
    LineThroughPoint,
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
    "LineThroughPoint",
    "JointPosture",
    "RelativePosition",
    "RelativeOrientation",
    "CenterOfMass",
    "CenterOfMassOverWheels",
    "BasePosition",
    "BaseYaw",
    "Expression",
)
"""The tasks with machine code; everyday names such as `HandPosition` are among them."""


class Structure(NamedTuple):
    """The part of a task that code is compiled for.

    Attributes:
        kind: One of `KINDS`.
        frame: Name of the frame; empty where the task acts on joints.
        axis: Axis in the frame, or normal in the world, for tasks that have one.
        joints: Names of the joints, for a posture; empty for all.
        target_size: Numbers that describe the target.
        reference: Name of the frame that `frame` or the center of mass is seen from, or where a line begins;
            empty for the world.
        corners: Corners of the polygon of contacts, x and y in turn, for a task that has one.
        hard: Whether the task is hard.
        source: Of an expression, see `Expression.source`.
    """

    kind: str
    frame: str
    axis: tuple[float, ...]
    joints: tuple[str, ...]
    target_size: int
    reference: str = ""
    corners: tuple[float, ...] = ()
    hard: bool = False
    source: str = ""


def structure_of(task: Task) -> Structure:
    """Return the structure of a task; tasks alike share one.

    Raises:
        InvalidValueError: for a kind of task without machine code, naming those that have it.
    """
    read = _reader(type(task))
    if read is None or getattr(task, "loads", None):
        raise InvalidValueError("task", type(task).__name__, f"one with machine code: {', '.join(KINDS)}")
    return read(task)


def known_structures(tasks: Sequence[Task]) -> tuple[Structure, ...] | None:
    """Return the structure of each task; None where there is no machine code for one of them.

    There is none for the center of mass of a robot that carries something.
    """
    found = []
    for task in tasks:
        read = _reader(type(task))
        if read is None or getattr(task, "loads", None):
            return None
        found.append(read(task))
    return tuple(found)


def target_of(task: Task) -> Array:
    """Return the numbers that describe a task's target, flat."""
    target: Array = getattr(task, task.target_name)
    return target if target.ndim == 1 else target.ravel()


def structures_of(tasks: Sequence[Task]) -> tuple[Structure, ...]:
    """Return the structure of each task."""
    return tuple([structure_of(task) for task in tasks])


@lru_cache(maxsize=4096)
def _of_frame(
    kind: str, frame: str, hard: bool, target_size: int, axis: bytes = b"", reference: str = ""
) -> Structure:
    """Return the structure of a task on a frame; to make it again takes as long as some steps."""
    return Structure(kind, frame, tuple(np.frombuffer(axis).tolist()), (), target_size, reference, (), hard)


def _wheels(task: CenterOfMassOverWheels) -> Structure:
    corners = tuple(task.contacts.ravel().tolist())
    return Structure("CenterOfMassOverWheels", "", (), (), 1, task.base_frame, corners, task.hard)


def _posture(task: JointPosture) -> Structure:
    return Structure("JointPosture", "", (), task.joints or (), task.target.shape[-1], hard=task.hard)


def _expression(task: Expression) -> Structure:
    return Structure("Expression", "", (), task.joints, task.target.size, hard=task.hard, source=task.source)


_READERS: dict[type, Callable[[Any], Structure]] = {
    FramePosition: lambda task: _of_frame("FramePosition", task.frame, task.hard, 3),
    FrameInPlane: lambda task: _of_frame("FrameInPlane", task.frame, task.hard, 3, task.normal.tobytes()),
    FrameOrientation: lambda task: _of_frame("FrameOrientation", task.frame, task.hard, 9),
    AxisAlignment: lambda task: _of_frame("AxisAlignment", task.frame, task.hard, 3, task.axis.tobytes()),
    LookAt: lambda task: _of_frame("LookAt", task.frame, task.hard, 3, task.axis.tobytes()),
    LineThroughPoint: lambda task: _of_frame(
        "LineThroughPoint", task.frame, task.hard, 3, reference=task.start
    ),
    JointPosture: _posture,
    RelativePosition: lambda task: _of_frame(
        "RelativePosition", task.frame, task.hard, 3, reference=task.reference
    ),
    RelativeOrientation: lambda task: _of_frame(
        "RelativeOrientation", task.frame, task.hard, 9, reference=task.reference
    ),
    CenterOfMass: lambda task: Structure("CenterOfMass", "", (), (), 2, hard=task.hard),
    CenterOfMassOverWheels: _wheels,
    BasePosition: lambda task: Structure("BasePosition", "", (), task.joints, 2, hard=task.hard),
    Expression: _expression,
    BaseYaw: lambda task: Structure("BaseYaw", "", (), task.joints, 1, hard=task.hard),
}


@lru_cache(maxsize=256)
def _reader(kind: type) -> Callable[[Any], Structure] | None:
    """Return what reads the structure of a class of tasks; `isinstance` of an abstract class is slow.

    A class derived from one of the library's may have another residual than the compiled one.
    """
    own = (getattr(kind, name).__module__ for name in ("residual", "jacobian", "size"))
    if not all(module.startswith("pepper_kin.") for module in own):
        return None
    return next((read for known, read in _READERS.items() if issubclass(kind, known)), None)
