"""Elements of Choregraphe's XML files with line numbers."""

from __future__ import annotations

import math
from xml.parsers import expat

from pepper_kin.exceptions import FileFormatError, shortened
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.reading import read_text
from pepper_kin.model.plain_number import plain_number

_DEEPEST = 200


class Element:
    """One element of an XML file.

    Args:
        tag: Name of the element.
        attributes: Attributes by name.
        line: Line where the element begins.

    Attributes:
        children: Child elements.
        text: Text of a script's `content`, else empty.
        text_line: Line where the text begins.
    """

    def __init__(self, tag: str, attributes: dict[str, str], line: int) -> None:
        self.tag, self.attributes, self.line = tag, attributes, line
        self.children: list[Element] = []
        self.text, self.text_line = "", line

    def named(self, tag: str) -> list[Element]:
        """Return the children with a tag."""
        return [child for child in self.children if child.tag == tag]


def attribute(path: PathName, element: Element, name: str) -> str:
    """Return the value of a required attribute."""
    if name not in element.attributes:
        raise FileFormatError(path, f"{element.tag} has no attribute {name!r}", element.line)
    return element.attributes[name]


def number(path: PathName, element: Element, name: str, otherwise: str | None = None) -> float:
    """Return an attribute as a finite number, or the number in `otherwise` if it is absent."""
    text = attribute(path, element, name) if otherwise is None else element.attributes.get(name, otherwise)
    value = plain_number(text)
    if not math.isfinite(value):
        raise FileFormatError(
            path, f"{name} of {element.tag} is {shortened(text)!r}, expected a finite number", element.line
        )
    return value


def parse(path: PathName) -> Element:
    """Return the root of an XML file; a document type, which could define entities, is refused."""
    parser = expat.ParserCreate()
    document = Element("", {}, 0)
    open_elements = [document]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, parser.CurrentLineNumber)
        if len(open_elements) > _DEEPEST:
            raise FileFormatError(path, f"nests more than {_DEEPEST} elements", element.line)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def text(characters: str) -> None:
        element = open_elements[-1]
        if element.tag == "content" and (element.text or characters.strip()):
            if not element.text:
                element.text_line = parser.CurrentLineNumber
            element.text += characters

    def doctype(*_: object) -> None:
        raise FileFormatError(path, "has a document type, expected none", parser.CurrentLineNumber)

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: open_elements.pop()
    parser.StartDoctypeDeclHandler = doctype
    parser.CharacterDataHandler = text
    try:
        parser.Parse(read_text(path), True)
    except expat.ExpatError as error:
        raise FileFormatError(path, f"is not a complete XML file: {error}", error.lineno) from error
    return document.children[0]
