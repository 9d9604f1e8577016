"""Errors of NAOqi's calls, in the format of the robot's messages."""

from __future__ import annotations

from pepper_kin.exceptions import PepperKinError, shortened

__all__ = [
    "MissingMethodError",
    "NaoqiError",
    "NotSimulatedError",
    "RefusedByRobotError",
    "RobotConnectionError",
]


class NaoqiError(PepperKinError, RuntimeError):
    """A call to a module failed: "ALMotion::setAngles", a line break, a tab, and the reason.

    Attributes:
        module: Name of the module ("ALMotion").
        method: Name of the method ("setAngles").
        reason: Reason of the failure.
    """

    def __init__(self, module: str, method: str, reason: str) -> None:
        self.module, self.method, self.reason = module, method, reason
        super().__init__(f"{module}::{method}\n\t{reason}")


class MissingMethodError(NaoqiError, AttributeError):
    """A method that the robot's module does not have either; also an AttributeError, for `hasattr`."""

    def __init__(self, module: str, method: str, near: list[str]) -> None:
        hint = f" (did you mean {' or '.join(near)}?)" if near else ""
        super().__init__(module, method, f"no such method{hint}")
        self.args = (f"{module}::{method}: {self.reason}",)


class NotSimulatedError(NaoqiError):
    """A method or a module that the robot has and the twin does not simulate."""

    def __init__(self, module: str, method: str, why: str) -> None:
        super().__init__(module, method, f"is not simulated: {why}")


class RefusedByRobotError(NaoqiError):
    """A call that Pepper itself refuses; it works in the mode "twin"."""

    def __init__(self, module: str, method: str, why: str) -> None:
        super().__init__(module, method, f'{why} (mode "twin" does it, the robot does not)')


class RobotConnectionError(PepperKinError, ConnectionError):
    """The connection with a robot failed or was lost.

    Attributes:
        url: Address of the robot.
        reason: Attempted operation and its outcome.
    """

    def __init__(self, url: str, reason: str) -> None:
        self.url, self.reason = url, reason
        super().__init__(f"{url}: {reason}")


def quoted(value: object) -> str:
    """Return a value for a message, in quotes and cut at 80 characters."""
    return shortened(repr(value))
