"""Goals of the action that a live motion goes to: spliced, canceled, among obstacles of the scene."""

import time

import numpy as np
import pytest
from short_messages import ACTION, goal, trajectory

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.naoqi.body import Body
from pepper_kin.naoqi.joint_names import ACTUATED
from pepper_kin.ros import goal_motion
from pepper_kin.ros.client import RobotClient
from pepper_kin.ros.controllers import TRAJECTORY
from pepper_kin.ros.joint_trajectory import ErrorCode
from pepper_kin.ros.node import RobotNode
from pepper_kin.ros.transport import GoalStatus
from pepper_kin.ros.transports.local import LocalTransport
from pepper_kin.ros.transports.rosbridge import RosbridgeServer
from pepper_kin.ros.transports.rosbridge_client import RosbridgeClient
from pepper_kin.ros_messages import message_type
from pepper_kin.supervision import RobotMotionStatus

WHOLE = "/joint_trajectory_controller/follow_joint_trajectory"
LEFT = "/LeftArm_controller/follow_joint_trajectory"
SHARE = 0.3
DOWN, UP = [1.4, 0.2, -1.2, -0.5, 0.0], [0.2, 0.2, -1.2, -0.5, 0.0]  # the left arm
ARM = ["LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw"]


@pytest.fixture
def node():
    with LocalTransport() as transport, RobotNode(Body(real_time=False), transport, live=SHARE) as made:
        yield made


@pytest.fixture
def commands(node):
    """Commanded positions of all cycles, shape (T, n)."""
    rows = []
    node.body.listeners.append(lambda: rows.append(node.body.command.copy()))
    return rows


def keep_limits(body, rows):
    """Assert that commands keep the share of the limits of speed, and nearly that of acceleration."""
    pepper, speed = body.pepper, np.diff(np.array(rows), axis=0) / 0.02
    joints = [body.index[name] for name in ACTUATED]
    over = np.abs(speed) - SHARE * pepper.velocity_limits
    k, j = np.unravel_index(over.argmax(), over.shape)
    assert over.max() < 1e-6, (pepper.joint_names[j], speed[max(k - 3, 0) : k + 4, j])
    change = np.abs(np.diff(speed, axis=0))[:, joints] / 0.02
    assert np.all(change <= 1.05 * SHARE * pepper.acceleration_limits[joints] + 1e-6)


def ball_at(position, radius):
    """The message of a ball, which adds it or puts it elsewhere."""
    kind = message_type("moveit_msgs/msg/CollisionObject")
    made = kind(id="ball", operation=kind.ADD)
    made.header.frame_id = "world"
    made.primitives = [message_type("shape_msgs/msg/SolidPrimitive")(type=2, dimensions=[radius])]
    made.pose.position.x, made.pose.position.y, made.pose.position.z = position
    made.pose.orientation.w = 1.0
    return made


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


def twist(x):
    made = message_type("geometry_msgs/msg/Twist")()
    made.linear.x = x
    return made


@pytest.mark.thorough
def test_a_goal_is_reached_within_the_share_of_the_limits(node, commands):
    feedback = []
    sent = goal(trajectory(ARM, (0.1, DOWN), (0.2, UP)))  # far too fast to be followed
    found = node.transport.send_goal(LEFT, ACTION, sent, feedback.append).result(60)
    assert (found.status, found.result.error_code) == (GoalStatus.SUCCEEDED, 0)
    assert np.allclose([node.body.measured(name) for name in ARM], UP, rtol=0, atol=0.05)
    times = [seconds(one.desired.time_from_start) for one in feedback]
    assert times == sorted(times)
    assert np.allclose(feedback[-1].desired.positions, UP, rtol=0, atol=1e-6)
    keep_limits(node.body, commands)
    node.body.time.sleep(0.1)
    assert not list(node.body.tasks)


@pytest.mark.thorough
def test_a_trajectory_within_the_limits_is_followed(node, commands):
    via = [0.9, 0.6, -0.8, -0.9, 0.3]
    still, count = [0.0] * 5, []
    sent = goal(trajectory(ARM, (2.0, via, still, still), (4.0, UP, still, still)))
    found = node.transport.send_goal(LEFT, ACTION, sent, lambda one: count.append(len(commands))).result(60)
    assert found.status is GoalStatus.SUCCEEDED
    rows = [node.body.index[name] for name in ARM]
    assert np.abs(np.array(commands)[:, rows] - via).max(axis=1).min() < 1e-3
    assert len(commands) - count[0] == pytest.approx(200, abs=8)
    keep_limits(node.body, commands)


@pytest.mark.thorough
def test_a_new_goal_is_spliced_into_the_motion(node, commands):
    second = []

    def feedback(message):
        if seconds(message.desired.time_from_start) > 0.6 and not second:
            turn = goal(trajectory(ARM[:4], (1.0, [0.9, 0.4, -1.0, -1.0])))
            second.append((len(commands), node.transport.send_goal(WHOLE, ACTION, turn)))

    first = node.transport.send_goal(LEFT, ACTION, goal(trajectory(ARM, (2.0, UP))), feedback).result(60)
    assert first.status is GoalStatus.ABORTED
    assert "replaced" in first.result.error_string
    (at, handle) = second[0]
    assert handle.result(60).status is GoalStatus.SUCCEEDED
    assert node.body.commanded("LShoulderPitch") == pytest.approx(0.9, abs=1e-3)
    keep_limits(node.body, commands)
    speed = np.abs(np.diff(np.array(commands), axis=0)).max(axis=1) / 0.02
    assert speed[at : at + 20].min() > 0.02, "it stopped between the goals"


@pytest.mark.thorough
def test_goals_of_other_joints_do_not_end_one_another(node):
    arm = node.transport.send_goal(LEFT, ACTION, goal(trajectory(ARM, (2.0, UP))))
    head = "/Head_controller/follow_joint_trajectory"
    turned = node.transport.send_goal(head, ACTION, goal(trajectory(["HeadYaw"], (0.5, [0.6]))))
    assert arm.result(60).status is turned.result(60).status is GoalStatus.SUCCEEDED
    assert node.body.measured("HeadYaw") == pytest.approx(0.6, abs=0.05)
    assert np.allclose([node.body.measured(name) for name in ARM], UP, rtol=0, atol=0.05)


@pytest.mark.thorough
def test_a_canceled_goal_stops_within_the_limits(node, commands):
    def feedback(message):
        if seconds(message.desired.time_from_start) > 0.4:
            handle.cancel()

    with node.body.time.lock:
        handle = node.transport.send_goal(LEFT, ACTION, goal(trajectory(ARM, (2.0, UP))), feedback)
    found = handle.result(60)
    assert (found.status, found.result.error_string) == (GoalStatus.CANCELED, "canceled")
    node.body.time.sleep(1.0)
    keep_limits(node.body, commands)
    assert np.array_equal(commands[-1], commands[-10])
    assert abs(node.body.commanded("LShoulderPitch") - UP[0]) > 0.1
    again = node.transport.send_goal(LEFT, ACTION, goal(trajectory(ARM, (2.0, UP)))).result(60)
    assert again.status is GoalStatus.SUCCEEDED


@pytest.mark.thorough
def test_what_else_moves_the_robot_ends_the_goal(node, commands):
    def feedback(message):
        if seconds(message.desired.time_from_start) > 0.4 and not told:
            told.append(node.commands.on_velocity(twist(0.1)))

    told = []
    found = node.transport.send_goal(LEFT, ACTION, goal(trajectory(ARM, (2.0, UP))), feedback).result(60)
    assert found.result.error_code == ErrorCode.PATH_TOLERANCE_VIOLATED
    assert "cmd_vel moves Wheel" in found.result.error_string
    node.body.time.sleep(2.0)
    keep_limits(node.body, commands)
    assert np.array_equal(commands[-1], commands[-5])


@pytest.mark.thorough
def test_refused_goals_and_blocked_ways_are_named(node):
    inside = [1.57, 0.01, 1.5, -1.5, 0.0]  # the forearm in the trunk
    found = node.transport.send_goal(LEFT, ACTION, goal(trajectory(ARM, (1.0, inside)))).result(60)
    assert found.result.error_code == ErrorCode.INVALID_GOAL
    assert "would touch" in found.result.error_string
    q = node.body.configuration(False)
    q[[node.body.index[name] for name in ARM]] = UP
    hand = pk.kinematics.frame_pose(node.body.pepper, q, "LArm_effector")[:3, 3]
    with node.transport.advertise("/collision_object", "moveit_msgs/msg/CollisionObject") as publisher:
        publisher.publish(ball_at(hand, 0.1))
    node.transport.flush(60.0)
    sent = goal(trajectory(ARM, (1.0, UP)), goal_time=1.0)
    found = node.transport.send_goal(LEFT, ACTION, sent).result(60)
    assert found.result.error_code == ErrorCode.GOAL_TOLERANCE_VIOLATED
    assert "2 s are allowed" in found.result.error_string
    with pytest.raises(InvalidValueError, match="live"):
        RobotNode(node.body, node.transport, live=1.5)


@pytest.mark.thorough
def test_a_closed_node_brakes(node, commands):
    with node.transport.advertise("/LeftArm_controller/joint_trajectory", TRAJECTORY) as publisher:
        publisher.publish(trajectory(ARM, (2.0, UP)))
    node.transport.flush(60.0)
    node.body.time.sleep(0.5)
    node.close()
    node.body.time.sleep(1.0)
    assert np.array_equal(commands[-1], commands[-5])
    assert abs(node.body.command_rate("LShoulderPitch")) < 1e-9


@pytest.mark.thorough
def test_a_ball_on_a_topic_crosses_the_way(monkeypatch):
    """In real time over rosbridge: a client moves a ball through the arm's way while it sends goals."""
    monkeypatch.setattr(goal_motion, "STATE_TIMEOUT", 10.0)  # of a machine that does other things as well
    body = Body()
    states = []
    with RosbridgeServer(port=0) as server, RobotNode(body, server, cameras=(), live=SHARE):
        body.listeners.append(lambda: states.append((body.configuration(False), body.scene)))
        body.time.start()
        with RosbridgeClient(server.url) as client:
            balls = client.advertise("/collision_object", "moveit_msgs/msg/CollisionObject")
            begun, handle = time.monotonic(), None
            while time.monotonic() < begun + 5.0:
                y = 0.9 - 0.35 * (time.monotonic() - begun)
                balls.publish(ball_at((0.35, y, 0.9), 0.12))
                if handle is None and time.monotonic() > begun + 0.5:
                    handle = client.send_goal(LEFT, ACTION, goal(trajectory(ARM, (2.0, UP))))
                time.sleep(0.03)
            found = handle.result(60)
            with RobotClient(client) as robot:
                start = robot.configuration()
                away = start.copy()
                away[robot.pepper.joint_index("HeadYaw")] = 0.5
                supervised = robot.follow(pk.retime(robot.pepper, [start, away]))
        body.time.stop()
    assert supervised.status is RobotMotionStatus.COMPLETED, supervised.report()
    assert found.status is GoalStatus.SUCCEEDED, found.result.error_string
    pepper = body.pepper
    moving = [k for k in range(1, len(states)) if np.abs(states[k][0] - states[k - 1][0]).max() > 1e-6]
    touched = [k for k in moving if states[k][1] and pk.collision.in_collision(pepper, *states[k])]
    assert len(moving) > 20
    assert not touched
