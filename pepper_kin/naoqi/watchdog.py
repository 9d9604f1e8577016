"""The watchdog of `on_robot` as a module of the simulated robot."""

from __future__ import annotations

from typing import Any

from pepper_kin.naoqi import on_robot
from pepper_kin.naoqi.module import Module


class MotionWatchdogModule(Module):
    """Stops joints and base when a client that armed it falls silent.

    A robot has it only where `pepper_kin/naoqi/on_robot.py` runs beside NAOqi.
    """

    name = on_robot.NAME

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._watchdog = on_robot.MotionWatchdog(broker.motion)

    def arm(self, seconds: float, joints: Any) -> int:
        """Watch a client: the longest silence [s], and the joints that it moves; return its number."""
        limit = self.number("arm", "seconds", seconds)
        try:
            return self._watchdog.arm(limit, list(joints))
        except ValueError as error:
            raise self.fail("arm", str(error)) from error

    def beat(self, number: int) -> bool:
        """Say that a client is there; return False where it is not watched any more."""
        return self._watchdog.beat(int(self.number("beat", "number", number)))

    def disarm(self, number: int) -> bool:
        """Watch a client no longer; return whether it was watched."""
        return self._watchdog.disarm(int(self.number("disarm", "number", number)))

    def status(self, number: int) -> str:
        """Return "armed", "disarmed", "unknown", or why the robot was stopped."""
        return self._watchdog.status(int(self.number("status", "number", number)))


MODULES = (MotionWatchdogModule,)
