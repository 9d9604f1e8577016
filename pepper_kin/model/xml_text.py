"""Writing of numbers and elements as XML text."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from pepper_kin.exceptions import InvalidValueError


def number(value: float) -> str:
    """Return the shortest text that reads back as the same number.

    Raises:
        InvalidValueError: for NaN or infinity, which the formats cannot represent.
    """
    if not math.isfinite(value):
        raise InvalidValueError("number to export", value, "a finite number")
    short = repr(float(value))
    return "0" if float(value) == 0.0 else short.removesuffix(".0")


def numbers(values: Iterable[float]) -> str:
    """Return numbers separated by blanks; see `number`."""
    return " ".join(number(float(value)) for value in values)


def child(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    """Append an element with attributes and text and return it."""
    element = ET.SubElement(parent, tag, attributes)
    element.text = text
    return element


def own_child(parent: ET.Element, tag: str) -> ET.Element:
    """Return the first child element with a tag, which is appended if there is none."""
    found = parent.find(tag)
    return ET.SubElement(parent, tag) if found is None else found


def document(root: ET.Element, *comments: str) -> str:
    """Return an indented XML text with comments before its root."""
    ET.indent(root)
    notes = "".join(f"<!-- {comment.replace('--', '- -')} -->\n" for comment in comments)
    return f'<?xml version="1.0"?>\n{notes}{ET.tostring(root, encoding="unicode")}\n'
