"""Types for Cyclone DDS: the fields of messages, under the names that ROS 2 uses on DDS."""

from __future__ import annotations

from functools import cache
from typing import Any

from pepper_kin.ros_messages import message_type
from pepper_kin.ros_messages.definitions import BOUNDED, FIXED, STRING, Field


def topic_name(topic: str) -> str:
    """Return the name of a topic on DDS: `/joint_states` is `rt/joint_states`."""
    return "rt/" + topic.lstrip("/")


def dds_name(type_name: str) -> str:
    """Return the name of a type on DDS: `std_msgs/msg/String` is `std_msgs::msg::dds_::String_`."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


@cache
def announced_type(type_name: str) -> Any:
    """Return Cyclone's structure of a message type: final, in CDR of version 1.

    The structure is never instantiated: messages are sent as bytes of `pepper_kin.ros_messages.encode`.

    Args:
        type_name: Full name of the message type.
    """
    from cyclonedds.idl import annotations, make_idl_struct, types

    kind = message_type(type_name)
    fields = {field.name: _field_type(field) for field in kind.definition.fields}
    fields = fields or {"structure_needs_at_least_one_member": types.uint8}
    name = dds_name(kind.type_name)
    made = make_idl_struct(name.replace("::", "_"), name.replace("::", "."), fields)
    return annotations.cdrv0(annotations.final(made))


def _field_type(field: Field) -> Any:
    """Return Cyclone's type of a field."""
    from cyclonedds.idl import types

    if field.nested:
        base = announced_type(field.base)
    elif field.base == STRING:
        base = types.bounded_str[field.string_length] if field.string_length else str
    elif field.base == "bool":
        base = bool
    else:
        base = getattr(types, field.base)
    if field.array == FIXED:
        return types.array[base, field.length]
    if field.array == BOUNDED:
        return types.sequence[base, field.length]
    return base if field.array is None else types.sequence[base]
