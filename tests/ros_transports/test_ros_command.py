"""`pepper-kin ros` over DDS, as a user starts it, in front of a client with rclpy only in another process."""

import json
import os
import signal
import subprocess
from functools import partial

import pytest
from peers import Peer, environment_variables

from pepper_kin.ros_messages import action_type, message_type

ACTION = "control_msgs/action/FollowJointTrajectory"
HEAD = "/Head_controller/follow_joint_trajectory"
STATES = "/joint_states"
# A shell that begins a program with & has it ignore Ctrl-C, and so do the programs that it begins.
HEAR = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
CODE = f"{HEAR}; from pepper_kin.cli import main; main()"


def command(python, *arguments, **variables):
    """Start `pepper-kin ros`, with the range of discovery that a user has who has set none."""
    made = environment_variables(**variables)
    if "ROS_AUTOMATIC_DISCOVERY_RANGE" not in variables:
        made.pop("ROS_AUTOMATIC_DISCOVERY_RANGE")
    return subprocess.Popen(
        [str(python), "-c", CODE, "ros", *arguments],
        env=made,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def first_json(process):
    text = ""
    while "}" not in text:
        line = process.stdout.readline()
        assert line, process.stderr.read()
        text += line
    return json.loads(text)


def trajectory(angle):
    point = message_type("trajectory_msgs/JointTrajectoryPoint")(positions=[angle])
    point.time_from_start.sec = 1
    return message_type("trajectory_msgs/JointTrajectory")(joint_names=["HeadYaw"], points=[point])


def head_angle(client, near, again=None):
    """Return the angle of HeadYaw when it is near a value, or after 500 messages, each 100th with `again`."""
    for k in range(500):
        if again is not None and k % 100 == 99:
            again()
        states = client.next_message(message_type("sensor_msgs/JointState"), STATES)
        angle = states.position[states.name.index("HeadYaw")]
        if abs(angle - near) < 0.004:
            break
    return angle


@pytest.mark.parametrize("reach", ["LOCALHOST", "SUBNET"])
@pytest.mark.parametrize("transport", ["rclpy", "cyclonedds"])
def test_a_client_reads_and_commands_a_robot_of_the_command_line(ros_python, tmp_path, transport, reach):
    """Each on its own: Ctrl-C ends it for one range of the client, SIGTERM for the other."""
    record = tmp_path / "new" / "run.csv"
    arguments = ("--transport", transport, "--cameras", "none", "--record", str(record), "--json")
    robot = command(ros_python, *arguments)
    client = None
    try:
        found = first_json(robot)
        expected = {"domain_id": 1 + os.getpid() % 100, "discovery_range": "LOCALHOST"}
        assert found == {"transport": transport, **expected}
        client = Peer(ros_python, "rclpy_peer.py", ROS_AUTOMATIC_DISCOVERY_RANGE=reach)
        client.listen(topic=STATES, type="sensor_msgs/msg/JointState")
        assert len(client.next_message(message_type("sensor_msgs/JointState"), STATES).name) == 20
        again = None
        if transport == "rclpy":
            goal = action_type(ACTION).goal(trajectory=trajectory(0.3))
            assert client.send_goal(name=HEAD, type=ACTION, data=goal)["accepted"]
            assert client.result(name=HEAD)["error_code"] == 0
        else:
            topic = "/Head_controller/joint_trajectory"
            client.advertise(topic=topic, type="trajectory_msgs/msg/JointTrajectory")
            # The subscription may not know its publisher yet, which does know it: what is sent then is lost.
            again = partial(client.publish, topic=topic, data=trajectory(0.3))
            again()
        assert head_angle(client, 0.3, again) == pytest.approx(0.3, abs=0.005)
        robot.send_signal(signal.SIGINT if reach == "LOCALHOST" else signal.SIGTERM)
        errors = robot.communicate(timeout=60)[1]
        assert robot.returncode == 0, errors
        assert "Traceback" not in errors
        assert record.stat().st_size > 10_000
    finally:
        robot.kill()
        robot.communicate()
        if client is not None:
            client.end()


@pytest.mark.parametrize(
    ("transport", "arguments", "variables", "line"),
    [
        ("rclpy", ("--port", "9090"), {}, "--port: got 9090, expected to be left out"),
        *(
            (
                transport,
                (),
                {"ROS_DOMAIN_ID": "233"},
                "ROS_DOMAIN_ID: got '233', expected a whole number from 0 to 232",
            )
            for transport in ("rclpy", "cyclonedds")
        ),
        (
            "rclpy",
            (),
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "HOME"},
            "ROS_AUTOMATIC_DISCOVERY_RANGE: got 'HOME', expected one of OFF, LOCALHOST, SUBNET",
        ),
        ("cyclonedds", ("--record", "run.mcp"), {}, "--record: got 'run.mcp', expected a file that ends in"),
    ],
    ids=["port", "domain rclpy", "domain cyclonedds", "range", "record"],
)
def test_what_is_wrong_is_said_in_one_line(ros_python, transport, arguments, variables, line):
    process = subprocess.Popen(
        [str(ros_python), "-c", CODE, "ros", "--transport", transport, *arguments],
        env=environment_variables(**variables),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    output, errors = process.communicate(timeout=100)
    assert (process.returncode, output) == (2, "")
    assert errors.startswith(f"pepper-kin: {line}")
    assert len(errors.splitlines()) == 1
