"""Safe reading of XML: no external files, no entities, and bounded nesting."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.exceptions import ModelError, shortened
from pepper_kin.model.plain_number import plain_number

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST = 1e30
"""Maximum number in a description, such as a limit or a mass [kg]: products of larger ones overflow."""
DEEPEST = 100
"""Maximum depth of nested elements; a URDF has six levels."""
MOST_ATTRIBUTES = 1000
"""Maximum number of attributes of an element: Pinocchio's reader compares each with all before it."""


class XmlText:
    """A checked XML text and its tree, which all readers of the text share.

    Attributes:
        text: The text.
    """

    text: str

    @cached_property
    def tree(self) -> ET.Element:
        """Root element of the text, parsed once; it must not be changed: see `copied_tree`."""
        return ET.fromstring(self.text)

    def keep_tree(self, root: ET.Element) -> None:
        """Set the tree of a text that has been parsed already."""
        vars(self)["tree"] = root

    def copied_tree(self) -> ET.Element:
        """Return the root of a tree that may be changed: parsing the text again is faster than a copy."""
        return ET.fromstring(self.text)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the tree, for copies and other processes."""
        return {name: value for name, value in vars(self).items() if name != "tree"}


def unbound_prefixes(text: str) -> list[str]:
    """Return prefixes that no `xmlns` of an XML text declares, such as `sensor` of `<sensor:camera>`."""
    used = set(re.findall(r"[<\s]/?([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*(?=[\s=/>])", text))
    return sorted(used - {"xml", "xmlns", *re.findall(r"xmlns:([\w.-]+)\s*=", text)})


def with_bound_prefixes(text: str) -> str:
    """Return a description with undeclared prefixes declared at its root: Gazebo needs no declaration."""
    names = "".join(f' xmlns:{prefix}="undeclared:{prefix}"' for prefix in unbound_prefixes(text))
    return re.sub(r"<robot(?=[\s>])", lambda found: found[0] + names, text, count=1) if names else text


def parse_xml(text: str, what: str, root_tag: str = "robot") -> ET.Element:
    """Return the root element of a description.

    Args:
        text: The XML. Document type declarations are refused: entities can hide or multiply content.
        what: Name of the format for messages, such as "URDF".
        root_tag: Expected tag of the root element.

    Raises:
        ModelError: naming the format, for a text that is not well-formed, is nested deeper than DEEPEST, or
            has an element with more than MOST_ATTRIBUTES, another root element, or half of a surrogate pair.
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
    """Refuse deep nesting, for which writing or Pinocchio's reading would overflow the stack.

    Elements with more than MOST_ATTRIBUTES attributes are refused as well.
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


def attribute_of(element: ET.Element, name: str, what: str) -> str:
    """Return the value of a required attribute.

    Raises:
        ModelError: naming `what`, if the attribute is missing or empty.
    """
    value = element.get(name)
    if not value:
        raise ModelError(f"URDF: a <{element.tag}> of {what} has no {name!r}")
    return value


def number_of(element: ET.Element, name: str, default: float, what: str) -> float:
    """Return an attribute as a number, or `default` where it is absent.

    Raises:
        ModelError: naming `what`, for anything but a number of magnitude up to MOST.
    """
    text = element.get(name)
    if text is None:
        return default
    value = plain_number(text)
    if not abs(value) <= MOST:
        raise ModelError(f"URDF: {what}: {name}={cut(text)} is not a finite number up to {MOST:g}")
    return value


def positive_of(element: ET.Element, name: str, default: float, what: str) -> float:
    """Return an attribute as a number of at least 0, or `default` where it is absent.

    Raises:
        ModelError: naming `what` and the value, for a negative value, one above MOST, or anything but a
            number.
    """
    value = number_of(element, name, default, what)
    if value < 0.0:
        raise ModelError(f"URDF: {what}: {name} is {value:g}, expected at least 0")
    return value


def cut(text: str) -> str:
    """Return a text for a message: quoted, and no longer than 80 characters."""
    quoted = repr(text)
    return quoted if len(quoted) <= 80 else f"{quoted[:76]}..."


def vector_of(text: str | None, size: int, default: Sequence[float], what: str) -> NDArray[np.float64]:
    """Return a text as `size` numbers up to MOST, or `default` for None.

    Raises:
        ModelError: naming `what`, for anything else.
    """
    return np.array(numbers_of(text, size, default, what), dtype=float)


def numbers_of(text: str | None, size: int, default: Sequence[float], what: str) -> Sequence[float]:
    """Return a text as a sequence of `size` numbers up to MOST, or `default` for None."""
    if text is None:
        return default
    values = [plain_number(v) for v in text.split()]
    if len(values) != size or not all(abs(value) <= MOST for value in values):
        raise ModelError(f"URDF: {what}: {cut(text)} is not {size} finite numbers up to {MOST:g}")
    return values
