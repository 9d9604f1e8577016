"""Tasks of the inverse kinematics: what a configuration should fulfill."""

from pepper_kin.ik.tasks.axis_alignment import AxisAlignment
from pepper_kin.ik.tasks.base_placement import BasePlacement, BasePosition, BaseYaw
from pepper_kin.ik.tasks.center_of_mass import CenterOfMass
from pepper_kin.ik.tasks.center_of_mass_over_wheels import CenterOfMassOverWheels
from pepper_kin.ik.tasks.expression import Expression
from pepper_kin.ik.tasks.frame_in_plane import FrameInPlane
from pepper_kin.ik.tasks.frame_orientation import FrameOrientation
from pepper_kin.ik.tasks.frame_pose import FramePose
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.hands import HAND_FRAMES, HandPose, HandPosition, Point, PointAt
from pepper_kin.ik.tasks.joint_posture import JointPosture
from pepper_kin.ik.tasks.joint_value import JointValue
from pepper_kin.ik.tasks.line_through_point import LineThroughPoint
from pepper_kin.ik.tasks.look_at import LookAt
from pepper_kin.ik.tasks.relative_orientation import RelativeOrientation
from pepper_kin.ik.tasks.relative_pose import RelativePose
from pepper_kin.ik.tasks.relative_position import RelativePosition
from pepper_kin.ik.tasks.task import Task, TaskGroup

__all__ = [
    "HAND_FRAMES",
    "AxisAlignment",
    "BasePlacement",
    "BasePosition",
    "BaseYaw",
    "CenterOfMass",
    "CenterOfMassOverWheels",
    "Expression",
    "FrameInPlane",
    "FrameOrientation",
    "FramePose",
    "FramePosition",
    "HandPose",
    "HandPosition",
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
    "TaskGroup",
]
