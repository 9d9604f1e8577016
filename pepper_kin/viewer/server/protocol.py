"""Commands of the pages: JSON texts with checked fields.

A command is an object with its name in the field "do", and the fields below; all others are refused.

    joint           name, value               posture         name
    show            layer, on                 follow          on
    target          name, position, stamp?    release         name?
    add             kind, position?, size?    change          name, position?, size?, color?
    remove          name                      plan
    go                                        play
    pause                                     seek            time
    speed           value                     loop            on
    clear
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model.joint_vectors import as_finite

LONGEST_TEXT = 4096
"""Maximum length of a command [byte]."""
LONGEST_NAME = 200
FARTHEST = 10.0
"""Largest magnitude of a coordinate [m]."""


@dataclass(frozen=True)
class PageCommand:
    """A command of a page.

    Attributes:
        name: Name of the command.
        fields: Checked operands by name; omitted optional ones are absent.
    """

    name: str
    fields: dict[str, Any]


def _text(name: str, value: Any) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= LONGEST_NAME:
        raise InvalidValueError(name, repr(value), "a name")
    return value


def _flag(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise InvalidValueError(name, repr(value), "true or false")
    return value


def _number(name: str, value: Any) -> float:
    try:
        number = math.nan if isinstance(value, bool) or not isinstance(value, int | float) else float(value)
    except OverflowError:  # an integer of hundreds of digits
        number = math.inf
    if not math.isfinite(number):
        raise InvalidValueError(name, repr(value), "a finite number")
    return number


def _count(name: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**32:
        raise InvalidValueError(name, repr(value), "a whole number below 2^32")
    return value


def _numbers(name: str, value: Any) -> np.ndarray:
    if not isinstance(value, list) or not 1 <= len(value) <= 3:
        raise InvalidValueError(name, repr(value), "a list of one to three numbers")
    return np.array([_number(name, item) for item in value])


def _place(name: str, value: Any) -> np.ndarray:
    place = as_finite(_numbers(name, value), name, (3,))
    if np.abs(place).max() > FARTHEST:
        raise InvalidValueError(name, place.tolist(), f"coordinates within {FARTHEST:g} m")
    return place


Reader = Callable[[str, Any], Any]
_FIELDS: dict[str, dict[str, Reader]] = {
    "joint": {"name": _text, "value": _number},
    "posture": {"name": _text},
    "show": {"layer": _text, "on": _flag},
    "follow": {"on": _flag},
    "target": {"name": _text, "position": _place, "stamp?": _count},
    "release": {"name?": _text},
    "add": {"kind": _text, "position?": _place, "size?": _numbers},
    "change": {"name": _text, "position?": _place, "size?": _numbers, "color?": _numbers},
    "remove": {"name": _text},
    "plan": {},
    "go": {},
    "play": {},
    "pause": {},
    "seek": {"time": _number},
    "speed": {"value": _number},
    "loop": {"on": _flag},
    "clear": {},
}
NAMES = tuple(_FIELDS)


def parse(text: str | bytes) -> PageCommand:
    """Parse a command.

    Args:
        text: JSON text of a page.

    Returns:
        The command.

    Raises:
        InvalidValueError: for a text that is too long, no JSON or no object, or that lacks a field, has an
            unknown one or a wrong value; with the field's name.
        UnknownNameError: for an unknown command.
    """
    if not isinstance(text, str) or len(text) > LONGEST_TEXT:
        raise InvalidValueError("command", "something else", f"JSON text of at most {LONGEST_TEXT} letters")
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise InvalidValueError("command", repr(text), "JSON text") from None
    if not isinstance(content, dict):
        raise InvalidValueError("command", repr(content), "an object with a field 'do'")
    name = content.pop("do", None)
    if not isinstance(name, str) or name not in _FIELDS:
        raise UnknownNameError("command", name, NAMES)
    fields = {}
    for key, read in _FIELDS[name].items():
        field = key.removesuffix("?")
        if field in content:
            fields[field] = read(field, content.pop(field))
        elif not key.endswith("?"):
            raise InvalidValueError(f"command {name!r}", f"no {field!r}", f"a field {field!r}")
    if content:
        raise InvalidValueError(
            f"command {name!r}", f"a field {next(iter(content))!r}", "only its own fields"
        )
    return PageCommand(name, fields)
