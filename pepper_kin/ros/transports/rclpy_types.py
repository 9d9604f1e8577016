"""Message classes of rclpy, and conversion to and from this package's messages through bytes.

Distributions of ROS 2 differ in some types: FollowJointTrajectory's feedback has an index since 2025.  If the
installed class has other fields than this package's, fields of the same name are copied and others have their
defaults.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np

from pepper_kin.exceptions import optional
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros_messages import Message, decode, encode, message_type
from pepper_kin.ros_messages.definitions import (
    BOUNDED,
    FIXED,
    PRIMITIVES,
    STRING,
    UNBOUNDED,
    Definition,
    Field,
    full_name,
)
from pepper_kin.ros_messages.messages import library_type

_NAMES = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}
_TYPE = re.compile(r"(?P<base>[\w/]+)(?:<(?P<string>\d+)>)?")


def ros_class(type_name: str) -> Any:
    """Return rclpy's class of a message, a service or an action.

    Args:
        type_name: Full name of the type, or of a part such as `std_srvs/srv/Trigger_Request`.

    Raises:
        MissingDependencyError: if the package of the type is not installed.
        TransportError: if the installed package does not have the type.
    """
    package, kind, name = type_name.split("/")
    command = f"sudo apt install ros-$ROS_DISTRO-{package.replace('_', '-')}"
    module = optional(f"{package}.{kind}", command=command, need=f"the ROS type {type_name}")
    outer, _, part = name.partition("_")
    found = getattr(module, outer, None)
    found = getattr(found, part, None) if part else found
    if found is None:
        raise TransportError(type_name, f"the package {package} that is installed has no such type")
    return found


class Converter:
    """Converter between rclpy's class of a type and this package's.

    Args:
        type_name: Full name of the type.

    Attributes:
        kind: This package's class.
        ros: rclpy's class.
    """

    def __init__(self, type_name: str) -> None:
        from rclpy.serialization import deserialize_message, serialize_message

        self.kind = message_type(type_name)
        self.ros = ros_class(self.kind.type_name)
        self._serialize, self._deserialize = serialize_message, deserialize_message
        library: dict[str, Definition] = {}
        _describe(self.kind.type_name, self.ros, library)
        self._foreign = library_type(self.kind.type_name, library)

    def to_bytes(self, message: Message) -> bytes:
        """Return this package's message as bytes of the installed type.

        Raises:
            InvalidValueError: naming the field, for a value that the type cannot represent.
        """
        same = self._foreign is self.kind
        return encode(message if same else copied(message, self._foreign))

    def from_bytes(self, data: bytes) -> Message:
        """Return this package's message from bytes of the installed type.

        Raises:
            MessageError: for bytes that are not a message of the type.
        """
        message = decode(self._foreign, data)
        return message if self._foreign is self.kind else copied(message, self.kind)

    def to_ros(self, message: Message) -> Any:
        """Return rclpy's message from this package's; raises InvalidValueError as `to_bytes` does."""
        return self._deserialize(self.to_bytes(message), self.ros)

    def from_ros(self, message: Any) -> Message:
        """Return this package's message from rclpy's."""
        return self.from_bytes(self._serialize(message))


@cache
def converter(type_name: str) -> Converter:
    """Return the converter of a message type; raises the errors of `ros_class`."""
    return Converter(type_name)


def copied(message: Message, kind: type[Message]) -> Message:
    """Return a message of another version of a type: fields of the same name and kind are copied.

    Args:
        message: The message.
        kind: Class of the other version.
    """
    theirs = {field.name: field for field in message.definition.fields}
    values: dict[str, Any] = {}
    for field in kind.definition.fields:
        other = theirs.get(field.name)
        if other is None or (other.base, other.array) != (field.base, field.array):
            continue
        value = getattr(message, field.name)
        if field.nested:
            inner = kind.nested[field.name]
            same = inner is message.nested[field.name]
            if not same:
                value = copied(value, inner) if field.array is None else [copied(v, inner) for v in value]
        values[field.name] = value
    return kind(**values)


def _describe(type_name: str, found: Any, library: dict[str, Definition]) -> None:
    """Add the definitions of a type and of its nested types to a library, from rclpy's classes."""
    fields = tuple(_field(name, text) for name, text in found.get_fields_and_field_types().items())
    library[type_name] = Definition(type_name, fields, {})
    for field in fields:
        if field.nested and field.base not in library:
            _describe(field.base, ros_class(field.base), library)


def _field(name: str, text: str) -> Field:
    """Return a field from rclpy's text for its type: "sequence<double, 3>", "string<256>", "uint8[16]"."""
    array, length = None, 0
    if text.startswith("sequence<"):
        text = text[len("sequence<") : -1]
        text, _, bound = text.partition(", ")
        array, length = (BOUNDED, int(bound)) if bound else (UNBOUNDED, 0)
    elif text.endswith("]"):
        text, _, number = text[:-1].partition("[")
        array, length = FIXED, int(number)
    match = _TYPE.fullmatch(text)
    if match is None:
        raise TransportError(name, f"has the type {text!r}, which this library cannot read")
    base = _NAMES.get(match["base"], match["base"])
    if base not in PRIMITIVES and base != STRING:
        base = full_name(base)
    return Field(name, base, array, length, int(match["string"] or 0))


def uuid_bytes(goal_id: Any) -> bytes:
    """Return the 16 bytes of rclpy's UUID message."""
    return np.asarray(goal_id.uuid, np.uint8).tobytes()
