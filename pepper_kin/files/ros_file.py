"""Trajectories as `trajectory_msgs/JointTrajectory` of ROS, in the YAML that `ros2 topic pub` takes."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import FileFormatError, shortened
from pepper_kin.file_access import atomic_file
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.reading import plain_whole, read_text
from pepper_kin.files.certified import Conditions, certified_points, examination
from pepper_kin.files.motion_points import NANOSECONDS, MotionPoints
from pepper_kin.files.sampled_motion import (
    check_joint_names,
    check_times,
    points_of_file,
    units_for,
)
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.trajectory import Trajectory

STEP = 0.01
"""Time between points that is tried first without dt [s]."""

_FIELDS = {"header", "joint_names", "points"}
_LISTS = ("positions", "velocities", "accelerations", "effort")
_POINT = {*_LISTS, "time_from_start"}
_NUMBER = re.compile(r"[+-]?(\d+|(\d+\.\d*|\.\d+)([eE][+-]\d+)?)", re.ASCII)  # numbers of YAML 1.1
_DEEPEST = 16  # maximum depth of nested lists and mappings; a trajectory has five levels
_TOO_DEEP = f"is not a JointTrajectory: nested more than {_DEEPEST} deep"
_MOST_NODES = 3_000_000  # maximum number of nodes after expansion of aliases, which could exceed the memory


def ros_points(
    trajectory: Trajectory,
    dt: float | None = None,
    *,
    pepper: PepperModel | None = None,
    unchecked: bool = False,
    **conditions: Unpack[Conditions],
) -> MotionPoints:
    """Return the points of a JointTrajectory whose curve in ros2_control passes its certificate.

    Args:
        trajectory: The trajectory.
        dt: Time between points [s]; if omitted, chosen so that the curve passes, as in `save`.
        pepper: The robot of the check, see `save`.
        unchecked: Whether to skip the check.
        conditions: Options of `pepper_kin.trajectory.check`, such as `scene` and `payload`.

    Returns:
        The points; without accelerations for a motion whose acceleration jumps.

    Raises:
        InvalidValueError: for a dt that is not above zero, or a curve that fails its certificate.
    """
    examined = examination(trajectory, pepper, unchecked, conditions)
    return certified_points(trajectory, STEP, dt, examined)


def write_ros(path: PathName, points: MotionPoints) -> Path:
    """Write a motion as YAML of `trajectory_msgs/msg/JointTrajectory`.

    Publish it with
        ros2 topic pub --once TOPIC trajectory_msgs/msg/JointTrajectory "$(cat FILE)"

    Args:
        path: The file; its folder must exist.
        points: The motion at discrete times.

    Raises:
        FileFormatError: if the file cannot be written.
    """
    lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''", "joint_names:"]
    lines += [f"- {_text(name)}" for name in points.joint_names]
    lines.append("points:")
    for i, stamp in enumerate(points.stamps.tolist()):
        seconds, nanoseconds = divmod(stamp, NANOSECONDS)
        lines += [
            f"- positions: {_floats(points.position[i])}",
            f"  velocities: {_floats(points.velocity[i])}",
            f"  accelerations: {'[]' if points.acceleration is None else _floats(points.acceleration[i])}",
            "  effort: []",
            f"  time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}",
        ]
    return atomic_file.write_text(path, "\n".join(lines) + "\n")


def _text(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"


def _floats(values: Array) -> str:
    """Return numbers, shape (n,), as a YAML list; YAML 1.1 reads 1e-05 as a text, 1.0e-05 as a number."""
    return "[" + ", ".join(_float(value) for value in values.tolist()) + "]"


def _float(value: float) -> str:
    digits = repr(value)
    return digits if "." in digits else digits.replace("e", ".0e")


def read_ros(path: PathName, pepper: PepperModel | None = None) -> Trajectory:
    """Read a trajectory from YAML of `trajectory_msgs/msg/JointTrajectory`.

    All points may lack accelerations (giving cubic segments) or also velocities (giving a cubic spline from
    rest to rest); the first is at time 0.

    Args:
        path: The file.
        pepper: The robot whose joints the file must have, in its order; any joints, in radians, if omitted.

    Raises:
        FileFormatError: naming path, line and fault.
    """
    import yaml

    text = read_text(path)
    if not text.endswith("\n"):
        raise FileFormatError(
            path, "is truncated: its last line does not end with a newline", text.count("\n") + 1
        )
    try:
        root = _document(path, text)
    except yaml.MarkedYAMLError as error:
        line = None if error.problem_mark is None else error.problem_mark.line + 1
        if "nesting depth" in str(error.problem):  # limit of the parser, since PyYAML 6.0.4
            raise FileFormatError(path, _TOO_DEEP, line) from error
        raise FileFormatError(path, f"is not complete YAML: {error.problem}", line) from error
    except yaml.YAMLError as error:
        raise FileFormatError(path, f"is not YAML: {error}") from error
    message = _YamlReader(path).mapping(root, _FIELDS, {"joint_names", "points"}, "JointTrajectory")
    return _trajectory(_YamlReader(path), message, pepper)


class _Node(NamedTuple):
    """A part of a YAML document.

    Attributes:
        kind: "mapping", "sequence" or "scalar".
        value: Pairs of nodes, nodes, or a text.
        line: Line where the node begins, counted from 1.
        plain: Whether the node is a scalar without quotes and tag, such as a number.
    """

    kind: str
    value: Any
    line: int
    plain: bool = False


def _document(path: PathName, text: str) -> _Node | None:
    """Return the only document of a YAML text; None for an empty text.

    Nodes are built from events: PyYAML's own nodes resolve types and end marks, which takes three times as
    long, and libyaml's composer overflows the stack for deeply nested documents.

    Raises:
        FileFormatError: naming the line, for deep nesting, more than one document, and aliases that are
            undefined or expand to too many nodes.
        yaml.YAMLError: for malformed YAML.
    """
    import yaml

    roots: list[_Node] = []
    open_nodes: list[tuple[_Node, str | None, int]] = []
    anchored: dict[str, tuple[_Node, int]] = {}  # node and number of nodes of each anchor
    count = 0
    for event in yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
        if isinstance(event, yaml.CollectionEndEvent):
            node, anchor, before = open_nodes.pop()
            if anchor is not None:
                anchored[anchor] = node, count - before
            continue
        if not isinstance(event, yaml.NodeEvent):
            continue
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            node, size = anchored.get(event.anchor, (_Node("", None, line), 0))
            count += size
            if not size or count > _MOST_NODES:
                what = f"more than {_MOST_NODES} values, with others" if size else "nothing before it"
                raise FileFormatError(path, f"holds {shortened(event.anchor)!r}, an alias of {what}", line)
        elif isinstance(event, yaml.ScalarEvent):
            count += 1
            node = _Node("scalar", event.value, line, event.style in (None, "") and event.tag is None)
            if event.anchor is not None:
                anchored[event.anchor] = node, 1
        else:
            node = _Node("mapping" if isinstance(event, yaml.MappingStartEvent) else "sequence", [], line)
        (open_nodes[-1][0].value if open_nodes else roots).append(node)
        if isinstance(event, yaml.CollectionStartEvent):
            open_nodes.append((node, event.anchor, count))
            count += 1
            if len(open_nodes) > _DEEPEST:
                raise FileFormatError(path, _TOO_DEEP, line)
    others = [
        node for node in roots[1:] if node.kind != "scalar" or node.value
    ]  # `ros2 topic echo` ends in ---
    if others:
        raise FileFormatError(path, "holds more than one document", others[0].line)
    return roots[0] if roots else None


def _trajectory(read: _YamlReader, message: dict[str, _Node], pepper: PepperModel | None) -> Trajectory:
    """Return the trajectory of a JointTrajectory message."""
    names_node = message["joint_names"]
    texts = [node.value if node.kind == "scalar" else None for node in read.items(names_node, "joint_names")]
    names = check_joint_names(read.path, texts, pepper, names_node.line)
    nodes = read.items(message["points"], "points")
    points = [read.mapping(node, _POINT, {"positions", "time_from_start"}, "point") for node in nodes]
    time = np.array([read.duration(point["time_from_start"]) for point in points]) / NANOSECONDS
    check_times(read.path, time, lambda i: (nodes[i] if nodes else message["points"]).line)
    found: dict[str, Array | None] = {}
    for name in _LISTS[:3]:
        rows = [read.numbers(point[name], name) if name in point else [] for point in points]
        found[name] = _table(read, name, rows, nodes, len(names))
    if found["positions"] is None:
        raise FileFormatError(read.path, "points have no positions", nodes[0].line)
    if found["velocities"] is None and found["accelerations"] is not None:
        raise FileFormatError(read.path, "points have accelerations but no velocities", nodes[0].line)
    units = units_for(names, pepper)
    values = (found["positions"], found["velocities"], found["accelerations"])
    return points_of_file(read.path, names, units, time, *values)


def _table(read: _YamlReader, name: str, rows: list[list[float]], nodes: list[_Node], n: int) -> Array | None:
    """Return the values of all points, shape (T, n); None if no point has any."""
    if not any(rows):
        return None
    for row, node in zip(rows, nodes, strict=True):
        if len(row) != n:
            raise FileFormatError(read.path, f"{len(row)} {name} for {n} joints", node.line)
    return np.array(rows)


class _YamlReader:
    """Reader of YAML nodes that reports the line of an error."""

    def __init__(self, path: PathName) -> None:
        self.path = path

    def fail(self, node: _Node | None, reason: str) -> FileFormatError:
        """Return the error that names the node's line."""
        return FileFormatError(self.path, reason, None if node is None else node.line)

    def mapping(self, node: _Node | None, known: set[str], needed: set[str], what: str) -> dict[str, _Node]:
        """Return the nodes of a mapping by field."""
        if node is None or node.kind != "mapping":
            raise self.fail(node, f"is not a {what}: expected fields {', '.join(sorted(needed))}")
        found: dict[str, _Node] = {}
        for key, value in zip(node.value[::2], node.value[1::2], strict=True):
            name = key.value if key.kind == "scalar" else f"a {key.kind}"
            if name not in known:
                raise self.fail(
                    key, f"unknown field {shortened(name)!r} of {what}, expected {', '.join(sorted(known))}"
                )
            if name in found:
                raise self.fail(key, f"field {name!r} of {what} occurs twice")
            found[name] = value
        if len(found) < len(needed) or needed - found.keys():
            raise self.fail(node, f"field {min(needed - found.keys())!r} of {what} is missing")
        return found

    def items(self, node: _Node, what: str) -> list[_Node]:
        """Return the nodes of a sequence."""
        if node.kind != "sequence":
            raise self.fail(node, f"{what} is not a list")
        nodes: list[_Node] = node.value
        return nodes

    def numbers(self, node: _Node, what: str) -> list[float]:
        """Return the finite numbers of a sequence."""
        return [self._number(item, what) for item in self.items(node, what)]

    def _number(self, node: _Node, what: str) -> float:
        """Return the finite number of a scalar node."""
        if node.plain and _NUMBER.fullmatch(node.value):
            value = float(node.value)
            if math.isfinite(value):
                return value
        found = shortened(repr(node.value)) if node.kind == "scalar" else f"a {node.kind}"
        raise self.fail(node, f"{what} has {found}, expected a finite number")

    def duration(self, node: _Node) -> int:
        """Return a duration [ns]."""
        fields = self.mapping(node, {"sec", "nanosec"}, {"sec", "nanosec"}, "time_from_start")
        total = 0
        for name, factor in (("sec", NANOSECONDS), ("nanosec", 1)):
            digits = str(fields[name].value)
            number = plain_whole(digits)
            if number is None or not 0 <= number * factor < 2**61:
                reason = f"{name} is {shortened(repr(digits))}, expected a whole number of 0 or more"
                raise self.fail(fields[name], reason)
            total += number * factor
        return total
