"""Base of transports: open parts are recorded, and closed with the transport, the last first."""

from __future__ import annotations

import threading
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.transport import Closable, Transport


class GraphTransport(Transport):
    """A transport that records its open parts.

    Attributes:
        lock: Lock that is held while parts are made.
        closed: Whether the transport was closed.
    """

    def __init__(self) -> None:
        self.lock, self.closed = threading.RLock(), False
        self._parts: list[OpenPart] = []

    def check_open(self, name: str) -> None:
        """Refuse the use of a closed transport.

        Raises:
            TransportError: after `close`.
        """
        if self.closed:
            raise TransportError(name, "the transport is closed; make a new one")

    def keep(self, name: str, make: Callable[[], Any]) -> Any:
        """Return a new part, which is closed with the transport.

        Raises:
            TransportError: after `close`.
        """
        with self.lock:
            self.check_open(name)
            part = make()
            self._parts.append(part)
            self._listed()
        return part

    def discard(self, part: OpenPart) -> None:
        """Forget a part that was closed."""
        with self.lock:
            if not self.closed:
                self._parts = [other for other in self._parts if other is not part]
                self._listed()

    def close(self) -> None:
        """Close all parts, actions before their services, and end the connection."""
        with self.lock:
            if self.closed:
                return
            self.closed = True
            parts, self._parts = self._parts, []
        for part in reversed(parts):
            part.close()
        self._leave()

    def _listed(self) -> None:
        """Announce the open parts on transports that list them."""

    @abstractmethod
    def _leave(self) -> None:
        """End the connection."""


class OpenPart(Closable):
    """An open part of a transport, such as a publisher or a service.

    Args:
        transport: Transport of the part.
        end: Function that ends the part.

    Attributes:
        closed: Whether the part was closed.
    """

    def __init__(self, transport: GraphTransport, end: Callable[[], object]) -> None:
        self._transport, self._end_it = transport, end
        self._closing, self.closed = threading.Lock(), False

    def close(self) -> None:
        """End the part."""
        with self._closing:
            if self.closed:
                return
            self.closed = True
        self._transport.discard(self)
        self._end_it()
