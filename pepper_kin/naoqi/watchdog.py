"""The watchdog of `on_robot` as a module of the simulated robot."""

from __future__ import annotations

from typing import Any

from pepper_kin.naoqi import on_robot
from pepper_kin.naoqi.module import Module


class MotionWatchdogModule(Module):
    """Passes commands of clients on, and stops joints and base when one falls silent.

    A robot has it only where `pepper_kin/naoqi/on_robot.py` runs beside NAOqi.
    """

    name = on_robot.NAME

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self.watchdog = on_robot.MotionWatchdog(broker.motion)

    def protocol(self) -> int:
        """Return the version of these methods."""
        return self.watchdog.protocol()

    def arm(self, seconds: float, joints: Any, base: Any) -> int:
        """Watch a motion: longest silence [s], joints it moves, whether the base; return its token."""
        limit = self.number("arm", "seconds", seconds)
        try:
            return self.watchdog.arm(limit, list(joints), base)
        except ValueError as error:
            raise self.fail("arm", str(error)) from error

    def command(self, token: int, number: int, calls: Any) -> str:
        """Pass calls of "setAngles" and "move" on; return the motion's state."""
        token, number = self._whole("command", token=token, number=number)
        return self.watchdog.command(token, number, calls)

    def add(self, token: int, number: int, part: Any) -> str:
        """Keep a part of the times and keys of `start`; return the motion's state."""
        token, number = self._whole("add", token=token, number=number)
        return self.watchdog.add(token, number, part)

    def start(self, token: int, number: int, method: str, arguments: Any) -> str:
        """Begin "moveTo" or "angleInterpolationBezier"; return the motion's state."""
        token, number = self._whole("start", token=token, number=number)
        return self.watchdog.start(token, number, str(method), arguments)

    def beat(self, token: int) -> str:
        """Say that a client is there; return the motion's state."""
        return self.watchdog.beat(*self._whole("beat", token=token))

    def release(self, token: int) -> str:
        """Watch a motion no longer; return its state."""
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
