"""The rosbridge server: JSON over web sockets, for roslibpy, roslib and other clients."""

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
"""Where rosbridge servers listen."""

END_SECONDS = 5.0
"""What is under way when the server ends is waited for no longer [s]."""

RISK = "others could move the robot, plan on this machine, and see what its cameras see"


class RosbridgeServer(LocalTransport):
    """Topics, services and actions of this program for rosbridge clients, and theirs for this program.

    Args:
        host: Where to listen.
        port: Where to listen; 0 for any free port.
        allow_remote: Whether the host may be one that other machines reach; the address has a token then.
        token: The token; None draws one where others can reach the server, and leaves it out elsewhere.

    Attributes:
        access: Who may connect.
        port: Where it listens.

    Raises:
        InvalidValueError: for a port that is none, or a host beyond loopback without `allow_remote`.
        InfeasibleError: where the port is taken.
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
        """Where clients connect, with the token where one is needed."""
        token = "" if self.access.token is None else f"?token={self.access.token}"
        return f"ws://{self.access.shown_host}:{self.port}/{token}"

    def close(self) -> None:
        """End the server and all that is open."""
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
        """Say why a connection is refused, or None where it is not.

        Pages may come from any port of this machine, as pages for robots do; others only from this server.

        Args:
            host: The header `Host`.
            origin: The header `Origin`, None where there is none.
            token: The token that it carries, None where there is none.
        """
        try:
            local = origin is not None and is_loopback(urlsplit(origin).hostname or "?")
        except ValueError:
            local = False
        return self.access.fault(host, None if local else origin, token)


__all__ = ["DEFAULT_PORT", "LARGEST_TEXT", "RosbridgeServer"]
