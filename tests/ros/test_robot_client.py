"""The client's side: certified motions through rosbridge, refusals, and lost connections."""

import threading

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.naoqi import RobotMotionStatus
from pepper_kin.ros import TransportError
from pepper_kin.ros.client import RobotClient
from pepper_kin.ros.transports.local import LocalTransport
from pepper_kin.ros.transports.rosbridge import RosbridgeServer
from pepper_kin.ros.transports.rosbridge_client import RosbridgeClient


@pytest.fixture(scope="module")
def model():
    return pk.load_pepper(hands="mimic")


@pytest.fixture
def robot(served, model):
    with RosbridgeClient(served.transport.url) as transport, RobotClient(transport, pepper=model) as made:
        yield made


def motion(robot, duration=None, **joints):
    """A certified motion from where the robot is."""
    start = robot.configuration()
    goal = start.copy()
    for name, value in joints.items():
        goal[robot.pepper.joint_index(name)] = value
    return pk.retime(robot.pepper, np.stack([start, goal]), duration=duration)


def test_joint_states_arrive_in_our_order(robot, served):
    q = robot.configuration()
    for name in ("HeadYaw", "LElbowRoll", "KneePitch"):
        assert q[robot.pepper.joint_index(name)] == pytest.approx(served.body.measured(name), abs=1e-3)


@pytest.mark.thorough
def test_a_certified_motion_is_followed(robot, served):
    for _ in range(5):  # where the robot's thread has no processor for half a second, it is stopped
        times = []
        trajectory = motion(robot, 1.5, HeadYaw=0.5, HeadPitch=0.2)
        result = robot.follow(trajectory, on_progress=times.append)
        if result.status is not RobotMotionStatus.STATE_UNUSABLE:
            break
    assert result.success, result.report()
    assert served.body.measured("HeadYaw") == pytest.approx(0.5, abs=5e-3)
    assert times == sorted(times)
    assert result.largest_error < 0.05


@pytest.mark.thorough
def test_a_motion_without_a_certificate_is_refused(robot, served):
    trajectory = motion(robot, 1.5, HeadYaw=-0.5).scaled(0.02)
    before = served.body.commanded("HeadYaw")
    with pytest.raises(InvalidValueError, match="fails velocity"):
        robot.follow(trajectory)
    assert served.body.commanded("HeadYaw") == before
    other = pk.load_pepper()
    with pytest.raises(InvalidValueError, match="one of other joints"):
        robot.follow(pk.retime(other, np.stack([other.neutral(), other.joint_vector({"HeadYaw": 0.3})])))


def test_a_motion_that_starts_elsewhere_is_not_begun(robot):
    trajectory = motion(robot, 1.5, HeadYaw=0.9)
    assert robot.follow(trajectory.reversed()).status is RobotMotionStatus.NOT_AT_START


def test_stop_and_tolerances(robot):
    trajectory = motion(robot, 3.0, HeadYaw=-0.8)
    result = robot.follow(trajectory, on_progress=lambda time: time > 0.5 and robot.stop())
    assert result.status is RobotMotionStatus.STOPPED
    result = robot.follow(motion(robot, 1.0, HeadYaw=0.5), path_tolerance=1e-5)
    assert result.status is RobotMotionStatus.ABORTED
    assert "position error of HeadYaw" in result.message
    assert result.error_code == -4


@pytest.mark.thorough
def test_a_lost_connection_stops_the_robot_and_is_reported(robot, served):
    trajectory = motion(robot, 4.0, HeadYaw=1.2)
    progress = threading.Event()

    def cut():
        progress.wait(60)
        client = robot.transport
        client._loop.call_soon_threadsafe(client._socket.protocol._abort)  # the cable, not a polite end

    threading.Thread(target=cut, daemon=True).start()
    result = robot.follow(trajectory, on_progress=lambda time: time > 0.5 and progress.set())
    assert result.status is RobotMotionStatus.CONNECTION_LOST
    body = served.body
    assert body.time.wait_until(lambda: not list(body.tasks), 10.0)
    assert abs(body.measured("HeadYaw")) < 1.1


@pytest.mark.thorough
def test_joint_states_that_stop_cancel_the_motion(model):
    """A robot whose action goes on, but whose joint states do not: the client cancels."""
    from pepper_kin.naoqi.body import Body
    from pepper_kin.ros.node import RobotNode

    with LocalTransport() as transport:
        body = Body()
        body.time.start()
        with RobotNode(body, transport, cameras=()) as node, RobotClient(transport, pepper=model) as robot:
            trajectory = motion(robot, 4.0, HeadYaw=1.2)

            def silence(time):
                if time > 0.5:
                    node._joint_states[:] = []

            result = robot.follow(trajectory, on_progress=silence)
            assert result.status is RobotMotionStatus.STATE_UNUSABLE
            assert "no joint states arrived" in result.message
            assert not result.at_rest
            assert body.time.wait_until(lambda: not list(body.tasks), 10.0)
            assert abs(body.measured("HeadYaw")) < 1.1
        body.time.stop()


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_states_that_are_no_numbers_stop_the_robot(model, value):
    from pepper_kin.naoqi.body import Body
    from pepper_kin.ros.node import RobotNode
    from pepper_kin.ros_messages import message_type

    with LocalTransport() as transport:
        body = Body()
        body.time.start()
        with RobotNode(body, transport, cameras=()), RobotClient(transport, pepper=model) as robot:
            trajectory = motion(robot, 4.0, HeadYaw=1.2)
            kind = message_type("sensor_msgs/msg/JointState")
            damaged = kind(name=["HeadYaw"], position=[value])
            result = robot.follow(
                trajectory, on_progress=lambda time: time > 0.5 and robot._on_joint_states(damaged)
            )
            assert result.status is RobotMotionStatus.STATE_UNUSABLE
            assert "position of HeadYaw: got" in result.message
            assert result.at_rest
            assert abs(body.measured("HeadYaw")) < 1.1
        body.time.stop()


def test_a_stop_while_the_certificate_is_checked_counts(robot, served, monkeypatch):
    """A2, over rosbridge."""
    trajectory = motion(robot, 1.5, HeadYaw=0.9 if served.body.measured("HeadYaw") < 0.5 else 0.0)
    monkeypatch.setattr("pepper_kin.ros.client.refuse_unsafe", lambda *_, **__: robot.stop())
    before = served.body.commanded("HeadYaw")
    result = robot.follow(trajectory)
    assert result.status is RobotMotionStatus.STOPPED
    assert served.body.commanded("HeadYaw") == before


def test_no_robot(model):
    with (
        RosbridgeServer(port=0) as server,
        RosbridgeClient(server.url) as transport,
        RobotClient(transport, pepper=model) as robot,
        pytest.raises(TransportError, match=r"none arrived within 0\.1 s"),
    ):
        robot.configuration(0.1)
