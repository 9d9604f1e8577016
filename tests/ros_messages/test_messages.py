"""Message classes, dictionaries and JSON texts."""

import json
import pickle

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.ros_messages import action_type, message_names, message_type, service_type
from pepper_kin.ros_messages.json_text import to_json


def test_dictionaries_and_json_are_read_as_they_were_written(filled):
    for name in message_names():
        kind = message_type(name)
        message = filled(kind, np.random.default_rng(11))
        values = message.to_dict()
        assert kind.from_dict(values) == message
        assert json.loads(to_json(message)) == json.loads(json.dumps(values))
        assert kind.from_dict(json.loads(to_json(message))) == message


def test_numbers_that_json_has_not_are_null():
    message = message_type("sensor_msgs/msg/Range")(range=float("inf"))
    assert json.loads(to_json(message))["range"] is None
    scan = message_type("sensor_msgs/msg/LaserScan")(ranges=[1.0, float("nan")])
    assert json.loads(to_json(scan))["ranges"] == [1.0, None]


def test_bytes_are_base64():
    image = message_type("sensor_msgs/msg/Image")(data=b"\x00\x01\xff")
    assert image.to_dict()["data"] == "AAH/"


def test_wrong_dictionaries_are_refused_by_field():
    for values, word in [
        ({"position": "x"}, "position"),
        ({"name": [1]}, "name"),
        ({"header": 4}, "header"),
        ({"header": {"stamp": {"sec": 1.5}}}, "sec"),
        ({"header": {"stamp": {"sec": 2**40}}}, "sec"),
        ({"nose": 1}, "nose"),
    ]:
        with pytest.raises((InvalidValueError, UnknownNameError), match=word):
            message_type("sensor_msgs/msg/JointState").from_dict(values)


def test_types_are_found_by_both_names_and_unknown_ones_refused():
    assert message_type("sensor_msgs/JointState") is message_type("sensor_msgs/msg/JointState")
    assert service_type("std_srvs/srv/Trigger").response().success is False
    assert action_type("control_msgs/action/FollowJointTrajectory").goal().trajectory.points == []
    with pytest.raises(UnknownNameError, match="JointState"):
        message_type("sensor_msgs/msg/JointStat")


def test_messages_are_pickled(filled):
    message = filled(message_type("trajectory_msgs/msg/JointTrajectory"), np.random.default_rng(1))
    assert pickle.loads(pickle.dumps(message)) == message
