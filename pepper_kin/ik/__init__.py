"""Inverse kinematics: from tasks to the best configuration, with the reason of a failure.

    solve, IKResult, IKStatus                 one problem; TaskError and TorqueUse are parts of the result
    solve_batch, BatchResult                  many targets at once
    solutions                                 several configurations for one problem
    HandPose, HandPosition, LookAt, Point, PointAt            tasks of Pepper
    straight_pointing                         tasks of pointing with a stretched arm
    FramePose, FramePosition, FrameOrientation, FrameInPlane  tasks of any frame
    AxisAlignment, LineThroughPoint
    RelativePose, RelativePosition, RelativeOrientation       tasks of one frame relative to another
    JointPosture, JointValue, BasePlacement, BasePosition, BaseYaw
    CenterOfMass, CenterOfMassOverWheels, HoldingTorque
    Expression                                any CasADi expression of q
    Task, TaskGroup                           base classes of user-defined tasks

The differential-IK controller and the search for base placements are separate packages, `pepper_kin.servo`
and `pepper_kin.base_placement`.
"""

from pepper_kin.call_errors import name_options
from pepper_kin.ik.batch import BatchResult, solve_batch
from pepper_kin.ik.pointing import straight_pointing
from pepper_kin.ik.result import IKResult, IKStatus, TaskError, TorqueUse
from pepper_kin.ik.solutions import solutions
from pepper_kin.ik.solve import solve
from pepper_kin.ik.tasks.axis_alignment import AxisAlignment
from pepper_kin.ik.tasks.base_placement import BasePlacement, BasePosition, BaseYaw
from pepper_kin.ik.tasks.center_of_mass import CenterOfMass
from pepper_kin.ik.tasks.center_of_mass_over_wheels import CenterOfMassOverWheels
from pepper_kin.ik.tasks.expression import Expression
from pepper_kin.ik.tasks.frame_in_plane import FrameInPlane
from pepper_kin.ik.tasks.frame_orientation import FrameOrientation
from pepper_kin.ik.tasks.frame_pose import FramePose
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.hands import HandPose, HandPosition, Point, PointAt
from pepper_kin.ik.tasks.holding_torque import HoldingTorque
from pepper_kin.ik.tasks.joint_posture import JointPosture
from pepper_kin.ik.tasks.joint_value import JointValue
from pepper_kin.ik.tasks.line_through_point import LineThroughPoint
from pepper_kin.ik.tasks.look_at import LookAt
from pepper_kin.ik.tasks.relative_orientation import RelativeOrientation
from pepper_kin.ik.tasks.relative_pose import RelativePose
from pepper_kin.ik.tasks.relative_position import RelativePosition
from pepper_kin.ik.tasks.task import Task, TaskGroup

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
    "HoldingTorque",
    "IKResult",
    "IKStatus",
    "JointPosture",
    "JointValue",
    "LineThroughPoint",
    "LookAt",
    "Point",
    "PointAt",
    "RelativeOrientation",
    "RelativePose",
    "RelativePosition",
    "Task",
    "TaskError",
    "TaskGroup",
    "TorqueUse",
    "solutions",
    "solve",
    "solve_batch",
    "straight_pointing",
]

name_options(__name__)
