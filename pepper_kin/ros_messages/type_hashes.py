"""Hashes of interface types (RIHS01), by which ROS 2 distinguishes versions of a type.

Source: REP 2011, Evolving Message Types; the hash is the SHA-256 of the type's description as JSON.
"""

from __future__ import annotations

import hashlib
import json
from functools import cache
from typing import Any

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.ros_messages.definitions import (
    ACTION_PARTS,
    BOUNDED,
    FIXED,
    SERVICE_PARTS,
    STRING,
    Definition,
    Field,
    definition,
    full_name,
    interface_names,
    message_names,
)

_IDS = {
    "int8": 2,
    "uint8": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    STRING: 17,
}
_NESTED, _BOUNDED_STRING = 1, 21
_ARRAY_IDS = {None: 0, FIXED: 48, BOUNDED: 96, "unbounded": 144}


@cache
def type_hash(type_name: str) -> str:
    """Return the hash of a message, service or action.

    Args:
        type_name: Full name, such as `sensor_msgs/msg/JointState` or `std_srvs/srv/Trigger`; parts of
            services and actions, such as `std_srvs/srv/Trigger_Request`, are messages.

    Returns:
        "RIHS01_" and 64 hexadecimal digits.

    Raises:
        UnknownNameError: for a type that the package does not have.
    """
    main = _interface(full_name(type_name))
    described = {
        "type_description": _described(main),
        "referenced_type_descriptions": [_described(found) for found in _referenced(main)],
    }
    text = json.dumps(described, ensure_ascii=True, separators=(", ", ": "))
    return "RIHS01_" + hashlib.sha256(text.encode()).hexdigest()


def _interface(name: str) -> Definition:
    """Return the definition of a message, or of the structure that describes a service or an action."""
    if name in interface_names("srv") or name.removesuffix("_SendGoal").removesuffix(
        "_GetResult"
    ) in interface_names("action"):
        if name in interface_names("action"):
            parts = {part[1:].lower(): name + part for part in ACTION_PARTS}
            parts |= {"send_goal_service": f"{name}_SendGoal", "get_result_service": f"{name}_GetResult"}
            parts["feedback_message"] = f"{name}_FeedbackMessage"
        else:
            parts = {f"{part[1:].lower()}_message": name + part for part in (*SERVICE_PARTS, "_Event")}
        return Definition(name, tuple(Field(field, base) for field, base in parts.items()), {})
    try:
        return definition(name)
    except UnknownNameError:
        names = (*message_names(), *interface_names("srv"), *interface_names("action"))
        raise UnknownNameError("interface type", name, names) from None


def _referenced(main: Definition) -> list[Definition]:
    """Return the definitions of all types within a type, including an action's services."""
    library: dict[str, Definition] = {}
    for field in main.fields:
        if field.nested and field.base not in library:
            part = _interface(field.base)
            library |= {part.type_name: part, **{d.type_name: d for d in _referenced(part)}}
    return [library[name] for name in sorted(library)]


def _described(found: Definition) -> dict[str, Any]:
    fields = found.fields or (Field("structure_needs_at_least_one_member", "uint8"),)
    return {"type_name": found.type_name, "fields": [_described_field(field) for field in fields]}


def _described_field(field: Field) -> dict[str, Any]:
    base = _NESTED if field.nested else _IDS[field.base]
    if field.string_length:
        base = _BOUNDED_STRING
    return {
        "name": field.name,
        "type": {
            "type_id": base + _ARRAY_IDS[field.array],
            "capacity": field.length,
            "string_capacity": field.string_length,
            "nested_type_name": field.base if field.nested else "",
        },
    }
