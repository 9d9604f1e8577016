"""Connections without a token: bounded in number and time, while a client with one is served."""

import asyncio
import logging
import socket
from concurrent.futures import ThreadPoolExecutor

import pytest

from pepper_kin.ros.transports.rosbridge import RosbridgeServer
from pepper_kin.servers import connection_gate
from pepper_kin.servers.connection_gate import BoundedPool, ConnectionGate, listening_sockets

TOKEN = "0123456789abcdef"
HALF = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-a: b\r\n"
GET = f"GET /?token={TOKEN} HTTP/1.1\r\nHost: 127.0.0.1\r\n".encode()
UPGRADE = (
    "GET /?token={} HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


def in_a_loop(attack):
    """Run in another thread: a browser of other tests keeps a loop running in this one."""
    with ThreadPoolExecutor(1) as pool:
        pool.submit(lambda: asyncio.run(attack())).result()


def connected(port, first=b""):
    link = socket.create_connection(("127.0.0.1", port), 30.0)
    link.sendall(first)
    return link


def answer(link):
    """All that a server sends until it closes the connection."""
    parts = []
    while part := link.recv(65_536):
        parts.append(part)
    return b"".join(parts)


@pytest.fixture(scope="module")
def server():
    with RosbridgeServer(port=0, token=TOKEN) as server:
        yield server


def test_a_client_with_the_token_is_served_while_more_than_all_places_are_half_open(server, caplog):
    with caplog.at_level(logging.WARNING):
        links = [connected(server.port, HALF) for _ in range(3 * connection_gate.MOST_WAITING)]
        with connected(server.port, UPGRADE.format(TOKEN).encode()) as client:
            assert client.recv(100).startswith(b"HTTP/1.1 101")
        ended = 0
        for link in links[: connection_gate.MOST_WAITING]:  # the oldest are closed
            try:
                ended += link.recv(1) == b""
            except ConnectionError:
                ended += 1
    assert ended == connection_gate.MOST_WAITING
    assert len([record for record in caplog.records if "closed" in record.getMessage()]) <= 1
    for link in links:
        link.close()


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (b"GET /?token=wrong HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", 403),
        (GET + b"Content-Length: 9\r\n\r\n", 413),
        (GET + b"Transfer-Encoding: chunked\r\n\r\n", 413),
        (b"\x42\xde\xad\x42\r\n\r\n", 400),
    ],
)
def test_what_may_not_pass_is_answered_and_closed(server, request_, code):
    with connected(server.port, request_) as link:
        assert answer(link).startswith(f"HTTP/1.1 {code} ".encode())


def test_a_second_request_on_a_connection_is_not_answered(server):
    """It has not passed the gate: it may have another host or no token."""
    with connected(server.port, 2 * (GET + b"\r\n")) as link:
        try:
            received = answer(link)
        except ConnectionError:
            received = b""
    assert received.count(b"HTTP/1.1") <= 1


class Clock:
    """The time of an event loop, moved by hand."""

    def __init__(self, loop):
        self.ahead, self._true = 0.0, loop.time
        loop.time = lambda: self._true() + self.ahead


def test_a_first_message_has_a_time_limit_that_no_drop_of_bytes_prolongs():
    async def attack():
        clock, admitted = Clock(asyncio.get_running_loop()), []
        gate = ConnectionGate("server", lambda text: text.endswith(b"!"), lambda *a: admitted.append(a))
        (listener,) = listening_sockets("server", "127.0.0.1", 0)
        gate.start([listener])
        slow = connected(listener.getsockname()[1], b"a")
        while gate.waiting < 1:
            await asyncio.sleep(0.01)
        clock.ahead += 0.9 * connection_gate.FIRST_MESSAGE_SECONDS
        slow.sendall(b"b")
        await asyncio.sleep(0.05)
        assert gate.waiting == 1
        clock.ahead += 0.2 * connection_gate.FIRST_MESSAGE_SECONDS
        slow.setblocking(False)
        while gate.waiting:
            await asyncio.sleep(0.01)
        fast = connected(listener.getsockname()[1], b"hello!")
        while not admitted:
            await asyncio.sleep(0.01)
        assert admitted[0][1] == b"hello!"
        gate.close()
        admitted[0][0].close()
        slow.close()
        fast.close()

    in_a_loop(attack)


@pytest.mark.thorough
def test_a_process_without_files_closes_the_oldest_and_logs_once(monkeypatch, caplog):
    async def attack():
        gate = ConnectionGate("server", lambda text: False, lambda *_: None)
        (listener,) = listening_sockets("server", "127.0.0.1", 0)
        gate.start([listener])
        first = connected(listener.getsockname()[1])
        while gate.waiting < 1:
            await asyncio.sleep(0.01)

        for _ in range(100):
            gate._make_room(listener, OSError(24, "Too many open files"))
        assert gate.waiting == 0
        gate.close()
        first.close()

    with caplog.at_level(logging.WARNING):
        in_a_loop(attack)
    assert len(caplog.records) == 1
    assert "Too many open files" in caplog.text


def test_the_address_with_the_most_items_gives_one_up():
    pool = BoundedPool(4, 3)
    assert [pool.add(k, "192.0.2.1") for k in range(3)] == [None] * 3
    assert pool.add(3, "192.0.2.1") == 0
    assert pool.add(4, "192.0.2.2") is None
    assert pool.add(5, "192.0.2.3") == 1
    assert pool.oldest() == 2
    assert 5 in pool
    assert pool.add(6, "2001:db8::1") == 2
    assert pool.add(7, "2001:db8::2") == 6 or len(pool) == 4  # one network of 64 bits is one client
    assert len(pool) == 4
