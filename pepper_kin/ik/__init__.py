"""Inverse kinematics: tasks in, the best configuration and the reason out."""

from pepper_kin.ik.batch import BatchResult, solve_batch
from pepper_kin.ik.placement import PlacementResult, PlacementStatus, PlacementWeights, floor_map, place_base
from pepper_kin.ik.result import IKResult, Status, TaskError, TorqueUse
from pepper_kin.ik.servo import DifferentialStep, Servo, ServoState, ServoStatus, differential_step
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
    "DifferentialStep",
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
    "Servo",
    "ServoState",
    "ServoStatus",
    "Status",
    "Task",
    "TaskError",
    "TaskGroup",
    "TorqueUse",
    "differential_step",
    "floor_map",
    "place_base",
    "solve",
    "solve_batch",
]
