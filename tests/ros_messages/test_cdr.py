"""Bytes of messages against an independent codec, mcap_ros2, and damaged bytes."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest
from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ros_messages import MessageError, decode, encode, message_names, message_type
from pepper_kin.ros_messages.definitions import definition_texts

NAMES = [name for name in message_names() if name in definition_texts()]
"""Messages that have a definition file; parts of services and actions are built of the same fields."""

SPECIAL = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
"""Types that mcap_ros2 has built in."""

SIGNED_CHAR = "service_msgs/msg/ServiceEventInfo"
"""mcap_ros2 reads `char` as signed; in ROS 2 it is uint8."""


def types_within(kind):
    """Return the names of all types within a message."""
    inner = kind.nested.values()
    return {part.type_name for part in inner}.union(*map(types_within, inner))


def schema(name):
    """Return the text that a recording holds: the definition and all that it refers to."""
    texts = [definition_texts()[name]]
    for part in sorted(types_within(message_type(name)) - set(SPECIAL)):
        texts.append(f"MSG: {part.replace('/msg/', '/')}\n{definition_texts()[part]}")
    return ("\n" + "=" * 80 + "\n").join(texts)


def same(ours, theirs):
    """Whether a message holds what mcap_ros2 has read, field by field."""
    for field in ours.definition.fields:
        a, b = getattr(ours, field.name), getattr(theirs, field.name)
        if field.nested:
            pairs = [(a, b)] if field.array is None else list(zip(a, b, strict=True))
            if not all(same(x, y) for x, y in pairs):
                return False
        elif field.array is not None:
            if isinstance(b, (bytes, bytearray)):
                b = list(b)
            if list(a) != list(b):
                return False
        elif a != b:
            return False
    return True


def as_namespace(message):
    """Return a message as an object without this package's classes."""
    values = {}
    for field in message.definition.fields:
        value = getattr(message, field.name)
        if field.nested:
            value = as_namespace(value) if field.array is None else [as_namespace(v) for v in value]
        elif field.array is not None:
            value = list(value) if isinstance(value, list) else value.tolist()
        values[field.name] = value
    return SimpleNamespace(**values)


def test_bytes_are_those_of_an_independent_codec(filled):
    for name in [name for name in NAMES if name not in (*SPECIAL, SIGNED_CHAR)]:
        text = schema(name)
        read, write = generate_dynamic(name, text)[name], serialize_dynamic(name, text)[name]
        random = np.random.default_rng(len(name))
        for _ in range(3):
            message = filled(message_type(name), random)
            data = encode(message)
            assert same(message, read(data))
            theirs = write(as_namespace(message))
            assert decode(message_type(name), theirs) == message
            assert theirs.rstrip(b"\0") == data.rstrip(b"\0")  # padding at the end is left open by CDR


def test_every_message_is_read_as_it_was_written(filled):
    for name in message_names():
        kind, random = message_type(name), np.random.default_rng(7)
        message = filled(kind, random)
        assert decode(kind, encode(message)) == message


def test_a_known_message_has_the_bytes_of_the_standard():
    data = encode(message_type("std_msgs/msg/String")(data="abc"))
    assert data == bytes.fromhex("00010000 04000000 61626300".replace(" ", ""))


@pytest.mark.parametrize("name", ["sensor_msgs/msg/JointState", "moveit_msgs/msg/MotionPlanRequest"])
def test_damaged_bytes_are_refused_or_read_and_nothing_else(name, filled):
    kind, random = message_type(name), np.random.default_rng(3)
    data = encode(filled(kind, random))
    for length in range(0, len(data) - 8, max(len(data) // 60, 1)):
        with pytest.raises(MessageError):
            decode(kind, data[:length])
    for _ in range(300):
        damaged = bytearray(data)
        for place in random.integers(4, len(data), 4):
            damaged[place] = random.integers(256)
        with contextlib.suppress(MessageError):
            decode(kind, bytes(damaged))


def test_lengths_beyond_the_bytes_reserve_no_memory():
    for name in ("sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"):
        with pytest.raises(MessageError):
            decode(message_type(name), b"\x00\x01\x00\x00" + b"\xff" * 64)
    with pytest.raises(MessageError, match="begins with 0007, expected 0000 or 0001"):
        decode(message_type("std_msgs/msg/String"), b"\x00\x07\x00\x00\x00\x00\x00\x01\x00")


def test_values_that_a_type_cannot_hold_are_refused_by_field():
    with pytest.raises(InvalidValueError, match="sec"):
        encode(message_type("builtin_interfaces/msg/Time")(sec=2**31))
    with pytest.raises(InvalidValueError, match="frame_id"):
        encode(message_type("std_msgs/msg/Header")(frame_id=5))
