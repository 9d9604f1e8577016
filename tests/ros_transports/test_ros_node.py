"""The simulated Pepper as a node, in front of clients with rclpy only."""

import time

import pytest
from peers import Peer

from pepper_kin.ros_messages import action_type, message_type

ACTION = "control_msgs/action/FollowJointTrajectory"
HEAD = "/Head_controller/follow_joint_trajectory"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6

TOPICS = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/odom": "nav_msgs/msg/Odometry",
    "/laser": "sensor_msgs/msg/LaserScan",
    "/sonar/front": "sensor_msgs/msg/Range",
    "/imu/torso": "sensor_msgs/msg/Imu",
    "/camera/front/image_raw": "sensor_msgs/msg/Image",
    "/camera/front/camera_info": "sensor_msgs/msg/CameraInfo",
    "/Head_controller/controller_state": "control_msgs/msg/JointTrajectoryControllerState",
}
"""What the node publishes all the time."""

LATCHED = {"/tf_static": "tf2_msgs/msg/TFMessage", "/robot_description": "std_msgs/msg/String"}


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


def goal(joint, angle, duration, path=0.0):
    point = message_type("trajectory_msgs/JointTrajectoryPoint")(positions=[angle])
    point.time_from_start.sec, point.time_from_start.nanosec = int(duration), int(duration % 1 * 1e9)
    made = action_type(ACTION).goal()
    made.trajectory.joint_names, made.trajectory.points = [joint], [point]
    if path:
        made.path_tolerance = [message_type("control_msgs/JointTolerance")(name=joint, position=path)]
    return made


@pytest.fixture(scope="module")
def listening(robot, client):
    for topic, kind in TOPICS.items():
        client.listen(topic=topic, type=kind, reliable=False)
    for topic, kind in LATCHED.items():
        client.listen(topic=topic, type=kind, latched=True)
    client.advertise(topic="/cmd_vel", type="geometry_msgs/msg/Twist")
    client.advertise(topic="/Head_controller/joint_trajectory", type="trajectory_msgs/msg/JointTrajectory")
    return robot


def test_every_topic_arrives(listening, client):
    for topic, kind in {**TOPICS, **LATCHED}.items():
        assert client.heard(topic=topic), topic
        assert client.names(kind="topics")[topic] == [kind]


def test_velocities_move_the_odometry(listening, client):
    kind, topic = message_type("nav_msgs/Odometry"), "/odom"
    start = client.next_message(kind, topic).pose.pose.position.x
    twist = message_type("geometry_msgs/Twist")()
    twist.linear.x = 0.2
    for _ in range(10):
        client.publish(topic="/cmd_vel", data=twist)
        time.sleep(0.1)
    assert 0.03 < client.next_message(kind, topic).pose.pose.position.x - start < 0.3


def test_a_trajectory_on_a_topic_moves_the_head(listening, client):
    message = goal("HeadYaw", -0.2, 0.8).trajectory
    client.publish(topic="/Head_controller/joint_trajectory", data=message)
    assert angle_of(client, "HeadYaw", near=-0.2, patience=40.0) == pytest.approx(-0.2, abs=0.005)


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
@pytest.mark.parametrize(
    ("message", "code"),
    [
        (goal("LElbowYaw", 0.1, 1.0), -2),
        (goal("HeadYaw", -0.3, 1.0, path=1e-6), -4),
        (goal("HeadYaw", 9.0, 1.0), -1),
    ],
    ids=["wrong joint", "violated tolerance", "beyond the limits"],
)
def test_codes_of_results(listening, client, message, code):
    assert send(client, message)
    result = client.result(name=HEAD)
    assert (result["status"], result["error_code"]) == (ABORTED, code)
    assert message.trajectory.joint_names[0] in result["error_string"]


@WITH_ACTIONS
def test_a_cancel_request_brakes(listening, client):
    assert send(client, goal("HeadYaw", 1.5, 4.0))
    time.sleep(0.5)
    assert client.cancel(name=HEAD) == 1
    assert client.result(name=HEAD)["status"] == CANCELED
    angle = angle_of(client, "HeadYaw", near=9.0, patience=0.5)
    assert angle < 1.4
    assert angle_of(client, "HeadYaw", near=9.0, patience=0.5) == pytest.approx(angle, abs=0.01)


@WITH_ACTIONS
def test_a_new_goal_replaces_the_one_under_way(listening, client):
    assert send(client, goal("HeadYaw", 1.0, 3.0))
    client.keep(name=HEAD, other="first")
    assert send(client, goal("HeadYaw", 0.0, 1.5))
    assert client.result(name="first")["status"] == ABORTED
    assert client.result(name=HEAD)["status"] == SUCCEEDED
