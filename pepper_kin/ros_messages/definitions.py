"""Definitions of message types: fields, defaults and constants, parsed from ROS 2's syntax."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from importlib import resources
from keyword import kwlist
from typing import Any, NamedTuple

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.ros_messages.errors import MessageError

PRIMITIVES = {
    "bool": ("?", 1),
    "byte": ("B", 1),
    "int8": ("b", 1),
    "uint8": ("B", 1),
    "int16": ("h", 2),
    "uint16": ("H", 2),
    "int32": ("i", 4),
    "uint32": ("I", 4),
    "int64": ("q", 8),
    "uint64": ("Q", 8),
    "float32": ("f", 4),
    "float64": ("d", 8),
}
"""Primitive type -> its code in `struct` and its size [bytes]."""

STRING = "string"
FIXED, BOUNDED, UNBOUNDED = "fixed", "bounded", "unbounded"
_LARGEST_ARRAY = 1 << 16  # limits the memory of defaults; ROS's longest fixed array has 36
TAKEN_NAMES = {*kwlist, "definition", "from_dict", "nested", "self", "to_dict", "type_name"}
"""Names that attributes of a message's class cannot have."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_TYPE = re.compile(
    r"(?P<base>[A-Za-z][\w/]*)(?:<=(?P<string>\d{1,9}))?(?:\[(?P<bound><=)?(?P<length>\d{0,9})\])?"
)
_LINE = re.compile(r"(?P<type>\S+)\s+(?P<name>\w+)\s*(?P<rest>.*)")


class Field(NamedTuple):
    """A field of a message.

    Attributes:
        name: Name of the field.
        base: A key of PRIMITIVES, "string", or the full name of a message type.
        array: None for one value, else "fixed", "bounded" or "unbounded".
        length: Number of elements of a fixed array, maximum number of a bounded one, else 0.
        string_length: Maximum length of a string; 0 for no limit.
        default: Default in the definition; None if it has none.
    """

    name: str
    base: str
    array: str | None = None
    length: int = 0
    string_length: int = 0
    default: Any = None

    @property
    def attribute(self) -> str:
        """Name in the message's class: the field's name, with "_" appended to reserved names.

        rosidl's generator and rosbags do the same for Python's keywords.
        """
        return f"{self.name}_" if self.name in TAKEN_NAMES else self.name

    @property
    def nested(self) -> bool:
        """Whether the values are messages."""
        return self.base not in PRIMITIVES and self.base != STRING


class Definition(NamedTuple):
    """Fields and constants of a message type.

    Attributes:
        type_name: Full name, such as `sensor_msgs/msg/JointState`.
        fields: Fields in order.
        constants: Name of a constant -> value.
    """

    type_name: str
    fields: tuple[Field, ...]
    constants: dict[str, Any]


def full_name(type_name: str, kind: str = "msg") -> str:
    """Return the full name of a type: `std_msgs/String` is `std_msgs/msg/String`.

    Args:
        type_name: Full or short name.
        kind: "msg", "srv" or "action".
    """
    parts = str(type_name).split("/")
    return "/".join((parts[0], kind, parts[1])) if len(parts) == 2 else str(type_name)


def parse_message(type_name: str, text: str) -> Definition:
    """Parse the definition of a message.

    Args:
        type_name: Full name; types without a package in the text are of the same package.
        text: Text in the syntax of a `.msg` file.

    Raises:
        MessageError: for a line that cannot be read, with the line.
    """
    package = type_name.split("/")[0]
    fields, constants = [], {}
    for line in map(_without_comment, text.splitlines()):
        if not line:
            continue
        match = _LINE.fullmatch(line)
        kind = _TYPE.fullmatch(match["type"]) if match else None
        if match is None or kind is None or _NAME.fullmatch(match["name"]) is None:
            raise MessageError(type_name, f"definition has the line {line!r}, expected TYPE NAME [DEFAULT]")
        base, rest = _full_base(kind["base"], package), match["rest"].strip()
        if rest.startswith("="):
            if match["name"] in constants:
                raise MessageError(type_name, f"definition has two constants {match['name']}")
            constants[match["name"]] = _value(type_name, base, rest[1:].strip())
            continue
        length = int(kind["length"] or 0)
        array = None if kind["length"] is None else UNBOUNDED
        if array and kind["length"]:
            array = BOUNDED if kind["bound"] else FIXED
        if array == FIXED and not 0 < length <= _LARGEST_ARRAY:
            raise MessageError(type_name, f"definition has an array of {length} elements: {line!r}")
        default = _value(type_name, base, rest, array is not None) if rest else None
        fields.append(Field(match["name"], base, array, length, int(kind["string"] or 0), default))
    if len({*constants, *(field.attribute for field in fields)}) < len(fields) + len(constants):
        raise MessageError(type_name, "definition has two fields or constants of the same name")
    return Definition(type_name, tuple(fields), constants)


def parse_definition(type_name: str, text: str) -> Iterator[Definition]:
    """Parse a text; yield the definitions of a message, or of all messages of a service or an action.

    Args:
        type_name: Full name.
        text: Text in the syntax of a `.msg`, `.srv` or `.action` file.

    Raises:
        MessageError: for a text that cannot be read, with the reason.
    """
    parts = re.split(r"^---$", text, flags=re.MULTILINE)
    kind = type_name.split("/")[1]
    names = {"msg": ("",), "srv": SERVICE_PARTS, "action": ACTION_PARTS}.get(kind, ())
    if len(names) != len(parts):
        raise MessageError(type_name, f"definition has {len(parts)} parts, expected {len(names)}")
    for name, part in zip(names, parts, strict=True):
        yield parse_message(type_name + name, part)
    if kind == "action":
        for name, part in _ACTION_MESSAGES.items():
            yield parse_message(type_name + name, part.replace("@", type_name))
    services = {"srv": ("",), "action": ("_SendGoal", "_GetResult")}.get(kind, ())
    for name in services:
        yield parse_message(f"{type_name}{name}_Event", _EVENT.replace("@", type_name + name))


SERVICE_PARTS = ("_Request", "_Response")
ACTION_PARTS = ("_Goal", "_Result", "_Feedback")
_ACTION_MESSAGES = {
    "_SendGoal_Request": "unique_identifier_msgs/msg/UUID goal_id\n@_Goal goal",
    "_SendGoal_Response": "bool accepted\nbuiltin_interfaces/msg/Time stamp",
    "_GetResult_Request": "unique_identifier_msgs/msg/UUID goal_id",
    "_GetResult_Response": "int8 status\n@_Result result",
    "_FeedbackMessage": "unique_identifier_msgs/msg/UUID goal_id\n@_Feedback feedback",
}
_EVENT = "service_msgs/msg/ServiceEventInfo info\n@_Request[<=1] request\n@_Response[<=1] response"


def split_definitions(text: str) -> dict[str, str]:
    """Split a text at lines `=== NAME`; return full name -> text of each definition."""
    texts: dict[str, str] = {}
    for block in re.split(r"^=== ", text, flags=re.MULTILINE)[1:]:
        name, _, rest = block.partition("\n")
        texts[name.strip()] = rest
    return texts


@cache
def definition_texts() -> dict[str, str]:
    """Return the text of every definition of the package, by full name."""
    data = resources.files("pepper_kin.ros_messages").joinpath("data", "definitions.msg")
    return split_definitions(data.read_text("utf-8"))


@cache
def _definitions() -> dict[str, Definition]:
    return {d.type_name: d for name, text in definition_texts().items() for d in parse_definition(name, text)}


def message_names() -> tuple[str, ...]:
    """Return the full names of all message types, including those of services and actions."""
    return tuple(_definitions())


def interface_names(kind: str) -> tuple[str, ...]:
    """Return the full names of all services ("srv") or actions ("action")."""
    return tuple(name for name in definition_texts() if name.split("/")[1] == kind)


def definition(type_name: str) -> Definition:
    """Return the definition of a message type.

    Args:
        type_name: Full or short name.

    Raises:
        UnknownNameError: for a type that the package does not have.
    """
    found = _definitions().get(full_name(type_name))
    if found is None:
        raise UnknownNameError("message type", type_name, message_names())
    return found


def _full_base(base: str, package: str) -> str:
    if base in PRIMITIVES or base == STRING:
        return base
    if base == "char":
        return "uint8"  # ROS 2's `char` is unsigned
    return full_name(base if "/" in base else f"{package}/{base}")


def _without_comment(line: str) -> str:
    """Return a line without its comment; a # within quotes starts no comment."""
    quote = ""
    for i, character in enumerate(line):
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        elif character == "#":
            return line[:i].strip()
    return line.strip()


def _value(type_name: str, base: str, text: str, array: bool = False) -> Any:
    """Parse a constant or a default of a type.

    Args:
        type_name: Name of the message type, for errors.
        base: Primitive type or "string".
        text: Text in the definition: `[1, 2]`, `true`, `'text'`, or a text without quotes.
        array: Whether a list is expected.

    Raises:
        MessageError: for a value that the type cannot hold.
    """
    if base == STRING and not array and text[:1] not in ('"', "'"):
        return text
    literal = (
        re.sub(r"\b(true|false)\b", lambda m: m[0].title(), text, flags=re.I) if base == "bool" else text
    )
    try:
        value = ast.literal_eval(literal)
        if array != isinstance(value, list | tuple):
            raise ValueError
        values = [_element(base, v) for v in value] if array else _element(base, value)
    except (ValueError, TypeError, SyntaxError, OverflowError, MemoryError, RecursionError):
        kind = f"an array of {base}" if array else f"a {base}"
        raise MessageError(type_name, f"definition has the value {text!r} for {kind}") from None
    return values


def _element(base: str, value: Any) -> Any:
    """Convert a value to a type; raise ValueError or TypeError if the type cannot hold it."""
    if base == STRING:
        if not isinstance(value, str):
            raise ValueError
        return value
    if not isinstance(value, bool | int | float):
        raise TypeError
    if base == "bool":
        if value not in (0, 1):
            raise ValueError
        return bool(value)
    code, size = PRIMITIVES[base]
    if base.startswith("float"):
        return float(value)
    least = -(1 << 8 * size - 1) if code.islower() else 0
    if isinstance(value, float) or not least <= value < least + (1 << 8 * size):
        raise ValueError
    return int(value)
