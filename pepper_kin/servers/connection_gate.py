"""Connections before they are admitted: bounds on their number, their time and what is logged of them."""

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
"""A connection whose first message is not complete by then is closed [s]."""
LARGEST_FIRST_MESSAGE = 65_536
"""What a first message may be long [byte]."""
MOST_WAITING, MOST_WAITING_OF_ONE = 512, 448
"""Connections whose first message is not complete: in all, and of one address."""
MOST_ADMITTED = 100
"""Connections that are admitted, at a time."""
BACKLOG = 4096
"""Connections that the system keeps until they are accepted."""
ACCEPTED_AT_ONCE = 256
"""Connections that are accepted before those that wait are read: as many as may wait."""
PAUSE = 0.05
"""Until connections are accepted again after the process had no file left for them [s]."""
LOG_SECONDS = 60.0
"""A gate logs one line in this time at most [s]."""

_RESET, _FLUSH = struct.pack("ii", 1, 0), struct.pack("ii", 0, 0)
_NOW = getattr(socket, "MSG_DONTWAIT", 0)
"""With this flag a call to the system fewer is made for each connection."""

T = TypeVar("T")


class BoundedPool(Generic[T]):
    """Items of many addresses, of which the oldest is removed for the newest.

    The address with the most items gives one up, so that a client with thousands of connections closes its
    own and not those of others.

    Args:
        most: Items in all.
        most_of_one: Items of one address; of a network of 64 bits with IPv6, which is what one client has.
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
        """Add an item; return the one that has to go for it, which is no longer in the pool."""
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
        """Remove an item; return whether it was there."""
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
    """Accepts connections, and admits those whose first message may pass.

    Whoever connects costs the server a socket and the bytes sent, until the first message is complete.  Such
    connections are bounded in number and time; the oldest of the address that has the most is closed for the
    newest, since a client sends its first message at once.  `judge` gets what was received and returns True
    to admit, False to wait for more, or the bytes that are sent before the connection is closed.

    All methods belong to the thread of the event loop.

    Args:
        name: What the log calls the server.
        judge: Looks at the bytes received so far.
        admit: Gets the connection (non-blocking), those bytes and the address of the client; `leave` has to
            be called when it ends.
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
        for listener in self._listeners:  # accepted ones inherit it: nothing is left of them in the system
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            if hasattr(socket, "TCP_DEFER_ACCEPT"):  # Linux accepts a connection with its first bytes
                listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, int(FIRST_MESSAGE_SECONDS))
            self._loop.add_reader(listener, self._accept, listener)

    def close(self) -> None:
        """Close the listening sockets, and what is not admitted."""
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
        """How many connections wait to be admitted."""
        return len(self._waiting)

    @property
    def full(self) -> bool:
        """Whether as many connections are admitted as may be."""
        return self.admitted >= MOST_ADMITTED

    def leave(self) -> None:
        """Count a connection that was admitted as ended."""
        self.admitted -= 1

    def dropped(self, why: str) -> None:
        """Log that a connection was closed; what follows within a minute is counted in the next line."""
        self._dropped += 1
        now = time.monotonic()
        if now - self._logged_at >= LOG_SECONDS:
            count = f"{self._dropped} connections were" if self._dropped > 1 else "A connection was"
            logger.warning("%s: %s closed, the last one because %s", self._name, count, why)
            self._dropped, self._logged_at = 0, now

    def _accept(self, listener: socket.socket) -> None:
        new: list[_Waiting] = []
        for _ in range(ACCEPTED_AT_ONCE):
            try:
                connection, address = listener.accept()
            except (BlockingIOError, ConnectionAbortedError):
                break
            except OSError as error:  # the process has no file left
                self._make_room(listener, error)
                break
            waiting = _Waiting(connection, address, self._loop.time())
            old = self._waiting.add(waiting, str(address[0]))
            if old is not None:
                self._end(old, "others came before its first message")
            if not self._read(waiting):
                new.append(waiting)
        for waiting in new:  # of a long queue most have gone already
            if waiting in self._waiting:
                waiting.connection.setblocking(False)
                self._loop.add_reader(waiting.connection.fileno(), self._read, waiting)
        if self._expiry is None:
            self._expire()

    def _make_room(self, listener: socket.socket, error: OSError) -> None:
        old = self._waiting.oldest()
        if old is not None:
            self._end(old, f"of {error.strerror}")
            return
        self.dropped(f"of {error.strerror}")
        self._loop.remove_reader(listener)  # it stays readable: the loop would do nothing else
        self._loop.call_later(PAUSE, self._accept_again, listener)

    def _accept_again(self, listener: socket.socket) -> None:
        if listener in self._listeners:
            self._loop.add_reader(listener, self._accept, listener)

    def _read(self, waiting: _Waiting) -> bool:
        """Read what has come; return whether the connection no longer waits."""
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
        """Close what has waited too long, and come back for the next."""
        self._expiry = None
        while (oldest := self._waiting.oldest()) is not None:
            left = oldest.since + FIRST_MESSAGE_SECONDS - self._loop.time()
            if left > 0.0:
                self._expiry = self._loop.call_later(left, self._expire)
                return
            self._end(oldest, f"its first message was not complete after {FIRST_MESSAGE_SECONDS:g} s")

    def _forget(self, waiting: _Waiting) -> None:
        self._waiting.discard(waiting)
        self._loop.remove_reader(waiting.connection.fileno())

    def _end(self, waiting: _Waiting, why: str | None = None, reply: bytes = b"") -> None:
        self._forget(waiting)
        try:
            if reply:
                waiting.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _FLUSH)
                waiting.connection.send(reply, _NOW)
                waiting.connection.shutdown(socket.SHUT_WR)
                waiting.connection.recv(LARGEST_FIRST_MESSAGE, _NOW)  # unread bytes would take it back
        except OSError:  # it has gone already, or does not read
            pass
        finally:
            waiting.connection.close()
        if why is not None:
            self.dropped(why)


def listening_sockets(server: str, host: str, port: object, tried: int = 1) -> list[socket.socket]:
    """Return sockets that listen on a port of a host.

    Args:
        server: What the error calls the server.
        host: A name or address of this machine.
        port: The port, 0 for any that is free.
        tried: How many ports are tried, from this one on.

    Raises:
        InvalidValueError: for a port that is none.
        InfeasibleError: where the port is taken, or the host is none of this machine's.
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
    """Return what one client has: an address of IPv4, or the 64 bits of a network of IPv6."""
    if ":" not in address:
        return address
    whole = ipaddress.IPv6Address(address.partition("%")[0])
    return str(whole.ipv4_mapped or int(whole) >> 64)
