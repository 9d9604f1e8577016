"""The causes that the doctor names, each met by a socket or a host that has it."""

import importlib.util
import json
import socket
import ssl
import subprocess
import threading

import pytest
from typer.testing import CliRunner

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.naoqi import Broker, Host
from pepper_kin.naoqi.commands import app
from pepper_kin.naoqi.doctor import examine

HEAT = "Device/SubDeviceList/HipPitch/Temperature/Sensor/Value"
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("qi") is None, reason="the package qi has no wheel for this machine"
)


def causes(address, **options):
    return {one.cause: one for one in examine(address, **options)}


@pytest.fixture(scope="module")
def robot():
    with Broker(mode="robot") as broker, Host(broker, port=0) as host:
        yield broker, host.url


@pytest.fixture
def listener():
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen(8)
        yield listening


@pytest.mark.thorough
def test_a_robot_that_is_ready(robot):
    broker, url = robot
    broker.module("ALAutonomousLife").setState("disabled")
    broker.motion.wakeUp()
    found = causes(url)
    assert set(found) == {"protection on"}
    assert not found["protection on"].hinders


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("cause", "begin", "end"),
    [
        ("asleep", lambda b: b.motion.rest(), lambda b: b.motion.wakeUp()),
        ("autonomous life", lambda b: b.module("ALAutonomousLife").setState("solitary"),
         lambda b: b.module("ALAutonomousLife").setState("disabled")),
        ("hatch open", lambda b: b.memory.insertData("BatteryTrapIsOpen", 1),
         lambda b: b.memory.insertData("BatteryTrapIsOpen", 0)),
        ("motors hot", lambda b: b.memory.insertData(HEAT, 81.0),
         lambda b: b.memory.removeData(HEAT)),
        ("in use", lambda b: b.motion.pCall("angleInterpolation", "HeadYaw", 0.5, 60.0, True),
         lambda b: b.motion.killAll()),
        ("protection off", lambda b: b.motion.setExternalCollisionProtectionEnabled("All", False),
         lambda b: b.motion.setExternalCollisionProtectionEnabled("All", True)),
        ("wrong robot", lambda b: b.memory.insertData("RobotConfig/Body/Type", "Nao"),
         lambda b: b.memory.removeData("RobotConfig/Body/Type")),
    ],
)  # fmt: skip
def test_states_that_hinder_are_named(robot, cause, begin, end):
    broker, url = robot
    broker.module("ALAutonomousLife").setState("disabled")
    assert cause not in causes(url)
    begin(broker)
    try:
        while cause == "in use" and not broker.motion.getTaskList():
            broker.body.time.sleep(0.02)
        found = causes(url)
    finally:
        end(broker)
    assert cause in found
    assert found[cause].advice
    assert found[cause].hinders is (cause != "protection off")


def test_another_version_is_named(robot, monkeypatch):
    monkeypatch.setattr("pepper_kin.naoqi.states.VERSION", "2.8.7")
    found = causes(robot[1])["wrong version"]
    assert (found.what, found.hinders) == ("NAOqi 2.8.7", False)


def test_nothing_listens_and_unknown_hosts():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    assert set(causes(f"tcp://127.0.0.1:{port}")) == {"nothing listens"}
    assert set(causes("no-such-robot.invalid")) == {"unknown host"}
    with pytest.raises(InvalidValueError, match="address"):
        examine("tcp://:9559")


def test_a_port_that_never_answers_is_a_firewall():
    with socket.socket() as full:  # a queue that is full drops new connections, as a firewall does
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        address = full.getsockname()
        waiting = [socket.socket() for _ in range(4)]
        for one in waiting:
            one.setblocking(False)
            one.connect_ex(address)
        assert set(causes(f"tcp://127.0.0.1:{address[1]}", timeout=0.5)) == {"no answer"}
        for one in waiting:
            one.close()


def test_an_encrypted_port_is_that_of_naoqi_2_9(listener, tmp_path):
    key, certificate = tmp_path / "key.pem", tmp_path / "cert.pem"
    made = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1", "-subj", "/CN=robot"]
    subprocess.run([*made, "-keyout", key, "-out", certificate], check=True, capture_output=True)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)

    def serve():
        while True:
            try:
                client, _ = listener.accept()
            except OSError:
                return
            try:
                context.wrap_socket(client, server_side=True).close()
            except OSError:
                client.close()

    threading.Thread(target=serve, daemon=True).start()
    found = causes(f"tcp://127.0.0.1:{listener.getsockname()[1]}")
    assert set(found) == {"encrypted"}
    assert "2.9" in found["encrypted"].advice


def test_something_else_that_listens(listener):
    def serve():
        while True:
            try:
                client, _ = listener.accept()
            except OSError:
                return
            client.sendall(b"SSH-2.0-OpenSSH_9.2\r\n")
            client.close()

    threading.Thread(target=serve, daemon=True).start()
    assert set(causes(f"tcp://127.0.0.1:{listener.getsockname()[1]}", timeout=2.0)) == {"no NAOqi"}


@pytest.mark.thorough
def test_a_token_that_is_wrong():
    with Broker() as broker, Host(broker, port=0, token="0123456789abcdef") as host:
        assert set(causes(host.url, token="fedcba9876543210")) == {"password"}


def test_the_command_says_and_ends_with_what_it_found(robot):
    broker, url = robot
    broker.module("ALAutonomousLife").setState("disabled")
    ready = CliRunner().invoke(app, ["doctor", url])
    assert ready.exit_code == 0
    assert ready.stdout.endswith("ready\n")
    broker.memory.insertData("BatteryTrapIsOpen", 1)
    hindered = CliRunner().invoke(app, ["doctor", url, "--json"])
    broker.memory.insertData("BatteryTrapIsOpen", 0)
    assert hindered.exit_code == 1
    assert json.loads(hindered.stdout)[0]["cause"] == "hatch open"
