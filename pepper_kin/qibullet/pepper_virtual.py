"""Pepper in a simulation: the twin with qiBullet's methods."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import shortened
from pepper_kin.naoqi.body import Body
from pepper_kin.naoqi.joint_tasks import SpeedTask
from pepper_kin.qibullet.base_controller import PepperBaseController
from pepper_kin.qibullet.camera import CameraDepth, CameraRgb
from pepper_kin.qibullet.errors import SimulationError
from pepper_kin.qibullet.imu import Imu
from pepper_kin.qibullet.joint import Joint
from pepper_kin.qibullet.laser import Laser
from pepper_kin.qibullet.link import Link
from pepper_kin.qibullet.robot_posture import PepperPosture
from pepper_kin.qibullet.robot_virtual import RobotVirtual
from pepper_kin.qibullet.simulation import EARTH, finite, pose_on_floor, simulation_of

IMU_FREQUENCY = 100.0

NEAR_OBSTACLE = 0.01
"""Distance at which the base stops before an obstacle [m]; qiBullet's base would push it."""


class PepperVirtual(RobotVirtual):
    """Pepper: joints, base, cameras, lasers and inertial unit.

    `SimulationManager.spawnPepper` creates and loads one.  Fingers are driven by their hand: their readings
    follow from the hand's, and a command to fingers commands the hand with the mean of the fingers' targets.

    Attributes:
        laser_manager: The lasers.
        base_controller: The controller of the base.
        linear_velocity: Initial linear velocity of `moveTo` [m/s].
        angular_velocity: Initial angular velocity of `moveTo` [rad/s].
        linear_acceleration: Initial linear acceleration of the base [m/s^2].
        angular_acceleration: Initial angular acceleration of the base [rad/s^2].
    """

    ID_CAMERA_TOP: ClassVar = 0
    ID_CAMERA_BOTTOM: ClassVar = 1
    ID_CAMERA_DEPTH: ClassVar = 2
    FRAME_WORLD: ClassVar = 1
    FRAME_ROBOT: ClassVar = 2
    P_STAND: ClassVar = PepperPosture("Stand")
    P_STAND_INIT: ClassVar = PepperPosture("StandInit")
    P_STAND_ZERO: ClassVar = PepperPosture("StandZero")
    P_CROUCH: ClassVar = PepperPosture("Crouch")

    laser_manager: Laser
    base_controller: PepperBaseController

    def __init__(self) -> None:
        super().__init__("pepper.urdf")
        self.linear_velocity, self.angular_velocity = 0.35, 1.0
        self.linear_acceleration, self.angular_acceleration = 0.3, 0.3
        self._fingers: dict[str, tuple[str, float, float]] = {}

    def loadRobot(self, translation: Any, quaternion: Any, physicsClientId: int = 0) -> None:
        """Load the robot into a simulation, in the posture "StandZero".

        Args:
            translation: Position x, y, z of the base [m]; z must be 0.
            quaternion: Quaternion x, y, z, w of the base, about the vertical axis.
            physicsClientId: Number of the simulation.

        Raises:
            SimulationError: for an unknown simulation, or values that are not finite numbers.
            UnsimulatedError: for a robot above the floor or tilted.
        """
        simulation = simulation_of(physicsClientId)
        pose = np.array(pose_on_floor(translation, quaternion))
        body = Body(real_time=simulation.auto_step, scene=simulation.scene, posture="StandZero")
        body.place_base(pose)
        body.security_distance = {"orthogonal": NEAR_OBSTACLE, "tangential": 0.0}
        if simulation.gravity != list(EARTH):
            body.set_gravity(simulation.gravity)
        self._body, self.physics_client = body, physicsClientId
        self.robot_model = model = simulation.add(self)
        self._list_joints_and_links(body)
        self._add_sensors(model, physicsClientId)
        self.base_controller = PepperBaseController(
            model,
            (self.linear_velocity, self.angular_velocity),
            (self.linear_acceleration, self.angular_acceleration),
            physicsClientId=physicsClientId,
        )
        simulation.show(self)
        body.time.start()

    def shown_points(self) -> NDArray[np.float64]:
        """Return the points in the world that laser beams hit, while `showLaser` is on [m], shape (k, 3)."""
        return self.laser_manager.ends()

    def setAngles(self, joint_names: Any, joint_values: Any, percentage_speed: Any) -> None:
        """Move joints toward angles; return at once.  A later call for the same joints replaces this one.

        Args:
            joint_names: Name of a joint, or a list of names.
            joint_values: Angle [rad, for hands a fraction], or a list; clipped to the limits.
            percentage_speed: Fraction of the maximum speed, 0 to 1, or a list with one for each joint.

        Raises:
            SimulationError: for lists of different lengths, NaN, or a fraction outside 0 to 1.
            UnknownNameError: for an unknown joint, a `KeyError`.
        """
        names, values = _pairs(joint_names, joint_values)
        speeds = _shares(percentage_speed, len(names))
        joints = [self.getJoint(name) for name in names]
        wanted: dict[str, tuple[float, float]] = {}
        hands: dict[str, list[tuple[float, float]]] = {}
        for joint, value, speed in zip(joints, values, speeds, strict=True):
            if joint.name in self._fingers:
                hand, multiplier, offset = self._fingers[joint.name]
                hands.setdefault(hand, []).append(((value - offset) / multiplier, speed))
            else:
                wanted[joint.name] = (value, self._share(joint, speed))
        for hand, targets in hands.items():
            value, speed = np.mean(targets, axis=0)
            wanted[hand] = (float(value), self._share(self.joint_dict[hand], float(speed)))
        with self.body.time.lock:
            self._use_efforts(wanted)
            for share in dict.fromkeys(share for _, share in wanted.values()):
                targets_of_share = {name: value for name, (value, s) in wanted.items() if s == share}
                self.body.do(SpeedTask("setAngles", targets_of_share, share))

    def getAnglesPosition(self, joint_names: Any) -> Any:
        """Return a list of the joints' angles [rad, for hands fractions]; a number for a single joint.

        Raises:
            UnknownNameError: for an unknown joint, a `KeyError`.
        """
        return self._measured(joint_names, "position")

    def getAnglesVelocity(self, joint_names: Any) -> Any:
        """Return a list of the joints' velocities [rad/s, for hands 1/s]; a number for a single joint.

        Raises:
            UnknownNameError: for an unknown joint, a `KeyError`.
        """
        return self._measured(joint_names, "velocity")

    def goToPosture(self, posture_name: str, percentage_speed: float) -> bool:
        """Move toward a posture; return at once, False for an unknown posture.

        Args:
            posture_name: "Stand", "StandInit", "StandZero" or "Crouch", in any case.
            percentage_speed: Fraction of the maximum speed, 0 to 1.

        Raises:
            SimulationError: for a fraction outside 0 to 1.
        """
        for posture in (self.P_STAND, self.P_STAND_INIT, self.P_STAND_ZERO, self.P_CROUCH):
            if posture.isPostureName(posture_name):
                self.setAngles(
                    posture.getPostureJointNames(), posture.getPostureJointValues(), percentage_speed
                )
                return True
        return False

    def moveTo(
        self,
        x: float,
        y: float,
        theta: float,
        frame: int = FRAME_ROBOT,
        speed: float | None = None,
        _async: bool = False,
    ) -> None:
        """Move to a pose x, y [m], theta [rad].

        Args:
            x: Position along x [m].
            y: Position along y [m].
            theta: Yaw [rad].
            frame: FRAME_WORLD or FRAME_ROBOT.
            speed: Linear velocity from now on [m/s], clipped to 0.1 to 0.55.
            _async: Whether to return at once; a later asynchronous call changes the goal.

        Raises:
            SimulationError: for an unknown frame, values that are not finite numbers, or a synchronous call
                while an asynchronous one runs.
        """
        if speed is not None:
            self.base_controller.setLinearVelocity(speed)
        self.base_controller.moveTo(x, y, theta, frame, _async=_async)

    def move(self, x: float, y: float, theta: float) -> None:
        """Move with a velocity [m/s, m/s, rad/s], clipped to 0.55 m/s and 2 rad/s, until `stopMove`.

        Raises:
            SimulationError: for values that are not finite numbers.
        """
        self.base_controller.move(x, y, theta)

    def stopMove(self) -> None:
        """Brake; return at once."""
        self.base_controller.stopMove()

    def subscribeLaser(self) -> None:
        """Start scanning."""
        self.laser_manager.subscribe()

    def unsubscribeLaser(self) -> None:
        """Stop scanning."""
        self.laser_manager.unsubscribe()

    def showLaser(self, display: bool) -> None:
        """Set whether the browser page marks the ends of beams."""
        self.laser_manager.showLaser(display)

    def getFrontLaserValue(self) -> list[float]:
        """Return the 15 distances of the front laser [m], clockwise."""
        return self.laser_manager.getFrontLaserValue()

    def getRightLaserValue(self) -> list[float]:
        """Return the 15 distances of the right laser [m], clockwise."""
        return self.laser_manager.getRightLaserValue()

    def getLeftLaserValue(self) -> list[float]:
        """Return the 15 distances of the left laser [m], clockwise."""
        return self.laser_manager.getLeftLaserValue()

    def _list_joints_and_links(self, body: Body) -> None:
        """Fill `joint_dict` and `link_dict` from the robot's description."""
        pepper = body.pepper
        numbers: dict[str, int] = {}
        for entry in pepper.document.joints:
            if entry.name in ("BaseX", "BaseY", "BaseYaw"):
                continue  # joints of the planar base
            numbers[entry.child] = index = len(numbers)
            self.link_dict[entry.child] = Link(index, entry.child, numbers.get(entry.parent, -1))
            if entry.name in body.index:
                k = body.index[entry.name]
                limits = (
                    pepper.lower_limits,
                    pepper.upper_limits,
                    pepper.effort_limits,
                    pepper.velocity_limits,
                )
                self.joint_dict[entry.name] = Joint(index, entry.name, *(float(row[k]) for row in limits))
            elif entry.mimic is not None and entry.mimic[0] in body.index:
                hand, multiplier, offset = entry.mimic
                self._fingers[entry.name] = (hand, multiplier, offset)
                k = body.index[hand]
                fastest = abs(multiplier) * float(pepper.velocity_limits[k])
                self.joint_dict[entry.name] = Joint(
                    index, entry.name, entry.lower, entry.upper, entry.effort, fastest
                )
        root = pepper.document.joints[2].child  # the child link of BaseYaw
        self.link_dict[root] = Link(-1, root, -1)

    def _add_sensors(self, model: int, client: int) -> None:
        link = self.link_dict
        self.camera_dict = {
            self.ID_CAMERA_TOP: CameraRgb(
                model, self.ID_CAMERA_TOP, link["CameraTop_optical_frame"], 56.3, 43.7, client
            ),
            self.ID_CAMERA_BOTTOM: CameraRgb(
                model, self.ID_CAMERA_BOTTOM, link["CameraBottom_optical_frame"], 56.3, 43.7, client
            ),
            self.ID_CAMERA_DEPTH: CameraDepth(
                model, self.ID_CAMERA_DEPTH, link["CameraDepth_optical_frame"], 58.0, 45.0, client
            ),
        }
        self.imu = Imu(model, link["base_footprint"], IMU_FREQUENCY, client)
        self.laser_manager = Laser(model, link["Tibia"].getIndex(), physicsClientId=client)

    def _share(self, joint: Joint, speed: float) -> float:
        """Convert a fraction of the joint's `max_velocity` to a fraction of the model's maximum speed."""
        if joint.name not in self.body.index:
            return speed
        return min(1.0, speed * joint.max_velocity / self.body.velocity_limits[joint.name])

    def _use_efforts(self, names: Iterable[str]) -> None:
        """Set the motors' stiffness from `Joint.setMaxEffort`; the lock is held."""
        body, changed = self.body, {}
        for name in names:
            strength = self.joint_dict[name].max_effort / float(body.pepper.effort_limits[body.index[name]])
            stiffness = min(max(strength, 0.0), 1.0)
            if stiffness != body.stiffness[name]:
                changed[name] = stiffness
        if changed:
            body.set_stiffness(changed)

    def _measured(self, joint_names: Any, quantity: str) -> Any:
        """Return a quantity of the state of one joint, or a list for several."""
        names = [joint_names] if isinstance(joint_names, str) else list(joint_names)
        joints = [self.getJoint(name) for name in names]
        with self.body.time.lock:
            state = getattr(self.body.state, quantity)
            found = [self._value(joint.name, state, quantity) for joint in joints]
        return found[0] if len(found) == 1 else found

    def _value(self, name: str, state: np.ndarray, quantity: str) -> float:
        """Return a joint's value in a state, shape (n,); a finger's value is computed from its hand's."""
        if name in self._fingers:
            hand, multiplier, offset = self._fingers[name]
            shift = offset if quantity == "position" else 0.0
            return multiplier * float(state[self.body.index[hand]]) + shift
        return float(state[self.body.index[name]])


def _pairs(names: Any, values: Any) -> tuple[list[str], list[float]]:
    """Return a list of names and as many finite numbers.

    Raises:
        SimulationError: for anything else.
    """
    if isinstance(names, str):
        names, values = [names], [values]
    if isinstance(values, str | bytes) or not hasattr(values, "__len__") or not hasattr(names, "__len__"):
        got = shortened(repr(values))
        raise SimulationError(
            f"joint_values: got {got}, expected a number for each of {shortened(repr(names))}"
        )
    if len(names) != len(values):
        raise SimulationError(f"joint_values: got {len(values)} of them for {len(names)} joint_names")
    return list(names), [
        finite(value, f"joint value of {shortened(str(name))}", "rad")
        for name, value in zip(names, values, strict=True)
    ]


def _shares(speeds: Any, count: int) -> list[float]:
    """Return a fraction for each joint.

    Raises:
        SimulationError: for a wrong number of fractions, or fractions outside 0 to 1.
    """
    rows = list(speeds) if hasattr(speeds, "__len__") and not isinstance(speeds, str) else [speeds] * count
    if len(rows) != count:
        raise SimulationError(f"percentage_speed: got {len(rows)} of them for {count} joint_names")
    shares = [finite(speed, "percentage_speed", "1") for speed in rows]
    for share in shares:
        if not 0.0 <= share <= 1.0:
            raise SimulationError(f"percentage_speed: got {share:g}, expected a share from 0 to 1")
    return shares
