"""Base class of robots in a simulation: joints, links, cameras and sensors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin import collision
from pepper_kin.exceptions import UnknownNameError, shortened
from pepper_kin.model import quaternion_from_rotation
from pepper_kin.qibullet.camera import Camera, CameraResolution
from pepper_kin.qibullet.errors import SimulationError, UnsimulatedError
from pepper_kin.qibullet.imu import Imu
from pepper_kin.qibullet.joint import Joint
from pepper_kin.qibullet.link import Link

if TYPE_CHECKING:
    from pepper_kin.naoqi.body import Body

NO_FEET = "the weight under the feet (FSR)"


class RobotVirtual:
    """A robot of a simulation; `PepperVirtual` is the only simulated one.

    Args:
        description_file: File of the robot's description.

    Attributes:
        robot_model: Number of the robot's model, once it is loaded.
        physics_client: Number of the simulation.
        camera_dict: Number of a camera -> camera.
        joint_dict: Name of a joint -> joint.
        link_dict: Name of a link -> link.
        imu: The inertial unit, or None.
    """

    def __init__(self, description_file: str) -> None:
        self.description_file = description_file
        self.physics_client = 0
        self.robot_model: int | None = None
        self.camera_dict: dict[int, Camera] = {}
        self.joint_dict: dict[str, Joint] = {}
        self.link_dict: dict[str, Link] = {}
        self.imu: Imu | None = None
        self._body: Body | None = None

    @property
    def body(self) -> Body:
        """The simulated body behind the robot.

        Raises:
            SimulationError: for a robot that was not loaded.
        """
        if self._body is None:
            raise SimulationError(f"{type(self).__name__}: not loaded into a simulation yet; see loadRobot")
        return self._body

    def loadRobot(self, translation: Any, quaternion: Any, physicsClientId: int = 0) -> None:
        """Raise, as only Pepper is simulated; see `PepperVirtual.loadRobot`.

        Raises:
            SimulationError: if the description file is missing.
            UnsimulatedError: for other robots.
        """
        if not Path(self.description_file).is_file():
            raise SimulationError(
                f"cannot load the robot: there is no file {shortened(self.description_file)!r}"
            )
        raise UnsimulatedError(f"the robot of {self.description_file}", "this simulation is made for Pepper")

    def end(self) -> None:
        """End the robot's simulation and its subscriptions."""
        for camera in self.camera_dict.values():
            camera.unsubscribe()
        if self.imu is not None:
            self.imu.unsubscribe()
        if self._body is not None:
            self._body.time.stop()

    def shown_points(self) -> NDArray[Any]:
        """Return the points that the browser page marks in the world [m], shape (k, 3)."""
        return np.empty((0, 3))

    def getRobotModel(self) -> int | None:
        """Return the number of the robot's model."""
        return self.robot_model

    def getPhysicsClientId(self) -> int:
        """Return the number of the simulation."""
        return self.physics_client

    def getJoint(self, joint_name: str) -> Joint:
        """Return a joint by name.

        Raises:
            UnknownNameError: for an unknown joint, a `KeyError`.
        """
        if joint_name not in self.joint_dict:
            raise UnknownNameError("joint", joint_name, self.joint_dict)
        return self.joint_dict[joint_name]

    def getLink(self, link_name: str) -> Link:
        """Return a link by name.

        Raises:
            UnknownNameError: for an unknown link, a `KeyError`.
        """
        if link_name not in self.link_dict:
            raise UnknownNameError("link", link_name, self.link_dict)
        return self.link_dict[link_name]

    def getLinkPosition(self, link_name: str) -> tuple[list[float], list[float]]:
        """Return position x, y, z [m] and quaternion x, y, z, w of a link in the world.

        Raises:
            UnknownNameError: for an unknown link, a `KeyError`.
        """
        link = self.getLink(link_name)
        with self.body.time.lock:
            pose = self.body.frame_pose(link.name, True)
        quaternion = quaternion_from_rotation(pose[:3, :3])
        return [float(value) for value in pose[:3, 3]], [float(value) for value in quaternion]

    def getPosition(self) -> tuple[float, float, float]:
        """Return x, y [m] and yaw [rad] of the base in the world."""
        with self.body.time.lock:
            x, y, theta = (float(value) for value in self.body.base_pose(True))
        return x, y, theta

    def isSelfColliding(self, link_names: str | list[str]) -> bool:
        """Return whether one of the links touches another part of the robot.

        Args:
            link_names: Name of a link, or a list of names.

        Raises:
            SimulationError: for an unknown link.
        """
        names = {link_names} if isinstance(link_names, str) else set(link_names)
        for name in sorted(map(str, names - set(self.link_dict))):
            raise SimulationError(str(UnknownNameError("link", name, self.link_dict)))
        with self.body.time.lock:
            q = self.body.configuration(True)
        touching = collision.contacts(self.body.pepper, q)
        return any(names & {*contact.names, *(contact.links or ())} for contact in touching)

    # Cameras.

    def subscribeCamera(
        self, camera_id: int, resolution: CameraResolution = Camera.K_QVGA, fps: float = 30.0
    ) -> int | None:
        """Subscribe to a camera; return a handle, or None for an unknown camera.

        Raises:
            SimulationError: for an invalid resolution, or an fps that is not above 0.
        """
        camera = self.camera_dict.get(camera_id)
        return None if camera is None else camera.subscribe(resolution, fps=fps)

    def unsubscribeCamera(self, handle: int) -> bool:
        """End a subscription to a camera; return whether there was one.

        The camera's number is accepted in place of a handle, as before version 1.4 of qiBullet.
        """
        camera = Camera._getCameraHandlesDict().get(handle, self.camera_dict.get(handle))
        return camera is not None and camera.unsubscribe()

    def getCamera(self, handle: int) -> Camera:
        """Return the camera with a handle.

        Raises:
            SimulationError: for an unknown handle.
        """
        cameras = Camera._getCameraHandlesDict()
        if handle not in cameras:
            raise SimulationError(
                f"handle: got {shortened(repr(handle))}, no camera is subscribed to with it"
            )
        return cameras[handle]

    def getCameraFrame(self, handle: int | None = None) -> NDArray[Any] | None:
        """Return the present image: blue, green, red, shape (h, w, 3), or distances [mm], shape (h, w).

        Without a handle, as before version 1.4 of qiBullet, the camera of the last subscription is used.

        Raises:
            SimulationError: for an unknown handle, or without a handle if there is no subscription.
        """
        if handle is None:
            own = [k for k, one in Camera._getCameraHandlesDict().items() if one in self.camera_dict.values()]
            handle = own[-1] if own else -1
        return self.getCamera(handle).getFrame()

    def getCameraResolution(self, handle: int) -> CameraResolution | None:
        """Return the resolution of a subscription.

        Raises:
            SimulationError: for an unknown handle.
        """
        return self.getCamera(handle).getResolution()

    def getCameraFps(self, handle: int) -> float | None:
        """Return the images a second of a subscription.

        Raises:
            SimulationError: for an unknown handle.
        """
        return self.getCamera(handle).getFps()

    def getCameraLink(self, handle: int) -> Link | None:
        """Return the link of a subscribed camera.

        Raises:
            SimulationError: for an unknown handle.
        """
        return self.getCamera(handle).getCameraLink()

    # The inertial unit.

    def subscribeImu(self, frequency: float | None = None) -> None:
        """Start reading the inertial unit, at a frequency [Hz] or its present one.

        Raises:
            SimulationError: for a robot without inertial unit, or a frequency that is not above 0.
        """
        imu = self._imu()
        if frequency is not None:
            imu.setFrequency(frequency)
        imu.subscribe()

    def unsubscribeImu(self) -> None:
        """Stop reading the inertial unit.

        Raises:
            SimulationError: for a robot without inertial unit.
        """
        self._imu().unsubscribe()

    def getImuGyroscopeValues(self) -> list[float]:
        """Return the angular velocity [rad/s] in world axes; zeros before a subscription.

        Raises:
            SimulationError: for a robot without inertial unit.
        """
        return self._imu().getGyroscopeValues()

    def getImuAccelerometerValues(self) -> list[float]:
        """Return the acceleration [m/s^2] in world axes, without gravity; zeros before a subscription.

        Raises:
            SimulationError: for a robot without inertial unit.
        """
        return self._imu().getAccelerometerValues()

    def getImuValues(self) -> tuple[list[float], list[float]]:
        """Return angular velocity [rad/s] and acceleration [m/s^2] in world axes.

        Raises:
            SimulationError: for a robot without inertial unit.
        """
        return self._imu().getValues()

    def getImu(self) -> Imu | None:
        """Return the inertial unit, or None."""
        return self.imu

    def _imu(self) -> Imu:
        if self.imu is None:
            raise SimulationError(f"{type(self).__name__}: the robot has no inertial unit")
        return self.imu

    # Sensors under NAO's feet.

    def getFsrHandler(self) -> None:
        """Return None: Pepper has no sensors under feet."""

    def getFsrValue(self, fsr_name: str) -> float:
        """Raise UnsimulatedError: Pepper has no sensors under feet.

        Raises:
            UnsimulatedError: always.
        """
        raise UnsimulatedError(NO_FEET, "Pepper has wheels")

    def getFsrValues(self, fsr_names: list[str]) -> list[float]:
        """Raise UnsimulatedError: Pepper has no sensors under feet.

        Raises:
            UnsimulatedError: always.
        """
        raise UnsimulatedError(NO_FEET, "Pepper has wheels")

    def getTotalFsrValues(self, fsr_names: list[str]) -> float:
        """Raise UnsimulatedError: Pepper has no sensors under feet.

        Raises:
            UnsimulatedError: always.
        """
        raise UnsimulatedError(NO_FEET, "Pepper has wheels")
