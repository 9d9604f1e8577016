"""Topics against a real ROS 2: rclpy over Fast DDS on the other side, every type both ways."""

import numpy as np
import ros_environment
from random_messages import random_message

from pepper_kin.ros_messages import message_names, message_type, type_hash

NOT_INSTALLED = (
    "moveit_msgs", "object_recognition_msgs", "octomap_msgs", "controller_manager_msgs", "rmw_dds_common",
    "service_msgs",
)  # fmt: skip
"""Packages without a wheel, or that are not meant for topics."""

TYPES = [
    name
    for name in message_names()
    if name.split("/")[1] == "msg" and name.split("/")[0] not in NOT_INSTALLED
]


def test_every_type_to_and_from_rclpy(peer, either):
    """Random contents arrive unchanged; what rclpy read and wrote again is what was sent."""
    rng = np.random.default_rng(5)
    way = "rclpy" if either.process.args[2] == "rclpy" else "cyclonedds"
    for name in TYPES:
        to, back = (f"/{way}/{d}/{name.replace('/', '_')}" for d in ("to", "back"))
        peer.listen(topic=to, type=name)
        either.advertise(topic=to, type=name)
        either.listen(topic=back, type=name)
        peer.advertise(topic=back, type=name)
    for name in TYPES:
        peer.joined(topic=f"/{way}/to/{name.replace('/', '_')}")
        either.joined(topic=f"/{way}/back/{name.replace('/', '_')}")
    for name in TYPES:
        to, back = (f"/{way}/{d}/{name.replace('/', '_')}" for d in ("to", "back"))
        kind = message_type(name)
        first, second = random_message(kind, rng), random_message(kind, rng)
        either.publish(topic=to, data=first)
        peer.publish(topic=back, data=second)
        assert peer.messages(kind, topic=to) == [first], name
        assert either.messages(kind, topic=back) == [second], name


def test_pictures_both_ways(peer, either):
    """QVGA pictures, 230 kB.

    Cyclone DDS drops the first that Fast DDS sends: it takes that for one from before the subscription,
    because Fast DDS may announce it before its last part has arrived.  Each of the later ones must arrive.
    """
    image = message_type("sensor_msgs/Image")
    rng = np.random.default_rng(1)
    pictures = [image(height=240, width=320, step=960, data=rng.bytes(230400)) for _ in range(4)]
    way = either.process.args[2]
    for a, b, suffix in ((either, peer, "to"), (peer, either, "back")):
        topic = f"/picture/{way}/{suffix}"
        b.listen(topic=topic, type="sensor_msgs/msg/Image")
        a.advertise(topic=topic, type="sensor_msgs/msg/Image")
        b.joined(topic=topic)
        for picture in pictures:
            a.publish(topic=topic, data=picture)
        lost = int(way == "cyclonedds" and suffix == "back")
        assert b.messages(image, topic=topic, count=4 - lost) in (pictures[lost:], pictures[: 4 - lost])


def test_best_effort_messages_both_ways(peer, either):
    """The quality of sensors: laser scans."""
    scan = message_type("sensor_msgs/LaserScan")(ranges=np.arange(61.0), range_max=3.0)
    for a, b, suffix in ((either, peer, "to"), (peer, either, "back")):
        topic = f"/scan/{either.process.args[2]}/{suffix}"
        b.listen(topic=topic, type="sensor_msgs/msg/LaserScan", reliable=False)
        a.advertise(topic=topic, type="sensor_msgs/msg/LaserScan", reliable=False)
        b.joined(topic=topic)
        a.publish(topic=topic, data=scan)
        assert b.messages(type(scan), topic=topic) == [scan]


def test_latched_messages_reach_late_subscriptions(peer, either):
    """A description of 300 kB, published before anybody subscribes."""
    text = message_type("std_msgs/String")(data="<robot>" * 43_000)
    topic = f"/latched/{either.process.args[2]}"
    for a, b, suffix in ((either, peer, "/to"), (peer, either, "/back")):
        a.advertise(topic=topic + suffix, type="std_msgs/msg/String", latched=True)
        a.publish(topic=topic + suffix, data=text, wait=False)
        b.listen(topic=topic + suffix, type="std_msgs/msg/String", latched=True)
        assert b.messages(type(text), topic=topic + suffix) == [text]


def test_the_graph_shows_node_topics_and_hashes(peer, either):
    topic = f"/shown/{either.process.args[2]}"
    either.advertise(topic=topic, type="sensor_msgs/msg/JointState")
    text = peer.hashes(topic=topic)[0]
    assert type_hash("sensor_msgs/msg/JointState").removeprefix("RIHS01_") in text.replace(" ", "").lower()
    assert peer.names(kind="topics")[topic] == ["sensor_msgs/msg/JointState"]
    assert "tested_node" in peer.nodes(with_name="tested_node")


def test_definitions_are_those_of_the_installed_packages(peer):
    """Names, order and types of fields, by rclpy's classes; and the defaults, by their bytes."""
    for name in TYPES:
        assert list(peer.fields(type=name)) == [f.name for f in message_type(name).definition.fields], name


def test_built_packages_are_listed():
    """What is built from our definitions is not compared with itself: its hashes are known otherwise."""
    assert set(ros_environment.BUILT) == {"tf2_msgs", "naoqi_bridge_msgs", "control_msgs"}
