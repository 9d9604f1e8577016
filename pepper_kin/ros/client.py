"""The client's side: certified motions on any robot with an action `follow_joint_trajectory`."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError, PepperKinError
from pepper_kin.files.certified import refuse_unsafe
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.ros.controllers import ACTION
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.joint_trajectory import ErrorCode, message_of, seconds
from pepper_kin.ros.message_parts import duration_message
from pepper_kin.ros.qos import RELIABLE
from pepper_kin.ros.transport import GoalHandle, GoalStatus, Transport
from pepper_kin.ros_messages import message_type
from pepper_kin.status import ResultStatus
from pepper_kin.trajectory import Trajectory

Array = NDArray[np.float64]

STATE_TIMEOUT = 0.5
"""Joint states that are older than this mean that the connection is lost [s]."""

NEAR = 0.05
"""How far the robot may be from the start of a motion [rad]."""

STEP = 0.05
"""Time between the points that are sent [s]."""


class FollowStatus(ResultStatus):
    """How a motion on the robot ended; `advice` says what to try."""

    REACHED = "reached", "The robot is at the end of the motion."
    REFUSED = "refused", "Read the message; the robot has not moved."
    ABORTED = "aborted", "Read the message, look at the robot, and plan again from where it is."
    CANCELED = "canceled", "Plan again from where the robot is."
    NOT_AT_START = "not_at_start", "Move the robot to the start of the motion, or plan from where it is."
    CONNECTION_LOST = (
        "connection_lost",
        "Look at the robot: its server ends motions of lost clients if it is ours, others may go on.",
    )


@dataclass(frozen=True)
class FollowResult:
    """How a motion on the robot ended.

    Attributes:
        status: Of the motion.
        message: What happened, in a sentence.
        error_code: Of the action's result; None where there is none.
        duration: How long it took [s].
        largest_error: Largest difference of a joint between wanted and actual in the feedback [rad].
    """

    status: FollowStatus
    message: str
    error_code: int | None = None
    duration: float = 0.0
    largest_error: float = 0.0

    @property
    def success(self) -> bool:
        """Whether the end was reached."""
        return self.status is FollowStatus.REACHED

    def report(self) -> str:
        """Return what happened and what to try."""
        return f"{self.message} {self.status.advice}"


class RobotClient:
    """A robot, or a simulated one, that is reached through a transport.

    Args:
        transport: How messages travel; it stays open when the client closes.
        pepper: The robot's model, whose names and units are used; Pepper with hands of one joint if omitted.
        controller: Name of the robot's controller.
        topic: Where it publishes joint states.
        joint_names: Our name of a joint -> the robot's, where they differ.

    Raises:
        TransportError: where the transport cannot subscribe.
    """

    def __init__(
        self,
        transport: Transport,
        pepper: PepperModel | None = None,
        *,
        controller: str = "joint_trajectory_controller",
        topic: str = "/joint_states",
        joint_names: Mapping[str, str] | None = None,
    ) -> None:
        self.transport, self.controller = transport, controller
        self.pepper = load_pepper(hands="mimic") if pepper is None else pepper
        self._theirs = dict(joint_names or {})
        self._ours = {theirs: ours for ours, theirs in self._theirs.items()}
        self._changed = threading.Condition()
        self._values: dict[str, tuple[float, float]] = {}
        self._heard_at, self._stamp = float("-inf"), 0.0
        self._goal: GoalHandle | None = None
        self._stopped = threading.Event()
        self._subscription = transport.subscribe(
            topic, "sensor_msgs/msg/JointState", RELIABLE, self._on_joint_states
        )

    def __enter__(self) -> RobotClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop a motion under way, and listen no more."""
        self.stop()
        self._subscription.close()

    @property
    def age(self) -> float:
        """Time since the last joint states arrived [s]; infinite before the first."""
        return time.monotonic() - self._heard_at

    def joint_positions(self, timeout: float = 5.0) -> dict[str, float]:
        """Return the positions of the joints, by our names [rad or m].

        Args:
            timeout: Time to wait for joint states that are not older than half a second [s].

        Raises:
            TransportError: where none arrive.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: self.age < STATE_TIMEOUT, timeout):
                raise TransportError(
                    "joint states", f"none arrived within {timeout:g} s; is the robot there?"
                )
            return {name: position for name, (position, _) in self._values.items()}

    def configuration(self, timeout: float = 5.0) -> Array:
        """Return the joint positions in the model's order [rad or m], shape (n,).

        Joints that the robot does not state are where the model is neutral.

        Args:
            timeout: As in `joint_positions`.

        Raises:
            TransportError: as in `joint_positions`.
        """
        q = np.array(self.pepper.neutral())
        for name, position in self.joint_positions(timeout).items():
            if name in self.pepper.joint_names:
                q[self.pepper.joint_index(name)] = position
        return q

    def follow(
        self,
        trajectory: Trajectory,
        *,
        scene: Any | None = None,
        payload: Mapping[str, float] | None = None,
        joints: Sequence[str] | None = None,
        path_tolerance: float | None = None,
        on_progress: Callable[[float], object] | None = None,
    ) -> FollowResult:
        """Let the robot follow a trajectory that passes its certificate; wait until it ends.

        It is stopped where its joint states stop arriving, or this call is interrupted.

        Args:
            trajectory: Of the model's joints.
            scene: What stands around the robot, for the certificate.
            payload: Point masses held, for the certificate, as `pepper_kin.trajectory.check` takes them.
            joints: Which joints are sent; those that move if omitted.
            path_tolerance: How far a joint may be from where it should be on the way [rad]; None for the
                controller's own.
            on_progress: Called with the time along the trajectory [s].

        Returns:
            How it ended.

        Raises:
            InvalidValueError: for a trajectory that fails its certificate, with what fails and by how much;
                or one of other joints.
            TransportError: where the robot, or its action, is not there.
        """
        if trajectory.joint_names != self.pepper.joint_names:
            raise InvalidValueError("trajectory", "one of other joints", f"one of {self.pepper.joint_names}")
        self._stopped.clear()
        refuse_unsafe(trajectory, self.pepper, scene, payload, unchecked=False, advice="")
        names = self._moved(trajectory) if joints is None else tuple(joints)
        away = self._away(trajectory, names)
        if away:
            return FollowResult(FollowStatus.NOT_AT_START, away)
        goal = self._goal_of(trajectory, names, path_tolerance)
        return self._follow(goal, trajectory.duration, on_progress)

    def _moved(self, trajectory: Trajectory) -> tuple[str, ...]:
        size = np.abs(trajectory.coefficients[:, 1:]).max(axis=(0, 1))
        names = tuple(n for n, s in zip(trajectory.joint_names, size, strict=True) if s > 1e-9)
        base = [name for name in names if name.startswith("Base")]
        if base or not names:
            moved = ", ".join(base) or "nothing"
            raise InvalidValueError("trajectory", f"one that moves {moved}", "one that moves joints")
        return names

    def _away(self, trajectory: Trajectory, names: Sequence[str]) -> str:
        """Return which joint is not where the trajectory starts; "" if all are there."""
        here = self.joint_positions()
        for name in names:
            if name not in here:
                return f"The robot states no joint {name}."
            wanted = float(trajectory.start[trajectory.joint_names.index(name)])
            if abs(here[name] - wanted) > NEAR:
                return f"{name} is at {here[name]:.3f} rad, the motion starts at {wanted:.3f} rad."
        return ""

    def _goal_of(self, trajectory: Trajectory, names: Sequence[str], tolerance: float | None) -> Any:
        """Return control_msgs/action/FollowJointTrajectory_Goal."""
        message = message_of(trajectory, STEP, names)
        message.joint_names = [self._theirs.get(name, name) for name in names]
        goal = message_type(f"{ACTION}_Goal")(trajectory=message)
        if tolerance is not None:
            kind = message_type("control_msgs/msg/JointTolerance")
            goal.path_tolerance = [kind(name=name, position=tolerance) for name in message.joint_names]
        goal.goal_time_tolerance = duration_message(2.0)
        return goal

    def _follow(
        self, goal: Any, duration: float, on_progress: Callable[[float], object] | None
    ) -> FollowResult:
        worst = 0.0

        def feedback(message: Any) -> None:
            nonlocal worst
            worst = max(worst, float(np.abs(message.error.positions).max(initial=0.0)))
            if on_progress is not None:
                on_progress(seconds(message.desired.time_from_start))

        if self._stopped.is_set():
            return FollowResult(FollowStatus.CANCELED, "Stopped before it began.")
        begin = time.monotonic()
        name = f"/{self.controller}/follow_joint_trajectory"
        handle = self._goal = self.transport.send_goal(name, ACTION, goal, feedback)
        try:
            if self._stopped.is_set():  # since the goal was sent
                self.stop()
            status, message, code = self._outcome(handle)
        except BaseException:
            self.stop()
            raise
        finally:
            self._goal = None
        return FollowResult(status, message, code, time.monotonic() - begin, worst)

    def _outcome(self, handle: GoalHandle) -> tuple[FollowStatus, str, int | None]:
        """Wait for the end of a goal, and watch the connection meanwhile."""
        while True:
            done = handle.done  # asked before: it may end just after the time to wait is over
            try:
                found = handle.result(0.1)
                break
            except TransportError as error:
                if done:
                    return FollowStatus.REFUSED, str(error), None
                if self.age > STATE_TIMEOUT:
                    self.stop()
                    lost = f"No joint states arrived for {self.age:.1f} s; the motion was canceled."
                    return FollowStatus.CONNECTION_LOST, lost, None
        if found.status is GoalStatus.UNKNOWN:
            return FollowStatus.CONNECTION_LOST, "The connection was lost.", None
        code, text = int(found.result.error_code), str(found.result.error_string)
        if found.status is GoalStatus.SUCCEEDED and code == ErrorCode.SUCCESSFUL:
            return FollowStatus.REACHED, "The end was reached.", code
        if found.status is GoalStatus.CANCELED:
            return FollowStatus.CANCELED, f"Canceled: {text}.", code
        return FollowStatus.ABORTED, f"Aborted with {code}: {text}.", code

    def stop(self) -> None:
        """Stop the motion under way, also one that is yet to be sent.

        Without effect where there is none, or the connection is lost.
        """
        self._stopped.set()
        goal = self._goal
        if goal is not None and not goal.done:
            try:
                goal.cancel(1.0)
            except PepperKinError:
                return  # lost: the result says so

    def _on_joint_states(self, message: Any) -> None:
        velocities = (
            message.velocity if len(message.velocity) == len(message.name) else [0.0] * len(message.name)
        )
        with self._changed:
            for name, position, velocity in zip(message.name, message.position, velocities, strict=False):
                self._values[self._ours.get(name, name)] = (float(position), float(velocity))
            self._heard_at, self._stamp = time.monotonic(), seconds(message.header.stamp)
            self._changed.notify_all()
