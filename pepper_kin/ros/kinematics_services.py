"""MoveIt's kinematics services: `/compute_ik`, `/compute_fk` and `/compute_cartesian_path`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin import ik, kinematics
from pepper_kin.arrays import Array
from pepper_kin.exceptions import PepperKinError
from pepper_kin.files import ros_points
from pepper_kin.motion import CartesianStatus, Line, cartesian_path
from pepper_kin.naoqi.joint_names import ACTUATED
from pepper_kin.ros.commands import WORLD_FRAMES
from pepper_kin.ros.joint_trajectory import message_of
from pepper_kin.ros.message_parts import pose_message
from pepper_kin.ros.planning import (
    CODES,
    RefusedError,
    configuration_of,
    fail,
    joints_of,
    placed,
    refuse_constraints,
)
from pepper_kin.ros_messages import message_type
from pepper_kin.trajectory import retime

if TYPE_CHECKING:
    from pepper_kin.ros.node import RobotNode

COMPUTE_IK, COMPUTE_FK, CARTESIAN_PATH = "/compute_ik", "/compute_fk", "/compute_cartesian_path"
IK_TYPE, FK_TYPE = "moveit_msgs/srv/GetPositionIK", "moveit_msgs/srv/GetPositionFK"
PATH_TYPE = "moveit_msgs/srv/GetCartesianPath"
TIPS = {"left_arm": "LArm_effector", "right_arm": "RArm_effector", "head": "CameraTop_optical_frame"}
"""Default link of each group."""

HANDS = {"LArm_effector": "left", "RArm_effector": "right"}
"""Links of Cartesian paths -> hand."""

LONGEST = 5.0
"""Maximum time of a solution [s]."""

FINEST = 1e-3
"""Minimum step along a line [m]."""

MOST_WAYPOINTS = 1000


class KinematicsServices:
    """Inverse kinematics, forward kinematics and Cartesian paths of hands, as services.

    Args:
        node: The node.
    """

    def __init__(self, node: RobotNode) -> None:
        self.node = node
        node.offer_service(COMPUTE_IK, IK_TYPE, self.compute_ik)
        node.offer_service(COMPUTE_FK, FK_TYPE, self.compute_fk)
        node.offer_service(CARTESIAN_PATH, PATH_TYPE, self.compute_cartesian_path)

    def compute_ik(self, request: Any) -> Any:
        """Solve inverse kinematics; return moveit_msgs/srv/GetPositionIK_Response.

        A pose whose quaternion is 0 sets the position alone, as arms of five joints reach few poses.
        """
        wanted, response = request.ik_request, message_type(f"{IK_TYPE}_Response")()
        try:
            refuse_constraints(wanted.constraints, "constraints")
            start = configuration_of(self.node, wanted.robot_state)
            joints = joints_of(self.node, wanted.group_name)
            body, tasks = self.node.body, self._tasks(wanted)
            stated = wanted.timeout.sec + 1e-9 * wanted.timeout.nanosec
            found = ik.solve(
                body.pepper,
                tasks,
                start,
                joints=joints,
                scene=body.scene if wanted.avoid_collisions else None,
                collisions=bool(wanted.avoid_collisions),
                timeout=min(stated, LONGEST) if stated > 0.0 else LONGEST,
            )
            if not found.success:
                fail(response, CODES.NO_IK_SOLUTION, found.report())
                return response
            named = [name for name in body.pepper.joint_names if name in ACTUATED]
            response.solution.joint_state.name = named
            response.solution.joint_state.position = found.q[
                [body.pepper.joint_index(name) for name in named]
            ]
            response.error_code.val = CODES.SUCCESS
        except RefusedError as error:
            fail(response, error.code, str(error))
        except PepperKinError as error:
            fail(response, CODES.FAILURE, str(error))
        return response

    def _tasks(self, wanted: Any) -> list[ik.Task | ik.TaskGroup]:
        """Return a task for each pose of a request."""
        if wanted.ik_link_names or wanted.pose_stamped_vector:
            pairs = list(zip(wanted.ik_link_names, wanted.pose_stamped_vector, strict=False))
            if len(wanted.ik_link_names) != len(wanted.pose_stamped_vector):
                words = f"{len(wanted.ik_link_names)} links for {len(wanted.pose_stamped_vector)} poses"
                raise RefusedError(CODES.INVALID_LINK_NAME, words)
        else:
            pairs = [(wanted.ik_link_name or TIPS.get(wanted.group_name, ""), wanted.pose_stamped)]
        return [self._task(str(link), stamped) for link, stamped in pairs]

    def _task(self, link: str, stamped: Any) -> ik.Task | ik.TaskGroup:
        """Return the task of a link's pose, or of its position if the quaternion is 0."""
        if link not in self.node.body.pepper.frame_names:
            raise RefusedError(CODES.INVALID_LINK_NAME, f"there is no link {link!r}")
        turn = stamped.pose.orientation
        if turn.x == turn.y == turn.z == turn.w == 0.0:
            turn.w = 1.0
            return ik.FramePosition(link, placed(self.node, stamped)[:3, 3])
        return ik.FramePose(link, placed(self.node, stamped))

    def compute_fk(self, request: Any) -> Any:
        """Return moveit_msgs/srv/GetPositionFK_Response: links' poses in the header's frame, or the world."""
        response = message_type(f"{FK_TYPE}_Response")()
        try:
            q = configuration_of(self.node, request.robot_state)
            frame = str(request.header.frame_id).lstrip("/") or WORLD_FRAMES[0]
            reference = np.eye(4) if frame in WORLD_FRAMES else self._frame(q, frame)
            for link in map(str, request.fk_link_names):
                stamped = message_type("geometry_msgs/msg/PoseStamped")()
                stamped.header.frame_id, stamped.header.stamp = frame, request.header.stamp
                stamped.pose = pose_message(np.linalg.inv(reference) @ self._frame(q, link))
                response.pose_stamped.append(stamped)
                response.fk_link_names.append(link)
            response.error_code.val = CODES.SUCCESS
        except RefusedError as error:
            response = message_type(f"{FK_TYPE}_Response")()
            fail(response, error.code, str(error))
        return response

    def compute_cartesian_path(self, request: Any) -> Any:
        """Return moveit_msgs/srv/GetCartesianPath_Response: a timed motion of a hand along lines.

        Only positions of the waypoints count.  If the hand stops early, `fraction` is the completed part of
        the path, and `error_code.message` the reason.
        """
        response = message_type(f"{PATH_TYPE}_Response")()
        try:
            self._lead(request, response)
        except RefusedError as error:
            fail(response, error.code, str(error))
        except PepperKinError as error:
            fail(response, CODES.FAILURE, str(error))
        return response

    def _lead(self, request: Any, response: Any) -> None:
        """Plan and time a Cartesian path of a hand, and write it to the response."""
        body, link = self.node.body, str(request.link_name) or TIPS.get(str(request.group_name), "")
        if link not in HANDS:
            raise RefusedError(CODES.INVALID_LINK_NAME, f"{link!r} is not one of {', '.join(HANDS)}")
        if not 0 < len(request.waypoints) <= MOST_WAYPOINTS:
            raise RefusedError(CODES.FAILURE, f"{len(request.waypoints)} waypoints, 1 to {MOST_WAYPOINTS}")
        refuse_constraints(request.path_constraints, "path_constraints")
        if 0.0 < request.max_step < FINEST:
            raise RefusedError(
                CODES.FAILURE, f"max_step is {request.max_step:g} m, expected at least {FINEST:g}"
            )
        start = configuration_of(self.node, request.start_state)
        joints = joints_of(self.node, request.group_name)
        stamped = message_type("geometry_msgs/msg/PoseStamped")(header=request.header)
        stamped.header.frame_id = stamped.header.frame_id or WORLD_FRAMES[0]
        lines = []
        for waypoint in request.waypoints:
            stamped.pose = waypoint
            lines.append(Line(placed(self.node, stamped)[:3, 3]))
        scene = body.scene if request.avoid_collisions else None
        found = cartesian_path(
            body.pepper, start, HANDS[link], lines, scene, joints=joints,
            step=min(request.max_step, 0.02) if request.max_step > 0.0 else 0.005,
        )  # fmt: skip
        response.start_state.joint_state.name = list(joints)
        response.start_state.joint_state.position = start[[body.pepper.joint_index(name) for name in joints]]
        if found.status is CartesianStatus.START_INVALID:
            raise RefusedError(CODES.START_STATE_INVALID, found.message)
        response.fraction = found.fraction
        response.error_code.val = CODES.SUCCESS
        response.error_code.message = "" if found.success else found.message
        if len(found.path) > 1:
            trajectory = retime(
                body.pepper,
                found.path,
                velocity_scale=request.max_velocity_scaling_factor or 1.0,
                acceleration_scale=request.max_acceleration_scaling_factor or 1.0,
                hand_speed=request.max_cartesian_speed or None,
            )
            points = ros_points(trajectory, pepper=body.pepper, scene=scene)
            response.solution.joint_trajectory = message_of(points, joints)

    def _frame(self, q: Array, link: str) -> Array:
        """Return the pose of a link in the world, shape (4, 4); q: joint positions [rad or m], shape (n,)."""
        pepper = self.node.body.pepper
        if link not in pepper.frame_names:
            raise RefusedError(CODES.INVALID_LINK_NAME, f"there is no link {link!r}")
        return np.asarray(kinematics.frame_pose(pepper, q, link))
