"""Animations from Choregraphe's behaviors and projects, and from NAOqi's lists of keys."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pepper_kin.exceptions import FileFormatError, InvalidValueError, shortened
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.reading import is_real_text, read_bytes, read_text
from pepper_kin.files.choregraphe_xml import Element, attribute, number, parse
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.trajectory.key_curve import Handle, JointCurve, Key
from pepper_kin.trajectory.timeline import HANDS, Timeline

# NAOqi's numbers of interpolation types; Choregraphe exports 3 for handles that it computed itself.
NAOQI_KINDS = {0: "constant", 1: "linear", 2: "bezier", 3: "bezier"}
_XML_KINDS = {"bezier": "bezier", "linear": "linear", "constant": "constant", "bezier_auto": "auto"}
_DEGREE, _SHARE, _UNSTATED = 0, 1, -1
_APPEND = re.compile(r"\s*(?:\w+\.)*(names|times|keys)\.append\((.*)")


def read_choregraphe(path: PathName) -> tuple[Timeline, ...]:
    """Read all timelines with motion of a behavior (.xar) or of the behaviors of a project (.pml).

    Behaviors in the older format keep their boxes in other files, of which those with the root `Animation`
    can be read one by one.

    A key at frame f is at (f - start_frame) / fps seconds, as in the robot's player; keys before the start
    frame and muted curves are left out. Angles are in degrees and hands in fractions of opening, also if a
    file does not state the unit (-1). Handles are in frames and degrees relative to their key; keys without
    handles have automatic ones.

    Args:
        path: A file with the suffix .xar or .pml.

    Returns:
        Timelines that move a joint, in the file's order, named by the boxes around them.

    Raises:
        FileFormatError: naming path, line and fault; also if no timeline moves a joint.
    """
    if Path(path).suffix.lower() == ".pml":
        return _project(path)
    root = parse(path)
    if root.tag not in ("ChoregrapheProject", "Animation"):
        raise FileFormatError(path, f"is not a behavior: its root is {root.tag!r}", root.line)
    found = tuple(_timelines(path, root, ()))
    if not found:
        old = next((child for child in root.children if child.tag == "BoxInstance"), None)
        if old is not None:
            reason = "keeps its boxes in other files, an older format; read those whose root is Animation"
            raise FileFormatError(path, reason, old.line)
        raise FileFormatError(path, "has no timeline that moves a joint")
    return found


def naoqi_timeline(
    names: Sequence[str], times: Sequence[Sequence[float]], keys: Sequence[Sequence[Any]], name: str = "keys"
) -> Timeline:
    """Return the animation from the arguments of `ALMotion.angleInterpolationBezier`.

    Args:
        names: Names of the joints.
        times: Times of each joint's keys [s].
        keys: Keys of each joint: an angle [rad], or [angle, [kind, dTime, dAngle], [kind, dTime, dAngle]]
            with the handles before and behind the key; kinds are 0 constant, 1 linear, 2 and 3 Bezier.  Keys
            that are plain angles have automatic handles.
        name: Name of the timeline.

    Raises:
        InvalidValueError: naming joint and key, for lists of different lengths, NaN, or times out of order.
    """
    if not len(names) == len(times) == len(keys):
        lengths = f"{len(names)} names, {len(times)} lists of times, {len(keys)} of keys"
        raise InvalidValueError(f"lists of {name}", lengths, "as many of each")
    curves = []
    for joint, at, values in zip(names, times, keys, strict=True):
        if not is_real_text(joint):
            raise InvalidValueError(f"joint of {name}", ascii(joint), "its name")
        if len(at) != len(values):
            raise InvalidValueError(
                f"lists of {joint}", f"{len(at)} times, {len(values)} keys", "as many of each"
            )
        curves.append(
            JointCurve(joint, tuple(_naoqi_key(joint, t, key) for t, key in zip(at, values, strict=True)))
        )
    return Timeline(name, tuple(curves))


def read_naoqi_export(path: PathName) -> Timeline:
    """Read a timeline from a Python script exported by Choregraphe; the script is not run.

    Such a script calls `names.append(...)`, `times.append(...)` and `keys.append(...)` once for each joint.

    Args:
        path: The script.

    Raises:
        FileFormatError: naming path, line and fault.
    """
    lists: dict[str, list[Any]] = {"names": [], "times": [], "keys": []}
    # Read line by line, since Python 3 cannot parse the script, which is Python 2.
    for at, line in enumerate(read_text(path).splitlines(), start=1):
        begun = _APPEND.match(line)
        if begun is None:
            continue
        name, rest = begun.groups()
        try:
            lists[name].append(ast.literal_eval(rest[: rest.rindex(")")].strip()))
        except (ValueError, TypeError, SyntaxError, RecursionError, MemoryError) as error:
            raise FileFormatError(path, f"{name}.append(...) has no plain values", at) from error
    if not lists["names"]:
        raise FileFormatError(path, "has no names.append(...), as Choregraphe exports it")
    try:
        return naoqi_timeline(lists["names"], lists["times"], lists["keys"], Path(path).stem)
    except (InvalidValueError, TypeError) as error:
        raise FileFormatError(path, str(error)) from error


def _naoqi_key(joint: str, time: Any, key: Any) -> Key:
    """Return a key from its list in the form of NAOqi."""
    what = f"key of {joint} at {shortened(time)} s"
    plain = not isinstance(key, (list, tuple))
    parts = [key] if plain else list(key)
    if len(parts) not in (1, 3) or not all(isinstance(p, (list, tuple)) and len(p) == 3 for p in parts[1:]):
        raise InvalidValueError(
            what, key, "an angle, or [angle, [kind, dTime, dAngle], [kind, dTime, dAngle]]"
        )
    handles = [Handle(), Handle()]
    for i, (kind, dtime, dangle) in enumerate(parts[1:]):
        if isinstance(kind, bool) or kind not in NAOQI_KINDS:
            raise InvalidValueError(what, f"kind {kind!r}", "a kind of 0, 1, 2 or 3")
        handles[i] = Handle(NAOQI_KINDS[kind], _finite(what, dtime), _finite(what, dangle))
    return Key(_finite(what, time), _finite(what, parts[0]), *handles)


def _finite(what: str, value: Any) -> float:
    return float(as_finite(value, what, ()))


def _project(path: PathName) -> tuple[Timeline, ...]:
    """Return the timelines of all behaviors of a project."""
    found: list[Timeline] = []
    read: dict[tuple[Path, str], list[Timeline]] = {}
    for folder, file in behaviors_of(path):
        if (file, folder) not in read:  # a project may name a file repeatedly
            read[file, folder] = list(_timelines(file, parse(file), (folder,)))
        found += read[file, folder]
    if not found:
        raise FileFormatError(path, "has no behavior with a timeline that moves a joint")
    return tuple(found)


def behaviors_of(path: PathName) -> tuple[tuple[str, Path], ...]:
    """Return the folder and file of each behavior in a project (.pml).

    Raises:
        FileFormatError: naming the line, for anything but a project, and for a missing behavior or one
            outside the project's folder.
    """
    root = parse(path)
    if root.tag != "Package":
        raise FileFormatError(path, f"is not a project: its root is {root.tag!r}", root.line)
    behaviors = [
        b for group in root.named("BehaviorDescriptions") for b in group.named("BehaviorDescription")
    ]
    if not behaviors:
        raise FileFormatError(path, "names no behavior", root.line)
    found = []
    for behavior in behaviors:
        folder, xar = (attribute(path, behavior, name) for name in ("src", "xar"))
        below = Path(folder) / xar
        if below.is_absolute() or ".." in below.parts:
            raise FileFormatError(path, f"names {str(below)!r}, outside its own folder", behavior.line)
        file = Path(path).parent / below
        try:
            read_bytes(file)
        except FileFormatError as error:
            raise FileFormatError(path, f"names a behavior: {error}", behavior.line) from error
        found.append((folder, file))
    return tuple(found)


def _timelines(path: PathName, element: Element, boxes: tuple[str, ...]) -> Iterator[Timeline]:
    """Yield the timelines below an element, named by the boxes around them."""
    if element.tag == "Box":
        boxes = (*boxes, element.attributes.get("name", "?"))
    if element.tag in ("Timeline", "Animation"):
        timeline = timeline_of(path, element, "/".join(boxes) or "Timeline")
        if timeline is not None:
            yield timeline
    for child in element.children:
        yield from _timelines(path, child, boxes)


def timeline_of(path: PathName, element: Element, name: str) -> Timeline | None:
    """Return the motion of a Timeline or Animation element, or None."""
    elements = [curve for group in element.named("ActuatorList") for curve in group.named("ActuatorCurve")]
    heard = [curve for curve in elements if curve.attributes.get("mute", "0") not in ("1", "true")]
    if not any(curve.named("Key") for curve in heard):
        return None
    fps = number(path, element, "fps")
    if fps <= 0:
        raise FileFormatError(path, f"fps is {fps:g}, expected a rate above 0", element.line)
    first = number(path, element, "start_frame", "1")
    curves = [_curve(path, curve, fps, first) for curve in heard]
    kept = tuple(curve for curve in curves if curve is not None)
    try:
        return Timeline(name, kept) if kept else None
    except InvalidValueError as error:
        raise FileFormatError(path, str(error), element.line) from error


def _curve(path: PathName, element: Element, fps: float, first: float) -> JointCurve | None:
    """Return the curve of a joint without keys before the first frame, or None."""
    joint = attribute(path, element, "actuator")
    usual = _SHARE if joint in HANDS else _DEGREE
    unit = int(number(path, element, "unit", str(usual)))
    if unit == _UNSTATED:
        unit = usual
    if unit not in (_DEGREE, _SHARE):
        raise FileFormatError(
            path, f"unit of {joint} is {unit}, expected 0 (degrees), 1 (share) or -1", element.line
        )
    scale = math.radians(1.0) if unit == _DEGREE else 1.0
    keys: list[Key] = []
    for child in element.named("Key"):
        frame = number(path, child, "frame")
        if frame < first:
            continue
        time = (frame - first) / fps
        if keys and time <= keys[-1].time:
            reason = f"frame {frame:g} of {joint} does not come after the key before"
            raise FileFormatError(path, reason, child.line)
        handles = _handles(path, child, fps, scale)
        try:
            keys.append(Key(time, scale * number(path, child, "value"), *handles))
        except InvalidValueError as error:
            raise FileFormatError(path, f"{joint}: {error}", child.line) from error
    return JointCurve(joint, tuple(keys)) if keys else None


def _handles(path: PathName, key: Element, fps: float, scale: float) -> tuple[Handle, Handle]:
    """Return the left and the right handle of a key."""
    found = {"left": Handle(), "right": Handle()}
    for tangent in key.named("Tangent"):
        side = attribute(path, tangent, "side")
        kind = attribute(path, tangent, "interpType")
        if side not in found:
            raise FileFormatError(path, f"side is {side!r}, expected left or right", tangent.line)
        if kind not in _XML_KINDS:
            known = ", ".join(_XML_KINDS)
            raise FileFormatError(path, f"interpType is {kind!r}, expected one of {known}", tangent.line)
        time = number(path, tangent, "abscissaParam", "0") / fps
        value = number(path, tangent, "ordinateParam", "0") * scale
        found[side] = Handle(_XML_KINDS[kind], time, value)
    return found["left"], found["right"]
