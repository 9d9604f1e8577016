"""Texts of message types in recordings: a definition, then the definitions of all types within it."""

from __future__ import annotations

import re

from pepper_kin.ros_messages.definitions import (
    BOUNDED,
    FIXED,
    Field,
    definition_texts,
    full_name,
    message_names,
    parse_message,
)
from pepper_kin.ros_messages.definitions import definition as own_definition
from pepper_kin.ros_messages.errors import MessageError
from pepper_kin.ros_messages.messages import Message, library_type, message_type

_RULE = "=" * 80
_PART = re.compile(r"^={8,}\s*\nMSG:\s*(\S+)[^\S\n]*\n?", re.MULTILINE)


def schema_text(kind: type[Message]) -> str:
    """Return the text of a message type, without comments.

    Args:
        kind: Class of the message.
    """
    parts: dict[str, type[Message]] = {}
    _collect(kind, parts)
    texts = [_text(kind)]
    for name in sorted(parts):
        package, _, short = name.split("/")
        texts.append(f"{_RULE}\nMSG: {package}/{short}\n{_text(parts[name])}")
    return "".join(texts)


def schema_type(type_name: str, text: str) -> type[Message]:
    """Return the class of a message type from its text; the package's class if the definitions agree.

    Args:
        type_name: Full or short name.
        text: Definition, with the definitions of types within it; missing ones are the package's.

    Raises:
        MessageError: for a line that cannot be read, or a type without a definition.
    """
    name = full_name(type_name)
    if not re.fullmatch(r"\w+/\w+/\w+", name):
        raise MessageError(type_name, "is not the name of a message type, such as std_msgs/msg/String")
    blocks = _PART.split(text)
    library = {name: parse_message(name, blocks[0])}
    for part, block in zip(blocks[1::2], blocks[2::2], strict=True):
        if not re.fullmatch(r"\w+/(\w+/)?\w+", part):
            raise MessageError(type_name, f"definition names a type {part!r}")
        library.setdefault(full_name(part), parse_message(full_name(part), block))
    waiting = list(library.values())
    while waiting:
        for field in waiting.pop().fields:
            if field.nested and field.base not in library:
                if field.base.endswith("/wstring"):
                    raise MessageError(type_name, f"has the wstring {field.name}, which is not supported")
                if field.base not in message_names():
                    raise MessageError(type_name, f"definition lacks the type {field.base}")
                library[field.base] = own_definition(field.base)
                waiting.append(library[field.base])
    return library_type(name, library)


def _collect(kind: type[Message], parts: dict[str, type[Message]]) -> None:
    for inner in kind.nested.values():
        parts[inner.type_name] = inner
        _collect(inner, parts)


def _text(kind: type[Message]) -> str:
    """Return the package's text of a type, or a generated one for a type of another library."""
    name = kind.type_name
    if name in definition_texts() and kind is message_type(name):
        return definition_texts()[name]
    return "".join(map(_line, kind.definition.fields))


def _line(field: Field) -> str:
    """Return the line of a field in ROS 2's syntax."""
    base = field.base
    if field.nested:
        package, _, name = base.split("/")
        base = f"{package}/{name}"
    if field.string_length:
        base += f"<={field.string_length}"
    array = {None: "", FIXED: f"[{field.length}]", BOUNDED: f"[<={field.length}]"}.get(field.array, "[]")
    default = None if field.default is None else repr(field.default)
    if default is not None and base == "bool":
        default = default.lower()
    return f"{base}{array} {field.name}{'' if default is None else f' {default}'}\n"
