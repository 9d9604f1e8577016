"""Conversion of messages to JSON values and back, in rosbridge's layout.

Source: rosbridge protocol 2.1: arrays of bytes (`uint8[]`, `char[]`) are base64 texts; numbers that JSON does
not have (NaN, infinity) are null.
"""

from __future__ import annotations

import base64
import binascii
import math
from typing import Any, TypeVar

import numpy as np

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.ros_messages.definitions import FIXED, PRIMITIVES, STRING, Field
from pepper_kin.ros_messages.messages import DTYPES, Message, as_array, check_message, check_number

_Message = TypeVar("_Message", bound=Message)


def to_dict(message: Message) -> dict[str, Any]:
    """Convert a message to a dictionary of JSON values.

    Raises:
        InvalidValueError: for a value that the type cannot hold, with the field's name.
    """
    check_message(message, type(message))
    return _dictionary(message)


def _dictionary(message: Message) -> dict[str, Any]:
    """Return the dictionary of a checked message."""
    values = {}
    for field in message.definition.fields:
        value = getattr(message, field.attribute)
        if field.array is not None and field.base in PRIMITIVES:
            values[field.name] = _array_out(as_array(value, field, message.type_name), field)
        elif field.array is not None:
            values[field.name] = [_dictionary(v) for v in value] if field.nested else list(value)
        else:
            values[field.name] = _dictionary(value) if field.nested else _scalar_out(value, field)
    return values


def _array_out(array: Any, field: Field) -> Any:
    if field.base == "uint8":
        return base64.b64encode(array.tobytes()).decode("ascii")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        return [x if math.isfinite(x) else None for x in array.tolist()]
    return array.tolist()


def _scalar_out(value: Any, field: Field) -> Any:
    if field.base in ("float32", "float64"):
        return float(value) if math.isfinite(value) else None
    if field.base == STRING:
        return value
    return bool(value) if field.base == "bool" else int(value)


def from_dict(kind: type[_Message], values: Any) -> _Message:
    """Convert a dictionary of JSON values to a message.

    Missing fields have their defaults; null is NaN; arrays of bytes may be lists, too.

    Args:
        kind: Class of the message.
        values: Name of a field -> value.

    Raises:
        UnknownNameError: for a field that the message does not have.
        InvalidValueError: for a value that a field cannot hold, with the field's name.
    """
    return _message(kind, values, kind.type_name)


def _message(kind: type[_Message], values: Any, path: str) -> _Message:
    """Return a message from values; `path` names it in errors."""
    if not isinstance(values, dict):
        raise InvalidValueError(path, values, f"an object with the fields of {kind.type_name}")
    fields = {field.name: field for field in kind.definition.fields}
    read = {}
    for name, value in values.items():
        field = fields.get(name)
        if field is None:
            raise UnknownNameError(f"field of {path}", name, fields)
        where = f"{path}.{name}"
        if field.array is None:
            read[field.attribute] = _value(kind, field, value, where)
        elif field.base in PRIMITIVES:
            read[field.attribute] = as_array(_array_in(field, value, where), field, path)
        elif not isinstance(value, list):
            raise InvalidValueError(where, value, "a list")
        else:
            read[field.attribute] = [_value(kind, field, v, f"{where}[{i}]") for i, v in enumerate(value)]
    return kind(**read)


def _value(kind: type[Message], field: Field, value: Any, where: str) -> Any:
    """Convert a JSON value to a value of a field that is no array."""
    if field.nested:
        return _message(kind.nested[field.name], value, where)
    if field.base == STRING:
        if not isinstance(value, str):
            raise InvalidValueError(where, value, "a string")
        return value
    if DTYPES[field.base].kind == "f":
        value = math.nan if value is None else value
    elif isinstance(value, bool) and field.base != "bool":
        raise InvalidValueError(where, value, f"a {field.base}")
    elif isinstance(value, float) and value.is_integer():
        value = int(value)  # JavaScript has one number type
    check_number(value, field.base, where)
    return float(value) if DTYPES[field.base].kind == "f" else value


def _array_in(field: Field, value: Any, where: str) -> Any:
    """Convert base64 or a list of JSON values to the elements of an array."""
    if isinstance(value, str) and field.base == "uint8":
        try:
            return base64.b64decode(value, validate=True)
        except (binascii.Error, ValueError):
            raise InvalidValueError(where, value, "base64") from None
    if not isinstance(value, list):
        expected = "base64 or a list of whole numbers" if field.base == "uint8" else "a list of numbers"
        raise InvalidValueError(where, value, expected)
    if field.array == FIXED and len(value) != field.length:
        raise InvalidValueError(where, f"{len(value)} elements", f"exactly {field.length}")
    scalar = field._replace(array=None)
    return [_value(Message, scalar, v, f"{where}[{i}]") for i, v in enumerate(value)]
