"""Base class of all modules, and the list of a robot's methods."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.naoqi.errors import (
    MissingMethodError,
    NaoqiError,
    NotSimulatedError,
    RefusedByRobotError,
    quoted,
)
from pepper_kin.naoqi.simple_methods import simple_methods
from pepper_kin.naoqi.tables import rows, table

if TYPE_CHECKING:
    from pepper_kin.naoqi.body import Body
    from pepper_kin.naoqi.broker import Broker

VERSION = "2.5.10"
"""Version of NAOqi whose methods are listed."""


@dataclass(frozen=True)
class MethodSignature:
    """A method in the robot's list.

    Attributes:
        module: Name of the module, "ALMotion".
        name: Name of the method, "setAngles".
        parameters: Name and type of each parameter.
        returns: Type of the returned value.
    """

    module: str
    name: str
    parameters: tuple[tuple[str, str], ...]
    returns: str

    def __str__(self) -> str:
        """Return "ALMotion.setAngles(names: any, angles: any, fractionMaxSpeed: float32) -> void"."""
        inner = ", ".join(f"{name}: {kind}" for name, kind in self.parameters)
        return f"{self.module}.{self.name}({inner}) -> {self.returns}"


@functools.cache
def robot_signatures() -> tuple[MethodSignature, ...]:
    """Return the public methods of a robot's ALMotion, ALRobotPosture, ALMemory and ALAnimatedSpeech."""
    found = []
    for row in rows("signatures"):
        pairs = (pair.partition(": ") for pair in row["parameters"].split("; ") if pair)
        parameters = tuple((name, kind) for name, _, kind in pairs)
        found.append(MethodSignature(row["module"], row["name"], parameters, row["returns"]))
    return tuple(found)


HELPERS = ("fail", "number", "numbers", "share")
"""Methods of `Module` that the robot does not have, besides names with an underscore."""


class Module:
    """A module of NAOqi.

    Args:
        broker: The simulated robot with all its modules.

    Attributes:
        name: Name of the module, "ALMotion".
        not_simulated: Method -> reason why it is not simulated.
        kept: Values that simple methods keep.
    """

    name = "ALModule"
    not_simulated: dict[str, str] = {}  # noqa: RUF012

    def __init__(self, broker: Broker) -> None:
        self.broker = broker
        self.kept: dict[tuple[Any, ...], Any] = {}

    def __init_subclass__(cls) -> None:
        """Add the module's simple methods."""
        if "name" in vars(cls):
            _add_simple_methods(cls)

    @property
    def body(self) -> Body:
        """The simulated body."""
        return self.broker.body

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """Return a function that raises NotSimulatedError with the reason, for a method of the robot."""
        if name.startswith("_"):
            raise AttributeError(name)
        why = self.not_simulated.get(name)
        if why is None:
            listed = any(s.module == self.name and s.name == name for s in robot_signatures())
            if not listed and name not in table("modules")["not_simulated"].get(self.name, ()):
                raise MissingMethodError(self.name, name, get_close_matches(name, self.getMethodList(), 2))
            why = "the twin has nothing that it could act on"

        def refuse(*_: object) -> None:
            raise NotSimulatedError(self.name, name, why)

        return refuse

    # Methods of every module on the robot.

    def pCall(self, method: str, *arguments: Any) -> int:
        """Call a method asynchronously; return the call's number for `wait`."""
        return self.broker.post(functools.partial(getattr(self, method), *arguments))

    def version(self) -> str:
        """Return the version of NAOqi."""
        return VERSION

    def getMethodList(self) -> list[str]:
        """Return the names of all methods."""
        own = [
            name
            for name, value in inspect.getmembers(type(self), inspect.isfunction)
            if name[0].islower() and "_" not in name and name not in HELPERS
        ]
        listed = [s.name for s in robot_signatures() if s.module == self.name]
        return sorted({*own, *listed})

    def getMethodHelp(self, methodName: str) -> str:
        """Return the description of a method."""
        method = getattr(self, methodName)
        return inspect.getdoc(method) or ""

    def getModuleHelp(self) -> str:
        """Return the description of the module."""
        return inspect.getdoc(type(self)) or ""

    def wait(self, id: int, timeoutPeriod: int = 0) -> bool:
        """Wait for a posted call.

        Return whether it is still running after the timeout [ms]; 0 waits without a limit.
        """
        return self.broker.wait_for(int(id), timeoutPeriod / 1000.0 if timeoutPeriod > 0 else None)

    def isRunning(self, id: int) -> bool:
        """Return whether a posted call is running."""
        return self.broker.is_running(int(id))

    def stop(self, id: int) -> None:
        """Stop a posted call."""
        self.broker.stop_call(int(id))

    def getUsage(self, name: str) -> str:
        """Return the signatures of a method, or its description if none is listed."""
        known = [str(s) for s in robot_signatures() if s.module == self.name and s.name == name]
        return "\n".join(known) or self.getMethodHelp(name)

    # Helpers of the modules.

    def fail(self, method: str, reason: str) -> NaoqiError:
        """Return the error of a method."""
        return NaoqiError(self.name, method, reason)

    def _instead(self, _method: str, *arguments: Any) -> Any:
        """Call the method that the last argument names; rows of old names use this."""
        return getattr(self, arguments[-1])(*arguments[:-1])

    def robot_refuses(self, method: str, why: str) -> None:
        """Refuse a call in the mode "robot".

        Raises:
            RefusedByRobotError: in the mode "robot".
        """
        if self.body.mode == "robot":
            raise RefusedByRobotError(self.name, method, why)

    def number(self, method: str, quantity: str, value: Any) -> float:
        """Return a finite number.

        Raises:
            NaoqiError: for anything else.
        """
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise self.fail(method, f"{quantity}: got {quoted(value)}, expected a number") from None
        if not np.isfinite(number):
            raise self.fail(method, f"{quantity}: got {quoted(value)}, expected a finite number")
        return number

    def numbers(self, method: str, quantity: str, value: Any, count: int | None = None) -> list[float]:
        """Return a list of finite numbers, of a given length if `count`; a single number counts as a list."""
        if isinstance(value, int | float | np.number) and not isinstance(value, bool):
            value = [value]
        if isinstance(value, str | bytes | dict) or not isinstance(value, Iterable):
            raise self.fail(method, f"{quantity}: got {quoted(value)}, expected a list of numbers")
        found = [self.number(method, quantity, one) for one in value]
        if count is not None and len(found) != count:
            raise self.fail(method, f"{quantity}: got {len(found)} numbers, expected {count}")
        return found

    def share(self, method: str, quantity: str, value: Any) -> float:
        """Return a number above 0 and at most 1."""
        number = self.number(method, quantity, value)
        if not 0.0 < number <= 1.0:
            raise self.fail(method, f"{quantity}: got {number:g}, expected a number above 0 and at most 1")
        return number


def _add_simple_methods(kind: type[Module]) -> None:
    for name, method in simple_methods(kind.name).items():
        setattr(kind, name, method)


_add_simple_methods(Module)
