"""qiBullet's classes of other robots and of ROS, which raise and say what to use instead."""

from __future__ import annotations

from typing import ClassVar

from pepper_kin.qibullet.errors import UnsimulatedError
from pepper_kin.qibullet.robot_virtual import RobotVirtual

ONLY_PEPPER = "this simulation is made for Pepper"
BY_THE_BRIDGE = "see pepper_kin's own bridge to ROS 2"


class NaoVirtual(RobotVirtual):
    """NAO, which is not simulated."""

    ID_CAMERA_TOP: ClassVar = 0
    ID_CAMERA_BOTTOM: ClassVar = 1
    FRAME_WORLD: ClassVar = 1
    FRAME_ROBOT: ClassVar = 2

    def __init__(self) -> None:
        raise UnsimulatedError("NAO", ONLY_PEPPER)


class RomeoVirtual(RobotVirtual):
    """Romeo, which is not simulated."""

    ID_CAMERA_RIGHT: ClassVar = 0
    ID_CAMERA_LEFT: ClassVar = 1
    ID_CAMERA_DEPTH: ClassVar = 2
    FRAME_WORLD: ClassVar = 1
    FRAME_ROBOT: ClassVar = 2

    def __init__(self) -> None:
        raise UnsimulatedError("Romeo", ONLY_PEPPER)


class PepperRosWrapper:
    """qiBullet's bridge to ROS 1 and 2 for Pepper, which is not offered."""

    def __init__(self) -> None:
        raise UnsimulatedError("PepperRosWrapper", BY_THE_BRIDGE)


class NaoRosWrapper:
    """qiBullet's bridge to ROS for NAO, which is not simulated."""

    def __init__(self) -> None:
        raise UnsimulatedError("NaoRosWrapper", ONLY_PEPPER)


class RomeoRosWrapper:
    """qiBullet's bridge to ROS for Romeo, which is not simulated."""

    def __init__(self) -> None:
        raise UnsimulatedError("RomeoRosWrapper", ONLY_PEPPER)
