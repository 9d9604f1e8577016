"""Forward kinematics: poses, velocities, accelerations and Jacobians of frames, and reach maps.

    frame_pose, frame_poses, link_poses       homogeneous transforms, shape (..., 4, 4)
    frame_velocity, frame_acceleration        linear first, then angular, shape (..., 6)
    frame_jacobian, frame_jacobian_rate       shape (..., 6, n)
    manipulability                            how well a frame can move in all directions
    named_axes, NamedAxis                     axes of palms, cameras and sensors, by name
    reach_map, ReachMap                       positions in space that a frame reaches

Functions of joint vectors take shape (..., n); frames are named as in `pepper.frame_names`.
"""

from pepper_kin.call_errors import name_options
from pepper_kin.kinematics.axes import NamedAxis, named_axes
from pepper_kin.kinematics.frames import frame_pose, frame_poses, link_poses
from pepper_kin.kinematics.jacobian import frame_jacobian, frame_jacobian_rate
from pepper_kin.kinematics.manipulability import manipulability
from pepper_kin.kinematics.reach_map import ReachMap, reach_map
from pepper_kin.kinematics.velocity import frame_acceleration, frame_velocity

__all__ = [
    "NamedAxis",
    "ReachMap",
    "frame_acceleration",
    "frame_jacobian",
    "frame_jacobian_rate",
    "frame_pose",
    "frame_poses",
    "frame_velocity",
    "link_poses",
    "manipulability",
    "named_axes",
    "reach_map",
]

name_options(__name__)
