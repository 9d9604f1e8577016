"""Proxy in front of libqi's port: it bounds connections, and admits only messages of libqi."""

from __future__ import annotations

import asyncio
import socket
import struct
import threading
from collections.abc import Callable
from typing import Any

from pepper_kin.servers.access import LOOPBACK
from pepper_kin.servers.connection_gate import (
    FIRST_MESSAGE_SECONDS,
    LARGEST_FIRST_MESSAGE,
    MOST_ADMITTED,
    BoundedPool,
    ConnectionGate,
)

_MAGIC, _SIZE, _HEADER_SIZE = b"\x42\xde\xad\x42", struct.Struct("<8xI"), 28

MOST_STRANGERS, MOST_STRANGERS_OF_ONE = 64, 48
"""Maximum number of sessions without the token: in all, and of one address."""


class HostGate:
    """Proxy that forwards connections to libqi, which listens on a private port of loopback.

    libqi accepts as many connections as the process may open files, waits for their first message for ever,
    and has no setting for either.  Here a connection is forwarded only once its first message is complete.
    With a token, sessions without it are bounded, too: they may read, and a new session closes the oldest one
    that has not sent the token.

    Args:
        sockets: Listening sockets that clients connect to.
        port: Private port of libqi.
        token: Token that unlocks the robot; None if none is needed.
    """

    def __init__(self, sockets: list[socket.socket], port: int, token: str | None) -> None:
        self._port, self._token = port, None if token is None else token.encode()
        self._gate = ConnectionGate("server of NAOqi", self._judge, self._admit)
        self._strangers: BoundedPool[asyncio.Task[None]] = BoundedPool(MOST_STRANGERS, MOST_STRANGERS_OF_ONE)
        self._links: set[asyncio.Task[None]] = set()
        self._loop = asyncio.SelectorEventLoop()
        self._thread = threading.Thread(target=self._run, args=(sockets,), name="gate of NAOqi", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close all connections."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def _run(self, sockets: list[socket.socket]) -> None:
        """Run the event loop of the gate until `close`."""
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.call_soon(self._gate.start, sockets)
            self._loop.run_forever()
            self._gate.close()
            for task in self._links:
                task.cancel()
            self._loop.run_until_complete(asyncio.gather(*self._links, return_exceptions=True))
        finally:
            self._loop.close()

    def _judge(self, received: bytes) -> bool | bytes:
        """Admit a connection whose first message is complete; drop an invalid one without an answer."""
        if not _MAGIC.startswith(received[:4]):
            return b""
        if len(received) < _HEADER_SIZE:
            return False
        size = _HEADER_SIZE + _SIZE.unpack_from(received)[0]
        if size > LARGEST_FIRST_MESSAGE or len(self._links) - len(self._strangers) >= MOST_ADMITTED:
            return b""
        return len(received) >= size

    def _admit(self, connection: socket.socket, received: bytes, address: Any) -> None:
        task = self._loop.create_task(self._serve(connection, received))
        self._links.add(task)
        if self._token is not None:
            old = self._strangers.add(task, str(address[0]))
            if old is not None:
                old.cancel()
                self._gate.dropped("other sessions came before it stated the token")

    async def _serve(self, connection: socket.socket, received: bytes) -> None:
        """Forward a connection until one side has closed it."""
        task = asyncio.current_task()
        assert task is not None
        client = _End(self._token, lambda: self._strangers.discard(task))
        robot = _End(None, lambda: False)
        client.other, robot.other = robot, client
        try:
            await self._loop.create_connection(lambda: robot, LOOPBACK, self._port)
            await self._loop.create_connection(lambda: client, sock=connection)
            client.data_received(received)
            client.transport.resume_reading()
            robot.transport.resume_reading()
            await asyncio.wait((client.lost, robot.lost), return_when=asyncio.FIRST_COMPLETED)
        except OSError as error:  # the process has no file left, or libqi ends
            self._gate.dropped(f"of {error.strerror}")
        finally:
            for end in (client, robot):
                end.close()
            if not client.made:
                connection.close()
            self._gate.leave()
            self._strangers.discard(task)
            self._links.discard(task)


class _End(asyncio.Protocol):
    """One end of a forwarded connection; reading starts once both ends are connected."""

    other: _End
    transport: asyncio.Transport

    def __init__(self, token: bytes | None, on_token: Callable[[], object]) -> None:
        self._token, self._on_token, self._tail = token, on_token, b""
        self.made, self.lost = False, asyncio.get_running_loop().create_future()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport, and pause reading."""
        assert isinstance(transport, asyncio.Transport)
        self.made, self.transport = True, transport
        transport.pause_reading()

    def data_received(self, data: bytes) -> None:
        """Forward bytes, and search them for the token."""
        self.other.transport.write(data)
        if self._token is not None:
            text = self._tail + data
            if self._token in text:
                self._token = None
                self._on_token()
            else:
                self._tail = text[1 - len(self._token) :]

    def pause_writing(self) -> None:
        """Pause reading at the other end."""
        self.other.transport.pause_reading()

    def resume_writing(self) -> None:
        """Resume reading at the other end."""
        self.other.transport.resume_reading()

    def connection_lost(self, error: Exception | None) -> None:
        """Record the end of the connection."""
        if not self.lost.done():
            self.lost.set_result(None)

    def close(self) -> None:
        """Close the transport; abort it if the remaining bytes are not sent in time."""
        if self.made:
            self.transport.close()
            asyncio.get_running_loop().call_later(FIRST_MESSAGE_SECONDS, self.transport.abort)
