"""A connection with a robot's NAOqi in which every wait has a timeout."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from pepper_kin.naoqi.errors import NaoqiError, RobotConnectionError
from pepper_kin.naoqi.qi_library import libqi

PORT = 9559
"""TCP port of NAOqi."""

ANSWER = 5.0
"""Default timeout of an answer [s]."""


class RobotLink:
    """A session of libqi with a timeout on every wait.

    Args:
        url: Address, "tcp://pepper.local:9559".
        token: Token for the service "Access" of a simulated robot that requires one.
        timeout: Timeout of each answer [s].

    Raises:
        MissingDependencyError: if `qi` is not installed.
        RobotConnectionError: if nothing answers.
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
        """Raise if nothing listens at an address, because libqi's own attempt may never end.

        It does not end in processes that loaded coal before libqi; see `pepper_kin.naoqi.qi_library`.
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
        except (OSError, UnicodeError) as error:  # UnicodeError for names that no host can have
            reason = getattr(error, "strerror", None) or error
            raise RobotConnectionError(url, f"connect: {reason}") from error

    @property
    def alive(self) -> bool:
        """Whether the session is connected, as far as libqi knows."""
        return bool(self._session.isConnected())

    def close(self) -> None:
        """Close the connection."""
        self._services.clear()
        self._opened = None
        self._session.close(_async=True).wait(int(1000 * self.timeout))

    def names(self) -> list[str]:
        """Return the names of the robot's services."""
        found = self.value(self._session.services(_async=True), "services")
        return [str(one["name"]) for one in found]

    def service(self, name: str) -> Any:
        """Return a service of the robot; it is looked up once."""
        if name not in self._services:
            source = self._session if self._opened is None else self._opened
            self._services[name] = self.value(source.service(name, _async=True), f"service {name}")
        return self._services[name]

    def start(self, module: str, method: str, *arguments: Any) -> Any:
        """Start a call; return its future."""
        try:
            return getattr(self.service(module), method)(*arguments, _async=True)
        except (RuntimeError, AttributeError) as error:
            if not self.alive:
                raise RobotConnectionError(self.url, f"lost before {module}.{method}") from error
            raise NaoqiError(module, method, str(error)) from error

    def call(self, module: str, method: str, *arguments: Any, timeout: float | None = None) -> Any:
        """Call a method and return its value.

        Args:
            module: Name of the module, "ALMotion".
            method: Name of the method, "getAngles".
            arguments: Arguments of the method.
            timeout: Timeout [s]; the connection's timeout if omitted.

        Raises:
            RobotConnectionError: if the connection is lost, or no answer comes in time.
            NaoqiError: if the robot returned an error.
        """
        return self.value(self.start(module, method, *arguments), f"{module}.{method}", timeout)

    def value(self, future: Any, what: str, timeout: float | None = None) -> Any:
        """Return the value of a future; raise the same errors as `call`."""
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
    """The methods of a module, as calls with a timeout."""

    def __init__(self, link: RobotLink, module: str) -> None:
        self._link, self._module = link, module

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return lambda *arguments: self._link.call(self._module, name, *arguments)
