"""`Robot` against the simulated one, which another process hosts, by real messages."""

import contextlib
import importlib.util
import json
import os
import re
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from dataclasses import replace
from functools import reduce

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion import LiveMotion, LiveStatus
from pepper_kin.naoqi import FollowOptions, Robot, RobotConnectionError, RobotMotionStatus, follow_motions
from pepper_kin.naoqi.follow_motions import placed
from pepper_kin.naoqi.hosted_twin import hosted_twin
from pepper_kin.naoqi.joint_names import ACTUATED

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("qi") is None, reason="the package qi has no wheel for this machine"
)


@pytest.fixture(scope="module")
def host():
    with hosted_twin() as (url, process):
        yield url
        assert process.poll() is None


@pytest.fixture
def robot(host):
    pepper = pk.load_pepper(hands="mimic")
    standing = [float(pepper.posture("Stand")[pepper.joint_index(name)]) for name in ACTUATED]
    with Robot(host) as made:
        made._link.call("ALMotion", "setStiffnesses", "Body", 1.0)
        made._link.call(
            "ALMotion", "angleInterpolationWithSpeed", list(ACTUATED), standing, 0.5, timeout=30.0
        )
        yield made


LOOSE = FollowOptions(joint_tolerance=1.5, base_tolerance=0.3, hold_time=10.0, silence=3.0)
"""Of tests that run beside others: the clock of the hosted robot waits where the machine is busy."""


def waving(slower=5.0):
    """A certified motion of head and arms from where the robot stands."""
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    goal = q.copy()
    for name, value in (("HeadYaw", 0.6), ("LShoulderPitch", 0.6), ("LElbowRoll", -0.9)):
        goal[pepper.joint_index(name)] = value
    there = pk.retime(pepper, pk.plan(pepper, q, goal, seed=0)).scaled(slower)
    return there.then(there.reversed())


def waving_fingers():
    """A motion of a Pepper whose fingers move by themselves, which NAOqi knows nothing of."""
    pepper = pk.load_pepper(hands="independent")
    return pk.Trajectory.from_positions(pepper, [0.0, 1.0], [pepper.posture("Stand")] * 2)


def driving(distance):
    """A motion of the base alone, on a straight line, from rest to rest."""
    pepper = pk.load_pepper(base="planar")
    q = pepper.posture("Stand")
    goal = q.copy()
    goal[0] += distance
    return pk.retime(pepper, pk.plan(pepper, q, goal, seed=0))


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not (met := condition()) and time.monotonic() < end:
        time.sleep(0.05)
    return met


def moved_in(robot, seconds):
    """How far joints move in some time [rad]."""
    first = robot.state().q
    time.sleep(seconds)
    return float(np.abs(robot.state().q - first).max())


@contextlib.contextmanager
def once_moving(robot, act, moved=0.03):
    """Do something with another connection as soon as an elbow has moved [rad]; its error ends the motion."""
    start = robot.state().of(["LElbowRoll"])
    errors = []

    def watch():
        try:
            with Robot(robot.url) as other:
                assert until(lambda: np.abs(other.state().of(["LElbowRoll"]) - start)[0] > moved)
                act(other)
        except BaseException as error:
            errors.append(error)
            robot.stop()

    thread = threading.Thread(target=watch)
    thread.start()
    yield
    thread.join()
    if errors:
        raise errors[0]


def off_the_path(run, trajectory):
    """How far the farthest measured configuration is from the nearest of the motion, at whatever time.

    A command that a busy machine sends late is made up for by each joint at its rate: they are apart by up to
    what the fastest moves meanwhile, which is taken off.
    """
    planned = trajectory(np.linspace(0.0, trajectory.duration, 500))
    late = max(float(np.diff(run.time).max()) - 0.05, 0.0)
    far = max(np.abs(planned.position - q).max(axis=1).min() for q in run.position)
    return far - late * np.abs(planned.velocity).max()


@pytest.mark.thorough
def test_a_state_has_our_names_and_units(robot):
    state = robot.state()
    pepper = robot.pepper
    assert state.joint_names == pepper.joint_names
    joints = ["HeadYaw", "LShoulderPitch", "KneePitch"]
    stand = [pepper.posture("Stand")[pepper.joint_index(name)] for name in joints]
    assert state.of(joints) == pytest.approx(stand, abs=0.01)
    assert np.abs(state.q - state.command).max() < 0.02
    assert np.nanmin(state.stiffness) == 1.0
    assert state.battery == 1.0
    assert state.pressed == dict.fromkeys(state.pressed, False)
    assert set(state.pressed) > {"bumper_front_left", "head_touch_middle"}
    with pytest.raises(ValueError, match="read-only"):
        state.q[0] = 1.0


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["stream", "bezier"])
def test_a_certified_motion_is_followed(robot, method):
    trajectory = waving()
    result = robot.follow(trajectory, method=method, options=LOOSE)
    assert result.status is RobotMotionStatus.COMPLETED, result.report()
    assert result.guarded
    run = result.run
    assert run.joint_names == trajectory.joint_names
    assert run.duration > trajectory.duration - 0.1
    assert off_the_path(run, trajectory) < 0.04
    assert np.ptp(run.position[:, run.joint_names.index("HeadYaw")]) > 0.5
    assert robot.state().of(trajectory.joint_names) == pytest.approx(trajectory.end, abs=0.03)
    assert "Motion by " in result.report()


@pytest.mark.thorough
def test_the_base_follows_its_part_of_a_motion(robot):
    trajectory = driving(0.3)
    before = robot.state().base_pose
    result = robot.follow(trajectory, options=LOOSE)
    assert result.status is RobotMotionStatus.COMPLETED, result.report()
    expected = placed(before, trajectory.start[:3], trajectory.end[:3])
    assert robot.state().base_pose == pytest.approx(expected, abs=0.02)
    assert np.hypot(*(expected - before)[:2]) == pytest.approx(0.3)


@pytest.mark.thorough
def test_a_base_that_braked_beyond_the_end_comes_back(robot, monkeypatch):
    """As where a busy machine sees late that it is near; here it brakes where it passes the end."""
    monkeypatch.setattr(follow_motions, "STANDS", 1.0)
    trajectory = driving(0.3)
    expected = placed(robot.state().base_pose, trajectory.start[:3], trajectory.end[:3])
    result = robot.follow(trajectory, options=replace(LOOSE, base_gain=4.0))
    assert result.status is RobotMotionStatus.COMPLETED, result.report()
    assert robot.state().base_pose == pytest.approx(expected, abs=0.02)


@pytest.mark.thorough
def test_a_live_motion_goes_where_its_goal_goes(robot):
    pepper = pk.load_pepper()
    careful = pepper.with_limits(velocity=0.2 * pepper.velocity_limits)
    stand = pepper.posture("Stand")
    turned, reaching, head = stand.copy(), stand.copy(), pepper.joint_index("HeadYaw")
    turned[head], reaching[pepper.joint_index("LShoulderPitch")] = 0.6, 0.6
    goals = [turned, reaching, stand]
    live = LiveMotion(careful, robot.state().of(pepper.joint_names), tolerance=1.5, budget=1.0)
    seen, said_no = [], []

    def each_cycle(now, state):
        if state is None or state.status is LiveStatus.REACHED:
            if not goals:
                said_no.append(now)
                return False
            live.set_goal(goals.pop(0))
        elif state.status is LiveStatus.MOVING and len(goals) == 2 and state.at(now).position[head] > 0.2:
            live.set_goal(goals.pop(0))  # on its way
        assert not said_no  # nor asked again after it
        live.set_scene(pk.Scene(), now)
        seen.append(state)
        return len(seen) < 3000

    result = robot.follow_live(live, each_cycle, options=LOOSE)
    assert result.status is RobotMotionStatus.COMPLETED, result.report()
    assert not goals
    assert robot.state().of(pepper.joint_names) == pytest.approx(stand, abs=0.03)
    assert np.ptp(result.run.position[:, result.run.joint_names.index("HeadYaw")]) > 0.2


@pytest.mark.thorough
def test_an_error_in_a_cycle_of_a_live_motion_stops_the_robot(robot):
    pepper = pk.load_pepper()
    live = LiveMotion(pepper, robot.state().of(pepper.joint_names), tolerance=1.5, budget=1.0)
    live.set_goal(waving()(1.0).position)
    seen = []

    def each_cycle(now, state):
        seen.append(now)
        if now > seen[0] + 0.5:
            raise RuntimeError("the camera is gone")
        return True

    with pytest.raises(RuntimeError, match="the camera is gone"):
        robot.follow_live(live, each_cycle, options=LOOSE)
    assert until(lambda: moved_in(robot, 0.3) < 0.005)
    driving_pepper = pk.load_pepper(base="planar")
    with pytest.raises(InvalidValueError, match="a base"):
        robot.follow_live(LiveMotion(driving_pepper, driving_pepper.posture("Stand")), each_cycle)


def test_a_pose_placed_elsewhere_keeps_what_lies_between():
    origin, start = np.array([1.0, 2.0, np.pi / 2]), np.array([3.0, 0.0, 0.0])
    pose = np.array([4.0, 0.5, 0.2])
    assert placed(origin, start, pose) == pytest.approx([0.5, 3.0, np.pi / 2 + 0.2])
    assert placed(start, start, pose) == pytest.approx(pose)


@pytest.mark.thorough
def test_driving_and_going_to_a_pose(robot):
    before = robot.state().base_pose
    assert robot.move_to([0.1, 0.0, 0.0], silence=3.0)
    robot.drive([0.0, 0.0, 0.4], 0.6, silence=3.0)
    assert until(lambda: np.abs(robot.state().velocity[:3]).max() < 1e-3)
    after = robot.state().base_pose
    assert np.hypot(*(after - before)[:2]) == pytest.approx(0.1, abs=0.02)
    assert 0.05 < (after - before)[2] < 0.6


@pytest.mark.thorough
def test_motions_without_a_certificate_are_refused(robot):
    fast = waving(0.3)
    with pytest.raises(InvalidValueError, match=r"one that fails velocity.*passes check\(\); velocity"):
        robot.follow(fast)
    with pytest.raises(InvalidValueError, match="one that fails"):
        Robot.dry_run(fast)
    pepper = pk.load_pepper()
    hand = pk.kinematics.frame_pose(pepper, pepper.posture("Stand"), "LArm_effector")[:3, 3]
    scene = pk.Scene().add_sphere("ball", radius=0.1, position=tuple(hand))
    with pytest.raises(InvalidValueError, match="clearance"):
        robot.follow(waving(), scene=scene)
    with pytest.raises(InvalidValueError, match=r"joints of the trajectory.*hands='mimic'"):
        robot.follow(waving_fingers())


@pytest.mark.thorough
def test_motions_from_elsewhere_and_limp_motors_are_refused(robot):
    trajectory = waving()
    half = trajectory.between(trajectory.duration / 2, trajectory.duration)
    with pytest.raises(InvalidValueError, match=r"start of \w+: got .* where the robot is at .*plan from"):
        robot.follow(half)
    robot._link.call("ALMotion", "setStiffnesses", "HeadYaw", 0.0)
    try:
        with pytest.raises(InvalidValueError, match=r"HeadYaw off, expected .*wake_up"):
            robot.follow(trajectory)
    finally:
        robot._link.call("ALMotion", "setStiffnesses", "HeadYaw", 1.0)


@pytest.mark.thorough
def test_a_robot_that_lets_an_arm_fall_is_stopped_and_reported(robot):
    trajectory = waving(10.0)
    options = replace(LOOSE, joint_tolerance=0.2)
    with once_moving(robot, lambda other: other._link.call("ALMotion", "setStiffnesses", "LArm", 0.0)):
        result = robot.follow(trajectory, options=options)
    assert result.status is RobotMotionStatus.DEVIATED
    assert re.search(r"L\w+ is 0\.\d+ from the motion, tolerance 0\.2", result.message)


@pytest.mark.thorough
def test_a_motion_that_somebody_else_ends_is_not_complete(robot):
    with once_moving(robot, lambda other: other._link.call("ALMotion", "killAll")):
        result = robot.follow(waving(20.0), method="bezier", options=LOOSE)
    assert result.status is RobotMotionStatus.STOPPED
    assert re.search(r"ended it after \d\.\d+ s of \d+\.\d+ s", result.message)


@pytest.mark.thorough
def test_stop_ends_a_motion(robot):
    trajectory = waving(20.0)
    with once_moving(robot, lambda other: robot.stop()):
        result = robot.follow(trajectory, options=LOOSE)
    assert result.status is RobotMotionStatus.STOPPED
    assert result.run.duration < trajectory.duration / 2
    assert until(lambda: moved_in(robot, 0.3) < 1e-3)


CLIENT = textwrap.dedent(
    """
    import json, sys
    from pepper_kin.naoqi import Robot
    with Robot(sys.argv[1], timeout=3.0) as robot:
        print("ready", flush=True)
        result = robot.drive([0.15, 0.0, 0.0], 600.0, silence=2.0)
        print(json.dumps([result.message, result.status.value]), flush=True)
    """
)


def started(url):
    client = subprocess.Popen([sys.executable, "-c", CLIENT, url], stdout=subprocess.PIPE, text=True)
    assert client.stdout.readline() == "ready\n"
    return client


@pytest.mark.thorough
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_the_host_stops_a_robot_whose_client_is_gone_or_stalled(robot, how):
    client = started(robot.url)
    try:
        assert until(lambda: np.hypot(*robot.state().velocity[:2]) > 0.1)
        os.kill(client.pid, how)
        assert until(lambda: np.abs(robot.state().velocity[:3]).max() < 1e-3)
        place = robot.state().base_pose
        time.sleep(0.5)
        assert robot.state().base_pose == pytest.approx(place, abs=1e-3)
        if how == signal.SIGSTOP:
            os.kill(client.pid, signal.SIGCONT)
            text, status = json.loads(client.communicate(timeout=60)[0])
            assert status == "stalled", text
            assert re.search(r"watchdog stopped it: no beat for \d\.\d+ s", text)
    finally:
        client.kill()
        client.communicate(timeout=30)


class Cable:
    """A connection to a port that can be cut."""

    def __init__(self, url):
        self.port = int(url.rsplit(":", 1)[1])
        self.server = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self.server.getsockname()[1]}"
        self.ends = []
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                near, _ = self.server.accept()
            except OSError:
                return
            far = socket.create_connection(("127.0.0.1", self.port))
            self.ends += [near, far]
            for a, b in ((near, far), (far, near)):
                threading.Thread(target=self.pass_on, args=(a, b), daemon=True).start()

    def pass_on(self, a, b):
        try:
            while data := a.recv(65536):
                b.sendall(data)
        except OSError:
            pass

    def cut(self):
        self.server.close()
        for end in self.ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["stream", "bezier"])
def test_a_cut_connection_in_mid_motion_is_reported_and_the_robot_stands(robot, method):
    cable = Cable(robot.url)
    with Robot(cable.url, timeout=3.0) as cut:
        trajectory = waving(30.0 if method == "stream" else 15.0)
        with once_moving(robot, lambda other: cable.cut()):
            result = cut.follow(trajectory, method=method, options=LOOSE)
        assert result.status is RobotMotionStatus.CONNECTION_LOST
        assert cable.url in result.message
        assert result.run.duration < trajectory.duration / 2
        assert until(lambda: moved_in(robot, 0.4) < 1e-3, 15.0)
        assert np.abs(robot.state().of(trajectory.joint_names) - trajectory.start).max() > 0.01
        with pytest.raises(RobotConnectionError):
            cut.state()
        assert not cut.connected
    time.sleep(LOOSE.silence + 0.5)  # until the watchdog has stopped what moves, which may be the next test's


def rocking(standing, times=12):
    """A certified motion of an elbow to and fro, never farther from a posture than a start may be."""
    pepper = pk.load_pepper()
    elbow = pepper.joint_index("LElbowRoll")
    ends = [standing.copy(), standing.copy()]
    ends[0][elbow] += 0.018
    ends[1][elbow] -= 0.018
    there = pk.Trajectory.from_positions(pepper, [0.0, 4.0], ends)
    once = there.then(there.reversed())
    return reduce(pk.Trajectory.then, [once] * times)


@pytest.mark.thorough
def test_of_two_clients_that_follow_at_once_the_second_is_refused(robot):
    results, going = [], []
    pepper = pk.load_pepper()
    standing = pepper.posture("Stand").copy()
    standing[pepper.joint_index("LElbowRoll")] = -0.3
    stay = pk.Trajectory.from_positions(pepper, [0.0, 2.0], [standing, standing])
    rocked = rocking(standing)
    here = [float(x) for x in rocked.start]
    robot._link.call(
        "ALMotion", "angleInterpolationWithSpeed", list(rocked.joint_names), here, 0.5, timeout=30.0
    )
    assert until(lambda: moved_in(robot, 0.3) < 1e-3)

    def intrude(other):
        results.append(other.follow(stay, options=LOOSE))
        going.append(until(lambda: moved_in(other, 0.5) > 1e-3))
        robot.stop()

    with once_moving(robot, intrude, moved=0.02):
        result = robot.follow(rocked, options=LOOSE)
    assert result.status is RobotMotionStatus.STOPPED, result.report()
    assert going == [True]
    (refused,) = results
    assert refused.status is RobotMotionStatus.REFUSED
    assert "another client moves HeadPitch, HeadYaw" in refused.message


@pytest.mark.thorough
def test_a_host_that_dies_is_reported():
    with hosted_twin() as (url, process), Robot(url, timeout=2.0) as robot:
        trajectory = waving(30.0)
        with once_moving(robot, lambda other: process.kill()):
            result = robot.follow(trajectory, options=LOOSE)
        assert result.status is RobotMotionStatus.CONNECTION_LOST
        assert result.run.duration < trajectory.duration / 2


def test_nobody_answers():
    with pytest.raises(RobotConnectionError, match="connect: "):
        Robot("tcp://127.0.0.1:1")


@pytest.mark.thorough
def test_a_robot_without_a_watchdog_is_not_driven(robot):
    robot.has_watchdog = False
    for call in (
        lambda: robot.drive([0.1, 0.0, 0.0], 1.0),
        lambda: robot.move_to([0.1, 0.0, 0.0]),
        lambda: robot.follow(waving(), method="bezier"),
        lambda: robot.follow(driving(0.1)),
    ):
        with pytest.raises(InvalidValueError, match="unguarded=True"):
            call()
    result = robot.follow(waving(), options=LOOSE)
    assert result.success
    assert not result.guarded
    assert "no watchdog" in result.report()


@pytest.mark.thorough
def test_a_dry_run_needs_a_motion_only():
    result = Robot.dry_run(waving(), method="bezier", options=LOOSE)
    assert result.success, result.report()
    assert off_the_path(result.run, waving()) < 0.03


def test_the_watchdog_for_the_robot_is_one_file(tmp_path):
    path = Robot.write_watchdog(tmp_path / "watchdog.py")
    done = subprocess.run(
        [sys.executable, "-I", "-S", str(path)], capture_output=True, text=True, timeout=60, check=False
    )
    assert "No module named 'qi'" in done.stderr  # the only thing that it needs
    assert path.read_text().isascii()


@pytest.mark.thorough
def test_what_a_hosted_twin_logs_never_stops_it():
    """A pipe that nobody reads is full after 64 kB, and libqi then waits for ever."""
    with hosted_twin() as (url, process):
        pipe = os.open(f"/proc/{process.pid}/fd/1", os.O_WRONLY | os.O_NONBLOCK)
        try:
            left, end = 1_000_000, time.monotonic() + 60.0
            while left and time.monotonic() < end:
                try:
                    left -= os.write(pipe, b"[W] something\n" * min(1000, left // 14 + 1))
                except BlockingIOError:
                    time.sleep(0.01)
                left = max(left, 0)
        finally:
            os.close(pipe)
        assert not left
        with Robot(url) as robot:
            assert robot.state().q.size
