"""Bags of topics: what mcap_ros2 reads of what a node publishes, and back on the topics."""

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.naoqi.body import Body
from pepper_kin.ros import BagRecorder, LocalTransport, RobotNode, TransportError, play_bag
from pepper_kin.ros_messages import Bag, BagWriter, message_type

STATES = "/joint_states"


def recorded(node, path):
    clock = lambda: round(node.now * 1e9)  # noqa: E731
    topics = {name: kind for name, kind in node.topics.items() if not name.endswith("image_raw")}
    with BagRecorder(node.transport, path, topics, clock=clock) as recorder:
        for _ in range(25):
            node.body.time.sleep(0.04)
            node.transport.flush()
    return recorder


@pytest.mark.thorough
def test_a_second_of_a_node_is_read_by_mcap_ros2(node, tmp_path):
    recorder = recorded(node, tmp_path / "run.mcap")
    found = list(read_ros2_messages(tmp_path / "run.mcap"))
    assert recorder.count == len(found)
    by_topic = {}
    for message in found:
        by_topic.setdefault(message.channel.topic, []).append(message.ros_msg)
    assert len(by_topic[STATES]) == pytest.approx(50, abs=1)
    assert len(by_topic["/laser"]) == pytest.approx(10, abs=1)
    assert len(by_topic["/robot_description"]) == len(by_topic["/tf_static"]) == 1  # latched
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in by_topic[STATES]]
    assert np.allclose(np.diff(stamps), 0.02)
    last = dict(zip(by_topic[STATES][-1].name, by_topic[STATES][-1].position, strict=True))
    assert last["HeadYaw"] == pytest.approx(node.body.measured("HeadYaw"), abs=1e-3)


@pytest.mark.thorough
def test_what_was_recorded_is_played_on_the_topics(node, tmp_path):
    recorded(node, tmp_path / "run.mcap")
    sent = [(m.topic, m.message) for m in Bag(tmp_path / "run.mcap").messages(topics=[STATES, "/tf_static"])]
    heard = []
    with LocalTransport() as transport:
        transport.listen(STATES, "sensor_msgs/msg/JointState", lambda m: heard.append((STATES, m)))
        listen = lambda m: heard.append(("/tf_static", m))  # noqa: E731
        transport.listen("/tf_static", "tf2_msgs/msg/TFMessage", listen)
        count = play_bag(tmp_path / "run.mcap", transport, topics=[STATES, "/tf_static"], rate=1e6)
    assert count == len(sent) == len(heard)
    assert heard == sent


@pytest.mark.thorough
def test_a_recorded_command_moves_another_robot(tmp_path):
    trajectory = message_type("trajectory_msgs/msg/JointTrajectory")(joint_names=["HeadYaw"])
    trajectory.points = [message_type("trajectory_msgs/msg/JointTrajectoryPoint")(positions=[0.4])]
    trajectory.points[0].time_from_start.sec = 1
    with BagWriter(tmp_path / "orders.mcap") as bag:
        bag.write("/Head_controller/joint_trajectory", trajectory, 5_000_000_000)
    with LocalTransport() as transport, RobotNode(Body(real_time=False), transport) as node:
        assert play_bag(tmp_path / "orders.mcap", transport) == 1
        transport.flush()
        node.body.time.sleep(2.0)
        assert node.body.measured("HeadYaw") == pytest.approx(0.4, abs=0.01)


@pytest.mark.thorough
def test_what_cannot_be_played_or_recorded_is_refused(node, tmp_path):
    recorded(node, tmp_path / "run.mcap")
    with pytest.raises(UnknownNameError, match="topic '/nothing'"):
        play_bag(tmp_path / "run.mcap", node.transport, topics=["/nothing"])
    with pytest.raises(InvalidValueError, match="rate: got 0"):
        play_bag(tmp_path / "run.mcap", node.transport, rate=0)
    with pytest.raises(TransportError, match="its type is sensor_msgs/msg/JointState"):
        BagRecorder(node.transport, tmp_path / "no.mcap", {STATES: "std_msgs/msg/String"})
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]
