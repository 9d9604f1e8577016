"""Services and actions through rclpy against rclpy's servers and clients: feedback, results, cancels."""

import itertools

import pytest

from pepper_kin.ros_messages import action_type, message_type

ACTION, SERVICE = "control_msgs/action/FollowJointTrajectory", "std_srvs/srv/SetBool"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6

_numbers = itertools.count()


@pytest.fixture(params=["our server", "our client"])
def sides(request, ours, peer):
    """Server and client of an action, one of them ours, and its name."""
    server, client = (ours, peer) if request.param == "our server" else (peer, ours)
    name = f"/action{next(_numbers)}"
    server.serve_action(name=name, type=ACTION)
    return server, client, name


def send(client, name, *joints):
    trajectory = message_type("trajectory_msgs/JointTrajectory")(joint_names=joints)
    goal = action_type(ACTION).goal(trajectory=trajectory)
    try:
        return client.send_goal(name=name, type=ACTION, data=goal)
    except AssertionError as error:
        # A server that has not found the reader of its answer in time, on a busy machine, drops the answer.
        if "no answer within" not in str(error):
            raise
    return client.send_goal(name=name, type=ACTION, data=goal)


def test_feedback_and_result(sides):
    _, client, name = sides
    assert send(client, name, "HeadYaw", "HeadPitch")["accepted"]
    result = client.result(name=name)
    assert (result["status"], result["error_code"]) == (SUCCEEDED, 0)
    assert result["indices"] == sorted(result["indices"])
    assert result["indices"]
    assert result["joint_names"] == ["HeadYaw", "HeadPitch"]


def test_wrong_joints_are_refused(sides):
    _, client, name = sides
    assert not send(client, name, "wrong")["accepted"]


def test_violated_tolerances_abort(sides):
    _, client, name = sides
    assert send(client, name, "violated")["accepted"]
    result = client.result(name=name)
    assert (result["status"], result["error_code"]) == (ABORTED, -4)
    assert result["error_string"] == "HeadYaw by 0.2"


def test_cancel(sides):
    _, client, name = sides
    assert send(client, name, "long")["accepted"]
    assert client.cancel(name=name) == 1
    result = client.result(name=name)
    assert (result["status"], result["error_string"]) == (CANCELED, "stopped")
    assert client.cancel(name=name) == 0


def test_a_server_may_refuse_to_cancel(ours, peer):
    ours.serve_action(name="/stubborn", type=ACTION)
    assert send(peer, "/stubborn", "stubborn", "long")["accepted"]
    assert peer.cancel(name="/stubborn") == 0


def test_a_failing_server_aborts(ours, peer):
    ours.serve_action(name="/failing", type=ACTION)
    assert send(peer, "/failing", "failing")["accepted"]
    assert peer.result(name="/failing")["status"] == ABORTED


def test_closing_an_action_aborts_its_goals(ours, peer):
    ours.serve_action(name="/closing", type=ACTION)
    assert send(peer, "/closing", "HeadYaw")["accepted"]
    assert peer.result(name="/closing")["status"] == SUCCEEDED, "now the server knows the client"
    assert send(peer, "/closing", "long")["accepted"]
    ours.stop_serving(name="/closing")
    assert peer.result(name="/closing")["status"] == ABORTED


def test_services_both_ways(ours, peer):
    ours.serve(name="/ours", type=SERVICE)
    peer.serve(name="/theirs", type=SERVICE)
    assert peer.call(name="/ours", type=SERVICE, value=False) == [True, "tested"]
    assert peer.call(name="/ours", type=SERVICE, value=True) == [False, ""], "a failing service must answer"
    assert peer.call(name="/ours", type=SERVICE, value=False) == [True, "tested"], "and go on"
    assert ours.call(name="/theirs", type=SERVICE, value=True) == [True, "peer"]


def test_a_missing_service_is_named(ours):
    assert "/nowhere: nobody offers this service" in ours.refused(
        name="/nowhere", type="std_srvs/srv/Trigger"
    )
