"""Joint trajectory controllers with topic, action and state, by ros2_control's names."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.naoqi.joint_names import ACTUATED, HEAD, LEFT_ARM, LEG, RIGHT_ARM
from pepper_kin.ros.following import ControllerTask
from pepper_kin.ros.joint_trajectory import (
    ErrorCode,
    StartState,
    TrajectoryRefusedError,
    check_joints,
    refuse_other_parts,
    seconds,
    tolerance_of,
    trajectory_of,
)
from pepper_kin.ros.live_goals import LiveGoal
from pepper_kin.ros.message_parts import duration_message, header
from pepper_kin.ros.transport import ActionServer, ServerGoal
from pepper_kin.ros_messages import message_type
from pepper_kin.trajectory.samples import State

if TYPE_CHECKING:
    from pepper_kin.ros.node import RobotNode

logger = logging.getLogger(__name__)

CONTROLLERS: Mapping[str, tuple[str, ...]] = {
    "Head_controller": HEAD,
    "LeftArm_controller": LEFT_ARM[:-1],
    "RightArm_controller": RIGHT_ARM[:-1],
    "Pelvis_controller": LEG,
    "LeftHand_controller": LEFT_ARM[-1:],
    "RightHand_controller": RIGHT_ARM[-1:],
    "joint_trajectory_controller": ACTUATED,
}
"""Name of a controller -> its joints; the last one has all."""

ACTION = "control_msgs/action/FollowJointTrajectory"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
STATE = "control_msgs/msg/JointTrajectoryControllerState"

CANCELED = "canceled"

GOAL_TOLERANCE = 0.05
"""Default tolerance of joint positions at the goal [rad]; the path has no default tolerance."""

GOAL_TIME = 2.0
"""Default time after the last point within which the goal must be reached [s]."""

FEEDBACK_EVERY = 2
"""Number of cycles between two feedback messages."""


class Controller(ActionServer):
    """Joint trajectory controller of the simulated body.

    A new trajectory replaces running trajectories of any of its joints; their goals are aborted.

    Args:
        node: The node.
        name: Name of the controller.
        joints: Joints that the controller may move; a trajectory may have a part of them.
    """

    def __init__(self, node: RobotNode, name: str, joints: Sequence[str]) -> None:
        self.node, self.name, self.joints = node, name, tuple(joints)
        self.task: ControllerTask | LiveGoal | None = None
        self._rows = [node.body.index[joint] for joint in joints]
        self._goals: dict[bytes, ControllerTask | LiveGoal] = {}
        self._canceled: set[bytes] = set()
        node.listen(f"/{name}/joint_trajectory", TRAJECTORY, self.on_trajectory)
        node.offer_action(f"/{name}/follow_joint_trajectory", ACTION, self)
        self._state = node.advertise(f"/{name}/controller_state", STATE)

    def on_trajectory(self, message: Any) -> None:
        """Follow a trajectory of a message; a refusal is logged."""
        try:
            self.follow(message)
        except TrajectoryRefusedError as error:
            logger.warning("%s: refused: %s", self.name, error)

    def follow(self, message: Any, handle: ServerGoal | None = None) -> ControllerTask | LiveGoal:
        """Follow a trajectory, or move to its end by a live motion, from now or its header's time on.

        Args:
            message: `trajectory_msgs/msg/JointTrajectory`.
            handle: The goal of the action, for tolerances and feedback.

        Raises:
            TrajectoryRefusedError: with the code and the reason.
        """
        body = self.node.body
        goal = None if handle is None else handle.goal
        names = tuple(str(name) for name in message.joint_names)
        check_joints(names, self.joints, self.name)
        if goal is not None:
            refuse_other_parts(goal)
        path = tolerance_of(goal.path_tolerance if goal is not None else (), names, float("inf"))
        end = tolerance_of(goal.goal_tolerance if goal is not None else (), names, GOAL_TOLERANCE)
        stated = seconds(goal.goal_time_tolerance) if goal is not None else 0.0
        late, live = stated or GOAL_TIME, self.node.live
        with body.time.lock:
            rows = [body.index[name] for name in names]
            lower, upper = body.pepper.lower_limits[rows], body.pepper.upper_limits[rows]
            rates = np.array([body.command_rate(name) for name in names])
            trajectory = trajectory_of(message, StartState(body.command[rows], rates, lower, upper))
            delay = self._delay(message, trajectory.duration)
            task: ControllerTask | LiveGoal
            if live is None:
                task = ControllerTask(trajectory, path, end, late, delay=delay)
            else:
                patience = stated or float("inf")
                task = live.goal(trajectory, path, end, late, delay=delay, patience=patience)
            if handle is not None:
                task.on_step = _feedback_to(handle, names)
                self._goals[handle.goal_id] = task
                if handle.goal_id in self._canceled:  # canceled before its start
                    task.outcome, task.ended = (None, CANCELED), True
                    return task
            self.node.replace(names)
            self.task = task
            body.do(task)
        return task

    def _delay(self, message: Any, duration: float) -> float:
        """Return the time until the start of a trajectory [s]."""
        begin = seconds(message.header.stamp)
        if begin == 0.0:
            return 0.0
        delay = begin - self.node.now
        if delay + duration < 0.0:
            raise TrajectoryRefusedError(
                ErrorCode.OLD_HEADER_TIMESTAMP,
                f"it begins at {begin:.3f} s and ends {-delay - duration:.3f} s before now",
            )
        return delay

    def publish_state(self) -> None:
        """Publish desired and actual state; called once a cycle, with the body's lock held."""
        if not self._state.subscription_count:
            return
        body, rows = self.node.body, self._rows
        wanted = [body.last_command(name) for name in self.joints]
        rates = [body.command_rate(name) for name in self.joints]
        state = body.state
        desired = _point(0.0, wanted, rates)
        actual = _point(0.0, state.position[rows].tolist(), state.velocity[rows].tolist())
        error = _point(0.0, np.subtract(wanted, state.position[rows]).tolist())
        self._state.publish(
            message_type("control_msgs/msg/JointTrajectoryControllerState")(
                header=header(self.node.now),
                joint_names=list(self.joints),
                reference=desired,
                feedback=actual,
                error=error,
                output=desired,
                speed_scaling_factor=1.0,
            )
        )

    def on_goal(self, goal: Any) -> bool:
        """Accept every goal: an impossible one ends at once, with code and text in its result."""
        return True

    def on_cancel(self, goal: ServerGoal) -> bool:
        """Accept the request: the joints brake, and the goal ends as canceled."""
        body = self.node.body
        with body.time.lock:
            task = self._goals.get(goal.goal_id)
            self._canceled.add(goal.goal_id)
            if task is not None:
                task.outcome = (None, CANCELED)
                self.node.kill([task])
        return True

    def execute(self, goal: ServerGoal) -> None:
        """Follow the trajectory of a goal to its end."""
        try:
            task = self.follow(goal.goal.trajectory, goal)
        except TrajectoryRefusedError as error:
            logger.warning("%s: refused: %s", self.name, error)
            goal.abort(_result(error.code, error.reason))
            return
        try:
            self.node.body.time.wait_until(lambda: task.ended)
        finally:
            with self.node.body.time.lock:
                self._goals.pop(goal.goal_id, None)
                self._canceled.discard(goal.goal_id)
        code, text = task.outcome
        if code is ErrorCode.SUCCESSFUL:
            goal.succeed(_result(code, text))
        elif text == CANCELED or goal.cancel_requested:
            goal.canceled(_result(ErrorCode.SUCCESSFUL, CANCELED))
        else:
            goal.abort(_result(ErrorCode.INVALID_GOAL if code is None else code, text))


def _feedback_to(goal: ServerGoal, joints: Sequence[str]) -> Callable[[float, State, State], None]:
    """Return a function that sends a goal's feedback: trajectory time [s], desired and actual state."""
    names, count = list(joints), 0

    def step(time: float, desired: State, actual: State) -> None:
        nonlocal count
        count += 1
        if count % FEEDBACK_EVERY:
            return
        wrong = State(*(wanted - found for wanted, found in zip(desired, actual, strict=True)))
        states = (("desired", desired), ("actual", actual), ("error", wrong))
        points = {field: _point(time, *(row.tolist() for row in state)) for field, state in states}
        goal.publish_feedback(message_type(f"{ACTION}_Feedback")(joint_names=names, **points))

    return step


def _result(code: ErrorCode, text: str) -> Any:
    return message_type(f"{ACTION}_Result")(error_code=int(code), error_string=text)


def _point(
    time: float, positions: list[float], velocities: Sequence[float] = (), accelerations: Sequence[float] = ()
) -> Any:
    """Return trajectory_msgs/msg/JointTrajectoryPoint."""
    return message_type("trajectory_msgs/msg/JointTrajectoryPoint")(
        positions=positions,
        velocities=list(velocities),
        accelerations=list(accelerations),
        time_from_start=duration_message(time),
    )
