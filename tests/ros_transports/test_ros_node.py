"""The simulated Pepper as a node, in front of clients with rclpy only."""

import time

import numpy as np
import pytest
from peers import Peer

from pepper_kin.ros_messages import action_type, message_type

ACTION = "control_msgs/action/FollowJointTrajectory"
HEAD = "/Head_controller/follow_joint_trajectory"
SUCCEEDED = 4

LATCHED = ("/tf_static", "/robot_description", "/info")
NO_WHEEL = "moveit_msgs/"
TOUCHES = {"/bumper": (2, "bumper"), "/head_touch": (2, "button"), "/hand_touch": (3, "hand")}
"""Topic -> number and field of the sensor that is pressed."""
PROGRESS = "/model/pepper_robot/joint_trajectory_progress"

COMMANDS = {
    "/cmd_vel": "geometry_msgs/msg/Twist",
    "/joint_angles": "naoqi_bridge_msgs/msg/JointAnglesWithSpeed",
    "/move_base_simple/goal": "geometry_msgs/msg/PoseStamped",
    "/pepper_robot/follow_target/left": "geometry_msgs/msg/PoseStamped",
    "/pepper_robot/joint_trajectory": "trajectory_msgs/msg/JointTrajectory",
}


@pytest.fixture(scope="module", params=["rclpy", "cyclonedds"])
def robot(request, ros_python):
    """A simulated robot in real time, through one of our transports."""
    made = Peer(ros_python, "transport_peer.py", request.param)
    made.node(cameras=["front"])
    yield made
    assert made.close() == ["MainThread"]
    made.end()


@pytest.fixture(scope="module")
def client(ros_python):
    """A program with rclpy only, which knows no robot yet."""
    made = Peer(ros_python, "rclpy_peer.py")
    yield made
    made.end()


WITH_ACTIONS = pytest.mark.parametrize("robot", ["rclpy"], indirect=True, scope="module")


def goal(joint, angle, duration):
    point = message_type("trajectory_msgs/JointTrajectoryPoint")(positions=[angle])
    point.time_from_start.sec, point.time_from_start.nanosec = int(duration), int(duration % 1 * 1e9)
    made = action_type(ACTION).goal()
    made.trajectory.joint_names, made.trajectory.points = [joint], [point]
    return made


@pytest.fixture(scope="module")
def listening(robot, client):
    topics = robot.topics()
    for topic in ("/joint_states", "/odom", *TOUCHES, PROGRESS):
        client.listen(topic=topic, type=topics[topic], reliable=topic in (*TOUCHES, PROGRESS))
    for topic, kind in COMMANDS.items():
        client.advertise(topic=topic, type=kind)
    robot.linked(sent=list(TOUCHES), heard=list(COMMANDS))
    for topic in (*TOUCHES, PROGRESS):  # what comes from a publisher that it does not know yet is lost
        client.joined(topic=topic)
    return robot


def test_every_topic_arrives(robot, ros_python):
    topics = {name: kind for name, kind in robot.topics().items() if not kind.startswith(NO_WHEEL)}
    client = Peer(ros_python, "rclpy_peer.py")
    try:
        for topic, kind in topics.items():
            client.listen(topic=topic, type=kind, reliable=topic in LATCHED, latched=topic in LATCHED)
        for topic in set(topics) - {*TOUCHES, PROGRESS}:
            assert client.heard(topic=topic), topic
        shown = client.names(kind="topics")
    finally:
        client.end()
    assert {topic: shown[topic] for topic in topics} == {topic: [kind] for topic, kind in topics.items()}


def test_touches_arrive(listening, client):
    """A ball may press pads beside the one on which it is put, too."""
    for state in (1, 0):
        listening.press(pressed=bool(state))
        for topic, (number, field) in TOUCHES.items():
            heard = (0, 1 - state)
            while heard != (number, state):
                [message] = client.messages(message_type(listening.topics()[topic]), topic=topic)
                heard = getattr(message, field), message.state


def test_velocities_move_the_odometry(listening, client):
    kind = message_type("nav_msgs/Odometry")
    start = client.next_message(kind, "/odom").pose.pose.position.x
    twist = message_type("geometry_msgs/Twist")()
    twist.linear.x = 0.2
    began, moved = time.monotonic(), 0.0
    while moved < 0.03 and time.monotonic() < began + 40.0:  # the first ones may be lost
        client.publish(topic="/cmd_vel", data=twist)
        time.sleep(0.1)
        moved = client.next_message(kind, "/odom").pose.pose.position.x - start
    assert 0.03 <= moved < 0.25 * (time.monotonic() - began)


def pose(frame, x, y, z):
    made = message_type("geometry_msgs/PoseStamped")()
    made.header.frame_id, made.pose.orientation.w = frame, 1.0
    made.pose.position.x, made.pose.position.y, made.pose.position.z = x, y, z
    return made


def standing(client):
    """Return where the base stands, once it does: messages may arrive seconds late."""
    kind, places = message_type("nav_msgs/Odometry"), [9.0, 8.0, 7.0]
    end = time.monotonic() + 40.0
    while np.ptp(places[-3:]) > 1e-3 and time.monotonic() < end:
        time.sleep(0.7)
        places.append(client.next_message(kind, "/odom").pose.pose.position.x)
    return places[-1]


def test_a_goal_moves_the_base(listening, client):
    start = standing(client)
    client.publish(topic="/move_base_simple/goal", data=pose("base_footprint", -0.1, 0.0, 0.0))
    time.sleep(1.0)
    assert standing(client) - start == pytest.approx(-0.1, abs=0.02)


def test_joint_angles_move_the_head(listening, client):
    kind = message_type("naoqi_bridge_msgs/msg/JointAnglesWithSpeed")
    angles = kind(joint_names=["HeadPitch"], joint_angles=[-0.3], speed=0.5)
    client.publish(topic="/joint_angles", data=angles)
    assert angle_of(client, "HeadPitch", near=-0.3, patience=40.0) == pytest.approx(-0.3, abs=0.005)


def test_a_hand_follows_targets(listening, client):
    """The elbow of the hand bends: where the palm arrives is tested in simulated time."""
    joint = "LElbowRoll"
    before = angle_of(client, joint, near=9.0, patience=0.2)
    target = pose("base_footprint", 0.25, 0.2, 0.85)
    end = time.monotonic() + 40.0
    while abs(angle_of(client, joint, near=9.0, patience=0.0) - before) < 0.2 and time.monotonic() < end:
        client.publish(topic="/pepper_robot/follow_target/left", data=target)
        time.sleep(0.1)
    assert abs(angle_of(client, joint, near=9.0, patience=0.0) - before) > 0.2
    time.sleep(1.5)  # the targets stop, and the hand with them


def test_a_trajectory_for_all_joints_shows_its_progress(listening, client):
    client.publish(topic="/pepper_robot/joint_trajectory", data=goal("HeadYaw", 0.2, 0.8).trajectory)
    assert angle_of(client, "HeadYaw", near=0.2, patience=40.0) == pytest.approx(0.2, abs=0.005)
    [first] = client.messages(message_type("std_msgs/msg/Float32"), topic=PROGRESS)
    assert 0.0 < first.data < 0.2


def angle_of(client, joint, near, patience=10.0):
    """Return the angle of a joint when it is near a value, or at the end of the patience [s]."""
    until = time.monotonic() + patience
    while True:
        states = client.next_message(message_type("sensor_msgs/JointState"), "/joint_states")
        angle = states.position[states.name.index(joint)]
        if abs(angle - near) < 0.004 or time.monotonic() > until:
            return angle


def send(client, message):
    return client.send_goal(name=HEAD, type=ACTION, data=message)["accepted"]


@WITH_ACTIONS
def test_an_action_with_feedback_and_result(listening, client):
    assert send(client, goal("HeadYaw", 0.3, 1.0))
    result = client.result(name=HEAD)
    assert (result["status"], result["error_code"]) == (SUCCEEDED, 0)
    assert len(result["indices"]) > 5
    assert result["joint_names"] == ["HeadYaw"]
    assert angle_of(client, "HeadYaw", near=0.3) == pytest.approx(0.3, abs=0.005)


@WITH_ACTIONS
def test_two_clients_at_once(listening, client, ros_python):
    arm = "/LeftArm_controller/follow_joint_trajectory"
    other = Peer(ros_python, "rclpy_peer.py")
    try:
        assert other.send_goal(name=arm, type=ACTION, data=goal("LElbowYaw", -0.9, 2.0))["accepted"]
        assert send(client, goal("HeadYaw", 0.5, 1.5))
        assert other.result(name=arm)["status"] == SUCCEEDED
        assert client.result(name=HEAD)["status"] == SUCCEEDED
    finally:
        other.end()
    assert angle_of(client, "LElbowYaw", near=-0.9) == pytest.approx(-0.9, abs=0.005)
    assert angle_of(client, "HeadYaw", near=0.5) == pytest.approx(0.5, abs=0.005)


@WITH_ACTIONS
@pytest.mark.parametrize("way", ["closed", "killed"])
def test_a_client_that_is_gone_in_mid_motion_stops_the_robot(listening, client, ros_python, way):
    """Closed: it leaves the graph.  Killed: DDS notices after its lease, 20 s."""
    pelvis = "/Pelvis_controller/follow_joint_trajectory"
    other = Peer(ros_python, "rclpy_peer.py")
    far = -0.5 if way == "closed" else -0.9
    try:
        start = angle_of(client, "HipPitch", near=9.0, patience=0.0)
        assert other.send_goal(name=pelvis, type=ACTION, data=goal("HipPitch", far, 60.0))["accepted"]
        time.sleep(1.0)
        if way == "killed":
            other.process.kill()
    finally:
        other.end()
    end, before, here = time.monotonic() + 45.0, None, start
    while (before is None or abs(here - before) > 1e-4) and time.monotonic() < end:
        before = here
        time.sleep(1.0)
        here = angle_of(client, "HipPitch", near=9.0, patience=0.0)
    assert abs(here - before) <= 1e-4
    assert 0.005 < abs(here - start) < 0.7 * abs(far - start)
