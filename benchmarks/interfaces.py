"""The interfaces: simulated NAOqi and ROS node, stops over the wire, attacked servers, qiBullet's tests."""

from __future__ import annotations

import importlib
import itertools
import json
import os
import random
import re
import resource
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from harness import Times, figures, in_turn, python

import pepper_kin.qibullet
from pepper_kin.naoqi import Robot
from pepper_kin.naoqi.body import Body
from pepper_kin.naoqi.hosted_twin import hosted_twin
from pepper_kin.ros import RobotNode, RosbridgeServer
from pepper_kin.ros.sensor_messages import CameraMessages
from pepper_kin.ros.state_messages import StateMessages
from pepper_kin.ros_messages import encode
from pepper_kin.ros_messages.json_text import to_json

POLLING = """
import sys, time, qi
session = qi.Session()
session.connect(sys.argv[1])
motion, memory = session.service("ALMotion"), session.service("ALMemory")
video = session.service("ALVideoDevice")
handle = video.subscribeCamera("bench", 0, 1, 11, 10)
end, calls, pictures = time.time() + float(sys.argv[2]), [], []
while time.time() < end:
    begun = time.time()
    motion.getAngles("Body", True)
    calls.append(time.time() - begun)
    if len(calls) % 5 == 0:
        begun = time.time()
        video.getImageRemote(handle)
        pictures.append(time.time() - begun)
    time.sleep(0.02)
middle = lambda values: sorted(values)[len(values) // 2] * 1e3
print(f"{middle(calls):.3f} {middle(pictures):.3f}")
"""


def tracking() -> float:
    """Return the rms of measured minus commanded angles after random interpolations [mrad]."""
    from pepper_kin.naoqi import Broker

    rng = np.random.default_rng(0)
    errors = []
    with Broker(real_time=False) as broker:
        motion = broker.motion
        names = motion.getBodyNames("Joints")
        limits = np.array(motion.getLimits("Joints"))
        for _ in range(20):
            share = rng.uniform(0.35, 0.65, len(names))
            goal = limits[:, 0] + share * (limits[:, 1] - limits[:, 0])
            motion.angleInterpolation(names, list(map(float, goal)), 1.5, True)
            errors.append(np.array(motion.getAngles(names, True)) - motion.getAngles(names, False))
    return 1000.0 * float(np.sqrt(np.mean(np.square(errors))))


@figures("benchmarks/twin.md", "the extra `naoqi`", seconds=3.0)
def naoqi_host(seconds: float = 20.0) -> Iterator[str]:
    """Cycles, calls and pictures of the simulated NAOqi.

    Jitter of the 50 Hz cycle while a client polls, and what calls cost.  Asked are 3 ms for the 99th
    percentile of the delay, with cameras at 10 Hz and one client that polls, and 1 mrad rms between measured
    and commanded angles after `angleInterpolation`.
    """
    from pepper_kin.naoqi import Broker, Host

    yield f"angles after angleInterpolation: {tracking():.2f} mrad rms"
    with Broker() as broker, Host(broker, port=0) as host:
        broker.body.time.delays.clear()
        call, picture = python(POLLING, host.url, str(seconds)).split()[-2:]
        delays = 1e3 * np.array(broker.body.time.delays)[50:]
        late = np.percentile(delays, [50, 99])
        yield f"{len(delays)} cycles: delay median {late[0]:.2f} ms, 99th percentile {late[1]:.2f} ms"
        yield f"getAngles over the wire {call} ms, a QVGA picture drawn and sent {picture} ms"


LISTENING = """
import json, sys, time
from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

async def listen():
    socket = await websocket_connect(sys.argv[1])
    await socket.write_message('{"op": "call_service", "service": "/rosapi/topics"}')
    for topic in json.loads(await socket.read_message())["values"]["topics"]:
        await socket.write_message(json.dumps({"op": "subscribe", "topic": topic}))
    end, count = time.time() + float(sys.argv[2]), 0
    while time.time() < end:
        await socket.read_message()
        count += 1
    print(count / float(sys.argv[2]))

IOLoop.current().run_sync(listen)
"""


@figures("benchmarks/twin.md", seconds=2.0)
def ros_node(seconds: float = 10.0) -> Iterator[str]:
    """Costs of messages, and cycles of the ROS 2 node while a rosbridge client listens to everything.

    Asked are 50 us for a joint state and 1 ms for a QVGA picture (made and written as JSON), and 3 ms for the
    99th percentile of the delay of the 50 Hz cycle.  How late cycles begin depends on what else the machine
    does; what a cycle computes, in processor time of its thread, hardly does.
    """
    body = Body(real_time=False)
    body.time.sleep(0.1)
    states, camera = StateMessages(body), CameraMessages(body, "front")
    picture, odometry = camera.picture(), np.zeros(3)
    for name, make, count in (
        ("joint state", lambda: states.joint_states(1.0), 5000),
        ("transforms", lambda: states.moving_transforms(1.0, odometry), 1000),
        ("QVGA picture", lambda: camera.image(picture, 1.0), 1000),
    ):
        message = make()
        jobs = {"made": make, "as JSON": partial(to_json, message), "as bytes": partial(encode, message)}
        costs = [(what, in_turn({0: call}, count, time.perf_counter)[0]) for what, call in jobs.items()]
        yield f"{name}: {', '.join(f'{what} {1e6 * np.median(spent):.1f} us' for what, spent in costs)}"
    drawn = in_turn({"": camera.picture}, 20, time.perf_counter)[""]
    yield f"drawing of a QVGA picture: {1e3 * np.median(drawn):.2f} ms"
    for cameras in ((), ("front",), ("front", "bottom", "depth")):
        yield f"cameras {', '.join(cameras) or 'none'}: {cycles(cameras, seconds)}"


def cycles(cameras: tuple[str, ...], seconds: float) -> str:
    """Return how late the cycles begin while a client listens to everything for some time [s]."""
    body = Body()
    body.time.start()
    with RosbridgeServer(port=0) as server, RobotNode(body, server, cameras=cameras):
        body.time.sleep(1.0)
        computed, cycle = [], body.time._on_cycle

        def timed() -> None:
            begin = time.thread_time()
            cycle()
            computed.append(time.thread_time() - begin)

        body.time._on_cycle = timed
        body.time.delays.clear()
        rate = float(python(LISTENING, server.url, str(seconds)))
        late = 1e3 * np.array(body.time.delays)
    body.time.stop()
    return (
        f"{rate:.0f} messages a second; the cycle begins late by {np.median(late):.2f} ms "
        f"in the median, {np.percentile(late, 99):.2f} ms at the 99th percentile, and computes "
        f"{1e3 * np.median(computed):.2f} ms"
    )


STILL = 6e-3
"""By how much a robot at rest may move [rad, m]."""

CLIENT = """
import json, sys
import numpy as np
import pepper_kin as pk
from pepper_kin.naoqi import FollowOptions, Robot

pepper = pk.load_pepper().with_requirements("limits")
with Robot(sys.argv[1]) as robot:
    print("ready", flush=True)
    for line in sys.stdin:
        method = line.strip()
        try:
            if method == "drive":
                result = robot.drive([0.2, 0.0, 0.3], 3.0)
            else:
                here = robot.state().of(pepper.joint_names)
                here = np.clip(here, pepper.lower_limits, pepper.upper_limits)
                goal = here.copy()
                k = pepper.joint_index("LShoulderPitch")
                goal[k] = 0.3 if here[k] > 0.8 else 1.3
                trajectory = pk.retime(pepper, np.array([here, goal]), velocity_scale=0.15)
                print("going", flush=True)
                result = robot.follow(trajectory, method=method, options=FollowOptions(silence=1.0))
            print(json.dumps([result.status.value, result.message, result.at_rest]), flush=True)
        except KeyboardInterrupt:
            print(json.dumps(["interrupted", "", True]), flush=True)
        except Exception as error:
            print(json.dumps(["error", f"{type(error).__name__}: {error}", True]), flush=True)
"""


class Client:
    """A client in another process."""

    def __init__(self, url: str) -> None:
        command = [sys.executable, "-c", CLIENT, url]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.expect("ready")

    def expect(self, text: str) -> str:
        """Return the next line that begins so; libqi's log is passed over."""
        return next((line.strip() for line in self.process.stdout if line.startswith(text)), "")

    def ask(self, method: str) -> None:
        """Begin a motion."""
        print(method, file=self.process.stdin, flush=True)

    def result(self) -> list:
        """Return status, message, and whether rest was measured."""
        return json.loads(self.expect('["') or '["lost", "", false]')


def movement(watcher: Robot, seconds: float) -> float:
    """Return how far the robot moves in some time [rad or m]."""
    first, most = watcher.state().q, 0.0
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        most = max(most, float(np.abs(watcher.state().q - first).max()))
        time.sleep(0.05)
    return most


def made(count: int) -> Iterator[str]:
    """Yield how many certified Bezier motions are followed to their end."""
    found: Counter[str] = Counter()
    with hosted_twin() as (url, _):
        client = Client(url)
        for _ in range(count):
            client.ask("bezier")
            status, message, _ = client.result()
            found[status] += 1
            if status != "completed":
                yield f"{status} {message}"
        client.process.kill()
    yield f"Bezier motions to their end: {found['completed']} of {count}  {dict(found)}"


def ended(count: int, load: int, seed: int) -> Iterator[str]:
    """Yield how many robots move though they were stopped."""
    rng, wrong, found = random.Random(seed), 0, Counter()
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(load)]
    try:
        with hosted_twin() as (url, _), Robot(url, timeout=30.0) as watcher:
            client = Client(url)
            for k in range(count):
                method = rng.choice(["bezier", "stream", "drive"])
                how = rng.choice(["stop", "int", "freeze", "kill"])
                before = watcher.state().q
                client.ask(method)
                end = time.monotonic() + 60.0
                while np.abs(watcher.state().q - before).max() < 0.02 and time.monotonic() < end:
                    time.sleep(0.02)
                time.sleep(rng.uniform(0.0, 0.5))
                if how == "stop":
                    watcher.stop()
                elif how == "int":
                    client.process.send_signal(signal.SIGINT)
                elif how == "freeze":
                    client.process.send_signal(signal.SIGSTOP)
                    time.sleep(2.5)
                    client.process.send_signal(signal.SIGCONT)
                else:
                    client.process.kill()
                    time.sleep(1.5)
                result = ["killed", "", True] if how == "kill" else client.result()
                moved = movement(watcher, 2.0)
                found[f"{how}: {result[0]}"] += 1
                if result[0] == "error" or (moved > STILL and result[2]):
                    wrong += 1
                    yield f"{k} {method} {how} {result} moved by {moved:.3f}"
                if client.process.poll() is not None:
                    client = Client(url)
            client.process.kill()
    finally:
        for process in busy:
            process.kill()
    yield f"robots that moved after their stop, or raw errors: {wrong} of {count}  {dict(found)}"


@figures("naoqi.md", "the extra `naoqi`", completed=1, stopped=1, load=0)
def robot_stops(completed: int = 0, stopped: int = 0, load: int = 10, seed: int = 0) -> Iterator[str]:
    """Motions over the wire of libqi, with a real clock: followed to their end, and stopped in every way.

    `completed` certified Bezier motions are made by a hosted robot to their end.  `stopped` motions are ended
    by `stop` of another client, Ctrl-C, SIGSTOP and SIGKILL of their client while `load` processes keep the
    machine busy, and robots counted that move after rest was reported, or 1.5 s after their client was
    killed.
    """
    if completed:
        yield from made(completed)
    if stopped:
        yield from ended(stopped, load, seed)


TOKEN = "0123456789abcdef"
FILES = 1024
PAUSE, LIMIT = 0.2, 5.0
"""Between two connections of the client, and the longest that it waits [s]."""
SERVERS = {
    "live page": ["view", "--no-open", "--port", "0", "--token", TOKEN],
    "rosbridge": ["ros", "--port", "0", "--cameras", "none", "--token", TOKEN],
    "NAOqi": ["naoqi", "serve", "--port", "0", "--token", TOKEN],
}
HTTP = {
    "silent": b"",
    "half": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-a: b\r\n",
    "no token": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
}
QI_HELLO = b"\x42\xde\xad\x42" + (1).to_bytes(4, "little") + (4).to_bytes(4, "little")
QI_HELLO += bytes.fromhex("0000010000000000 0000000008000000") + bytes(4)
"""Ask libqi to authenticate, with no capabilities."""
QI = {"silent": b"", "half": QI_HELLO[:20], "no token": QI_HELLO}


def attack(port: int, first: bytes, most: int, seconds: float) -> None:
    """Keep connections open; print how many were opened, and how many were open at once."""
    resource.setrlimit(
        resource.RLIMIT_NOFILE, (most + 100, max(most + 100, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
    )
    poll, held = select.epoll(), {}
    opened = peak = 0
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        for _ in range(min(200, most - len(held))):
            link = socket.socket()
            link.settimeout(1.0)
            try:
                link.connect(("127.0.0.1", port))
                link.send(first)
            except OSError:
                link.close()
                continue
            held[link.fileno()] = link
            poll.register(link, select.EPOLLIN | select.EPOLLRDHUP)
            opened += 1
        peak = max(peak, len(held))
        for number, event in poll.poll(0.0 if len(held) < most else 0.05, 1000):
            if event & (select.EPOLLRDHUP | select.EPOLLHUP | select.EPOLLERR):
                held.pop(number).close()
            else:
                held[number].recv(65_536)
    print(json.dumps([opened, peak]), flush=True)
    os._exit(0)  # without closing them one by one


def ask_http(port: int) -> None:
    """Get an answer to a request with the token."""
    with socket.create_connection(("127.0.0.1", port), LIMIT) as link:
        link.sendall(
            f"GET /socket?token={TOKEN} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
            "Sec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        assert link.recv(100).startswith(b"HTTP/1.1 101")


def ask_naoqi(port: int) -> None:
    """Read a joint with a session that states the token."""
    import qi

    session = qi.Session()
    session.connect(f"tcp://127.0.0.1:{port}", _async=True).value(int(1000 * LIMIT))
    opened = session.service("Access").unlock(TOKEN)
    assert len(opened.service("ALMotion").getAngles("HeadYaw", True)) == 1
    session.close(_async=True).wait(1000)


@contextmanager
def served(name: str, log: Path) -> Iterator[int]:
    """Run a server with 1,024 files; yield its port."""
    command = [sys.executable, "-c", "from pepper_kin.cli import main; main()", *SERVERS[name]]
    with log.open("w") as errors:
        server = subprocess.Popen(
            command,
            stdout=subprocess.PIPE, stderr=errors, text=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (FILES, FILES)),
        )  # fmt: skip
    try:
        line = next(line for line in server.stdout if "://" in line)
        yield int(re.search(r"://[^:/]+:([0-9]+)", line).group(1))
    finally:
        server.terminate()
        server.wait(30)


def measured(name: str, kind: str, count: int, seconds: float) -> tuple:
    """Attack a server while a client with the token asks it; return the figures."""
    first = (QI if name == "NAOqi" else HTTP)[kind]
    ask: Callable[[int], None] = ask_naoqi if name == "NAOqi" else ask_http
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        with served(name, log) as port:
            ask(port)
            start = log.stat().st_size
            code = f"import interfaces; interfaces.attack({port}, {first!r}, {count}, {seconds})"
            command, here = [sys.executable, "-c", code], Path(__file__).parent
            attacker = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=here)
            begun, times, failed = time.monotonic(), Times(time.monotonic), 0
            while attacker.poll() is None:
                try:
                    times("answered", ask, port)
                except (OSError, RuntimeError, AssertionError):
                    failed += 1
                    del times["answered"][-1]
                time.sleep(PAUSE)
            grown = (log.stat().st_size - start) / (time.monotonic() - begun)
            done = json.loads(attacker.stdout.read())
    found = times["answered"]
    late = (f"{x:.0f}" for x in times.at("answered", 50, 100)) if found else "--"
    return name, kind, *done, len(found) + failed, failed, *late, grown


@figures("viewer.md", "the extra `naoqi`", connections=100, seconds=2.0)
def half_open(connections=10_000, seconds=10.0, servers=tuple(SERVERS), kinds=tuple(HTTP)) -> Iterator[tuple]:
    """Servers under a client with thousands of connections and no token: is one with it served, and when?

    Each server runs with 1,024 files.  An attacker in a process of its own keeps up to 10,000 connections
    open, each with a part of a first message, and opens a new one for each that the server closes.  Meanwhile
    a client with the token connects anew, five times a second.  All of it is on loopback, so both have one
    address.
    """
    for name, kind in itertools.product(servers, kinds):
        yield (
            "server | sent | opened | held | asked | failed | median [ms] | longest [ms] | log [B/s] {:.0f}",
            *measured(name, kind, connections, seconds),
        )  # fmt: skip


CASES = {
    "simulation_manager_test": ("SimulationManagerTest",),
    "virtual_robot_test": ("VirtualRobotTest",),
    "base_test": ("PepperBaseTest",),
    "link_test": ("PepperLinkTest",),
    "joint_test": ("PepperJointTest",),
    "sensor_test": ("SensorTest",),
    "imu_test": ("PepperImuTest", "DummyImuTest"),
    "laser_test": ("PepperLaserTest",),
    "camera_test": ("PepperCameraTest",),
    "posture_test": ("PepperPostureTest",),
    "self_collision_test": ("PepperSelfCollisionTest",),
    "fsr_test": ("NaoFsrTest", "DummyFsrTest"),
}
"""Module of the tests -> its classes, but those that are the same for NAO and Romeo."""


def stand_in() -> None:
    """Let `import qibullet` and `from qibullet.imu import Imu` find the adapter."""
    sys.modules["qibullet"] = pepper_kin.qibullet
    for path in Path(pepper_kin.qibullet.__file__).parent.glob("*.py"):
        if path.stem != "__init__":
            module = importlib.import_module(f"pepper_kin.qibullet.{path.stem}")
            sys.modules[f"qibullet.{path.stem}"] = module


class Record(unittest.TestResult):
    """Passed and failed tests, by name, with the first line of the reason."""

    def __init__(self) -> None:
        super().__init__()
        self.passed: list[str] = []
        self.failed: dict[str, str] = {}

    def addSuccess(self, test: unittest.TestCase) -> None:  # noqa: N802
        self.passed.append(test.id())

    def addFailure(self, test, err) -> None:  # noqa: N802
        text = str(err[1]).splitlines()
        self.failed[test.id()] = f"{err[0].__name__}: {text[0] if text else ''}"

    addError = addFailure  # noqa: N815


def is_of_pepper(name: str) -> bool:
    """Return whether a test needs no robot but Pepper."""
    return not any(other in name.lower() for other in ("nao", "romeo"))


def share(passed: list[str], every: list[str]) -> str:
    return f"{len(passed)} of {len(every)} passed ({100.0 * len(passed) / max(len(every), 1):.0f} %)"


@figures("qibullet.md", "pybullet and qiBullet's repository")
def qibullet_tests(folder: str, verbose: bool = False) -> Iterator[str]:
    """qiBullet's own tests for Pepper against `pepper_kin.qibullet`, unmodified.

    Asked are 90 % of them.  The tests are read from a folder (qiBullet's repository has them, its wheel has
    not); each imports `qibullet`, which here is the adapter, and `pybullet`, which must be installed.
    """
    stand_in()
    sys.path.insert(0, folder)
    loader, record, every = unittest.TestLoader(), Record(), []
    manager, begun = pepper_kin.qibullet.SimulationManager(), time.perf_counter()
    for name, classes in CASES.items():
        module = importlib.import_module(name)
        for case in classes:
            suite = loader.loadTestsFromTestCase(getattr(module, case))
            ids = [test.id() for test in suite]
            every += ids
            suite(record)
            yield f"{case}: {share([i for i in ids if i in record.passed], ids)}"
            for client in range(20):  # those that failed before they stopped their simulation
                manager.stopSimulation(client)
    yield from (f"  {name}: {reason}" for name, reason in record.failed.items())
    if verbose:
        yield "\n".join(record.passed)
    of_pepper = list(filter(is_of_pepper, every))
    yield f"all: {share(record.passed, every)} in {time.perf_counter() - begun:.0f} s"
    yield f"those that need no other robot: {share(list(filter(is_of_pepper, record.passed)), of_pepper)}"
