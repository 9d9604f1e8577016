"""qiBullet's API over the twin: `from pepper_kin.qibullet import SimulationManager, PepperVirtual`.

SimulationManager                         launches simulations, and spawns robots in them
PepperVirtual, RobotVirtual               a robot: joints, base, cameras, lasers, inertial unit
Joint, Link, PepperPosture                parts and postures of a robot
Camera, CameraRgb, CameraDepth, CameraResolution, Laser, Imu   sensors of a robot
PepperBaseController                      controller of the base
SimulationError, UnsimulatedError         errors of calls; a `pybullet.error` if pybullet is installed
NaoVirtual, RomeoVirtual, NaoFsr, PepperRosWrapper, NaoRosWrapper, RomeoRosWrapper   not simulated
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.qibullet.base_controller import PepperBaseController
    from pepper_kin.qibullet.camera import Camera, CameraDepth, CameraResolution, CameraRgb
    from pepper_kin.qibullet.errors import SimulationError, UnsimulatedError
    from pepper_kin.qibullet.fsr import NaoFsr
    from pepper_kin.qibullet.imu import Imu
    from pepper_kin.qibullet.joint import Joint
    from pepper_kin.qibullet.laser import Laser
    from pepper_kin.qibullet.link import Link
    from pepper_kin.qibullet.other_robots import (
        NaoRosWrapper,
        NaoVirtual,
        PepperRosWrapper,
        RomeoRosWrapper,
        RomeoVirtual,
    )
    from pepper_kin.qibullet.pepper_virtual import PepperVirtual
    from pepper_kin.qibullet.robot_posture import PepperPosture
    from pepper_kin.qibullet.robot_virtual import RobotVirtual
    from pepper_kin.qibullet.simulation_manager import SimulationManager

__all__ = [
    "Camera",
    "CameraDepth",
    "CameraResolution",
    "CameraRgb",
    "Imu",
    "Joint",
    "Laser",
    "Link",
    "NaoFsr",
    "NaoRosWrapper",
    "NaoVirtual",
    "PepperBaseController",
    "PepperPosture",
    "PepperRosWrapper",
    "PepperVirtual",
    "RobotVirtual",
    "RomeoRosWrapper",
    "RomeoVirtual",
    "SimulationError",
    "SimulationManager",
    "UnsimulatedError",
]

__getattr__, __dir__ = lazily(__name__)
