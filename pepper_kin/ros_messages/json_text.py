"""Messages as JSON texts, by a function generated for each type: some ten times as fast as `to_dict`."""

from __future__ import annotations

import binascii
import json
from collections.abc import Callable
from functools import cache
from json.encoder import encode_basestring_ascii
from typing import Any

from pepper_kin.ros_messages.definitions import STRING, Field
from pepper_kin.ros_messages.messages import Message

_BYTES = ("uint8", "char")
_FLOATS = ("float32", "float64")


def to_json(message: Message) -> str:
    """Return the compact JSON text of `Message.to_dict`, with null for NaN.

    Values of wrong types are refused; the ranges of numbers are not checked.

    Raises:
        InvalidValueError: for a value that the type cannot hold, with the field's name.
    """
    try:
        kind: Any = type(message)
        return _writer_of(kind)(message)
    except (AttributeError, TypeError, ValueError):  # NaN, values of wrong types
        return json.dumps(message.to_dict(), separators=(",", ":"), allow_nan=False)


@cache
def _writer_of(kind: Any) -> Callable[[Message], str]:
    """Return a function that writes messages of a type; it raises for NaN and values of wrong types."""
    space: dict[str, Any] = {
        "_text": encode_basestring_ascii,
        "_float": _float,
        "_floats": _floats,
        "_base64": _base64,
        "_bool": _bool,
    }
    parts = _parts(kind, "m", space)
    body = " + ".join(parts)
    exec(f"def write(m):\n    return {body}", space)
    made: Callable[[Message], str] = space["write"]
    return made


def _parts(kind: type[Message], at: str, space: dict[str, Any]) -> list[str]:
    """Return expressions whose sum is the text of a message; `at` is the message's own expression."""
    if not kind.definition.fields:
        return [repr("{}")]
    parts: list[str] = []
    for number, field in enumerate(kind.definition.fields):
        parts.append(repr(f"{',' if number else '{'}{json.dumps(field.name)}:"))
        parts += _field_parts(kind, field, f"{at}.{field.attribute}", space)
    return [*parts, repr("}")]


def _field_parts(kind: type[Message], field: Field, value: str, space: dict[str, Any]) -> list[str]:
    """Return the expressions whose sum is the text of a field's value."""
    if field.nested:
        inner: Any = kind.nested[field.name]
        if field.array is None:
            return _parts(inner, value, space)
        name = f"_writer{len(space)}"
        space[name] = _writer_of(inner)
        return [f"'[' + ','.join([{name}(x) for x in {value}]) + ']'"]
    if field.array is not None:
        if field.base == STRING:
            return [f"'[' + ','.join([_text(x) for x in {value}]) + ']'"]
        if field.base in _BYTES:
            return [f"_base64({value})"]
        if field.base in _FLOATS:
            return [f"_floats({value})"]
        if field.base == "bool":
            return [f"'[' + ','.join([_bool(x) for x in {value}]) + ']'"]
        return [f"str({value}.tolist())"]
    if field.base == STRING:
        return [f"_text({value})"]
    if field.base in _FLOATS:
        return [f"_float({value})"]
    return [f"_bool({value})" if field.base == "bool" else f"format({value}, 'd')"]


def _float(value: Any) -> str:
    text = float.__repr__(float(value))
    if "n" in text:  # nan, inf
        raise ValueError
    return text


def _floats(array: Any) -> str:
    text = str(array.tolist())
    if "n" in text:
        raise ValueError
    return text


def _bool(value: Any) -> str:
    if value is True or value is False:
        return "true" if value else "false"
    raise TypeError


def _base64(array: Any) -> str:
    return '"' + binascii.b2a_base64(array, newline=False).decode("ascii") + '"'
