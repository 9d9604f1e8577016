"""ALMotion: joints, effectors, base and settings."""

from __future__ import annotations

from pepper_kin.naoqi.motion_base import BaseMethods
from pepper_kin.naoqi.motion_cartesian import CartesianMethods
from pepper_kin.naoqi.motion_joints import JointMethods
from pepper_kin.naoqi.motion_settings import ConfigurationMethods
from pepper_kin.naoqi.motion_whole_body import WholeBodyMethods


class ALMotion(JointMethods, CartesianMethods, BaseMethods, ConfigurationMethods, WholeBodyMethods):
    """Motion of joints, effectors and the base; stiffness, tasks and protection."""

    name = "ALMotion"
