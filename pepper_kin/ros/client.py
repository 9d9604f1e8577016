"""Client of a robot: certified motions by the action `follow_joint_trajectory`."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError, beside_limits
from pepper_kin.files.certified import refuse_unsafe
from pepper_kin.files.motion_points import MotionPoints
from pepper_kin.files.ros_file import ros_points
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.ros.controllers import ACTION
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.goal_motion import NEAR, STATE_TIMEOUT, STOP_TIME, GoalMotion
from pepper_kin.ros.joint_trajectory import message_of, seconds
from pepper_kin.ros.message_parts import duration_message
from pepper_kin.ros.qos import RELIABLE
from pepper_kin.ros.transport import Closable, Transport
from pepper_kin.ros_messages import message_type
from pepper_kin.supervision import (
    Clock,
    MotionEndedError,
    RobotMotionStatus,
    Supervisor,
    UnusableStateError,
)
from pepper_kin.trajectory import Trajectory

BEYOND = 0.5
"""Largest distance of a reported joint position beyond its limits [rad or m]."""

RESTART = 1.0
"""Time without joint states after which earlier stamps are accepted again [s]."""


@dataclass(frozen=True)
class FollowResult:
    """Outcome of a motion on the robot.

    Attributes:
        status: Status of the motion.
        message: Reason, in a sentence, and what is missing if rest is not confirmed.
        at_rest: Whether the robot was measured at rest, with its goal ended.
        error_code: Error code of the action's result; None without a result.
        duration: Duration of the motion [s].
        largest_error: Largest error of a joint's position in the feedback [rad].
    """

    status: RobotMotionStatus
    message: str
    at_rest: bool = True
    error_code: int | None = None
    duration: float = 0.0
    largest_error: float = 0.0

    @property
    def success(self) -> bool:
        """Whether the motion completed."""
        return self.status is RobotMotionStatus.COMPLETED

    def report(self) -> str:
        """Return the outcome and advice as text."""
        return f"{self.message} {self.status.advice}"


class RobotClient(Closable):
    """Client of a robot, real or simulated, through a transport.

    Args:
        transport: Transport of the messages; it stays open when the client closes.
        pepper: Model of the robot; Pepper with hands of one joint if omitted.
        controller: Name of the robot's controller.
        topic: Topic of the joint states.
        joint_names: The model's name of a joint -> the robot's name, where they differ.

    Raises:
        TransportError: if the transport cannot subscribe.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        pepper: PepperModel | None = None,
        controller: str = "joint_trajectory_controller",
        topic: str = "/joint_states",
        joint_names: Mapping[str, str] | None = None,
    ) -> None:
        self.transport, self.controller = transport, controller
        self.pepper = load_pepper(hands="mimic") if pepper is None else pepper
        self._theirs = dict(joint_names or {})
        self._ours = {theirs: ours for ours, theirs in self._theirs.items()}
        self.clock = Clock()
        self._lock = threading.Lock()
        self._states: dict[str, _JointState] = {}
        self._trouble = ""
        self._last_trouble = (float("-inf"), "")
        self._motions: set[Supervisor[Any]] = set()
        self._subscription = transport.subscribe(
            topic, "sensor_msgs/msg/JointState", RELIABLE, self._on_joint_states
        )

    def close(self) -> None:
        """Stop running motions, wait for their end, and end the subscription."""
        self.stop()
        end = self.clock.now() + STOP_TIME
        while self._motions and self.clock.now() < end:
            self.clock.sleep(0.01)
        self._subscription.close()

    @property
    def age(self) -> float:
        """Time since the last joint states arrived [s]; infinite before the first."""
        with self._lock:
            heard = max((state.heard_at for state in self._states.values()), default=float("-inf"))
        return self.clock.now() - heard

    def joint_positions(self, timeout: float = 5.0) -> dict[str, float]:
        """Return the joint positions, by the model's names [rad or m].

        Args:
            timeout: Maximum time to wait for joint states younger than half a second [s].

        Raises:
            TransportError: if none arrive.
        """
        end = self.clock.now() + timeout
        while self.age >= STATE_TIMEOUT:
            if self.clock.now() >= end:
                trouble = f" ({self._trouble})" if self._trouble else ""
                raise TransportError(
                    "joint states", f"none arrived within {timeout:g} s{trouble}; is the robot there?"
                )
            self.clock.sleep(0.005)
        with self._lock:
            return {name: state.position for name, state in self._states.items()}

    def configuration(self, timeout: float = 5.0) -> Array:
        """Return the joint positions in the model's order [rad or m], shape (n,).

        Joints that the robot does not report have the model's neutral position.

        Args:
            timeout: Maximum time to wait for joint states younger than half a second [s].

        Raises:
            TransportError: if none arrive.
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
        """Follow a trajectory that passes its certificate; return when the motion has ended.

        The robot is stopped, until it is measured at rest, if joint states stop arriving or are not finite,
        or if the call is interrupted.

        Args:
            trajectory: Trajectory of the model's joints.
            scene: Obstacles and attached objects for the certificate.
            payload: Point masses for the certificate, by hand or frame [kg].
            joints: Names of the joints to send; the moving joints if omitted.
            path_tolerance: Largest position error of a joint during the motion [rad]; None for the
                controller's own.
            on_progress: Called with the time along the trajectory [s].

        Returns:
            Outcome of the motion.

        Raises:
            InvalidValueError: for a trajectory that fails its certificate, or one of other joints or of
                the base.
            TransportError: if the robot reports no joints.
        """
        if trajectory.joint_names != self.pepper.joint_names:
            raise InvalidValueError("trajectory", "one of other joints", f"one of {self.pepper.joint_names}")
        names = self._moved(trajectory) if joints is None else tuple(joints)

        def check() -> Any:
            refuse_unsafe(trajectory, self.pepper, scene, payload, unchecked=False, advice="")
            away = self._away(trajectory, names)
            if away:
                raise MotionEndedError(RobotMotionStatus.NOT_AT_START, away)
            points = ros_points(trajectory, pepper=self.pepper, scene=scene, payload=payload)
            return self._goal_of(points, names, path_tolerance)

        end = {name: float(trajectory.end[trajectory.joint_names.index(name)]) for name in names}
        motion = GoalMotion(self, end, check, on_progress, trajectory.duration)
        supervisor = Supervisor(motion, self.clock)
        begin = self.clock.now()
        self._motions.add(supervisor)
        try:
            ended = supervisor.run()
        finally:
            self._motions.discard(supervisor)
        message = ended.message or "The end was reached."
        return FollowResult(
            ended.status, message, ended.at_rest, motion.code, self.clock.now() - begin, motion.worst
        )

    def stop(self) -> None:
        """Stop running motions, also during their certificate's check; they end at measured rest."""
        for supervisor in tuple(self._motions):
            supervisor.request_stop()

    def _moved(self, trajectory: Trajectory) -> tuple[str, ...]:
        """Return the joints that a trajectory moves; raise if it moves the base or nothing."""
        size = np.abs(trajectory.coefficients[:, 1:]).max(axis=(0, 1))
        names = tuple(n for n, s in zip(trajectory.joint_names, size, strict=True) if s > 1e-9)
        base = [name for name in names if name.startswith("Base")]
        if base or not names:
            moved = ", ".join(base) or "nothing"
            raise InvalidValueError("trajectory", f"one that moves {moved}", "one that moves joints")
        return names

    def _away(self, trajectory: Trajectory, names: Sequence[str]) -> str:
        """Return which joint is not at the start of the trajectory; "" if all are.

        Joints that are not sent have to be there as well, if the robot reports them: the certificate covers
        all joints.
        """
        here = self.joint_positions()
        for name, wanted in zip(trajectory.joint_names, trajectory.start.tolist(), strict=True):
            if name not in here:
                if name in names:
                    return f"The robot states no joint {name}."
                continue
            if not abs(here[name] - wanted) <= NEAR:
                return f"{name} is at {here[name]:.3f} rad, the motion starts at {wanted:.3f} rad."
        return ""

    def _goal_of(self, points: MotionPoints, names: Sequence[str], tolerance: float | None) -> Any:
        """Return control_msgs/action/FollowJointTrajectory_Goal."""
        message = message_of(points, names)
        message.joint_names = [self._theirs.get(name, name) for name in names]
        goal = message_type(f"{ACTION}_Goal")(trajectory=message)
        if tolerance is not None:
            kind = message_type("control_msgs/msg/JointTolerance")
            goal.path_tolerance = [kind(name=name, position=tolerance) for name in message.joint_names]
        goal.goal_time_tolerance = duration_message(2.0)
        return goal

    def positions_of(self, names: Sequence[str]) -> tuple[float, list[float]]:
        """Return the joints' positions [rad or m], and the earliest arrival time of their states [s].

        Raises:
            UnusableStateError: if the last message was malformed, or a joint is not reported.
        """
        with self._lock:
            if self._trouble:
                raise UnusableStateError(self._trouble)
            missing = [name for name in names if name not in self._states]
            if missing:
                raise UnusableStateError(f"no joint {missing[0]}")
            states = [self._states[name] for name in names]
        return min(state.heard_at for state in states), [state.position for state in states]

    def _beyond_limits(self, names: Sequence[str], positions: Array) -> str:
        """Return which joint of the model is impossibly far beyond its limits; "" if none is.

        Args:
            names: Names of the joints.
            positions: Positions of the joints [rad or m], shape (k,).
        """
        for name, position in zip(names, positions.tolist(), strict=True):
            if name in self.pepper.joint_names:
                k = self.pepper.joint_index(name)
                lower, upper = self.pepper.lower_limits[k], self.pepper.upper_limits[k]
                if not lower - BEYOND <= position <= upper + BEYOND:
                    got, *limits = beside_limits(position, lower, upper, outside=True, digits=6)
                    return f"position of {name}: got {got}, expected {' to '.join(limits)}"
        return ""

    def trouble_since(self, time: float) -> str:
        """Return the last fault of joint states that arrived since a time [s]; "" if there was none."""
        with self._lock:
            at, trouble = self._last_trouble
        return trouble if at >= time else ""

    def _on_joint_states(self, message: Any) -> None:
        """Store the positions of a message, or its fault."""
        now, stamp = self.clock.now(), seconds(message.header.stamp)
        names = [self._ours.get(name, name) for name in message.name]
        positions = np.asarray(message.position, dtype=float)
        trouble = ""
        if len(positions) != len(names):
            trouble = (
                f"joint states have {len(positions)} positions, expected {len(names)}, one for each name"
            )
        elif not np.isfinite(positions).all():
            k = int(np.argmin(np.isfinite(positions)))
            trouble = f"position of {names[k]}: got {positions[k]}, expected a finite number"
        else:
            trouble = self._beyond_limits(names, positions)
        with self._lock:
            self._trouble = trouble
            if trouble:
                self._last_trouble = (now, trouble)
                return
            for name, position in zip(names, positions.tolist(), strict=True):
                last = self._states.get(name)
                if last is None or stamp == 0.0 or stamp > last.stamp or now > last.heard_at + RESTART:
                    self._states[name] = _JointState(position, stamp, now)  # no late or repeated message


@dataclass(frozen=True)
class _JointState:
    """Position of a joint [rad or m], stamp of the message [s] and its arrival time [s]."""

    position: float
    stamp: float
    heard_at: float
