"""XML of descriptions, read without what could read other files, multiply, or be nested without end."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

from pepper_kin.exceptions import ModelError, shortened

DEEPEST = 100
"""Elements in one another that are read; a URDF has six."""
MOST_ATTRIBUTES = 1000
"""Attributes of an element that are read: Pinocchio's reader compares each with all before it."""


def parse_xml(text: str, what: str, root_tag: str = "robot") -> ET.Element:
    """Return the root element of a description.

    Args:
        text: The XML. Document type declarations are refused: entities can hide or multiply content.
        what: Name of the format for messages, such as "URDF".
        root_tag: What the root element must be.

    Raises:
        ModelError: naming the format, where the text is not well-formed, is nested deeper than DEEPEST, has
            an element of more than MOST_ATTRIBUTES, another root element, or half of a surrogate pair.
    """
    try:
        text.encode()
    except UnicodeEncodeError as error:
        reason = f"character {error.start} is half of a surrogate pair, which no XML holds"
        raise ModelError(f"{what}: {reason}") from error
    if re.search(r"<!\s*(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise ModelError(f"{what}: document type declarations and entities are not allowed")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise ModelError(f"{what}: not well-formed XML: {error}") from error
    if root.tag != root_tag:
        raise ModelError(f"{what}: the root element is <{shortened(root.tag)}>, expected <{root_tag}>")
    _check_shape(root, what)
    return root


def _check_shape(root: ET.Element, what: str) -> None:
    """Refuse deep nesting: writing such a tree, or Pinocchio's reading it, would overflow the stack.

    Refuse crowds of attributes as well.
    """
    level, depth = [root], 0
    while level:
        depth += 1
        for element in level:
            if len(element.keys()) > MOST_ATTRIBUTES:
                found = f"<{shortened(element.tag)}> has {len(element.keys())} attributes"
                raise ModelError(f"{what}: {found}, at most {MOST_ATTRIBUTES} are read")
        if depth > DEEPEST:
            raise ModelError(f"{what}: elements are nested more than {DEEPEST} deep")
        level = [child for element in level for child in element]
