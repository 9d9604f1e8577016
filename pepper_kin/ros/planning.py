"""The planning service: MoveIt's `GetMotionPlan`, answered by the library's planner."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin import ik
from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError, PepperKinError, UnknownNameError, beside_limits
from pepper_kin.files import ros_points
from pepper_kin.motion import Plan, PlanStatus, plan
from pepper_kin.naoqi.joint_names import ACTUATED, WHEELS
from pepper_kin.ros.commands import world_pose
from pepper_kin.ros.controllers import CONTROLLERS
from pepper_kin.ros.joint_trajectory import message_of
from pepper_kin.ros_messages import message_type
from pepper_kin.trajectory import retime

if TYPE_CHECKING:
    from pepper_kin.ros.node import RobotNode


SERVICE = "/plan_kinematic_path"
"""MoveIt's name of the service."""

TYPE = "moveit_msgs/srv/GetMotionPlan"
CODES: Any = message_type("moveit_msgs/msg/MoveItErrorCodes")

LONGEST, USUAL = 60.0, 5.0
"""Maximum planning time, and default planning time of a request [s]."""

ROUNDED = 1e-6
"""Tolerance of joint limits in a start state, for rounding [rad or m]."""

_STATUS_CODES = {
    PlanStatus.START_IN_COLLISION: CODES.START_STATE_IN_COLLISION,
    PlanStatus.START_TORQUE_LIMIT: CODES.START_STATE_INVALID,
    PlanStatus.START_TIPS_OVER: CODES.START_STATE_INVALID,
    PlanStatus.START_TOO_NEAR: CODES.START_STATE_INVALID,
    PlanStatus.START_SHUT_IN: CODES.START_STATE_INVALID,
    PlanStatus.GOAL_IN_COLLISION: CODES.GOAL_IN_COLLISION,
    PlanStatus.GOAL_TORQUE_LIMIT: CODES.GOAL_STATE_INVALID,
    PlanStatus.GOAL_TIPS_OVER: CODES.GOAL_STATE_INVALID,
    PlanStatus.GOAL_TOO_NEAR: CODES.GOAL_STATE_INVALID,
    PlanStatus.GOAL_SHUT_IN: CODES.GOAL_STATE_INVALID,
    PlanStatus.NO_IK: CODES.NO_IK_SOLUTION,
    PlanStatus.NO_PATH_IN_TIME: CODES.TIMED_OUT,
}


class RefusedError(PepperKinError):
    """A request was refused, with a MoveIt error code."""

    def __init__(self, code: int, reason: str) -> None:
        self.code = code
        super().__init__(reason)


class PlanningService:
    """Plans motions of the simulated robot, from its present state or the start state of a request.

    A start state beyond the limits is refused.  A request has one of two kinds of `goal_constraints`: joint
    positions; or the position of a link, as the pose of the first primitive of its region, optionally with
    an orientation.  `group_name` is a group or a controller whose joints may move; with "" all joints that
    hold a position may move.  The answer is a trajectory that has passed its certificate, or the reason and
    the advice in `error_code.message`.

    Args:
        node: The node.
    """

    def __init__(self, node: RobotNode) -> None:
        self.node = node
        self._one = threading.Lock()
        node.offer_service(SERVICE, TYPE, self.answer)

    def answer(self, request: Any) -> Any:
        """Plan a motion; return moveit_msgs/srv/GetMotionPlan_Response."""
        wanted = request.motion_plan_request
        response = message_type("moveit_msgs/msg/MotionPlanResponse")(group_name=wanted.group_name)
        begin = time.perf_counter()
        try:
            with self._one:
                self._plan(wanted, response)
        except RefusedError as error:
            fail(response, error.code, str(error))
        except PepperKinError as error:
            fail(response, CODES.PLANNING_FAILED, str(error))
        response.planning_time = time.perf_counter() - begin
        response.error_code.source = "pepper_kin"
        return message_type(f"{TYPE}_Response")(motion_plan_response=response)

    def _plan(self, wanted: Any, response: Any) -> None:
        """Plan a motion of a request, and write it or the reason of the failure to the response."""
        pepper, scene = self.node.body.pepper, self.node.body.scene
        start, joints = (
            configuration_of(self.node, wanted.start_state),
            joints_of(self.node, wanted.group_name),
        )
        goal = self._goal(wanted, start, joints)
        timeout = min(wanted.allowed_planning_time or USUAL, LONGEST)
        found = plan(pepper, start, goal, scene, joints=joints, timeout=max(timeout, 0.1))
        if not found.success:
            fail(response, _STATUS_CODES.get(found.status, CODES.PLANNING_FAILED), found.report())
            return
        self._answer_with(found, start, joints, wanted, response)

    def _answer_with(
        self, found: Plan, start: Array, joints: tuple[str, ...], wanted: Any, response: Any
    ) -> None:
        """Time and certify a plan, and write it to the response; start [rad or m], shape (n,)."""
        pepper = self.node.body.pepper
        rows = [pepper.joint_index(name) for name in joints]
        response.trajectory_start.joint_state.name = list(joints)
        response.trajectory_start.joint_state.position = start[rows]
        response.error_code.val, response.error_code.message = CODES.SUCCESS, "solved"
        if found.curve is None:
            return
        trajectory = retime(
            pepper,
            found,
            velocity_scale=wanted.max_velocity_scaling_factor or 1.0,
            acceleration_scale=wanted.max_acceleration_scaling_factor or 1.0,
            hand_speed=wanted.max_cartesian_speed or None,
        )
        try:
            points = ros_points(trajectory, pepper=pepper, scene=self.node.body.scene)
        except InvalidValueError as error:
            fail(response, CODES.INVALID_MOTION_PLAN, str(error))
            return
        response.trajectory.joint_trajectory = message_of(points, joints)

    def _goal(self, wanted: Any, start: Array, joints: tuple[str, ...]) -> Any:
        """Return the goal for `plan`, a configuration or tasks; start [rad or m], shape (n,)."""
        if len(wanted.goal_constraints) != 1:
            raise _bad_goal(f"{len(wanted.goal_constraints)} goal_constraints, exactly 1 is planned for")
        goal = wanted.goal_constraints[0]
        refuse_constraints(wanted.path_constraints, "path_constraints")
        if goal.visibility_constraints or wanted.trajectory_constraints.constraints:
            raise _bad_goal("visibility and trajectory constraints are not offered by this service")
        if wanted.reference_trajectories:
            raise _bad_goal("reference_trajectories are not followed by this service")
        if goal.joint_constraints and not (goal.position_constraints or goal.orientation_constraints):
            return self._joint_goal(goal.joint_constraints, start, joints)
        if len(goal.position_constraints) != 1 or len(goal.orientation_constraints) > 1:
            raise _bad_goal("a goal has joint_constraints, or 1 position and 0 or 1 orientation constraint")
        return [self._task(goal)]

    def _joint_goal(self, constraints: Any, start: Array, joints: tuple[str, ...]) -> Array:
        """Return the start with the joints of constraints changed [rad or m], shape (n,) both."""
        pepper, goal = self.node.body.pepper, start.copy()
        named = [str(constraint.joint_name) for constraint in constraints]
        if twice := [name for name in named if named.count(name) > 1]:
            raise _bad_goal(f"joint {twice[0]!r} has {named.count(twice[0])} constraints, expected 1")
        for constraint in constraints:
            if constraint.joint_name not in joints:
                known = ", ".join(joints)
                raise _bad_goal(f"joint {constraint.joint_name!r} is not one that may move: {known}")
            goal[pepper.joint_index(constraint.joint_name)] = constraint.position
        return goal

    def _task(self, goal: Any) -> Any:
        """Return the task of a position constraint, with an optional orientation."""
        position, pepper = goal.position_constraints[0], self.node.body.pepper
        region = position.constraint_region
        if position.link_name not in pepper.frame_names:
            raise RefusedError(CODES.INVALID_LINK_NAME, f"there is no link {position.link_name!r}")
        if not region.primitive_poses:
            raise _bad_goal("the position constraint has no primitive_poses; the first is the target")
        offset = position.target_point_offset
        if offset.x or offset.y or offset.z:
            raise _bad_goal("target_point_offset is not 0; name a frame of the robot instead")
        stamped = message_type("geometry_msgs/msg/PoseStamped")(
            header=position.header, pose=region.primitive_poses[0]
        )
        tolerance = float(region.primitives[0].dimensions[0]) if _has_size(region) else 1e-3
        if not goal.orientation_constraints:
            return ik.FramePosition(
                position.link_name, placed(self.node, stamped)[:3, 3], tolerance=max(tolerance, 1e-4)
            )
        turn = goal.orientation_constraints[0]
        stamped.pose.orientation = turn.orientation
        angles = (
            turn.absolute_x_axis_tolerance,
            turn.absolute_y_axis_tolerance,
            turn.absolute_z_axis_tolerance,
        )
        return ik.FramePose(
            position.link_name,
            placed(self.node, stamped),
            tolerance=max(tolerance, 1e-4),
            orientation_tolerance=max(min(angles), 1e-3),
        )


def configuration_of(node: RobotNode, state: Any) -> Array:
    """Return the commanded configuration changed by a moveit_msgs/msg/RobotState [rad or m], shape (n,).

    Wheels, which `/joint_states` contains as well, are ignored: the base keeps its pose.

    Args:
        node: The node of the robot.
        state: State message.

    Raises:
        RefusedError: for an unknown or repeated joint, positions that are missing, not
            finite or beyond the limits, a pose of the base, or an object that the robot does not hold.
    """
    body, pepper = node.body, node.body.pepper
    names, values = [str(name) for name in state.joint_state.name], np.asarray(state.joint_state.position)
    with body.time.lock:
        q = np.clip(body.configuration(False), pepper.lower_limits, pepper.upper_limits)
        held = () if body.scene is None else tuple(body.scene.attached)
    if len(names) != len(values) or len(set(names)) < len(names):
        words = f"{len(values)} positions for {len(set(names))} different joints of {len(names)}"
        raise _bad_state(f"the start state has {words}")
    if state.multi_dof_joint_state.joint_names:
        raise _bad_state("the start state has multi_dof_joint_state; the base stands where it stands")
    for one in state.attached_collision_objects:
        name = str(one.object.id)
        if not any(part == name or part.startswith(f"{name}/") for part in held):
            raise _bad_state(f"the robot does not hold {name!r}; attach it by /attached_collision_object")
    for name, value in zip(names, values.tolist(), strict=True):
        if name in WHEELS:
            continue
        if name not in pepper.joint_names:
            raise _bad_state(f"there is no joint {name!r}")
        k = pepper.joint_index(name)
        low, high = float(pepper.lower_limits[k]), float(pepper.upper_limits[k])
        if not np.isfinite(value):
            raise _bad_state(f"{name} is at {value} in the start state")
        if not low - ROUNDED <= value <= high + ROUNDED:
            at, *limits = beside_limits(value, low, high, outside=True, digits=6)
            reason = f"{name} is at {at} in the start state, beyond its limits {' and '.join(limits)}"
            raise RefusedError(CODES.START_STATE_INVALID, f"{reason}; give a state within them")
        q[k] = min(max(value, low), high)
    return np.asarray(q)


def refuse_constraints(constraints: Any, what: str) -> None:
    """Raise RefusedError for a moveit_msgs/msg/Constraints that is not empty."""
    kinds = ("joint_constraints", "position_constraints", "orientation_constraints", "visibility_constraints")
    held = [kind for kind in kinds if len(getattr(constraints, kind))]
    if held:
        raise _bad_goal(f"{what} has {', '.join(held)}, which this service does not offer; use pk.plan")


def joints_of(node: RobotNode, group: str) -> tuple[str, ...]:
    """Return the joints of a group or a controller; with "" all joints that hold a position.

    Raises:
        RefusedError: for an unknown group.
    """
    pepper = node.body.pepper
    if not group:
        return tuple(name for name in pepper.joint_names if name in ACTUATED)
    if group in CONTROLLERS:
        return CONTROLLERS[group]
    try:
        return tuple(name for name in pepper.joint_group(group) if name in ACTUATED)
    except UnknownNameError as error:
        raise RefusedError(CODES.INVALID_GROUP_NAME, str(error)) from error


def placed(node: RobotNode, stamped: Any) -> Array:
    """Return the pose of a geometry_msgs/msg/PoseStamped in the world, shape (4, 4).

    Raises:
        RefusedError: for an unknown frame.
    """
    try:
        return world_pose(node, stamped)
    except UnknownNameError as error:
        raise RefusedError(CODES.FRAME_TRANSFORM_FAILURE, str(error)) from error


def _has_size(region: Any) -> bool:
    return bool(region.primitives) and len(region.primitives[0].dimensions) > 0


def _bad_state(reason: str) -> RefusedError:
    return RefusedError(CODES.INVALID_ROBOT_STATE, reason)


def _bad_goal(reason: str) -> RefusedError:
    return RefusedError(CODES.INVALID_GOAL_CONSTRAINTS, reason)


def fail(response: Any, code: int, reason: str) -> None:
    """Write an error code and its reason to a response."""
    response.error_code.val, response.error_code.message = code, reason
