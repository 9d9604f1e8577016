"""Tasks of the inverse kinematics: what a configuration should fulfil."""

from pepper_kin.ik.tasks.axis_alignment import AxisAlignment
from pepper_kin.ik.tasks.frame_orientation import FrameOrientation
from pepper_kin.ik.tasks.frame_pose import FramePose
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.hands import HAND_FRAMES, HandPose, HandPosition, Point
from pepper_kin.ik.tasks.joint_posture import JointPosture
from pepper_kin.ik.tasks.look_at import LookAt
from pepper_kin.ik.tasks.task import Task, TaskGroup

__all__ = [
    "HAND_FRAMES",
    "AxisAlignment",
    "FrameOrientation",
    "FramePose",
    "FramePosition",
    "HandPose",
    "HandPosition",
    "JointPosture",
    "LookAt",
    "Point",
    "Task",
    "TaskGroup",
]
