"""Rosbridge server: JSON over web sockets, for roslibpy, roslib and other clients."""

from __future__ import annotations

import asyncio
import logging
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from pepper_kin.kernels.threads import OWN_THREADS
from pepper_kin.ros.transports.local import LocalTransport
from pepper_kin.ros.transports.rosbridge_json import LARGEST_TEXT
from pepper_kin.servers.access import Access, is_loopback
from pepper_kin.servers.connection_gate import listening_sockets

if TYPE_CHECKING:
    from pepper_kin.ros.transports.rosbridge_session import RosbridgeSession

logger = logging.getLogger(__name__)

DEFAULT_PORT = 9090
"""Default TCP port of rosbridge servers."""

END_SECONDS = 5.0
"""Maximum time that the server waits for open work when it ends [s]."""

RISK = "others could move the robot, plan on this machine, and see what its cameras see"


class RosbridgeServer(LocalTransport):
    """Server that shares topics, services and actions between this program and rosbridge clients.

    Args:
        host: Host name or address on which to listen.
        port: TCP port on which to listen; 0 for any free port.
        allow_remote: Whether other machines may reach the host; the address has a token then.
        token: The token; None draws one if other machines can reach the server, else uses none.

    Attributes:
        access: Rules for connections.
        port: TCP port on which the server listens.

    Raises:
        InvalidValueError: for an invalid port, or a host beyond loopback without `allow_remote`.
        InfeasibleError: if the port is in use.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        *,
        allow_remote: bool = False,
        token: str | None = None,
    ) -> None:
        super().__init__()
        self.access = Access.of(host, allow_remote, token, risk=RISK)
        self._sockets = listening_sockets("rosbridge", host, port)
        self.port = int(self._sockets[0].getsockname()[1])
        self.sessions: set[RosbridgeSession] = set()
        self.executor = ThreadPoolExecutor(16, thread_name_prefix=f"{OWN_THREADS}-rosbridge")
        self._loop = asyncio.SelectorEventLoop()
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rosbridge", daemon=True)
        self._thread.start()
        self._started.wait()

    @property
    def url(self) -> str:
        """URL for clients, with the token if one is needed."""
        token = "" if self.access.token is None else f"?token={self.access.token}"
        return f"ws://{self.access.shown_host}:{self.port}/{token}"

    def close(self) -> None:
        """End the server and close all open parts."""
        if self._thread.is_alive():
            super().close()
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()
            self.executor.shutdown(wait=False, cancel_futures=True)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        from pepper_kin.ros.transports.rosbridge_socket import application
        from pepper_kin.servers.http_server import GatedHttpServer

        self._stop = asyncio.Event()
        server = GatedHttpServer(application(self), "rosbridge", self.fault)
        server.start(self._sockets)
        self._started.set()
        await self._stop.wait()
        for session in tuple(self.sessions):
            session.close()
        await server.close()
        others = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in others:
            task.cancel()
        if others:
            await asyncio.wait(others, timeout=END_SECONDS)

    def fault(self, host: str | None, origin: str | None, token: str | None) -> str | None:
        """Return why a connection is refused, or None if it is accepted.

        Web pages may come from any port of this machine, as pages for robots do; others from this server.

        Args:
            host: Header `Host` of the request.
            origin: Header `Origin` of the request, None if missing.
            token: Token of the request, None if missing.
        """
        try:
            local = origin is not None and is_loopback(urlsplit(origin).hostname or "?")
        except ValueError:
            local = False
        return self.access.fault(host, None if local else origin, token)


__all__ = ["DEFAULT_PORT", "LARGEST_TEXT", "RosbridgeServer"]
