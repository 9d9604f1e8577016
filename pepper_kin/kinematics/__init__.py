"""Forward kinematics: poses and Jacobians of frames."""

from pepper_kin.kinematics.frames import frame_pose, frame_poses, link_poses
from pepper_kin.kinematics.jacobian import frame_jacobian

__all__ = ["frame_jacobian", "frame_pose", "frame_poses", "link_poses"]
