"""The node: topics, services and actions of a simulated Pepper, over any transport."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError, MissingDependencyError, UnknownNameError
from pepper_kin.naoqi.body import Body
from pepper_kin.naoqi.joint_names import ACTUATED
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.naoqi.tasks import BodyTask
from pepper_kin.ros.commands import Commands
from pepper_kin.ros.controllers import CONTROLLERS, TRAJECTORY, Controller
from pepper_kin.ros.driver_services import DriverServices
from pepper_kin.ros.errors import NotCarriedError
from pepper_kin.ros.following import BrakeTask, ControllerTask
from pepper_kin.ros.kinematics_services import KinematicsServices
from pepper_kin.ros.live_goals import LiveBrake, LiveDrive
from pepper_kin.ros.message_parts import time_message
from pepper_kin.ros.pictures import CameraPictures
from pepper_kin.ros.planning import PlanningService
from pepper_kin.ros.planning_scene import PlanningScene
from pepper_kin.ros.qos import LATCHED, RELIABLE, TRANSFORMS, QoS
from pepper_kin.ros.sensor_messages import CAMERAS, SensorMessages
from pepper_kin.ros.state_messages import StateMessages
from pepper_kin.ros.transport import ActionServer, Closable, NoPublisher, Publisher, Transport
from pepper_kin.ros_messages import message_type

logger = logging.getLogger(__name__)

COMMAND_TIMEOUT = 0.5
"""Default time for which a velocity command holds [s]."""

SENSOR_RATE, ODOMETRY_RATE, STATE_RATE, DIAGNOSTICS_RATE = 10.0, 15.0, 50.0, 1.0
"""Publishing rates [Hz]."""


class RobotNode(Closable):
    """ROS 2 node of a simulated Pepper, with names, frames and rates of naoqi_driver2 and ros2_control.

    Args:
        body: The simulated body; its clock drives the node.
        transport: Open transport of the messages, which stays open when the node closes.
        cameras: Cameras of "front", "bottom" and "depth" to render while they have subscriptions.
        resolution: Resolution of the cameras: "VGA", "QVGA" or "QQVGA".
        robot: Name of the robot in the topics of the paper's simulation.
        noise: Whether sensor readings have noise.
        command_timeout: Time for which a velocity command holds [s].
        stamped: Whether `/cmd_vel` is a TwistStamped (Nav2's default) instead of naoqi_driver2's Twist,
            over rclpy and Cyclone DDS; other transports take both.
        live: Fraction of the velocity and acceleration limits of a live motion that moves to the ends of
            trajectories, clear of moving objects; None to follow trajectories instead.

    Attributes:
        topics: Name -> type of each published topic.
        live: The live motion of the joints; None if trajectories are followed.
        epoch: Time of the clock at the body's start [s]: seconds since 1970 in real time, otherwise 0.

    Raises:
        UnknownNameError: for an unknown camera.
        InvalidValueError: for a command_timeout that is not above 0, or `live` outside (0, 1].
        TransportError: if the transport cannot carry a topic of the node.
    """

    def __init__(
        self,
        body: Body,
        transport: Transport,
        *,
        cameras: Iterable[str] = tuple(CAMERAS),
        resolution: str = "QVGA",
        robot: str = "pepper_robot",
        noise: bool = True,
        command_timeout: float = COMMAND_TIMEOUT,
        stamped: bool = False,
        live: float | None = None,
    ) -> None:
        if not 0.0 < command_timeout < float("inf"):
            raise InvalidValueError("command_timeout", command_timeout, "a time above 0 s")
        for camera in (names := tuple(cameras)):
            if camera not in CAMERAS:
                raise UnknownNameError("camera", camera, CAMERAS)
        self.body, self.transport, self.robot = body, transport, robot
        self.live = None if live is None else LiveDrive(body, live)
        self.epoch = time.time() - body.time.now if body.time.real_time else 0.0
        self.topics: dict[str, str] = {}
        self._open: list[Closable] = []
        self._sent: dict[float, int] = {}
        self._states = StateMessages(body)
        self._sensors = SensorMessages(body, noise=noise)
        with body.time.lock:
            self._sensors.read()
        try:
            self._advertise_all()
            self.controllers = {name: Controller(self, name, joints) for name, joints in CONTROLLERS.items()}
            whole = self.controllers["joint_trajectory_controller"]
            self.listen(f"/{robot}/joint_trajectory", TRAJECTORY, whole.on_trajectory)
            self.commands = Commands(self, command_timeout, robot, stamped)
            self.planning, self.kinematics = PlanningService(self), KinematicsServices(self)
            self.driver, self.planning_scene = DriverServices(self), PlanningScene(self)
            self._pictures = CameraPictures(self, names, resolution)
        except BaseException:
            self.close()
            raise
        body.listeners.append(self._on_cycle)

    @property
    def now(self) -> float:
        """Time of the clock for stamps [s]."""
        return self.epoch + self.body.time.now

    @property
    def odometry(self) -> Array:
        """Pose of the base from wheel odometry: x, y [m], yaw [rad], shape (3,)."""
        return self._sensors.odometry

    def close(self) -> None:
        """Close topics, services and actions, and end all motion tasks; the body keeps running."""
        if self._on_cycle in self.body.listeners:
            self.body.listeners.remove(self._on_cycle)
            self._pictures.close()
        with self.body.time.lock:
            self.kill(list(self.body.tasks))
        for entry in reversed(self._open):
            entry.close()
        self._open.clear()

    # For the parts of the node.

    def advertise(self, topic: str, type_name: str, qos: QoS = RELIABLE) -> Publisher:
        """Return a publisher that is closed with the node."""
        try:
            publisher = self.transport.advertise(topic, type_name, qos)
        except MissingDependencyError as error:
            logger.warning("no topic %s: %s", topic, error)
            return NoPublisher()
        self.topics[topic] = type_name
        self._open.append(publisher)
        return publisher

    def listen(
        self, topic: str, type_name: str, callback: Callable[[Any], None], qos: QoS = RELIABLE
    ) -> None:
        """Subscribe until the node is closed; log a warning if the type is not installed."""
        try:
            self._open.append(self.transport.subscribe(topic, type_name, qos, callback))
        except MissingDependencyError as error:
            logger.warning("no topic %s: %s", topic, error)

    def offer_action(self, name: str, type_name: str, server: ActionServer) -> None:
        """Offer an action until the node is closed; a transport without actions is only logged."""
        try:
            self._open.append(self.transport.offer_action(name, type_name, server))
        except NotCarriedError as error:
            logger.info("no action: %s", error)
        except MissingDependencyError as error:
            logger.warning("no action %s: %s", name, error)

    def offer_service(self, name: str, type_name: str, callback: Callable[[Any], Any]) -> None:
        """Offer a service until the node is closed; a transport without services is only logged."""
        try:
            self._open.append(self.transport.offer_service(name, type_name, callback))
        except NotCarriedError as error:
            logger.info("no service: %s", error)
        except MissingDependencyError as error:
            logger.warning("no service %s: %s", name, error)

    def kill(self, tasks: Sequence[BodyTask]) -> None:
        """End tasks now; joints brake.  Called with the body's lock held."""
        self.body.tasks.kill(tasks, self.body)

    def replace(self, resources: Sequence[str]) -> None:
        """End tasks of joints, for a task that takes over at their speed; called with the lock held."""
        for task in self.body.tasks.using(resources):
            if isinstance(task, ControllerTask):
                task.replaced = True
                rest = sorted(task.resources.difference(resources))
                if rest:
                    self.body.tasks.add(BrakeTask(rest))
            self.kill([task])
        brakes = [t for t in self.body.tasks.using(resources) if isinstance(t, BrakeTask | LiveBrake)]
        for brake in brakes:
            brake.resources.difference_update(resources)

    def stop(self, resources: Sequence[str] = ACTUATED) -> None:
        """End tasks of joints, which brake; called with the lock held."""
        self.kill(self.body.tasks.using(resources))

    # Publishing.

    def _advertise_all(self) -> None:
        """Advertise all topics, and publish the latched ones."""
        model = f"/model/{self.robot}"
        self._clock = self.advertise("/clock", "rosgraph_msgs/msg/Clock")
        self._joint_states = [
            self.advertise(topic, "sensor_msgs/msg/JointState")
            for topic in ("/joint_states", f"/{self.robot}/joint_states")
        ]
        self._tf = [
            self.advertise(topic, "tf2_msgs/msg/TFMessage", TRANSFORMS) for topic in ("/tf", f"{model}/tf")
        ]
        self._true_pose = self.advertise(f"{model}/pose", "tf2_msgs/msg/TFMessage", TRANSFORMS)
        self._odometry = [
            self.advertise(topic, "nav_msgs/msg/Odometry") for topic in ("/odom", f"{model}/odom")
        ]
        self._progress = self.advertise(f"{model}/joint_trajectory_progress", "std_msgs/msg/Float32")
        self._laser = self.advertise("/laser", "sensor_msgs/msg/LaserScan")
        self._sonar = {
            side: self.advertise(f"/sonar/{side}", "sensor_msgs/msg/Range") for side in ("front", "back")
        }
        self._inertia = {
            part: self.advertise(f"/imu/{part}", "sensor_msgs/msg/Imu") for part in ("torso", "base")
        }
        self._touches = {
            topic: self.advertise(f"/{topic}", f"naoqi_bridge_msgs/msg/{kind}")
            for topic, kind in (
                ("bumper", "Bumper"),
                ("head_touch", "HeadTouch"),
                ("hand_touch", "HandTouch"),
            )
        }
        self.advertise("/robot_description", "std_msgs/msg/String", LATCHED).publish(self._states.description)
        fixed = self.advertise("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED)
        fixed.publish(self._states.fixed_transforms(self.now))

    def _on_cycle(self) -> None:
        """Publish the messages that are due; called after each cycle, with the body's lock held."""
        now, states = self.now, self._states
        self._sensors.read()
        self._clock.publish(message_type("rosgraph_msgs/msg/Clock")(clock=time_message(now)))
        self._publish(self._joint_states, lambda: states.joint_states(now))
        self._publish(self._tf, lambda: states.moving_transforms(now, self.odometry))
        self._publish([self._true_pose], lambda: states.base_pose(now))
        if self._due(ODOMETRY_RATE):
            self._publish(self._odometry, lambda: states.odometry(now, self.odometry))
        if self._due(SENSOR_RATE):
            self._publish_sensors(now)
        if self._due(DIAGNOSTICS_RATE):
            self.driver.publish()
        for topic, message in self._sensors.touches():
            self._touches[topic].publish(message)
        for controller in self.controllers.values():
            controller.publish_state()
            if controller.task is not None:
                self._publish_progress(controller)
        self._pictures.on_cycle()

    def _publish_sensors(self, now: float) -> None:
        sensors = self._sensors
        self._publish([self._laser], lambda: sensors.scan(now))
        for side, publisher in self._sonar.items():
            self._publish([publisher], lambda side=side: sensors.sonar(side, now))  # type: ignore[misc]
        for part, publisher in self._inertia.items():
            self._publish([publisher], lambda part=part: sensors.inertia(part, now))  # type: ignore[misc]

    def _publish_progress(self, controller: Controller) -> None:
        task = controller.task
        assert task is not None
        self._progress.publish(message_type("std_msgs/msg/Float32")(data=task.progress))
        if task.ended:
            controller.task = None

    def _publish(self, publishers: Sequence[Publisher], make: Callable[[], Any]) -> None:
        """Publish a message to topics with subscriptions; it is created once, and only if needed."""
        wanted = [publisher for publisher in publishers if publisher.subscription_count]
        if wanted:
            message = make()
            for publisher in wanted:
                publisher.publish(message)

    def _due(self, rate: float) -> bool:
        """Return whether a message of a rate [Hz] is due in this cycle."""
        count = int((self.body.time.now + 0.5 * CYCLE) * rate)
        if self._sent.get(rate) == count:
            return False
        self._sent[rate] = count
        return True
