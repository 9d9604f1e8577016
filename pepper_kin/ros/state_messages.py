"""Messages of the robot's state: joints, transforms, odometry and description."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.naoqi.body import Body
from pepper_kin.naoqi.joint_names import ACTUATED, WHEELS
from pepper_kin.ros.message_parts import header, planar_pose, pose_message, transforms, vector
from pepper_kin.ros_messages import message_type

ODOM, BASE = "odom", "base_footprint"
"""Frame of the odometry, and root of the robot's description."""

BASE_LINK = "base_link"
"""Child frame of `/odom`, as naoqi_driver2 names it."""


class StateMessages:
    """Messages of the state of a simulated body.

    Args:
        body: The simulated body.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        edges = _edges(self._described)
        self._fixed = [(parent, child) for parent, child, moves in edges if not moves]
        self._moving = [(parent, child) for parent, child, moves in edges if moves]
        self._frames = list(dict.fromkeys([BASE, *(name for pair in self._moving for name in pair)]))
        place = {name: k for k, name in enumerate(self._frames)}
        self._parents = np.array([place[parent] for parent, _ in self._moving])
        self._children = np.array([place[child] for _, child in self._moving])
        self._joint_rows = [body.index[name] for name in ACTUATED]
        self.joint_names = [*ACTUATED, *WHEELS]

    @cached_property
    def _described(self) -> PepperModel:
        return load_pepper(base="fixed", hands="mimic")

    @property
    def description(self) -> Any:
        """std_msgs/msg/String with the URDF of the robot, whose root is base_footprint."""
        return message_type("std_msgs/msg/String")(data=self._described.urdf)

    def joint_states(self, time: float) -> Any:
        """Return sensor_msgs/msg/JointState at a time [s]: the actuated joints and the wheels."""
        body, rows, state = self.body, self._joint_rows, self.body.state
        wheels = [0.0, 0.0, 0.0]
        return message_type("sensor_msgs/msg/JointState")(
            header=header(time),
            name=self.joint_names,
            position=[*state.position[rows].tolist(), *body.wheel_angles.tolist()],
            velocity=[*state.velocity[rows].tolist(), *body.controller.wheel_speeds.tolist()],
            effort=[*state.torque[rows].tolist(), *wheels],
        )

    def moving_transforms(self, time: float, odometry: Array) -> Any:
        """Return tf2_msgs/msg/TFMessage of the joints and of odom -> base_footprint.

        Args:
            time: Time of the stamps [s].
            odometry: Odometry of the base: x, y [m], yaw [rad], shape (3,).
        """
        poses = frame_poses(self.body.pepper, np.asarray(self.body.state.position), self._frames)
        parents, children = poses[self._parents], poses[self._children]
        turn = np.swapaxes(parents[:, :3, :3], 1, 2)
        relative = np.tile(np.eye(4), (len(parents), 1, 1))
        relative[:, :3, :3] = turn @ children[:, :3, :3]
        offset = children[:, :3, 3] - parents[:, :3, 3]
        relative[:, :3, 3] = np.einsum("kij,kj->ki", turn, offset)
        pairs = [(ODOM, BASE), *self._moving]
        sent = transforms(time, pairs, np.concatenate([planar_pose(odometry)[None], relative]))
        return message_type("tf2_msgs/msg/TFMessage")(transforms=sent)

    def fixed_transforms(self, time: float) -> Any:
        """Return tf2_msgs/msg/TFMessage of all fixed frames at a time [s]."""
        pepper = self._described
        names = list(dict.fromkeys(name for pair in self._fixed for name in pair))
        poses = dict(zip(names, frame_poses(pepper, pepper.neutral(), names), strict=True))
        relative = [np.linalg.inv(poses[parent]) @ poses[child] for parent, child in self._fixed]
        sent = transforms(time, self._fixed, np.array(relative))
        return message_type("tf2_msgs/msg/TFMessage")(transforms=sent)

    def odometry(self, time: float, pose: Array) -> Any:
        """Return nav_msgs/msg/Odometry of base_link, with the twist in its axes.

        Args:
            time: Time of the stamp [s].
            pose: Odometry of the base: x, y [m], yaw [rad], shape (3,).
        """
        at = planar_pose(pose)
        base, link = frame_poses(self._described, self._described.neutral(), [BASE, BASE_LINK])
        made = message_type("nav_msgs/msg/Odometry")(header=header(time, ODOM), child_frame_id=BASE_LINK)
        made.pose.pose = pose_message(at @ np.linalg.inv(base) @ link)
        x, y, turn = self.body.controller.twist.tolist()
        made.twist.twist.linear = vector((x, y, 0.0))
        made.twist.twist.angular = vector((0.0, 0.0, turn))
        return made

    def base_pose(self, time: float) -> Any:
        """Return tf2_msgs/msg/TFMessage of the true pose of the base in the world at a time [s]."""
        pose = planar_pose(self.body.base_pose(True))
        sent = transforms(time, [("world", BASE)], pose[None])
        return message_type("tf2_msgs/msg/TFMessage")(transforms=sent)


def _edges(pepper: PepperModel) -> list[tuple[str, str, bool]]:
    """Return parent, child and whether the joint moves, of every joint between known frames."""
    known = set(pepper.frame_names)
    return [
        (joint.parent, joint.child, joint.type != "fixed")
        for joint in pepper.document.joints
        if known.issuperset((joint.parent, joint.child))
    ]
