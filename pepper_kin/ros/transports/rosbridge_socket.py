"""Web sockets of the rosbridge server."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import TYPE_CHECKING, Any

import tornado.web
import tornado.websocket

from pepper_kin.ros.transports.rosbridge_json import LARGEST_TEXT
from pepper_kin.ros.transports.rosbridge_outbox import Outbox
from pepper_kin.ros.transports.rosbridge_session import RosbridgeSession

if TYPE_CHECKING:
    from pepper_kin.ros.transports.rosbridge import RosbridgeServer

logger = logging.getLogger(__name__)

PING_SECONDS, PONG_SECONDS = 2.0, 2.0
"""Interval of pings to a client, and time without a pong after which it is disconnected [s]."""

MOST_PER_SECOND, AT_ONCE = 5_000.0, 10_000.0
"""Maximum rate of messages read from a client [1/s], and maximum number at once; then its socket waits."""


def application(server: RosbridgeServer) -> tornado.web.Application:
    """Return the application: a socket at every path, like rosbridge servers."""
    return tornado.web.Application(
        [(".*", ClientSocket, {"server": server})],
        websocket_ping_interval=PING_SECONDS,
        websocket_ping_timeout=PONG_SECONDS,
        websocket_max_message_size=LARGEST_TEXT,
        log_function=lambda handler: None,
    )


class ClientSocket(tornado.websocket.WebSocketHandler):
    """The socket of one client."""

    def initialize(self, server: RosbridgeServer) -> None:
        """Store the server, which the application passes to every handler."""
        self._server = server
        self._session: RosbridgeSession | None = None
        self._allowance = Allowance()
        self._sending: asyncio.Task[None] | None = None

    def check_origin(self, origin: str) -> bool:
        """Return True: the gate has checked the page already."""
        return True

    def open(self, *args: str, **kwargs: str) -> None:
        """Begin a session."""
        self.set_nodelay(True)
        outbox = Outbox(self._send, self._overflow)
        loop = asyncio.get_running_loop()
        self._session = RosbridgeSession(self._server, outbox, loop, self._server.executor)
        self._server.sessions.add(self._session)
        self._sending = asyncio.ensure_future(self._send_all(outbox))

    async def on_message(self, message: str | bytes) -> None:
        """Execute a message of the client; a client that sends too much waits."""
        if self._session is not None:
            self._session.take(message)
        wait = self._allowance.wait()
        await asyncio.sleep(wait)

    def on_close(self) -> None:
        """End the session."""
        if self._session is not None:
            self._server.sessions.discard(self._session)
            self._session.close()
        if self._sending is not None:
            self._sending.cancel()

    async def _send_all(self, outbox: Outbox) -> None:
        try:
            await outbox.run()
        except tornado.websocket.WebSocketClosedError:
            return
        except Exception:  # a client whose answer cannot be sent is disconnected
            logger.exception("rosbridge: a client could not be answered; it is disconnected")
            self.close(1011, "the server failed")

    async def _send(self, text: str) -> Any:
        await self.write_message(text)

    def _overflow(self) -> None:
        logger.warning("rosbridge: a client does not read its answers; it is disconnected")
        self.close(1008, "answers are not read")


class Allowance:
    """Rate limit on the messages of a client."""

    def __init__(self) -> None:
        self._left, self._asked_at = AT_ONCE, time.monotonic()

    def wait(self) -> float:
        """Count one message; return the time until the next one may be read [s]."""
        now = time.monotonic()
        self._left = min(self._left + MOST_PER_SECOND * (now - self._asked_at), AT_ONCE) - 1.0
        self._asked_at = now
        return max(-self._left / MOST_PER_SECOND, 0.0)
