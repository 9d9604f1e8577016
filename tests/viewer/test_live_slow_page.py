"""A page that is slow to take what it is sent, over a real socket with little room."""

import base64
import gc
import os
import socket
import struct
import time
from urllib.parse import urlsplit

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.viewer.server import ViewerServer
from pepper_kin.viewer.server.body_poses import POSES


def opened(url):
    """A web socket whose receiver takes a few kilobytes and then makes the server wait."""
    place = urlsplit(url)
    link = socket.socket()
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    link.connect((place.hostname, place.port))
    key = base64.b64encode(os.urandom(16)).decode()
    link.sendall(
        f"GET /socket HTTP/1.1\r\nHost: {place.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    return link, link.makefile("rb")


def messages(stream):
    """Kind and content of each message that the server sends."""
    while head := stream.read(2):
        length = head[1] & 127
        if length == 126:
            (length,) = struct.unpack(">H", stream.read(2))
        elif length == 127:
            (length,) = struct.unpack(">Q", stream.read(8))
        yield head[0] & 15, stream.read(length)


@pytest.mark.thorough
def test_a_page_that_takes_long_to_load_gets_its_poses_although_nothing_moves(server):
    points = np.random.default_rng(0).uniform(1.0, 3.0, size=(40_000, 3))
    server.call(lambda session: session.set_scene(pk.Scene().add_point_cloud("dust", points, 0.001)))
    link, stream = opened(server.url)
    while stream.readline() != b"\r\n":
        pass
    link.settimeout(20)
    time.sleep(1.0)  # by now the server has nothing else to do
    kinds = []
    for opcode, content in messages(stream):
        kinds.append(struct.unpack("<I", content[:4])[0] if opcode == 2 else "text")
        if kinds[-1] == POSES:
            break
    assert kinds[0] == "text"
    assert kinds.count(POSES) == 1
    link.close()


@pytest.mark.thorough
def test_a_server_ends_without_a_word(pepper, caplog):
    """Whatever it was about to do: asyncio complains of tasks that are thrown away."""
    for _ in range(5):
        server = ViewerServer(pepper, port=0)
        server.call(lambda session: session.set_joint("HeadYaw", 0.3))
        server.close()
    gc.collect()
    assert caplog.text == ""
