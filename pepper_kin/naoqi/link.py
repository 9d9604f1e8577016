"""A connection with a robot's NAOqi in which no wait is without a limit."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from pepper_kin.naoqi.errors import NaoqiError, RobotConnectionError
from pepper_kin.naoqi.qi_library import libqi

PORT = 9559
"""Where NAOqi listens."""

ANSWER = 5.0
"""The longest time that an answer takes [s]."""


class RobotLink:
    """A session of libqi with limits on its waits.

    Args:
        url: "tcp://pepper.local:9559".
        token: What the service "Access" of a simulated robot takes, where it needs one.
        timeout: The longest time that an answer takes [s].

    Raises:
        MissingDependencyError: where `qi` is not installed.
        RobotConnectionError: where nobody answers.
        NaoqiError: for a wrong token.
    """

    def __init__(self, url: str, token: str | None = None, timeout: float = ANSWER) -> None:
        qi = libqi()
        self.url, self.timeout = url, timeout
        self._running = qi.FutureState.Running
        self._session = qi.Session()
        self._services: dict[str, Any] = {}
        self._opened: Any = None
        self._look_for(url)
        self.value(self._session.connect(url, _async=True), "connect")
        if token is not None:
            access = self.service("Access")
            self._opened = self.value(access.unlock(token, _async=True), "Access.unlock")
            self._services.clear()

    def _look_for(self, url: str) -> None:
        """Refuse an address where nobody listens, before libqi does, which may then never let go.

        It does so in processes that loaded coal before it; see `pepper_kin.naoqi.qi_library`.
        """
        try:
            parts = urlsplit(url)
            host, port = parts.hostname, parts.port or PORT
        except ValueError as error:
            raise RobotConnectionError(url, f"connect: {error}") from error
        if host is None:
            raise RobotConnectionError(url, "connect: no host in it, expected tcp://HOST:PORT")
        try:
            socket.create_connection((host, port), self.timeout).close()
        except TimeoutError as error:
            raise RobotConnectionError(url, f"connect: no answer within {self.timeout:g} s") from error
        except (OSError, UnicodeError) as error:  # the second for names that no host has
            reason = getattr(error, "strerror", None) or error
            raise RobotConnectionError(url, f"connect: {reason}") from error

    @property
    def alive(self) -> bool:
        """Whether the connection stands, as far as the system knows."""
        return bool(self._session.isConnected())

    def close(self) -> None:
        """End the connection."""
        self._services.clear()
        self._opened = None
        self._session.close(_async=True).wait(int(1000 * self.timeout))

    def names(self) -> list[str]:
        """Return the names of the robot's services."""
        found = self.value(self._session.services(_async=True), "services")
        return [str(one["name"]) for one in found]

    def service(self, name: str) -> Any:
        """Return a service of the robot, which is looked up once."""
        if name not in self._services:
            source = self._session if self._opened is None else self._opened
            self._services[name] = self.value(source.service(name, _async=True), f"service {name}")
        return self._services[name]

    def start(self, module: str, method: str, *arguments: Any) -> Any:
        """Begin a call; return its future."""
        try:
            return getattr(self.service(module), method)(*arguments, _async=True)
        except (RuntimeError, AttributeError) as error:
            if not self.alive:
                raise RobotConnectionError(self.url, f"lost before {module}.{method}") from error
            raise NaoqiError(module, method, str(error)) from error

    def call(self, module: str, method: str, *arguments: Any, timeout: float | None = None) -> Any:
        """Call a method and return its value.

        Args:
            module: "ALMotion".
            method: "getAngles".
            arguments: Of the method.
            timeout: The longest time to wait [s]; that of the connection if omitted.

        Raises:
            RobotConnectionError: where the connection is lost, or no answer comes.
            NaoqiError: what the robot answered instead of a value.
        """
        return self.value(self.start(module, method, *arguments), f"{module}.{method}", timeout)

    def value(self, future: Any, what: str, timeout: float | None = None) -> Any:
        """Return the value of a future; the errors are those of `call`."""
        limit = self.timeout if timeout is None else timeout
        if future.wait(int(1000 * limit)) == self._running:
            with contextlib.suppress(RuntimeError):
                future.cancel()
            raise RobotConnectionError(self.url, f"{what}: no answer within {limit:g} s")
        if future.hasError(0):
            reason = str(future.error(0))
            if what == "connect":
                raise RobotConnectionError(self.url, f"connect: {reason}")
            if not self.alive:
                raise RobotConnectionError(self.url, f"{what}: the connection was lost ({reason})")
            module, _, method = what.partition(".")
            raise NaoqiError(module, method or "service", reason.partition("\n\t")[2] or reason)
        return future.value(0)

    def proxy(self, module: str) -> Any:
        """Return an object whose methods are the calls of a module, for `on_robot.hold`."""
        return _Proxy(self, module)


class _Proxy:
    """The methods of a module as calls with a limit."""

    def __init__(self, link: RobotLink, module: str) -> None:
        self._link, self._module = link, module

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return lambda *arguments: self._link.call(self._module, name, *arguments)
