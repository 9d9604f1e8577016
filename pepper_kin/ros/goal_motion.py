"""A goal of `follow_joint_trajectory`, watched by joint states, for a supervisor."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from pepper_kin.ros.controllers import ACTION
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.joint_trajectory import ErrorCode, seconds
from pepper_kin.ros.transport import GoalHandle, GoalStatus
from pepper_kin.supervision import (
    MotionEndedError,
    RestMeter,
    RobotMotionStatus,
    SupervisedMotion,
    UnusableStateError,
)

if TYPE_CHECKING:
    from pepper_kin.ros.client import RobotClient

STATE_TIMEOUT = 0.5
"""Maximum age of joint states during a motion [s]."""

NEAR = 0.05
"""Largest deviation of a joint from the start of a motion, and from its end [rad]."""

SETTLE = 2.0
"""Maximum time to come to rest after the action's success [s]."""

SLOWEST, LATEST = 3.0, 10.0
"""Maximum time of a result: multiple of the motion's duration, plus a time [s]; simulations may be slow."""

CANCEL_AGAIN, CANCEL_WAIT = 0.2, 0.2
"""Time between two cancel requests, and timeout of their answers [s]."""

STOP_TIME = 5.0
"""Maximum time to wait for rest [s]."""


class GoalMotion(SupervisedMotion):
    """A motion as a goal of the action, watched by joint states.

    Args:
        client: Client of the robot.
        end: Joint -> position at the end [rad or m].
        check: Returns the goal to send; raises if the motion must not start.
        on_progress: Called with the time along the trajectory [s].
        duration: Duration of the motion [s].
    """

    stop_time = STOP_TIME
    ending_errors: ClassVar = (
        (TransportError, RobotMotionStatus.CONNECTION_LOST),
        (UnusableStateError, RobotMotionStatus.STATE_UNUSABLE),
    )

    def __init__(
        self,
        client: RobotClient,
        end: Mapping[str, float],
        check: Callable[[], Any],
        on_progress: Callable[[float], object] | None,
        duration: float,
    ) -> None:
        self._client, self._end, self._check = client, end, check
        self._longest = SLOWEST * duration + LATEST
        self._goal: Any = None
        self._on_progress = on_progress
        self._clock = client.clock
        self._rest = RestMeter(tuple(end))
        self._measured: deque[float] = deque([float("-inf")], maxlen=1)
        self._handle: GoalHandle | None = None
        self._canceled = float("-inf")
        self._ended: float | None = None
        self._begun = 0.0
        self._stepped = self._awake = float("-inf")
        self.code: int | None = None
        self.worst = 0.0

    @property
    def connected(self) -> bool:
        """Always True, as transports do not report it; the wait for rest has a timeout."""
        return True

    def check(self) -> None:
        """Raise if the motion must not start; else prepare the goal."""
        self._goal = self._check()

    def hand_over(self) -> bool:
        """Send the goal; return True."""
        self._begun = self._clock.now()
        name = f"/{self._client.controller}/follow_joint_trajectory"
        try:
            self._handle = self._client.transport.send_goal(name, ACTION, self._goal, self._feedback)
        except TransportError as error:
            raise MotionEndedError(RobotMotionStatus.REFUSED, str(error)) from error
        return True

    def _feedback(self, message: Any) -> None:
        self.worst = max(self.worst, float(np.abs(message.error.positions).max(initial=0.0)))
        if self._on_progress is not None:
            self._on_progress(seconds(message.desired.time_from_start))

    def step(self) -> bool:
        """Check the goal and the joint states; return whether the motion is complete."""
        assert self._handle is not None
        trouble = self._client.trouble_since(self._begun)
        if trouble:
            raise UnusableStateError(trouble)
        positions = self._measure()
        now = self._clock.now()
        if not self._handle.done:
            if now > self._begun + self._longest:
                text = f"no result of the action came within {self._longest:.0f} s"
                raise MotionEndedError(RobotMotionStatus.CONNECTION_LOST, text)
            return False
        if self._ended is None:
            self._look_at_result()
            self._ended = now
        moving = self._rest.moving(self._ended, now)
        off = {name: abs(q - end) for (name, end), q in zip(self._end.items(), positions, strict=True)}
        worst = max(off, key=lambda name: off[name])
        if not moving and off[worst] <= NEAR:
            return True
        if now > self._ended + SETTLE:
            text = moving or f"{worst} is {off[worst]:.3f} rad from the end"
            raise MotionEndedError(
                RobotMotionStatus.DEVIATED, f"{SETTLE:g} s after the robot's success {text}"
            )
        return False

    def _measure(self) -> list[float]:
        """Return the joints' positions, and record them for the detection of rest."""
        heard, positions = self._client.positions_of(tuple(self._end))
        now = self._clock.now()
        if now > self._stepped + STATE_TIMEOUT / 2.0:
            self._awake = now  # this process itself paused: give states time to arrive
        self._stepped = now
        age = now - max(heard, self._awake)
        if age > STATE_TIMEOUT:
            raise UnusableStateError(f"no joint states arrived for {age:.1f} s")
        if heard > self._measured[-1]:
            self._measured.append(heard)
            self._rest.add(heard, positions)
        return positions

    def _look_at_result(self) -> None:
        """Raise MotionEndedError if the goal did not succeed."""
        assert self._handle is not None
        try:
            found = self._handle.result(0.0)
        except TransportError as error:
            raise MotionEndedError(RobotMotionStatus.REFUSED, str(error)) from error
        if found.status is GoalStatus.UNKNOWN:
            raise MotionEndedError(RobotMotionStatus.CONNECTION_LOST, "The connection was lost.")
        self.code, text = int(found.result.error_code), str(found.result.error_string)
        if found.status is GoalStatus.CANCELED:
            raise MotionEndedError(RobotMotionStatus.STOPPED, f"Canceled: {text}.")
        if found.status is not GoalStatus.SUCCEEDED or self.code != ErrorCode.SUCCESSFUL:
            raise MotionEndedError(RobotMotionStatus.ABORTED, f"Aborted with {self.code}: {text}.")

    def stop(self) -> str:
        """Cancel the goal until it has ended, then wait for measured rest."""
        now, handle = self._clock.now(), self._handle
        trouble = ""
        try:
            self._measure()
        except UnusableStateError as error:
            trouble = error.reason
        if handle is not None and not handle.done:
            self._ended = None
            if now >= self._canceled + CANCEL_AGAIN:
                self._canceled = now
                handle.cancel(CANCEL_WAIT)
            return "the goal has not ended yet"
        if handle is not None and handle.accepted and handle.result(0.0).status is GoalStatus.UNKNOWN:
            return "whether the goal has ended is not known"
        self._ended = now if self._ended is None else self._ended
        moving = self._rest.moving(self._ended, now)
        return f"{moving} ({trouble})" if moving and trouble else moving
