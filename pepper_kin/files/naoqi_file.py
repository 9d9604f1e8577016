"""Trajectories as arguments of NAOqi's `ALMotion.angleInterpolation`, and as a script for the robot."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pepper_kin import atomic_file
from pepper_kin.atomic_file import PathName
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.file_reading import read_text
from pepper_kin.files.certified import refuse_unsafe
from pepper_kin.files.sampled_motion import check_joint_names, check_times, points_of_file
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.trajectory.trajectory import Trajectory

CYCLE = 0.02
"""[s] NAOqi commands its joints once a cycle."""

_TOKEN = re.compile(r"[\w.]+|[^\w\s.]")
_MOST_TOKENS = 2_000_000  # a million numbers; the syntax tree takes up to 0.5 kB for each
_LISTS = ("NAMES", "START", "ANGLES", "TIMES")
_SCRIPT = '''# -*- coding: utf-8 -*-
"""A motion for NAOqi, of {duration:.3f} s: python THIS_FILE --ip ROBOT

Needs the `qi` package of the robot's SDK.  The robot first goes to START slowly.
"""

# Joints, and where each begins [rad].
NAMES = {names}
START = {start}
# For each joint its positions [rad], and when it has them [s], after the start.
ANGLES = [
{angles}
]
TIMES = [
{times}
]


def run(motion):
    """Make the motion with an ALMotion service; returns when it is done."""
    motion.angleInterpolationWithSpeed(NAMES, START, 0.1)
    motion.angleInterpolation(NAMES, ANGLES, TIMES, True)


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
    """Arguments of `ALMotion.angleInterpolation(names, angles, times, True)`, and the pose before it.

    Attributes:
        names: Joints.
        angles: Positions of each joint [rad].
        times: When each joint has them [s], above 0.
        start: Position of each joint at time 0 [rad].
    """

    names: list[str]
    angles: list[list[float]]
    times: list[list[float]]
    start: list[float]


def naoqi_arguments(
    trajectory: Trajectory,
    dt: float = 2 * CYCLE,
    *,
    pepper: PepperModel | None = None,
    scene: Any | None = None,
    payload: Mapping[str, float] | None = None,
    unchecked: bool = False,
) -> NaoqiArguments:
    """Return a trajectory, sampled, as plain lists for NAOqi.

    Args:
        trajectory: The trajectory; its joints must turn, since NAOqi moves its base otherwise.
        dt: Time between positions [s].
        pepper: The robot that the motion is checked with, as in `save`, like the next ones.
        scene: What the check looks at around the robot.
        payload: Point masses that the check counts with, by hand or frame [kg].
        unchecked: Whether to leave the check out.

    Returns:
        The lists; the position at time 0 is apart, because NAOqi takes only times above 0.

    Raises:
        InvalidValueError: for a joint in meters, a dt that is not above zero, or a motion that fails its
            certificate.
    """
    arguments = _arguments(trajectory, dt)
    refuse_unsafe(trajectory, pepper, scene, payload, unchecked)
    return arguments


def _arguments(trajectory: Trajectory, dt: float) -> NaoqiArguments:
    sliding = [n for n, u in zip(trajectory.joint_names, trajectory.joint_units, strict=True) if u != "rad"]
    if sliding:
        raise InvalidValueError(
            "trajectory", f"joints in meters: {', '.join(sliding)}", "joints that angleInterpolation supports"
        )
    samples = trajectory.sample(dt)
    times = samples.time[1:].tolist()
    return NaoqiArguments(
        list(trajectory.joint_names),
        samples.position[1:].T.tolist(),
        [list(times) for _ in trajectory.joint_names],
        samples.position[0].tolist(),
    )


def write_naoqi(path: PathName, trajectory: Trajectory, dt: float = 2 * CYCLE) -> Path:
    """Write a Python script that makes the motion on a robot with NAOqi.

    Args:
        path: The script; its folder must exist.
        trajectory: The trajectory.
        dt: Time between positions [s].

    Raises:
        InvalidValueError: for a joint in meters, or a dt that is not above zero.
        FileFormatError: where the file cannot be written.
    """
    names, angles, times, start = _arguments(trajectory, dt)
    text = _SCRIPT.format(
        duration=trajectory.duration,
        names=repr(names),
        start=repr(start),
        angles="\n".join(f"    {row!r}," for row in angles),
        times="\n".join(f"    {row!r}," for row in times),
    )
    return atomic_file.write_text(path, text)


def read_naoqi(path: PathName, pepper: PepperModel | None = None) -> Trajectory:
    """Read the motion of a script that `write_naoqi` wrote; the script is not run.

    NAOqi gets positions only: between them the trajectory is the cubic spline from rest to rest.

    Args:
        path: The script.
        pepper: The robot whose joints the file must have, in its order; any joints if omitted.

    Raises:
        FileFormatError: naming path and line and what is wrong there.
    """
    lists = _lists(path)
    names_node, start_node, angles_node, times_node = (lists[name] for name in _LISTS)
    names = check_joint_names(path, _literals(path, names_node, "NAMES"), pepper, names_node.lineno)
    start = _numbers(path, start_node, "START")
    angles = [_numbers(path, node, f"ANGLES of {name}") for name, node in _rows(path, names, angles_node)]
    times = [_numbers(path, node, f"TIMES of {name}") for name, node in _rows(path, names, times_node)]
    if len(start) != len(names):
        raise FileFormatError(
            path, f"START has {len(start)} values for {len(names)} joints", start_node.lineno
        )
    for i, name in enumerate(names):
        if len(angles[i]) != len(times[i]):
            reason = f"{name} has {len(angles[i])} angles and {len(times[i])} times"
            raise FileFormatError(path, reason, angles_node.elts[i].lineno)
        if times[i] != times[0]:
            raise FileFormatError(path, f"{name} has other times than {names[0]}", times_node.elts[i].lineno)
    time = np.array([0.0, *times[0]])
    check_times(path, time, lambda _: int(times_node.elts[0].lineno))
    position = np.vstack([start, np.array(angles).T])
    return points_of_file(path, names, ("rad",) * len(names), time, position)


def _lists(path: PathName) -> dict[str, Any]:
    """Return the syntax trees of the four lists."""
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
    if len(node.elts) != len(names):
        raise FileFormatError(path, f"{len(node.elts)} lists for {len(names)} joints", node.lineno)
    return list(zip(names, node.elts, strict=True))


def _literals(path: PathName, node: Any, what: str) -> list[Any]:
    try:
        values = ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError, RecursionError) as error:
        raise FileFormatError(path, f"{what} is not a list of plain values", node.lineno) from error
    if not isinstance(values, list):
        raise FileFormatError(path, f"{what} is not a list", node.lineno)
    return values


def _numbers(path: PathName, node: Any, what: str) -> list[float]:
    values = _literals(path, node, what)
    try:
        return as_finite(values, what, (None,)).tolist()
    except InvalidValueError as error:
        raise FileFormatError(path, str(error), node.lineno) from error
