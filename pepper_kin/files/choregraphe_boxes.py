"""Behaviors of Choregraphe as boxes with scripts, signals and timelines."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from pepper_kin.exceptions import FileFormatError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.files.choregraphe import behaviors_of, timeline_of
from pepper_kin.files.choregraphe_xml import Element, attribute, number, parse
from pepper_kin.trajectory.timeline import Timeline

ON_LOAD, EVENT, START, STOP, MEMORY = range(5)
"""Types of inputs; an output of type `STOPPED` ends the box."""

STOPPED = 1

_BOOL, _INT, _FLOAT = "0", "1", "2"
_LARGEST = 1 << 30  # bytes of an unpacked application


class Port(NamedTuple):
    """An input or an output of a box.

    Attributes:
        name: Name in scripts.
        kind: `ON_LOAD`, ... or `STOPPED`.
        event: Event of ALMemory, for inputs of type `MEMORY`.
    """

    name: str
    kind: int
    event: str


class Parameter(NamedTuple):
    """A parameter of a box.

    Attributes:
        value: Value for scripts.
        inherited: Whether the enclosing box's parameter of the same name is used, if it has one.
    """

    value: bool | int | float | str
    inherited: bool


class BoxLink(NamedTuple):
    """Connection in a diagram: ids of two boxes (0 is the enclosing box) and of their ports."""

    source: int
    output: int
    target: int
    input: int


@dataclass(frozen=True)
class Diagram:
    """Boxes that are active from a frame until the layer's next diagram.

    Attributes:
        frame: Frame of the timeline at which the diagram begins.
        boxes: Boxes by id.
        links: Connections of the boxes.
    """

    frame: float
    boxes: dict[int, ChoregrapheBox]
    links: tuple[BoxLink, ...]


@dataclass(frozen=True)
class BoxTimeline:
    """Timeline of a box.

    Attributes:
        plays: Whether the timeline plays; otherwise the box is a diagram.
        fps: Frames per second.
        first: First frame.
        last: Last frame.
        motion: Motion of joints, or None.
        layers: Diagrams of each layer in order of frames.
    """

    plays: bool
    fps: float
    first: float
    last: float
    motion: Timeline | None
    layers: tuple[tuple[Diagram, ...], ...]


@dataclass(frozen=True)
class ChoregrapheBox:
    """A box of a behavior.

    Attributes:
        path: Names of the enclosing boxes and of this box, joined by slashes.
        script: Script in Python 2, or "".
        line: Line of the file where the script begins.
        inputs: Inputs by id.
        outputs: Outputs by id.
        parameters: Parameters by name.
        timeline: Timeline of the box, or None.
        dialog: Whether the box has a dialog file.
    """

    path: str
    script: str
    line: int
    inputs: dict[int, Port]
    outputs: dict[int, Port]
    parameters: dict[str, Parameter]
    timeline: BoxTimeline | None
    dialog: bool


def find_behaviors(path: PathName, unpacked: Path) -> dict[str, Path]:
    """Return the behaviors of a project: name of the folder -> file.

    Args:
        path: A behavior (.xar), a project (.pml), a folder with one of them, or an application (.pkg).
        unpacked: Folder to which an application is unpacked.

    Raises:
        FileFormatError: if there is no behavior.
    """
    file = Path(path)
    if file.suffix.lower() == ".xar":
        return {file.parent.name: file}
    if file.suffix.lower() == ".pkg":
        _unpack(file, unpacked)
        file = unpacked
    if file.is_dir():
        projects = sorted(one for one in file.glob("*.pml") if not one.name.startswith("."))
        if len(projects) > 1:
            names = ", ".join(one.name for one in projects)
            raise FileFormatError(path, f"holds more than one project; name one of {names}")
        if not projects:
            found = {one.parent.name: one for one in sorted(file.glob("**/behavior.xar"))}
            if not found:
                raise FileFormatError(path, "holds no project (.pml) and no behavior.xar")
            return found
        file = projects[0]
    return dict(behaviors_of(file))


def _unpack(path: Path, folder: Path) -> None:
    """Unpack an application into a folder, after a check of size and file names."""
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(one.file_size for one in archive.infolist()) > _LARGEST:
                raise FileFormatError(path, f"unpacks to more than {_LARGEST >> 20} MB")
            for one in archive.infolist():
                if Path(one.filename).is_absolute() or ".." in Path(one.filename).parts:
                    raise FileFormatError(path, f"holds {one.filename!r}, outside its own folder")
            archive.extractall(folder)
    except (OSError, zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise FileFormatError(path, f"is not an application that can be unpacked: {error}") from error


def read_behavior(path: PathName) -> ChoregrapheBox:
    """Read a behavior (.xar) and return its root box with all nested boxes.

    Raises:
        FileFormatError: naming the line and the fault.
    """
    root = parse(path)
    boxes = root.named("Box")
    if root.tag != "ChoregrapheProject" or not boxes:
        raise FileFormatError(path, "is not a behavior of Choregraphe 2", root.line)
    return _box(path, boxes[0], "")


def _box(path: PathName, element: Element, above: str) -> ChoregrapheBox:
    """Return a box from its element; `above` is the path of the enclosing box."""
    name = attribute(path, element, "name")
    name = f"{above}/{name}" if above else name
    contents = [content for script in element.named("script") for content in script.named("content")]
    script = contents[0] if contents and contents[0].text.strip() else None
    timelines = element.named("Timeline")
    return ChoregrapheBox(
        name,
        "" if script is None else script.text,
        element.line if script is None else script.text_line,
        dict(_ports(path, element.named("Input"))),
        dict(_ports(path, element.named("Output"))),
        {attribute(path, one, "name"): _parameter(path, one) for one in element.named("Parameter")},
        _timeline(path, timelines[0], name) if timelines else None,
        bool(element.named("dialogFile")),
    )


def _ports(path: PathName, elements: list[Element]) -> Iterator[tuple[int, Port]]:
    """Yield the id and port of each input or output element."""
    for one in elements:
        kind = int(number(path, one, "nature", "1"))
        yield (
            int(number(path, one, "id")),
            Port(attribute(path, one, "name"), kind, one.attributes.get("stm_value_name", "")),
        )


def _parameter(path: PathName, element: Element) -> Parameter:
    """Return a parameter with its value in the type of its content."""
    text, kind = attribute(path, element, "value"), element.attributes.get("content_type", "3")
    value: bool | int | float | str = text
    if kind == _BOOL:
        value = text.strip().lower() in ("1", "true")
    elif kind in (_INT, _FLOAT) and text.strip():
        value = number(path, element, "value")
        value = int(value) if kind == _INT else value
    return Parameter(value, element.attributes.get("inherits_from_parent", "0") == "1")


def _timeline(path: PathName, element: Element, name: str) -> BoxTimeline:
    """Return the timeline of a box."""
    plays = element.attributes.get("enable", "0") == "1"
    layers = [
        sorted((_diagram(path, one, name) for one in layer.named("BehaviorKeyframe")), key=lambda d: d.frame)
        for layer in element.named("BehaviorLayer")
        if layer.attributes.get("mute", "0") != "1"
    ]
    motion = timeline_of(path, element, name) if plays else None
    fps, first = number(path, element, "fps", "25"), number(path, element, "start_frame", "1")
    last = number(path, element, "end_frame", "-1")
    if last < first:  # not stated: use its size
        last = max(first, number(path, element, "size", "-1"))
    if plays and fps <= 0:
        raise FileFormatError(path, f"fps is {fps:g}, expected a rate above 0", element.line)
    return BoxTimeline(plays, fps, first, last, motion, tuple(map(tuple, layers)))


def _diagram(path: PathName, element: Element, name: str) -> Diagram:
    """Return the boxes and connections of a keyframe."""
    boxes, links = dict[int, ChoregrapheBox](), list[BoxLink]()
    for diagram in element.named("Diagram"):
        boxes |= {int(number(path, one, "id")): _box(path, one, name) for one in diagram.named("Box")}
        ends = ("outputowner", "indexofoutput", "inputowner", "indexofinput")
        for one in diagram.named("Link"):
            links.append(BoxLink(*(int(number(path, one, end)) for end in ends)))
    return Diagram(number(path, element, "index", "1"), boxes, tuple(links))
