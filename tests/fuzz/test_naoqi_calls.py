"""Calls and bytes with something wrong in them: the server of NAOqi's modules goes on.

The oracle: afterwards another client of libqi wakes the robot, turns its head, and reads the angle there.
"""

import importlib.util
import random
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pepper_kin.naoqi import Robot
from pepper_kin.naoqi.hosted_twin import hosted_twin

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("qi") is None, reason="the package qi has no wheel for this machine"
)

CLIENT = Path(__file__).with_name("naoqi_client.py")
MAGIC = 0x42DEAD42


@pytest.fixture
def server():
    with hosted_twin() as made:
        yield made


def turns_its_head(server):
    """Return whether another client can turn the head and read it.

    Calls of a client that has just ended may still be on their way through a busy server, and move the head
    once more, or stop it: it is tried again then.
    """
    url, process = server
    if process.poll() is not None:
        return False
    with Robot(url) as robot:
        for angle in (0.3, -0.2, 0.3, -0.2, 0.3):
            for call in ("killAll", "wakeUp"):
                robot._link.call("ALMotion", call, timeout=60.0)
            robot._link.call("ALMotion", "setStiffnesses", "Body", 1.0)
            robot._link.call("ALMotion", "angleInterpolation", "HeadYaw", angle, 1.0, True, timeout=60.0)
            if abs(robot.state().of(["HeadYaw"])[0] - angle) < 0.01:
                return True
            time.sleep(1.0)
        return False


def test_malformed_calls_do_not_end_the_server(server, amount, tried, request):
    """Calls of all methods of all services, with arguments that do not belong there."""
    count, seed = amount(500, 10_000, 300_000), request.config.getoption("--fuzz-seed")
    for k in range(0, count, 2_000):
        size = min(2_000, count - k)
        command = [sys.executable, str(CLIENT), server[0], str(size), str(seed + k)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=1800, check=False)
        assert done.returncode == 0, done.stderr
        assert int(done.stdout.split()[-1]) > size / 10
        tried("malformed qi calls", size, not turns_its_head(server))


def damaged(random_numbers):
    """Return a message of libqi with something wrong in it: noise, a wrong header, a wrong length."""
    body = random_numbers.randbytes(random_numbers.randrange(60))
    kind = random_numbers.randrange(3)
    if kind == 0:
        return body
    size = len(body) if kind == 1 else random_numbers.choice((0, 2**31, 2**32 - 1, len(body) + 9))
    head = [random_numbers.randrange(2**16) for _ in range(3)]
    places = [random_numbers.choice((0, 1, 2**32 - 1, 7)) for _ in range(3)]
    return struct.pack("<IIIHBBIII", MAGIC, 1, size, 0, head[0] % 9, 0, *places) + body


def test_damaged_bytes_do_not_end_the_server(server, amount, tried, rng):
    """Bytes that are no messages of libqi, from many connections."""
    count, random_numbers = amount(100, 2_000, 100_000), random.Random(int(rng.integers(2**32)))
    port = int(server[0].rsplit(":", 1)[1])
    for _ in range(count):
        with socket.create_connection(("127.0.0.1", port), timeout=30.0) as end:
            try:
                for _ in range(random_numbers.randrange(1, 4)):
                    end.sendall(damaged(random_numbers))
            except OSError:
                pass  # it has hung up
    tried("damaged connections to qi", count, not turns_its_head(server))
