"""Connections before admission, with bounds on their number, their time and their log entries."""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import logging
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from pepper_kin.exceptions import InfeasibleError, InvalidValueError

logger = logging.getLogger(__name__)

FIRST_MESSAGE_SECONDS = 5.0
"""Maximum time until the first message of a connection is complete [s]; then it is closed."""
LARGEST_FIRST_MESSAGE = 65_536
"""Maximum length of a first message [byte]."""
MOST_WAITING, MOST_WAITING_OF_ONE = 512, 448
"""Maximum number of connections with an incomplete first message, in total and of one address."""
MOST_ADMITTED = 100
"""Maximum number of admitted connections at a time."""
BACKLOG = 4096
"""Maximum number of connections that the system queues until they are accepted."""
ACCEPTED_AT_ONCE = 256
"""Maximum number of connections that are accepted in one call, before waiting ones are read."""
PAUSE = 0.05
"""Pause of accepting after the process ran out of file descriptors [s]."""
LOG_SECONDS = 60.0
"""Minimum time between two log lines of a gate [s]."""

_RESET, _FLUSH = struct.pack("ii", 1, 0), struct.pack("ii", 0, 0)
_NOW = getattr(socket, "MSG_DONTWAIT", 0)
"""Flag that saves one system call for each connection."""

T = TypeVar("T")


class BoundedPool(Generic[T]):
    """Bounded items of many addresses, of which the oldest is removed for the newest.

    The address with the most items loses one, so that a client with thousands of connections loses its own
    and not other clients'.

    Args:
        most: Maximum number of items in total.
        most_of_one: Maximum number of items of one address; for IPv6, of a 64-bit network, which one client
            has.
    """

    def __init__(self, most: int, most_of_one: int) -> None:
        self._most, self._most_of_one = most, most_of_one
        self._addresses: dict[T, str] = {}
        self._items: dict[str, dict[T, None]] = {}

    def __len__(self) -> int:
        return len(self._addresses)

    def __contains__(self, item: T) -> bool:
        return item in self._addresses

    def add(self, item: T, address: str) -> T | None:
        """Add an item; return the item that was removed for it, or None."""
        key = _network(address)
        mine = self._items.setdefault(key, {})
        mine[item] = None
        self._addresses[item] = key
        if len(mine) > self._most_of_one:
            return self._pop(mine)
        if len(self._addresses) > self._most:
            return self._pop(max(self._items.values(), key=len))
        return None

    def discard(self, item: T) -> bool:
        """Remove an item; return whether it was in the pool."""
        key = self._addresses.pop(item, None)
        if key is None:
            return False
        del self._items[key][item]
        if not self._items[key]:
            del self._items[key]
        return True

    def oldest(self) -> T | None:
        """Return the item that was added first, or None."""
        return next(iter(self._addresses), None)

    def _pop(self, items: dict[T, None]) -> T:
        """Remove and return the oldest of some items."""
        item = next(iter(items))
        self.discard(item)
        return item


@dataclass(eq=False)
class _Waiting:
    connection: socket.socket
    address: Any
    since: float
    received: bytearray = field(default_factory=bytearray)


class ConnectionGate:
    """Gate that accepts connections and admits those with an allowed first message.

    Until its first message is complete, a connection costs the server a socket and the received bytes.
    Waiting connections are bounded in number and time; the oldest one of the address with the most is closed
    for the newest, since a client sends its first message at once. `judge` is called with the received bytes
    and returns True to admit, False to wait for more, or bytes to send before closing the connection.

    All methods have to be called in the thread of the event loop.

    Args:
        name: Name of the server in the log.
        judge: Function that judges the bytes received so far.
        admit: Function that is called with the connection (non-blocking), the received bytes and the client's
            address; `leave` has to be called when the connection ends.
    """

    def __init__(
        self,
        name: str,
        judge: Callable[[bytes], bool | bytes],
        admit: Callable[[socket.socket, bytes, Any], None],
    ) -> None:
        self._name, self._judge, self._admit = name, judge, admit
        self._waiting: BoundedPool[_Waiting] = BoundedPool(MOST_WAITING, MOST_WAITING_OF_ONE)
        self._listeners: list[socket.socket] = []
        self._expiry: asyncio.TimerHandle | None = None
        self._dropped, self._logged_at = 0, -LOG_SECONDS
        self.admitted = 0

    def start(self, listeners: list[socket.socket]) -> None:
        """Accept connections of listening sockets in the running event loop."""
        self._loop, self._listeners = asyncio.get_running_loop(), list(listeners)
        for listener in self._listeners:  # accepted sockets inherit it: none lingers
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            if hasattr(socket, "TCP_DEFER_ACCEPT"):  # Linux accepts a connection with its first bytes
                listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, int(FIRST_MESSAGE_SECONDS))
            self._loop.add_reader(listener, self._accept, listener)

    def close(self) -> None:
        """Close the listening sockets and the waiting connections."""
        for listener in self._listeners:
            self._loop.remove_reader(listener)
            listener.close()
        self._listeners.clear()
        while (waiting := self._waiting.oldest()) is not None:
            self._end(waiting)
        if self._expiry is not None:
            self._expiry.cancel()

    @property
    def waiting(self) -> int:
        """Number of connections that wait for admission."""
        return len(self._waiting)

    @property
    def full(self) -> bool:
        """Whether the maximum number of connections is admitted."""
        return self.admitted >= MOST_ADMITTED

    def leave(self) -> None:
        """Count an admitted connection as ended."""
        self.admitted -= 1

    def dropped(self, why: str) -> None:
        """Log that a connection was closed; further ones within a minute are counted in the next line."""
        self._dropped += 1
        now = time.monotonic()
        if now - self._logged_at >= LOG_SECONDS:
            count = f"{self._dropped} connections were" if self._dropped > 1 else "A connection was"
            logger.warning("%s: %s closed, the last one because %s", self._name, count, why)
            self._dropped, self._logged_at = 0, now

    def _accept(self, listener: socket.socket) -> None:
        """Accept queued connections of a listening socket, and read those that have sent data."""
        new: list[_Waiting] = []
        for _ in range(ACCEPTED_AT_ONCE):
            try:
                connection, address = listener.accept()
            except (BlockingIOError, ConnectionAbortedError):
                break
            except OSError as error:  # the process has no file descriptor left
                self._make_room(listener, error)
                break
            waiting = _Waiting(connection, address, self._loop.time())
            old = self._waiting.add(waiting, str(address[0]))
            if old is not None:
                self._end(old, "others came before its first message")
            if not self._read(waiting):
                new.append(waiting)
        for waiting in new:  # most connections of a long queue are closed already
            if waiting in self._waiting:
                waiting.connection.setblocking(False)
                self._loop.add_reader(waiting.connection.fileno(), self._read, waiting)
        if self._expiry is None:
            self._expire()

    def _make_room(self, listener: socket.socket, error: OSError) -> None:
        """Close the oldest waiting connection, or pause accepting, after an error of `accept`."""
        old = self._waiting.oldest()
        if old is not None:
            self._end(old, f"of {error.strerror}")
            return
        self.dropped(f"of {error.strerror}")
        self._loop.remove_reader(listener)  # the socket stays readable, so the loop would do nothing else
        self._loop.call_later(PAUSE, self._accept_again, listener)

    def _accept_again(self, listener: socket.socket) -> None:
        """Resume accepting after a pause."""
        if listener in self._listeners:
            self._loop.add_reader(listener, self._accept, listener)

    def _read(self, waiting: _Waiting) -> bool:
        """Read received bytes; return whether the connection no longer waits."""
        try:
            data = waiting.connection.recv(LARGEST_FIRST_MESSAGE, _NOW)
        except BlockingIOError:
            return False
        except OSError:
            data = b""
        waiting.received += data
        verdict = self._judge(bytes(waiting.received)) if data else b""
        if verdict is False and len(waiting.received) < LARGEST_FIRST_MESSAGE:
            return False
        if verdict is True:
            self._forget(waiting)
            waiting.connection.setblocking(False)
            waiting.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _FLUSH)
            self.admitted += 1
            self._admit(waiting.connection, bytes(waiting.received), waiting.address)
        else:
            self._end(waiting, reply=verdict or b"")
        return True

    def _expire(self) -> None:
        """Close connections that have waited too long, and schedule the next check."""
        self._expiry = None
        while (oldest := self._waiting.oldest()) is not None:
            left = oldest.since + FIRST_MESSAGE_SECONDS - self._loop.time()
            if left > 0.0:
                self._expiry = self._loop.call_later(left, self._expire)
                return
            self._end(oldest, f"its first message was not complete after {FIRST_MESSAGE_SECONDS:g} s")

    def _forget(self, waiting: _Waiting) -> None:
        """Remove a waiting connection from the pool and the event loop."""
        self._waiting.discard(waiting)
        self._loop.remove_reader(waiting.connection.fileno())

    def _end(self, waiting: _Waiting, why: str | None = None, reply: bytes = b"") -> None:
        """Close a waiting connection after a reply, if any, and log the reason, if any."""
        self._forget(waiting)
        try:
            if reply:
                waiting.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _FLUSH)
                waiting.connection.send(reply, _NOW)
                waiting.connection.shutdown(socket.SHUT_WR)
                waiting.connection.recv(LARGEST_FIRST_MESSAGE, _NOW)  # unread bytes would reset it
        except OSError:  # the client has closed already, or does not read
            pass
        finally:
            waiting.connection.close()
        if why is not None:
            self.dropped(why)


def listening_sockets(server: str, host: str, port: object, tried: int = 1) -> list[socket.socket]:
    """Return sockets that listen on a port of a host.

    Args:
        server: Name of the server in the error.
        host: Name or address of this machine.
        port: The port, 0 for any free one.
        tried: Number of ports that are tried, from `port` on.

    Raises:
        InvalidValueError: for an invalid port.
        InfeasibleError: if the port is in use, or the host is not this machine's.
    """
    from tornado.netutil import bind_sockets

    if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port < 65536:
        raise InvalidValueError("port", port, "a whole number in 0 ... 65535")
    last = port + tried - 1
    for number in range(port, last + 1):
        try:
            return bind_sockets(number, host, backlog=BACKLOG)
        except OSError as error:
            fault = error
            if error.errno != errno.EADDRINUSE:
                break
    which = f"port {port}" if last == port else f"ports {port} to {last}"
    reason = f"{host} {which} cannot be had: {fault.strerror or fault}"
    raise InfeasibleError(server, reason, "choose another host or port, or port 0 for any") from fault


def _network(address: str) -> str:
    """Return the network of one client: an IPv4 address, or the 64-bit prefix of an IPv6 address."""
    if ":" not in address:
        return address
    whole = ipaddress.IPv6Address(address.partition("%")[0])
    return str(whole.ipv4_mapped or int(whole) >> 64)
