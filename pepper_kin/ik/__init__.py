"""Inverse kinematics: tasks in, the best configuration and the reason out.

The differential-IK controller and the search for a place to stand are separate packages, `pepper_kin.servo`
and `pepper_kin.base_placement`; their names can be had here too, and are loaded when first asked for.
"""

import importlib
from typing import Any

from pepper_kin.ik.batch import BatchResult, solve_batch
from pepper_kin.ik.result import IKResult, Status, TaskError, TorqueUse
from pepper_kin.ik.solutions import solutions
from pepper_kin.ik.solve import solve
from pepper_kin.ik.tasks import (
    AxisAlignment,
    BasePlacement,
    BasePosition,
    BaseYaw,
    CenterOfMass,
    CenterOfMassOverWheels,
    Expression,
    FrameInPlane,
    FrameOrientation,
    FramePose,
    FramePosition,
    HandPose,
    HandPosition,
    JointPosture,
    JointValue,
    LineThroughPoint,
    LookAt,
    Point,
    PointAt,
    RelativeOrientation,
    RelativePose,
    RelativePosition,
    Task,
    TaskGroup,
)

__all__ = [
    "AxisAlignment",
    "BasePlacement",
    "BasePosition",
    "BaseYaw",
    "BatchResult",
    "CenterOfMass",
    "CenterOfMassOverWheels",
    "Expression",
    "FrameInPlane",
    "FrameOrientation",
    "FramePose",
    "FramePosition",
    "HandPose",
    "HandPosition",
    "IKResult",
    "JointPosture",
    "JointValue",
    "LineThroughPoint",
    "LookAt",
    "Point",
    "PointAt",
    "RelativeOrientation",
    "RelativePose",
    "RelativePosition",
    "Status",
    "Task",
    "TaskError",
    "TaskGroup",
    "TorqueUse",
    "solutions",
    "solve",
    "solve_batch",
]

_HOMES = {
    "DifferentialStep": "servo",
    "PlacementResult": "base_placement",
    "PlacementStatus": "base_placement",
    "PlacementWeights": "base_placement",
    "Servo": "servo",
    "ServoState": "servo",
    "ServoStatus": "servo",
    "differential_step": "servo",
    "placement_map": "base_placement",
    "place_base": "base_placement",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"pepper_kin.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
