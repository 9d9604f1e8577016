"""The node in simulated time: what it publishes against the model, and what it does."""

import numpy as np
import pytest
from short_messages import ACTION, goal, trajectory

from pepper_kin.kinematics import frame_pose
from pepper_kin.model import rotation_from_quaternion
from pepper_kin.naoqi.body import Body
from pepper_kin.ros.joint_trajectory import ErrorCode
from pepper_kin.ros.node import RobotNode
from pepper_kin.ros.transport import GoalStatus
from pepper_kin.ros.transports.local import LocalTransport
from pepper_kin.ros_messages import message_type
from pepper_kin.twin.sensors import Camera

HEAD = "/Head_controller/follow_joint_trajectory"


def heard(node, topic):
    messages = []
    node.transport.listen(topic, None, messages.append)
    return messages


def say(node, topic, message):
    """Publish, and let the subscription's thread take it before time goes on."""
    kind = message_type(node.transport.topics[topic])
    with node.transport.advertise(topic, kind.type_name) as publisher:
        publisher.publish(message)
    node.transport.flush(60.0)


def twist(x=0.0, y=0.0, turn=0.0):
    made = message_type("geometry_msgs/msg/Twist")()
    made.linear.x, made.linear.y, made.angular.z = x, y, turn
    return made


def stamped_pose(frame, position):
    made = message_type("geometry_msgs/msg/PoseStamped")()
    made.header.frame_id = frame
    made.pose.position.x, made.pose.position.y, made.pose.position.z = position
    made.pose.orientation.w = 1.0
    return made


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


@pytest.mark.thorough
def test_rates(node):
    expected = {
        "/joint_states": 50, "/clock": 50, "/tf": 50, "/odom": 15, "/laser": 10, "/imu/torso": 10,
        "/imu/base": 10, "/sonar/front": 10, "/sonar/back": 10, "/camera/depth/camera_info": 10,
        "/Head_controller/controller_state": 50,
    }  # fmt: skip
    counts = {topic: heard(node, topic) for topic in expected}
    node.body.time.sleep(2.0)
    assert {topic: len(messages) / 2 for topic, messages in counts.items()} == expected
    stamps = np.array([seconds(message.header.stamp) for message in counts["/joint_states"]])
    np.testing.assert_allclose(np.diff(stamps), 0.02, atol=1e-9)


@pytest.mark.thorough
def test_joint_states_and_transforms_are_those_of_the_model(node):
    states, moving, fixed = (heard(node, topic) for topic in ("/joint_states", "/tf", "/tf_static"))
    node.body.command[node.body.index["LElbowYaw"]] = -0.7
    node.body.time.sleep(1.0)
    state, pepper = states[-1], node.body.pepper
    q = node.body.configuration(True)
    for name, position in zip(state.name[:17], state.position, strict=False):
        assert position == q[pepper.joint_index(name)]
    assert state.name[-3:] == ["WheelFL", "WheelFR", "WheelB"]
    edges = {t.child_frame_id: t for message in (fixed[-1], moving[-1]) for t in message.transforms}
    for frame in ("LArm_effector", "CameraTop_optical_frame", "LFinger13_link", "SonarFront_frame"):
        pose, child = np.eye(4), frame
        while child != "base_footprint":
            step, here = edges[child].transform, np.eye(4)
            turn = step.rotation
            here[:3, :3] = rotation_from_quaternion([turn.x, turn.y, turn.z, turn.w])
            here[:3, 3] = step.translation.x, step.translation.y, step.translation.z
            pose, child = here @ pose, edges[child].header.frame_id
        base = frame_pose(pepper, q, "base_footprint")
        np.testing.assert_allclose(base @ pose, frame_pose(pepper, q, frame), atol=1e-9)
    root = edges["base_footprint"].transform.translation
    np.testing.assert_allclose([root.x, root.y], node.body.base_pose(True)[:2], atol=2e-3)  # odometry


def test_the_description_is_a_robot_whose_root_is_base_footprint(node):
    import pinocchio

    [text] = heard(node, "/robot_description")
    model = pinocchio.buildModelFromXML(text.data)
    assert model.frames[1].name == "base_footprint" or model.frames[2].name == "base_footprint"
    assert {"HeadYaw", "LElbowRoll", "KneePitch"} <= set(model.names)


def test_the_laser_sees_the_wall(node):
    scans, sonar = heard(node, "/laser"), heard(node, "/sonar/front")
    node.body.time.sleep(0.5)
    scan = scans[-1]
    assert (len(scan.ranges), scan.header.frame_id) == (61, "base_footprint")
    assert scan.range_min == pytest.approx(0.1)
    assert np.all(scan.ranges[15:23] == -1.0)
    assert np.all(scan.ranges[38:46] == -1.0)
    assert scan.ranges[30] == pytest.approx(1.45, abs=0.1)  # the face of the wall
    assert sonar[-1].range == pytest.approx(1.45, abs=0.35)  # from the front of the base


def test_pictures_are_those_of_the_camera(node):
    pictures, depths = heard(node, "/camera/front/image_raw"), heard(node, "/camera/depth/image_raw")
    infos = heard(node, "/camera/front/camera_info")
    node.body.time.sleep(0.1)
    body, picture, depth = node.body, pictures[-1], depths[-1]
    assert (picture.height, picture.width, picture.encoding, picture.step) == (240, 320, "rgb8", 960)
    camera = Camera(body.pepper, "camera_top", lens=True)
    expected = camera.color(body.configuration(True), body.scene)
    assert picture.data.tobytes() == expected.tobytes()
    assert infos[-1].k[0] == camera.intrinsics.fx
    assert picture.header.frame_id == "CameraTop_optical_frame"
    meters = Camera(body.pepper, "camera_depth").depth(body.configuration(True), body.scene)
    here = depth.data.view("<u2").reshape(240, 320)
    np.testing.assert_allclose(here[meters < 4] / 1000.0, meters[meters < 4], atol=6e-4)


def test_a_velocity_holds_until_the_watchdog_stops_it(node):
    odometry = heard(node, "/odom")
    say(node, "/cmd_vel", twist(0.2, 0.0, 0.3))
    node.body.time.sleep(0.45)
    assert node.body.controller.twist[0] > 0.1
    node.body.time.sleep(1.5)
    assert np.abs(node.body.controller.twist).max() < 1e-9
    way = node.body.base_pose(True)
    assert 0.05 < way[0] < 0.2
    last = odometry[-1]
    assert (last.header.frame_id, last.child_frame_id) == ("odom", "base_link")
    assert last.pose.pose.position.x == pytest.approx(way[0], abs=0.02)
    say(node, "/cmd_vel", twist(float("nan")))
    node.body.time.sleep(0.1)
    assert np.abs(node.body.controller.twist).max() < 1e-9


@pytest.mark.thorough
@pytest.mark.parametrize("first", [False, True])
def test_velocities_come_with_and_without_a_stamp(first):
    """As Nav2 sends them by default, in a frame of the base, and as naoqi_driver2 takes them."""
    stamped, plain = (message_type(f"geometry_msgs/msg/{name}") for name in ("TwistStamped", "Twist"))
    with LocalTransport() as transport, RobotNode(Body(real_time=False), transport, stamped=first) as node:
        assert transport.topics["/cmd_vel"] == (stamped if first else plain).type_name
        assert not [name for name in transport.topics if " of " in name]
        for frame, goes in (("base_footprint", True), ("", True), ("map", False), (None, True)):
            message = twist(0.2, 0.0, 0.3)
            if frame is not None:
                message = stamped(twist=message)
                message.header.frame_id = frame
            with transport.advertise("/cmd_vel", message.type_name) as publisher:
                publisher.publish(message)
            transport.flush(60.0)
            node.body.time.sleep(0.4)
            assert bool(node.body.controller.twist[0] > 0.1) == goes
            node.body.time.sleep(1.5)


def test_a_goal_of_the_base_is_reached(node):
    say(node, "/move_base_simple/goal", stamped_pose("base_footprint", (0.3, 0.1, 0.0)))
    node.body.time.sleep(6.0)
    np.testing.assert_allclose(node.body.base_pose(True), [0.3, 0.1, 0.0], atol=0.01)
    say(node, "/move_base_simple/goal", stamped_pose("no_frame", (0.3, 0.1, 0.0)))
    node.body.time.sleep(0.2)
    assert not list(node.body.tasks)


@pytest.mark.thorough
def test_joint_angles(node):
    kind = message_type("naoqi_bridge_msgs/msg/JointAnglesWithSpeed")
    say(node, "/joint_angles", kind(joint_names=["HeadYaw"], joint_angles=[0.5], speed=0.3))
    node.body.time.sleep(2.0)
    say(node, "/joint_angles", kind(joint_names=["HeadYaw"], joint_angles=[-0.2], speed=0.3, relative=1))
    node.body.time.sleep(2.0)
    assert node.body.measured("HeadYaw") == pytest.approx(0.3, abs=2e-3)
    say(node, "/joint_angles", kind(joint_names=["Tail"], joint_angles=[0.5], speed=0.3))
    say(node, "/joint_angles", kind(joint_names=["HeadYaw"], joint_angles=[0.5], speed=7.0))
    node.body.time.sleep(0.1)
    assert not list(node.body.tasks)


@pytest.mark.parametrize("topic", ["/Head_controller/joint_trajectory", "/pepper_robot/joint_trajectory"])
def test_a_trajectory_on_a_topic(node, topic):
    progress = heard(node, "/model/pepper_robot/joint_trajectory_progress")
    say(node, topic, trajectory(["HeadYaw"], (1.0, [0.4], [0.0])))
    node.body.time.sleep(1.5)
    assert node.body.measured("HeadYaw") == pytest.approx(0.4, abs=3e-3)
    shares = [message.data for message in progress]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    say(node, topic, trajectory(["Tail"], (1.0, [0.4])))
    node.body.time.sleep(0.1)
    assert not list(node.body.tasks)


def test_an_action_to_its_end(node):
    feedback, start = [], node.body.commanded("HeadYaw")
    message = trajectory(["HeadYaw", "HeadPitch"], (1.0, [0.3, -0.1], [0, 0]), (2.0, [0, 0.1], [0, 0]))
    found = node.transport.send_goal(HEAD, ACTION, goal(message), feedback.append).result(60)
    assert (found.status, found.result.error_code) == (GoalStatus.SUCCEEDED, 0)
    assert len(feedback) == 50
    one = feedback[20]
    time = seconds(one.desired.time_from_start)
    expected = start + (0.3 - start) * (3 * time**2 - 2 * time**3)  # the cubic from rest to rest
    np.testing.assert_allclose(one.desired.positions[0], expected, atol=1e-9)
    np.testing.assert_allclose(one.desired.positions - one.actual.positions, one.error.positions)
    errors = [np.abs(each.error.positions).max() for each in feedback]
    assert max(errors) < 0.02
    assert node.body.measured("HeadPitch") == pytest.approx(0.1, abs=2e-3)


@pytest.mark.parametrize(
    ("sent", "code", "words"),
    [
        (goal(trajectory(["HeadYaw"], (-1.0, [0.1]))), ErrorCode.INVALID_GOAL, "does not come after"),
        (goal(trajectory(["LElbowYaw"], (1.0, [0.1]))), ErrorCode.INVALID_JOINTS, "no joint 'LElbowYaw'"),
        (goal(trajectory(["HeadYaw"], (0.1, [0.1]), stamp=0.5)), ErrorCode.OLD_HEADER_TIMESTAMP, "ends"),
        (
            goal(trajectory(["HeadYaw"], (0.05, [1.5])), path=[("HeadYaw", 0.05)]),
            ErrorCode.PATH_TOLERANCE_VIOLATED,
            "position error of HeadYaw",
        ),
        (
            goal(trajectory(["HeadYaw"], (0.01, [2.0])), end=[("HeadYaw", 1e-6)], goal_time=0.1),
            ErrorCode.GOAL_TOLERANCE_VIOLATED,
            "0.1 s are allowed: position error of HeadYaw",
        ),
    ],
)  # fmt: skip
def test_codes_of_results(node, sent, code, words):
    node.body.time.sleep(1.0)
    found = node.transport.send_goal(HEAD, ACTION, sent).result(60)
    assert found.status is GoalStatus.ABORTED
    assert found.result.error_code == code
    assert words in found.result.error_string
    node.body.time.sleep(1.0)
    assert abs(node.body.command_rate("HeadYaw")) < 1e-9


def test_a_cancel_request_brakes_within_the_limits(node):
    speeds = []
    node.body.listeners.append(lambda: speeds.append(node.body.command_rate("HeadYaw")))

    def feedback(message):
        if seconds(message.desired.time_from_start) > 0.5:
            handle.cancel()

    with node.body.time.lock:  # the handle is there before time passes
        handle = node.transport.send_goal(HEAD, ACTION, goal(trajectory(["HeadYaw"], (2.0, [1.6]))), feedback)
    found = handle.result(60)
    assert (found.status, found.result.error_string) == (GoalStatus.CANCELED, "canceled")
    node.body.time.sleep(1.0)
    assert max(speeds) > 0.5
    assert speeds[-1] == 0.0
    most = node.body.pepper.acceleration_limits[node.body.index["HeadYaw"]]
    brake = np.diff(speeds[speeds.index(max(speeds)) :]) / 0.02
    assert brake.min() >= -most - 1e-6


def test_a_new_trajectory_takes_over_at_speed(node):
    long = goal(trajectory(["HeadYaw"], (3.0, [1.5], [0.0])))
    positions, second = [], []

    def feedback(message):
        if seconds(message.desired.time_from_start) > 1.0 and not second:
            turn = goal(trajectory(["HeadYaw"], (1.5, [0.0], [0.0])))
            second.append(node.transport.send_goal(HEAD, ACTION, turn))

    node.body.listeners.append(lambda: positions.append(node.body.commanded("HeadYaw")))
    first = node.transport.send_goal(HEAD, ACTION, long, feedback).result(60)
    assert first.status is GoalStatus.ABORTED
    assert "replaced" in first.result.error_string
    assert second[0].result(60).status is GoalStatus.SUCCEEDED
    rates = np.diff(positions) / 0.02
    assert np.abs(np.diff(rates)).max() < 0.4  # no jump of the commanded speed


def test_a_hand_follows_a_target_until_the_targets_stop(node):
    place = frame_pose(node.body.pepper, node.body.configuration(True), "LArm_effector")[:3, 3]
    target = place + np.array([0.06, 0.0, 0.08])
    for _ in range(8):
        say(node, "/pepper_robot/follow_target/left", stamped_pose("world", target))
        node.body.time.sleep(0.3)
    here = frame_pose(node.body.pepper, node.body.configuration(True), "LArm_effector")[:3, 3]
    assert np.linalg.norm(here - target) < 0.01
    node.body.time.sleep(1.5)
    assert not list(node.body.tasks)


def test_nothing_moves_after_the_node_has_closed(node):
    body = node.body
    say(node, "/cmd_vel", twist(0.2))
    say(node, "/Head_controller/joint_trajectory", trajectory(["HeadYaw"], (3.0, [1.5])))
    body.time.sleep(0.3)
    node.close()
    body.time.sleep(1.0)
    assert np.abs(body.controller.twist).max() < 1e-9
    assert abs(body.command_rate("HeadYaw")) < 1e-9
    assert node.transport.topics == {}


def call(node, name, type_name, **fields):
    request = message_type(f"{type_name}_Request")(**fields)
    return node.transport.call_service(name, type_name, request)


def test_the_robot_says_what_it_is_as_the_driver_does(node):
    info = call(node, "/naoqi_driver/get_robot_config", "naoqi_bridge_msgs/srv/GetRobotInfo").info
    assert (info.type, info.number_of_arms, info.number_of_hands) == (info.PEPPER, 2, 2)
    told = heard(node, "/info")
    node.transport.flush(60.0)
    assert told[0].data.startswith("RobotConfig/Body/Type: ")
    language = "naoqi_bridge_msgs/srv/GetString"
    assert call(node, "/naoqi_driver/get_language", language).data == "English"
    for name, success, kept in (("French", True, "French"), ("Klingon", False, "French")):
        change = call(node, "/naoqi_driver/set_language", "naoqi_bridge_msgs/srv/SetString", data=name)
        assert change.success is success
        assert call(node, "/naoqi_driver/get_language", language).data == kept
    say(node, "/speech", message_type("std_msgs/msg/String")(data="hello"))
    assert list(node.driver.said) == ["hello"]


def test_diagnostics_are_sent_once_a_second_with_the_limits_of_the_description(node):
    told = heard(node, "/diagnostics")
    node.body.set_stiffness({"LElbowYaw": 0.25})
    node.body.time.sleep(3.01)
    node.transport.flush(60.0)
    assert len(told) == 4  # at 0, 1, 2 and 3 s
    by_name = {one.name: {pair.key: pair.value for pair in one.values} for one in told[-1].status}
    elbow, pepper = by_name["naoqi_driver_joints:LElbowYaw"], node.body.pepper
    k = pepper.joint_index("LElbowYaw")
    wanted = (
        pepper.lower_limits[k],
        pepper.upper_limits[k],
        pepper.velocity_limits[k],
        pepper.effort_limits[k],
    )
    found = [float(elbow[key]) for key in ("minAngle", "maxAngle", "maxVelocity", "maxTorque")]
    assert found == pytest.approx(wanted)
    assert (
        float(elbow["Stiffness"]) == float(by_name["naoqi_driver_joints:Status"]["Lowest Stiffness"]) == 0.25
    )
    assert int(by_name["naoqi_driver_battery:Status"]["Percentage"]) > 60
    assert {one.level for one in told[-1].status} == {0}


def test_controllers_claim_their_joints_while_they_move_them(node):
    listing = "controller_manager_msgs/srv/ListControllers"

    def claimed():
        listed = call(node, "/controller_manager/list_controllers", listing).controller
        assert [one.name for one in listed] == list(node.controllers)
        assert {one.state for one in listed} == {"active"}
        return {one.name: list(one.claimed_interfaces) for one in listed if one.claimed_interfaces}

    assert claimed() == {}
    handle = node.transport.send_goal(
        HEAD, ACTION, goal(trajectory(["HeadYaw", "HeadPitch"], (1.0, [0.3, 0.1])))
    )
    node.body.time.sleep(0.5)
    assert claimed() == {"Head_controller": ["HeadYaw/position", "HeadPitch/position"]}
    node.body.time.sleep(2.0)
    assert handle.result(60.0).status == GoalStatus.SUCCEEDED
    assert claimed() == {}
