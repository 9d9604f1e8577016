"""The client's side of the watchdog: beats while a motion goes on."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from pepper_kin.naoqi import on_robot
from pepper_kin.naoqi.errors import RobotConnectionError
from pepper_kin.naoqi.following import RobotMotionStatus
from pepper_kin.naoqi.link import Link

BEAT = 0.1
"""Time between two beats [s]."""


class MotionEndedError(RuntimeError):
    """A motion came to its end before its time.

    Args:
        status: How it ended.
        message: Why.
    """

    def __init__(self, status: RobotMotionStatus, message: str) -> None:
        self.status, self.message = status, message
        super().__init__(f"{status.value}: {message}")


class Guard:
    """A watchdog on the robot that is held off by beats; without one it does nothing.

    Args:
        link: The connection.
        silence: The longest time between two beats [s].
        joints: What the watchdog stops, besides the base.
        present: Whether the robot has a watchdog.
    """

    def __init__(self, link: Link, silence: float, joints: list[str], present: bool) -> None:
        self._link, self._silence = link, silence
        self._number = link.call(on_robot.NAME, "arm", silence, joints) if present else None
        self._sent = time.monotonic()
        self._answers: deque[tuple[float, Any]] = deque()

    def beat(self) -> None:
        """Send a beat where one is due; after a silence that was too long wait for its answer.

        Raises:
            MotionEndedError: where the watchdog has stopped the robot.
            RobotConnectionError: where no answer came in time.
        """
        now = time.monotonic()
        if self._number is None or now < self._sent + BEAT:
            return
        silent = now > self._sent + self._silence
        self._answers.append((now, self._link.start(on_robot.NAME, "beat", self._number)))
        self._sent = now
        while self._answers and (silent or self._answers[0][1].isFinished()):
            if not self._link.value(self._answers.popleft()[1], f"{on_robot.NAME}.beat"):
                raise MotionEndedError(RobotMotionStatus.STALLED, f"the watchdog has {self.status()}")
        if self._answers and now > self._answers[0][0] + self._link.timeout:
            raise RobotConnectionError(self._link.url, "the watchdog's answer is missing")

    def status(self) -> str:
        """Return what the watchdog says about this motion."""
        return str(self._link.call(on_robot.NAME, "status", self._number))

    def release(self) -> None:
        """Be watched no longer, whatever the watchdog has done."""
        if self._number is not None:
            self._link.call(on_robot.NAME, "disarm", self._number)

    def end(self) -> None:
        """Be watched no longer.

        Raises:
            MotionEndedError: where the watchdog has stopped the robot.
        """
        if self._number is not None and not self._link.call(on_robot.NAME, "disarm", self._number):
            raise MotionEndedError(RobotMotionStatus.STALLED, f"the watchdog has {self.status()}")
