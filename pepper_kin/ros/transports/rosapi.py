"""Essential services of rosapi: lists of topics, services and actions with their types."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.transports.local import LocalTransport
from pepper_kin.ros_messages import message_type

NODE = "/pepper_kin"
"""Name of the only node that is listed."""


def answer_rosapi(transport: LocalTransport, name: str, values: Any) -> dict[str, Any] | None:
    """Return the response values of a rosapi service, or None for another service.

    Args:
        transport: Transport whose topics, services and actions are listed.
        name: Name of the service, such as "/rosapi/topics".
        values: Arguments by name.

    Raises:
        TransportError: for an unknown topic or service.
        UnknownNameError: for an unknown type.
    """
    answer = _ANSWERS.get(name.removeprefix("/rosapi/")) if name.startswith("/rosapi/") else None
    if answer is None:
        return None
    return answer(transport, values if isinstance(values, dict) else {})


def _topics(transport: LocalTransport, _: dict[str, Any]) -> dict[str, Any]:
    return {"topics": list(transport.topics), "types": list(transport.topics.values())}


def _of_type(table: dict[str, str], values: dict[str, Any]) -> list[str]:
    return [name for name, kind in table.items() if kind == values.get("type")]


def _type_of(table: dict[str, str], name: Any) -> str:
    if name not in table:
        raise TransportError(str(name), f"is not known; there are: {', '.join(table) or '(none)'}")
    return table[name]


def _node_details(transport: LocalTransport, _: dict[str, Any]) -> dict[str, Any]:
    with transport.lock:
        heard = [name for name in transport.topics if transport.topic(name, None).subscriptions]
        sent = [name for name in transport.topics if transport.topic(name, None).publishers]
    return {"subscribing": heard, "publishing": sent, "services": list(transport.services)}


def _message_details(_: LocalTransport, values: dict[str, Any]) -> dict[str, Any]:
    """Return the definitions of a message type and of its nested types, as rosapi describes them."""
    found: dict[str, dict[str, Any]] = {}
    waiting = [message_type(str(values.get("type")))]
    while waiting:
        kind = waiting.pop()
        fields = kind.definition.fields
        found[kind.type_name] = {
            "type": kind.type_name,
            "fieldnames": [field.name for field in fields],
            "fieldtypes": [field.base for field in fields],
            "fieldarraylen": [-1 if f.array is None else f.length for f in fields],
            "examples": ["[]" if f.array else "{}" if f.nested else "0" for f in fields],
            "constnames": list(kind.definition.constants),
            "constvalues": [str(value) for value in kind.definition.constants.values()],
        }
        waiting += [one for one in kind.nested.values() if one.type_name not in found]
    return {"typedefs": list(found.values())}


def _time(_: LocalTransport, __: dict[str, Any]) -> dict[str, Any]:
    now = time.time_ns()
    return {"time": {"sec": now // 10**9, "nanosec": now % 10**9}}


_ANSWERS: dict[str, Callable[[LocalTransport, dict[str, Any]], dict[str, Any]]] = {
    "topics": _topics,
    "topics_for_type": lambda t, v: {"topics": _of_type(t.topics, v)},
    "topic_type": lambda t, v: {"type": _type_of(t.topics, v.get("topic"))},
    "topics_and_raw_types": lambda t, v: {**_topics(t, v), "typedefs_full_text": [""] * len(t.topics)},
    "services": lambda t, _: {"services": list(t.services)},
    "services_for_type": lambda t, v: {"services": _of_type(t.services, v)},
    "service_type": lambda t, v: {"type": _type_of(t.services, v.get("service"))},
    "action_servers": lambda t, _: {"action_servers": list(t.actions)},
    "action_type": lambda t, v: {"type": _type_of(t.actions, v.get("action"))},
    "nodes": lambda _, __: {"nodes": [NODE]},
    "node_details": _node_details,
    "publishers": lambda t, v: {"publishers": [NODE] if v.get("topic") in t.topics else []},
    "subscribers": lambda t, v: {"subscribers": [NODE] if v.get("topic") in t.topics else []},
    "message_details": _message_details,
    "get_time": _time,
    "get_ros_version": lambda _, __: {"version": 2, "distro": "kilted"},
}
"""Name of a service -> function that answers it."""
