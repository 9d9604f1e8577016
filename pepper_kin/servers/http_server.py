"""HTTP server of the live page and of rosbridge, with access rules for requests."""

from __future__ import annotations

import re
import socket
from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qs, urlsplit

from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPHeaders, HTTPInputError, HTTPMessageDelegate, parse_request_start_line
from tornado.iostream import IOStream
from tornado.web import Application

from pepper_kin.servers.connection_gate import FIRST_MESSAGE_SECONDS, LARGEST_FIRST_MESSAGE, ConnectionGate

_END = re.compile(rb"\r?\n\r?\n")

Fault = Callable[[str | None, str | None, str | None], str | None]


class GatedHttpServer:
    """Server of an application that admits requests with the right host, origin and token.

    A connection serves one request without a body, which neither server needs.

    Args:
        application: Application that answers admitted requests.
        name: Name of the server in the log.
        fault: Function from `Host`, `Origin` and token to the reason of a refusal or None, such as
            `Access.fault`.
    """

    def __init__(self, application: Application, name: str, fault: Fault) -> None:
        self._server = _OneRequestServer(
            application,
            max_header_size=LARGEST_FIRST_MESSAGE,
            idle_connection_timeout=FIRST_MESSAGE_SECONDS,
        )
        self._fault = fault
        self.gate = ConnectionGate(name, self._judge, self._admit)

    def start(self, sockets: list[socket.socket]) -> None:
        """Serve connections of listening sockets in the running event loop."""
        self.gate.start(sockets)

    async def close(self) -> None:
        """Stop the server; the owners of web sockets close them."""
        self.gate.close()
        self._server.stop()
        await self._server.close_all_connections()

    def _judge(self, received: bytes) -> bool | bytes:
        """Return whether the received bytes are an allowed request, or the bytes of a refusal."""
        end = _END.search(received)
        if end is None:
            return False
        try:
            first, _, rest = received[: end.end()].decode("latin1").lstrip("\r\n").partition("\n")
            target = urlsplit(parse_request_start_line(first.rstrip("\r")).path)
            tokens = parse_qs(target.query, keep_blank_values=True, max_num_fields=100).get("token")
            headers = HTTPHeaders.parse(rest)
        except (HTTPInputError, ValueError):
            return _answer(400, "Bad Request", "This is no request of HTTP.")
        origin = headers.get("Origin") or headers.get("Sec-Websocket-Origin")
        fault = self._fault(headers.get("Host"), origin, tokens[-1] if tokens else None)
        if fault is not None:
            return _answer(403, "Forbidden", fault)
        if headers.get("Content-Length", "0") != "0" or "Transfer-Encoding" in headers:
            return _answer(413, "Content Too Large", "This server takes no requests with a body.")
        if self.gate.full:
            count = self.gate.admitted
            return _answer(503, "Service Unavailable", f"There are {count} clients already.")
        return True

    def _admit(self, connection: socket.socket, received: bytes, address: Any) -> None:
        """Hand an admitted connection to the HTTP server."""
        self._server.handle_stream(_BegunStream(connection, received, self.gate.leave), address)


class _OneRequestServer(HTTPServer):
    """HTTP server that closes connections after one answer; `no_keep_alive` would refuse web sockets, too."""

    def start_request(self, server_conn: Any, request_conn: Any) -> HTTPMessageDelegate:
        """Begin a request; a second request of a connection, which has not passed the gate, closes it."""
        if request_conn.stream.begins_twice():
            request_conn.stream.close()
        return super().start_request(server_conn, request_conn)


class _BegunStream(IOStream):
    """Stream whose first bytes have been read already."""

    def __init__(self, connection: socket.socket, begun: bytes, on_end: Callable[[], None]) -> None:
        self._begun, self._on_end, self._used = bytearray(begun), on_end, False
        super().__init__(connection)

    def begins_twice(self) -> bool:
        """Note the beginning of a request; return whether it is not the first one."""
        before, self._used = self._used, True
        return before

    def read_from_fd(self, buf: bytearray | memoryview) -> int | None:
        """Read the bytes that were received before, then from the socket."""
        if not self._begun:
            return super().read_from_fd(buf)
        count = min(len(buf), len(self._begun))
        buf[:count] = self._begun[:count]
        del self._begun[:count]
        return count

    def close_fd(self) -> None:
        """Close the socket and count the connection as ended."""
        super().close_fd()
        self._on_end()


def _answer(code: int, name: str, text: str) -> bytes:
    """Return a complete HTTP response with one sentence."""
    body = text.encode()
    lines = (
        f"HTTP/1.1 {code} {name}",
        "Content-Type: text/plain; charset=utf-8",
        f"Content-Length: {len(body)}",
        "X-Content-Type-Options: nosniff",
        "Cache-Control: no-store",
        "Connection: close",
    )
    return "\r\n".join(lines).encode() + b"\r\n\r\n" + body
