"""The live page's server under malformed, hostile and slow clients: it goes on serving the next one."""

import asyncio
import base64
import json
import os
import random
import socket
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

import pepper_kin as pk
from pepper_kin.viewer.server import ViewerServer
from pepper_kin.viewer.server import app as server_app
from pepper_kin.viewer.server.obstacles import MOST_OBSTACLES
from pepper_kin.viewer.server.protocol import _FIELDS, NAMES


@pytest.fixture(scope="module")
def server():
    server = ViewerServer(pk.load_pepper(), port=0)
    yield server
    server.close()


@pytest.fixture
def unlimited(monkeypatch):
    """Let every command through: the bound on their rate has its test below."""
    monkeypatch.setattr(server_app, "MOST_PER_SECOND", 1e9)
    monkeypatch.setattr(server_app, "AT_ONCE", 1e9)


def run(question):
    """Run a coroutine in another thread: the session's browser may keep a loop running in this one."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, question).result()


def socket_of(server):
    return websocket_connect(server.url.replace("http", "ws", 1) + "socket")


async def next_text(link, kind, seconds=30.0):
    """Return the next JSON message of a type."""
    while True:
        message = await asyncio.wait_for(link.read_message(), seconds)
        assert message is not None, "the server closed the connection"
        if isinstance(message, str) and json.loads(message)["type"] == kind:
            return json.loads(message)


async def answers(link, name):
    """See that a connection lives: a wrong command is refused once its earlier answers have been read."""
    for _ in range(20):
        await link.write_message(json.dumps({"do": name}))
        try:
            while name not in (await next_text(link, "refused", 2.0))["text"]:
                pass
            return
        except TimeoutError:
            continue
    pytest.fail("a connection no longer answers")


async def still_serves(server):
    """See that a new client gets its page and state, and that what it asks for happens."""
    assert (await AsyncHTTPClient().fetch(server.url)).code == 200
    link = await socket_of(server)
    await next_text(link, "hello")
    angle = round(random.uniform(-0.5, 0.5), 4)
    await link.write_message(json.dumps({"do": "joint", "name": "HeadYaw", "value": angle}))
    deadline = time.monotonic() + 30
    while True:
        values = (await next_text(link, "state"))["values"]
        if "q" in values and values["q"][3] == angle:
            break
        assert time.monotonic() < deadline
    link.close()


SCALARS = (
    None, True, False, 0, -1, 0.5, 1e308, -1e308, 10**400, -(10**400), 2**63, "", "box", "ball", "gaze",
    "HeadYaw", "left hand", "Stand", "visual", "box 1", "\ud800", "\x00", "x" * 300, "😀" * 50, "__class__",
    float("nan"), float("inf"), [], {}, [1, 2, 3], [0.1, 0.2, 0.3], [1e308] * 3, [float("nan")] * 3,
    [[1, 2], [3]], [10**400, 0, 0], {"a": 1},
)  # fmt: skip


def malformed(draw):
    """Return a message that is wrong in one of many ways, or (one of ten) just odd."""
    way = draw.randrange(9)
    if way == 0:
        return bytes(draw.randrange(256) for _ in range(draw.randrange(60)))
    if way == 1:
        return draw.choice(["[", '{"do":', '{"a":{', "["]) * draw.randrange(1, 1300)
    if way == 2:
        return json.dumps(draw.choice(SCALARS))
    if way == 3:
        return "".join(chr(draw.randrange(1, 0xD7FF)) for _ in range(draw.randrange(40)))
    name = draw.choice(NAMES)
    fields = {key.removesuffix("?"): draw.choice(SCALARS) for key in _FIELDS[name] if draw.random() < 0.9}
    if way == 4:
        fields[draw.choice(["do", "extra", "self", "name", "\ud800"])] = draw.choice(SCALARS)
    text = json.dumps({"do": name, **fields})
    if way == 5 and len(text) > 3:  # one letter lost, doubled or changed
        at = draw.randrange(len(text))
        text = text[:at] + draw.choice(["", text[at] * 2, chr(draw.randrange(32, 127))]) + text[at + 1 :]
    return text


def test_malformed_messages_never_end_the_server(server, unlimited, amount, rng, tried):
    draw, count = random.Random(int(rng.integers(2**31))), amount(600, 10_000, 1_000_000)

    async def attack():
        links = [await socket_of(server), await socket_of(server)]
        for link in links:
            await next_text(link, "hello")
        for k in range(count):
            text = malformed(draw)
            link = links[k % 2]
            await link.write_message(text, binary=isinstance(text, bytes))
            if k % 500 > 497:
                await answers(link, f"end {k}")
        await still_serves(server)
        for link in links:
            link.close()

    run(attack())
    tried("malformed messages to the live server", count)


@pytest.mark.parametrize("digits", [20, 400, 4000])
def test_whole_numbers_of_any_length_are_refused_by_name(server, digits):
    async def ask():
        link = await socket_of(server)
        await next_text(link, "hello")
        text = '{"do": "joint", "name": "HeadYaw", "value": ' + "9" * digits + "}"
        await link.write_message(text)
        answer = (await next_text(link, "refused"))["text"]
        link.close()
        return answer

    answer = run(ask())
    assert "joint position" in answer if digits < 309 else "value: got 9" in answer
    assert len(answer) < 300


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://["},
        {"Origin": "http://[::1"},
        {"Origin": "null"},
        {"Origin": "http://a]b"},
        {"Origin": "\xff\xfe"},
        {"Host": "[::1"},
        {"Host": "a:b:c"},
        {"Host": "127.0.0.1:99999999999"},
        {"Host": "evil.example", "Origin": "http://evil.example"},
    ],
)
def test_malformed_origins_and_hosts_are_refused(server, headers):
    async def ask():
        request = HTTPRequest(server.url, headers=headers)
        code = (await AsyncHTTPClient().fetch(request, raise_error=False)).code
        await still_serves(server)
        return code

    assert run(ask()) in ((403,) if "99999999999" not in str(headers) else (200, 403))


def test_too_long_messages_and_bodies_end_their_connection_alone(server):
    async def ask():
        link = await socket_of(server)
        await next_text(link, "hello")
        await link.write_message("x" * 1_000_000)
        while await asyncio.wait_for(link.read_message(), 30) is not None:
            pass
        request = HTTPRequest(server.url, method="POST", body=b"x" * 1_000_000)
        try:
            code = (await AsyncHTTPClient().fetch(request, raise_error=False)).code
        except OSError:  # closed while the body was still being sent
            code = 400
        await still_serves(server)
        return code

    assert run(ask()) >= 400


def test_obstacles_are_bounded_and_their_fault_is_said(server, unlimited):
    async def ask():
        link = await socket_of(server)
        await next_text(link, "hello")
        for _ in range(MOST_OBSTACLES + 5):
            await link.write_message('{"do": "add", "kind": "ball", "size": [0.01], "position": [3, 3, 3]}')
        answer = (await next_text(link, "refused"))["text"]
        link.close()
        return answer

    try:
        assert "obstacles: got 100, expected at most 100" in run(ask())
        assert server.call(lambda session: len(session.scene.names)) == MOST_OBSTACLES
    finally:
        server.call(lambda session: session.set_scene(pk.Scene()))


def test_commands_beyond_the_rate_are_left_out_and_said(server, monkeypatch):
    monkeypatch.setattr(server_app, "MOST_PER_SECOND", 1.0)
    monkeypatch.setattr(server_app, "AT_ONCE", 20.0)
    done = []

    async def ask():
        link = await socket_of(server)
        await next_text(link, "hello")
        server.call(lambda session: monkeypatch.setattr(session, "on_target", lambda *_: done.append(1)))
        for _ in range(300):
            await link.write_message('{"do": "target", "name": "gaze", "position": [1, 0, 1]}')
        answer = (await next_text(link, "refused"))["text"]
        link.close()
        await still_serves(server)
        return answer

    assert "commands in a second: some were left out" in run(ask())
    assert 20 <= len(done) < 100
    server.call(lambda session: session.release())


def test_a_client_that_reads_nothing_is_closed_before_it_fills_the_memory(server, monkeypatch):
    monkeypatch.setattr(server_app, "MOST_UNSENT", 200_000)
    place = server.url.removeprefix("http://").rstrip("/")
    link = socket.socket()
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    link.connect(("127.0.0.1", server.port))
    key = base64.b64encode(os.urandom(16)).decode()
    link.sendall(
        f"GET /socket HTTP/1.1\r\nHost: {place}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    pages = server._hub._pages
    deadline = time.monotonic() + 30
    while not server.call(lambda session: len(pages)) and time.monotonic() < deadline:
        time.sleep(0.02)
    (page,) = server.call(lambda session: list(pages))
    most = 0
    for _ in range(3000):
        server.call(lambda session: session.board._send(b"x" * 20_000))
        most = max(most, page._bytes)
        if not server.call(lambda session: len(pages)):
            break
    assert not server.call(lambda session: len(pages))
    assert most < page._most_bytes + 40_000
    run(still_serves(server))
    link.close()


def test_one_plan_at_a_time(server):
    """A second request while one is being planned is refused: they would queue without bound."""

    def ask(session):
        session.move_target("left hand", session.targets["left hand"].position)
        session.document.set("busy", "Planning ...")
        try:
            with pytest.raises(pk.exceptions.InvalidValueError, match="one at a time"):
                session.plan()
        finally:
            session.document.set("busy", None)
            session.release()

    server.call(ask)
