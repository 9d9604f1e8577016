"""The transport through Zenoh between nodes of ours; beside pyzeros it is in `ros_transports`."""

import contextlib
import socket
import threading

import numpy as np
import pytest
from zenoh_goals import FOLLOW, Server, goal_of, until

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.naoqi.body import Body
from pepper_kin.ros import QoS, RobotClient, RobotNode, TransportError
from pepper_kin.ros.transport import GoalStatus
from pepper_kin.ros.transports.zenoh import ZenohTransport
from pepper_kin.ros_messages import message_type, service_type

STRING = message_type("std_msgs/msg/String")


@pytest.fixture
def router():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp/localhost:{free.getsockname()[1]}"


@pytest.fixture
def ours(router):
    with ZenohTransport("ours", domain_id=7, router=router) as transport:
        yield transport


@pytest.fixture
def other(ours, router):
    with ZenohTransport("other", domain_id=7, router=router) as transport:
        yield transport


def test_late_subscriptions_get_what_is_latched(ours, other):
    ours.advertise("/old", "std_msgs/msg/String", QoS(1, latched=True)).publish(STRING(data="kept"))
    heard = []
    other.subscribe("/old", "std_msgs/msg/String", QoS(1, latched=True), heard.append)
    assert until(lambda: heard)[0].data == "kept"


def test_goals_end_with_their_clients_and_clients_hear_that_a_server_has_gone(ours, other):
    offered = ours.offer_action("/follow", FOLLOW, Server())
    feedback = []
    handle = other.send_goal("/follow", FOLLOW, goal_of("x"), feedback.append, 60.0)
    assert handle.result(60.0).status == GoalStatus.SUCCEEDED
    assert [one.index for one in feedback] == list(range(6))
    assert not other.send_goal("/follow", FOLLOW, goal_of("wrong"), timeout=60.0).accepted
    kept = other.send_goal("/follow", FOLLOW, goal_of("long"), timeout=60.0)
    goal = offered._goals[kept.goal_id]
    other.close()
    assert goal.result(60.0).status == GoalStatus.CANCELED  # nobody is left to stop it


def test_a_client_hears_that_its_server_has_gone(ours, other):
    other.offer_action("/follow", FOLLOW, Server())
    handle = ours.send_goal("/follow", FOLLOW, goal_of("long"), timeout=60.0)
    other.close()
    assert handle.result(60.0).status == GoalStatus.ABORTED


@pytest.mark.thorough
def test_a_robot_is_moved_and_stopped_over_it(ours, other):
    """And one whose client has gone stops."""
    model, body = pk.load_pepper(hands="mimic"), Body()
    body.time.start()
    with contextlib.closing(RobotNode(body, ours, cameras=())), RobotClient(other, pepper=model) as robot:
        start = robot.configuration()
        goal = start.copy()
        goal[model.joint_index("HeadYaw")] = 0.5
        result = robot.follow(pk.retime(model, np.stack([start, goal]), duration=1.5))
        assert result.success, result.report()
        assert body.measured("HeadYaw") == pytest.approx(0.5, abs=5e-3)
        back = pk.retime(model, np.stack([goal, start]), duration=8.0)
        threading.Thread(target=lambda: robot.follow(back), daemon=True).start()
        until(lambda: body.measured("HeadYaw") < 0.45)
        other.close()
        until(lambda: not list(body.tasks))
        assert body.measured("HeadYaw") > 0.1
    body.time.stop()


def test_what_cannot_be_opened_is_said(ours, router):
    with pytest.raises(InvalidValueError, match="router"):
        ZenohTransport(router="localhost")
    with pytest.raises(TransportError, match="no router of Zenoh listens there"):
        ZenohTransport(router="tcp/192.0.2.1:7447")
    ours.close()
    with pytest.raises(TransportError, match="the transport is closed"):
        ours.advertise("/x", "std_msgs/msg/String")
    with pytest.raises(TransportError, match="closed"):
        ours.call_service("/x", "std_srvs/srv/Trigger", service_type("std_srvs/srv/Trigger").request())
