"""Command topics of the node: velocities, joint angles, goals of the base, targets of the hands."""

from __future__ import annotations

import logging
import threading
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin import ik
from pepper_kin.arrays import Array
from pepper_kin.exceptions import PepperKinError, UnknownNameError
from pepper_kin.model import rpy_from_rotation
from pepper_kin.naoqi.base_tasks import MoveToTask
from pepper_kin.naoqi.joint_names import ACTUATED, BASE_RESOURCES
from pepper_kin.naoqi.joint_tasks import SpeedTask
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.naoqi.tasks import BodyTask
from pepper_kin.ros.following import BrakeTask, CmdVelTask
from pepper_kin.ros.message_parts import planar_pose, pose_of
from pepper_kin.ros.state_messages import BASE, ODOM
from pepper_kin.servo import Servo, ServoStatus

if TYPE_CHECKING:
    from pepper_kin.naoqi.body import Body
    from pepper_kin.ros.node import RobotNode


logger = logging.getLogger(__name__)

WORLD_FRAMES = ("world", "map")
"""Frames of the simulated world."""

BASES = ("base_link", "base_footprint")
"""Frames of the base, in which velocities are given."""

HANDS = ("left", "right")


class Commands:
    """Executes commands on topics by the simulated body.

    Args:
        node: Node that subscribes.
        timeout: Time for which a velocity, or a target of a hand, holds [s]; then the robot brakes.
        robot: Name of the robot in topics.
        stamped: Whether `/cmd_vel` is a TwistStamped if the transport does not distinguish types.
    """

    def __init__(self, node: RobotNode, timeout: float, robot: str, stamped: bool) -> None:
        self.node, self.timeout = node, timeout
        self._drive: CmdVelTask | None = None
        self._reach: FollowTargetTask | None = None
        self._reaching = threading.Lock()
        both = [
            ("geometry_msgs/msg/Twist", self.on_velocity),
            ("geometry_msgs/msg/TwistStamped", self.on_stamped_velocity),
        ]
        first, second = reversed(both) if stamped else both
        node.listen("/cmd_vel", *first)
        if (name := node.transport.second_type("/cmd_vel", second[0])) is not None:
            node.listen(name, *second)
        node.listen(f"/model/{robot}/cmd_vel", "geometry_msgs/msg/Twist", self.on_velocity)
        node.listen("/joint_angles", "naoqi_bridge_msgs/msg/JointAnglesWithSpeed", self.on_joint_angles)
        node.listen("/move_base_simple/goal", "geometry_msgs/msg/PoseStamped", self.on_base_goal)
        for side in HANDS:
            node.listen(
                f"/{robot}/follow_target/{side}",
                "geometry_msgs/msg/PoseStamped",
                partial(self.on_target, side),
            )

    def on_velocity(self, message: Any) -> None:
        """Drive at the velocity of a geometry_msgs/msg/Twist until `timeout` after the last one."""
        twist = np.array([message.linear.x, message.linear.y, message.angular.z])
        if not np.isfinite(twist).all():
            logger.warning("/cmd_vel: refused: %s is not finite", twist)
            return
        body = self.node.body
        with body.time.lock:
            task = self._drive
            if task is not None and not task.ended and not task.killed and task.resources:
                task.refresh(twist)
                return
            self.node.replace(BASE_RESOURCES)
            self._drive = CmdVelTask(twist, self.timeout)
            body.do(self._drive)

    def on_stamped_velocity(self, message: Any) -> None:
        """Drive at the velocity of a geometry_msgs/msg/TwistStamped in a frame of the base, or in none."""
        frame = str(message.header.frame_id).lstrip("/")
        if frame and frame not in BASES:
            logger.warning("/cmd_vel: refused: frame %s, expected %s", frame, " or ".join(BASES))
            return
        self.on_velocity(message.twist)

    def on_joint_angles(self, message: Any) -> None:
        """Move joints at a ratio of their maximum speed, like `ALMotion.setAngles` and `changeAngles`."""
        names, angles = [str(name) for name in message.joint_names], list(message.joint_angles)
        unknown = [name for name in names if name not in ACTUATED]
        twice = len(set(names)) < len(names)
        if unknown or twice or len(names) != len(angles) or not names or not np.isfinite(angles).all():
            logger.warning("/joint_angles: refused: joints %s with angles %s", names, angles)
            return
        if not 0.0 < message.speed <= 1.0:
            logger.warning("/joint_angles: refused: a speed of %s, not in (0, 1]", message.speed)
            return
        body = self.node.body
        with body.time.lock:
            offset = [body.commanded(name) if message.relative else 0.0 for name in names]
            targets = {name: float(a) + o for name, a, o in zip(names, angles, offset, strict=True)}
            for name, target in targets.items():
                k = body.pepper.joint_index(name)
                low, high = body.pepper.lower_limits[k], body.pepper.upper_limits[k]
                if not low <= target <= high:  # ALMotion also moves to the nearest limit
                    what = (
                        "/joint_angles: %s to %.6g is beyond its limits %.6g and %.6g: it goes to the nearest"
                    )
                    logger.warning(what, name, target, low, high)
            self.node.replace(names)
            body.do(SpeedTask("setAngles", targets, float(message.speed)))

    def on_base_goal(self, message: Any) -> None:
        """Drive to a geometry_msgs/msg/PoseStamped."""
        try:
            pose = world_pose(self.node, message)
        except PepperKinError as error:
            logger.warning("/move_base_simple/goal: refused: %s", error)
            return
        yaw = float(rpy_from_rotation(pose[:3, :3])[2])
        with self.node.body.time.lock:
            self.node.replace(BASE_RESOURCES)
            place = np.array([pose[0, 3], pose[1, 3], yaw])
            self.node.body.do(MoveToTask("move_base_simple", [place], world=True))

    def on_target(self, side: str, message: Any) -> None:
        """Make a palm follow the position of a PoseStamped, until `timeout` after the last one."""
        body = self.node.body
        try:
            pose = world_pose(self.node, message)
        except PepperKinError as error:
            logger.warning("follow_target/%s: refused: %s", side, error)
            return
        with self._reaching:
            task = self._reach
            if task is None or task.ended or task.killed:
                with body.time.lock:
                    self.node.stop(ACTUATED)
                # Making the task takes a while, which must not delay the control cycles.
                task = FollowTargetTask(body, self.timeout)
                with body.time.lock:
                    self.node.replace(ACTUATED)
                    body.do(task)
                self._reach = task
            with body.time.lock:
                task.aim(side, pose)


class FollowTargetTask(BodyTask):
    """Makes hands follow targets by differential inverse kinematics, within all limits, without collisions.

    Args:
        body: The simulated body.
        timeout: Time for which a target holds [s].
    """

    def __init__(self, body: Body, timeout: float) -> None:
        super().__init__("follow_target", ACTUATED)
        pepper = body.pepper
        still = [name for name in pepper.joint_names if name not in ACTUATED]
        start = np.clip(body.configuration(False), pepper.lower_limits, pepper.upper_limits)
        self._servo = Servo(
            pepper, start, 1.0 / CYCLE, body.scene, command_timeout=timeout, locked=[*still, "LHand", "RHand"]
        )
        self._targets: dict[str, Array] = {}

    def aim(self, side: str, pose: Array) -> None:
        """Set the target of a palm, of which only the position counts: a pose in the world, shape (4, 4)."""
        self._targets[side] = pose
        self._servo.set_target(
            [ik.HandPosition(hand, target[:3, 3]) for hand, target in self._targets.items()]
        )

    def step(self, body: Body) -> bool:
        """Command one tick of the servo; the task ends when no target holds and all joints are at rest."""
        state = self._servo.step()
        rows = [body.index[name] for name in ACTUATED]
        body.command[rows] = state.q[rows]
        return state.status is not ServoStatus.RESTING

    def finish(self, body: Body) -> None:
        """Brake."""
        body.tasks.add(BrakeTask(sorted(self.resources)))


def world_pose(node: RobotNode, message: Any) -> Array:
    """Return the pose of geometry_msgs/msg/PoseStamped in the world, shape (4, 4).

    Its frame is "world" or "map", which are equal, "odom", or a frame of the robot.

    Raises:
        UnknownNameError: for another frame.
        InvalidValueError: for an invalid pose.
    """
    pose, frame = pose_of(message.pose), str(message.header.frame_id).lstrip("/")
    if frame in WORLD_FRAMES:
        return pose
    body = node.body
    with body.time.lock:
        if frame == ODOM:
            true = body.frame_pose(BASE, True)
            return np.asarray(true @ np.linalg.inv(planar_pose(node.odometry)) @ pose)
        if frame in body.pepper.frame_names:
            return np.asarray(body.frame_pose(frame, True) @ pose)
    raise UnknownNameError("frame", frame, [*WORLD_FRAMES, ODOM, *body.pepper.frame_names])
