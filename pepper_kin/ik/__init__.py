"""Inverse kinematics: tasks in, the best configuration and the reason out."""

from pepper_kin.ik.batch import BatchResult, solve_batch
from pepper_kin.ik.placement import PlacementResult, PlacementStatus, PlacementWeights, floor_map, place_base
from pepper_kin.ik.result import IKResult, Status, TaskError, TorqueUse
from pepper_kin.ik.solve import solve
from pepper_kin.ik.tasks import (
    AxisAlignment,
    FrameOrientation,
    FramePose,
    FramePosition,
    HandPose,
    HandPosition,
    JointPosture,
    LookAt,
    Point,
    Task,
    TaskGroup,
)

__all__ = [
    "AxisAlignment",
    "BatchResult",
    "FrameOrientation",
    "FramePose",
    "FramePosition",
    "HandPose",
    "HandPosition",
    "IKResult",
    "JointPosture",
    "LookAt",
    "PlacementResult",
    "PlacementStatus",
    "PlacementWeights",
    "Point",
    "Status",
    "Task",
    "TaskError",
    "TaskGroup",
    "TorqueUse",
    "floor_map",
    "place_base",
    "solve",
    "solve_batch",
]
