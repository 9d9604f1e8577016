"""Trajectories as arguments of NAOqi's `angleInterpolationBezier`, and as a script for the robot."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np

from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.file_access import atomic_file
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.reading import read_text
from pepper_kin.files.certified import Conditions, certified_points, examination
from pepper_kin.files.motion_points import MotionPoints
from pepper_kin.files.sampled_motion import check_joint_names, check_times, points_of_file
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.trajectory.trajectory import Trajectory

STEP = 0.04
"""Time between keys that is tried first [s]: twice the cycle of NAOqi."""

_TOKEN = re.compile(r"[\w.]+|[^\w\s.]")
_MOST_TOKENS = 2_000_000  # a million numbers; the syntax tree takes up to 0.5 kB for each
_LISTS = ("NAMES", "START", "TIMES", "ANGLES", "VELOCITIES")
_SCRIPT = '''# -*- coding: utf-8 -*-
"""A motion for NAOqi, of {duration:.3f} s: python THIS_FILE --ip ROBOT

Needs the `qi` package of the robot's SDK.  The robot first goes to START slowly.
"""

# Joints, and where each begins [rad].
NAMES = {names}
START = {start}
# When the joints have their keys [s], and for each joint its angles [rad] and velocities [rad/s] there.
TIMES = {times}
ANGLES = [
{angles}
]
VELOCITIES = [
{velocities}
]


def keys(angles, velocities):
    """Return the keys of a joint, with handles of a third of the time between two keys."""
    before = [(b - a) / 3.0 for a, b in zip([0.0] + TIMES, TIMES)]
    behind = before[1:] + [0.0]
    rows = zip(angles, velocities, before, behind)
    return [[q, [3, -b, -b * v], [3, f, f * v]] for q, v, b, f in rows]


def run(motion):
    """Make the motion with an ALMotion service; returns when it is done."""
    motion.angleInterpolationWithSpeed(NAMES, START, 0.1)
    curves = [keys(a, v) for a, v in zip(ANGLES, VELOCITIES)]
    motion.angleInterpolationBezier(NAMES, [TIMES] * len(NAMES), curves)


if __name__ == "__main__":
    import argparse

    import qi

    parser = argparse.ArgumentParser()
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    options = parser.parse_args()
    session = qi.Session()
    session.connect("tcp://{{}}:{{}}".format(options.ip, options.port))
    run(session.service("ALMotion"))
'''


class NaoqiArguments(NamedTuple):
    """Arguments of `ALMotion.angleInterpolationBezier(names, times, keys)`, and the start position.

    Attributes:
        names: Names of the joints.
        times: Times of each joint's keys [s], above 0.
        keys: Keys of each joint, [angle, [3, dTime, dAngle], [3, dTime, dAngle]], with the handles before and
            behind the key [rad, s], a third of the time to the next key long: cubics in time.
        start: Position of each joint at time 0 [rad], at rest.
    """

    names: list[str]
    times: list[list[float]]
    keys: list[list[list[Any]]]
    start: list[float]


def naoqi_arguments(
    trajectory: Trajectory,
    dt: float | None = None,
    *,
    pepper: PepperModel | None = None,
    unchecked: bool = False,
    **conditions: Unpack[Conditions],
) -> NaoqiArguments:
    """Return a trajectory as plain lists for NAOqi whose executed curve passes its certificate.

    Args:
        trajectory: A trajectory of revolute joints that begins at rest; NAOqi moves its base by other
            functions.
        dt: Time between keys [s]; if omitted, chosen so that the curve passes, as in `save`.
        pepper: The robot of the check, see `save`.
        unchecked: Whether to skip the check.
        conditions: Options of `pepper_kin.trajectory.check`, such as `scene` and `payload`.

    Returns:
        The lists; the position at time 0 is separate, because NAOqi takes only times above 0.

    Raises:
        InvalidValueError: for a joint in meters, a dt that is not above zero, or a curve that fails its
            certificate.
    """
    check_turning(trajectory)
    examined = examination(trajectory, pepper, unchecked, conditions)
    return naoqi_keys(certified_points(trajectory, STEP, dt, examined, bezier=True))


def naoqi_keys(points: MotionPoints) -> NaoqiArguments:
    """Return the keys of a motion from rest."""
    third = np.diff(points.time) / 3.0
    before, behind = third.tolist(), [*third[1:].tolist(), 0.0]
    handles = list(zip(before, behind, strict=True))
    keys = [
        [[q, [3, -b, -b * v], [3, f, f * v]] for q, v, (b, f) in zip(angles, speeds, handles, strict=True)]
        for angles, speeds in zip(points.position[1:].T.tolist(), points.velocity[1:].T.tolist(), strict=True)
    ]
    times = points.time[1:].tolist()
    names = list(points.joint_names)
    return NaoqiArguments(names, [list(times) for _ in names], keys, points.position[0].tolist())


def check_turning(trajectory: Trajectory) -> None:
    """Refuse joints that `angleInterpolationBezier` does not move.

    Raises:
        InvalidValueError: naming the joints in meters.
    """
    sliding = [n for n, u in zip(trajectory.joint_names, trajectory.joint_units, strict=True) if u != "rad"]
    if sliding:
        raise InvalidValueError(
            "trajectory",
            f"joints in meters: {', '.join(sliding)}",
            "joints that angleInterpolationBezier supports",
        )


def write_naoqi(path: PathName, points: MotionPoints) -> Path:
    """Write a Python script that makes the motion on a robot with NAOqi.

    Args:
        path: The script; its folder must exist.
        points: A motion of revolute joints from rest.

    Raises:
        FileFormatError: if the file cannot be written.
    """
    text = _SCRIPT.format(
        duration=points.time[-1],
        names=repr(list(points.joint_names)),
        start=repr(points.position[0].tolist()),
        times=repr(points.time[1:].tolist()),
        angles="\n".join(f"    {row!r}," for row in points.position[1:].T.tolist()),
        velocities="\n".join(f"    {row!r}," for row in points.velocity[1:].T.tolist()),
    )
    return atomic_file.write_text(path, text)


def read_naoqi(path: PathName, pepper: PepperModel | None = None) -> Trajectory:
    """Read the motion of a script that `write_naoqi` wrote; the script is not run.

    The motion begins at rest at START and follows the cubics that the handles of the keys define.

    Args:
        path: The script.
        pepper: The robot whose joints the file must have, in its order; any joints if omitted.

    Raises:
        FileFormatError: naming path, line and fault.
    """
    lists = _lists(path)
    names_node, start_node, times_node, angles_node, speeds_node = (lists[name] for name in _LISTS)
    names = check_joint_names(path, _literals(path, names_node, "NAMES"), pepper, names_node.lineno)
    start = _numbers(path, start_node, "START")
    if len(start) != len(names):
        raise FileFormatError(
            path, f"START has {len(start)} values for {len(names)} joints", start_node.lineno
        )
    time = np.array([0.0, *_numbers(path, times_node, "TIMES")])
    check_times(path, time, lambda _: int(times_node.lineno))
    tables = []
    for what, node in (("ANGLES", angles_node), ("VELOCITIES", speeds_node)):
        rows = [
            (name, row, _numbers(path, row, f"{what} of {name}")) for name, row in _rows(path, names, node)
        ]
        for name, row, values in rows:
            if len(values) != time.size - 1:
                reason = f"{name} has {len(values)} {what.lower()} and {time.size - 1} times"
                raise FileFormatError(path, reason, row.lineno)
        tables.append(np.array([values for _, _, values in rows]).T)
    position, velocity = np.vstack([start, tables[0]]), np.vstack([np.zeros(len(names)), tables[1]])
    return points_of_file(path, names, ("rad",) * len(names), time, position, velocity)


def _lists(path: PathName) -> dict[str, Any]:
    """Return the syntax trees of the lists named in `_LISTS`."""
    text = read_text(path)
    if (size := sum(1 for _ in _TOKEN.finditer(text))) > _MOST_TOKENS:
        raise FileFormatError(path, f"holds {size} words and signs, at most {_MOST_TOKENS} are read")
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        reason = str(error) or "its parts are nested too deep"
        raise FileFormatError(path, f"is not a complete Python script: {reason}", line) from error
    found: dict[str, Any] = {}
    for statement in tree.body:
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            name = statement.targets[0].id
            if name in found:
                raise FileFormatError(path, f"{name} occurs twice", statement.lineno)
            if name in _LISTS:
                if not isinstance(statement.value, ast.List):
                    raise FileFormatError(path, f"{name} is not a list", statement.lineno)
                found[name] = statement.value
    missing = [name for name in _LISTS if name not in found]
    if missing:
        raise FileFormatError(path, f"has no list {missing[0]}, expected {', '.join(_LISTS)}")
    return found


def _rows(path: PathName, names: tuple[str, ...], node: Any) -> list[tuple[str, Any]]:
    """Return (joint, syntax tree) of the rows of a list of lists."""
    if len(node.elts) != len(names):
        raise FileFormatError(path, f"{len(node.elts)} lists for {len(names)} joints", node.lineno)
    return list(zip(names, node.elts, strict=True))


def _literals(path: PathName, node: Any, what: str) -> list[Any]:
    """Return the values of a list of literals."""
    try:
        values = ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError, RecursionError) as error:
        raise FileFormatError(path, f"{what} is not a list of plain values", node.lineno) from error
    if not isinstance(values, list):
        raise FileFormatError(path, f"{what} is not a list", node.lineno)
    return values


def _numbers(path: PathName, node: Any, what: str) -> list[float]:
    """Return the finite numbers of a list of literals."""
    values = _literals(path, node, what)
    try:
        return as_finite(values, what, (None,)).tolist()
    except InvalidValueError as error:
        raise FileFormatError(path, str(error), node.lineno) from error
