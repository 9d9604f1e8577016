"""The watchdog of `on_robot` as a module of the simulated robot."""

from __future__ import annotations

from typing import Any

from pepper_kin.naoqi import on_robot
from pepper_kin.naoqi.module import Module


class MotionWatchdogModule(Module):
    """Service that forwards clients' commands, and stops joints and base when heartbeats are missing.

    A real robot has it only while `pepper_kin/naoqi/on_robot.py` runs on it.
    """

    name = on_robot.NAME

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self.watchdog = on_robot.MotionWatchdog(broker.motion)

    def protocol(self) -> int:
        """Return the version of the methods."""
        return self.watchdog.protocol()

    def arm(self, seconds: float, joints: Any, base: Any) -> int:
        """Watch a motion with its maximum silence [s], joints and use of the base; return its token."""
        limit = self.number("arm", "seconds", seconds)
        try:
            return self.watchdog.arm(limit, list(joints), base)
        except ValueError as error:
            raise self.fail("arm", str(error)) from error

    def command(self, token: int, number: int, calls: Any) -> str:
        """Forward calls of "setAngles" and "move"; return the motion's state."""
        token, number = self._whole("command", token=token, number=number)
        return self.watchdog.command(token, number, calls)

    def add(self, token: int, number: int, part: Any) -> str:
        """Store a part of the times and keys for `start`; return the motion's state."""
        token, number = self._whole("add", token=token, number=number)
        return self.watchdog.add(token, number, part)

    def start(self, token: int, number: int, method: str, arguments: Any) -> str:
        """Start "moveTo" or "angleInterpolationBezier"; return the motion's state."""
        token, number = self._whole("start", token=token, number=number)
        return self.watchdog.start(token, number, str(method), arguments)

    def beat(self, token: int) -> str:
        """Record a heartbeat of the client; return the motion's state."""
        return self.watchdog.beat(*self._whole("beat", token=token))

    def release(self, token: int) -> str:
        """Stop watching a complete motion; return its state."""
        return self.watchdog.release(*self._whole("release", token=token))

    def halt(self, token: int, why: str) -> str:
        """End a motion, or all (0), and hold the robot until it is at rest; return the motion's state."""
        (token,) = self._whole("halt", token=token)
        return self.watchdog.halt(token, str(why))

    def status(self, token: int) -> str:
        """Return the state of a motion."""
        return self.watchdog.status(*self._whole("status", token=token))

    def _whole(self, method: str, **numbers: Any) -> tuple[int, ...]:
        return tuple(int(self.number(method, name, value)) for name, value in numbers.items())


MODULES = (MotionWatchdogModule,)
