"""The twin beside a robot, live and from a log: what is mirrored, how they differ, what tools read."""

import importlib.util
import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import pepper_kin as pk
from pepper_kin.cli import app
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.naoqi import Broker, Mirror, Robot, RunLog, states_of_run
from pepper_kin.naoqi.hosted_twin import hosted_twin
from pepper_kin.twin import load_run
from pepper_kin.twin.base import BalanceMonitor

needs_qi = pytest.mark.skipif(
    importlib.util.find_spec("qi") is None, reason="the package qi has no wheel for this machine"
)


@pytest.fixture(scope="module")
def pepper():
    return pk.load_pepper(base="planar", hands="mimic")


@pytest.fixture(scope="module")
def log():
    """A run of the simulated robot: head and an arm move, then the base."""
    with Broker(real_time=False) as broker:
        log = RunLog(broker.body)
        names = ["HeadYaw", "LShoulderPitch", "LElbowRoll"]
        broker.motion.angleInterpolation(names, [[0.5], [0.8], [-1.0]], [[1.0]] * 3, True)
        broker.motion.moveTo(0.2, 0.1, 0.5)
        return log.run()


def mirrored(pepper, run):
    mirror = Mirror(pepper)
    for state in states_of_run(run):
        mirror.add(state)
    return mirror


def test_the_twin_does_what_a_simulated_robot_did(pepper, log):
    mirror = mirrored(pepper, log)
    assert len(mirror) == len(log)
    assert mirror.restarts == 1
    assert mirror.run().position == pytest.approx(log.position, abs=1e-9)
    assert mirror.run().time == pytest.approx(log.time, abs=1e-9)
    off = mirror.twin_run().position - log.position
    rms = np.sqrt(np.mean(off**2, axis=0))
    assert rms[3:].max() < 1e-3
    assert rms[:3].max() < 1e-2  # the twin's base follows what was measured
    assert np.ptp(log.position[:, pepper.joint_index("LElbowRoll")]) > 0.4


def test_a_joint_that_is_held_is_first_in_the_report(pepper, log):
    position = np.array(log.position)
    elbow = pepper.joint_index("LElbowRoll")
    position[:, elbow] = position[0, elbow]
    mirror = mirrored(pepper, replace(log, position=position))
    off = mirror.difference
    assert np.argmax(np.abs(off)) == elbow
    assert abs(off[elbow]) == pytest.approx(abs(log.position[-1, elbow] - position[0, elbow]), abs=5e-3)
    assert mirror.report().splitlines()[2].split()[0] == "LElbowRoll"


def test_joints_without_stiffness_and_a_turned_base_do_not_differ(pepper, log):
    mirror = Mirror(pepper)
    yaw, arm = pepper.joint_index("BaseYaw"), pepper.joint_index("RShoulderPitch")
    for state in states_of_run(log):
        q, stiffness = np.array(state.q), np.array(state.stiffness)
        q[yaw] = np.pi - 0.2 + 2.0 * state.time / log.duration
        q[yaw] = (q[yaw] + np.pi) % (2.0 * np.pi) - np.pi  # as odometry may report it
        q[arm] += 0.3 * state.time / log.duration
        stiffness[arm] = 0.0
        mirror.add(replace(state, q=q, stiffness=stiffness))
        assert np.abs(mirror.difference[[yaw, arm]]).max() < 0.05
    assert np.abs(np.diff(mirror.run().position[:, yaw])).max() < 0.1


def test_after_a_gap_the_twin_begins_where_the_robot_is(pepper, log):
    mirror = Mirror(pepper)
    first, *_, last = states_of_run(log)
    mirror.add(first)
    assert np.abs(mirror.add(last)).max() < 1e-9
    assert mirror.restarts == 2


def test_states_that_do_not_fit_are_refused(pepper, log):
    mirror = Mirror(pepper)
    first = next(states_of_run(log))
    for call, message in (
        (lambda: mirror.difference, "states: got 0"),
        (mirror.run, "states: got 0, expected 2 or more"),
        (lambda: mirror.add(replace(first, joint_names=first.joint_names[1:])), "joints of the state"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            call()
    mirror.add(first)
    with pytest.raises(InvalidValueError, match=r"time of the state: got 0.*more than 0 s"):
        mirror.add(first)


@pytest.mark.thorough
def test_the_run_is_read_by_the_tools(pepper, log, tmp_path):
    run = mirrored(pepper, log).run()
    again = load_run(pepper, run.save(tmp_path / "run.csv"))
    assert again.position == pytest.approx(run.position, abs=1e-9)
    report = BalanceMonitor(pepper).assess_run(again)
    assert len(report.margin) == len(run)
    page = pk.Viewer(pepper).save_html(tmp_path / "run.html", again)
    assert page.stat().st_size > 100_000
    assert "worst tracking" in again.report()


@pytest.mark.thorough
@needs_qi
def test_a_live_robot_is_mirrored_as_its_log_has_it(pepper, tmp_path):
    record = tmp_path / "host.csv"
    mirror = Mirror(pepper)
    with hosted_twin(None, "--record", str(record)) as (url, _), Robot(url) as robot:
        future = robot._link.start(
            "ALMotion", "angleInterpolation", ["HeadYaw"], [[0.6, 0.0]], [[1.5, 3.0]], True
        )
        for state in robot.states():
            mirror.add(state)
            if future.isFinished():
                break
    logged = load_run(pepper, record).position
    rows = []
    for q in (state.q for state in mirror._measured):  # each state is one that the robot was in
        rows.append(int(np.argmin(np.abs(logged - q)[:, 3:].max(axis=1))))
        off = np.abs(logged[rows[-1]] - q)
        assert off[3:].max() < 1e-5
        assert off[:3].max() < 1e-3  # the base is read by another message, in a cycle nearby
    assert (np.diff(rows) >= 0).all()
    yaw = pepper.joint_index("HeadYaw")
    assert np.ptp(mirror.run().position[:, yaw]) > 0.3
    gap = np.diff([state.time for state in mirror._measured]).max()
    speed = pepper.velocity_limits[yaw]
    assert np.abs(mirror.run().tracking_error[:, yaw]).max() < speed * (gap + 0.1)


@pytest.mark.thorough
@needs_qi
def test_the_command_mirrors_a_robot_and_its_log(tmp_path):
    live, again = tmp_path / "live.csv", tmp_path / "again.csv"
    with hosted_twin() as (url, _):
        done = CliRunner().invoke(app, ["naoqi", "mirror", url, "--seconds", "1.5", "--record", str(live)])
    assert done.exit_code == 0, done.output
    assert "Mirror of 1." in done.stdout
    done = CliRunner().invoke(app, ["naoqi", "mirror", str(live), "--record", str(again), "--json"])
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert max(said["most_off"].values()) < 0.01
    pepper = pk.load_pepper(base="planar", hands="mimic")
    first, second = (load_run(pepper, path) for path in (live, again))
    for quantity in ("time", "position", "reference_position", "velocity", "torque"):
        assert getattr(second, quantity) == pytest.approx(getattr(first, quantity), abs=1e-6)


def test_the_watchdog_is_written_by_a_command(tmp_path):
    path = tmp_path / "watchdog.py"
    done = CliRunner().invoke(app, ["naoqi", "watchdog", "-o", str(path), "--json"])
    assert done.exit_code == 0, done.output
    assert "class MotionWatchdog" in path.read_text()


def test_the_command_refuses_a_file_that_is_not_there(tmp_path):
    done = CliRunner().invoke(app, ["naoqi", "mirror", str(tmp_path / "none.csv")])
    assert done.exit_code != 0
