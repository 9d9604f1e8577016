"""Writing and reading of trajectories, in the format of the file's suffix."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pepper_kin.atomic_file import PathName
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.files.certified import refuse_unsafe
from pepper_kin.files.csv_file import read_csv, write_csv
from pepper_kin.files.json_file import read_json, write_json
from pepper_kin.files.mcap_file import read_mcap, write_mcap
from pepper_kin.files.naoqi_file import CYCLE, read_naoqi, write_naoqi
from pepper_kin.files.npz_file import read_npz, write_npz
from pepper_kin.files.ros_file import read_ros, write_ros
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.trajectory import Trajectory, checked_trajectory


class _Format(NamedTuple):
    suffixes: tuple[str, ...]
    write: Callable[..., Path]
    read: Callable[[PathName, PepperModel | None], Trajectory]
    step: float | None  # default time between samples [s]; None where the file is exact


FORMATS: dict[str, _Format] = {
    "csv": _Format((".csv",), write_csv, read_csv, 0.01),
    "npz": _Format((".npz",), write_npz, read_npz, None),
    "json": _Format((".json",), write_json, read_json, None),
    "ros": _Format((".yaml", ".yml"), write_ros, read_ros, 0.01),
    "naoqi": _Format((".py",), write_naoqi, read_naoqi, 2 * CYCLE),
    "mcap": _Format((".mcap",), write_mcap, read_mcap, 0.01),
}
"""Format -> suffixes, writer, reader and step."""


PLAYED = ("ros", "naoqi")
"""Formats that robots play, whose motions are checked before they are written."""


def save(
    trajectory: Trajectory,
    path: PathName,
    *,
    format: str | None = None,
    dt: float | None = None,
    pepper: PepperModel | None = None,
    scene: Any | None = None,
    payload: Mapping[str, float] | None = None,
    unchecked: bool = False,
) -> Path:
    """Write a trajectory to a file, whole or not at all.

    "npz" and "json" hold the polynomials and are exact; the others hold samples, which read back the same at
    the samples' times.  "ros" and "naoqi" are what robots play: a motion that fails
    `pepper_kin.trajectory.check` is refused there.

    Args:
        trajectory: The trajectory.
        path: The file; its folder must exist.
        format: "csv", "npz", "json", "ros" (YAML for `ros2 topic pub`), "naoqi" (a Python script for the
            robot) or "mcap"; by the suffix (.csv, .npz, .json, .yaml, .py, .mcap) if omitted.
        dt: Time between samples [s]; 0.01, for "naoqi" 0.04, if omitted.  Without meaning where exact.
        pepper: The robot that a motion for "ros" or "naoqi" is checked with; if omitted, Pepper, where the
            joints are its own.
        scene: What the check looks at around the robot; None for nothing.
        payload: Point masses that the check counts with, by hand or frame [kg].
        unchecked: Whether to write "ros" and "naoqi" without a check.

    Returns:
        The path.

    Raises:
        UnknownNameError: for an unknown format or suffix.
        InvalidValueError: for a dt that is not above zero, or joints that the format cannot hold; for "ros"
            and "naoqi" also for a motion that fails its certificate, with what fails, or a robot that is not
            known.
        MissingDependencyError: for "mcap" without its package.
        FileFormatError: where the file cannot be written.
    """
    checked_trajectory(trajectory)
    chosen = _chosen(path, format)
    if any(chosen is FORMATS[name] for name in PLAYED):
        refuse_unsafe(trajectory, pepper, scene, payload, unchecked)
    if chosen.step is None:
        return chosen.write(path, trajectory)
    return chosen.write(path, trajectory, chosen.step if dt is None else dt)


def load(path: PathName, pepper: PepperModel | None = None, *, format: str | None = None) -> Trajectory:
    """Read a trajectory that `save` wrote.

    Args:
        path: The file.
        pepper: The robot whose joints the file must have, in its order; any joints if omitted.
        format: As for `save`; by the suffix if omitted.

    Returns:
        The trajectory.

    Raises:
        UnknownNameError: for an unknown format or suffix.
        MissingDependencyError: for "mcap" without its package.
        FileFormatError: naming path, line and what is wrong: truncated, another order of joints, NaN, times
            that do not rise, or no such file at all.
    """
    return _chosen(path, format).read(path, pepper)


def _chosen(path: PathName, format: str | None) -> _Format:
    if format is not None:
        if format not in FORMATS:
            raise UnknownNameError("format", format, FORMATS)
        return FORMATS[format]
    suffix = Path(path).suffix.lower()
    for known in FORMATS.values():
        if suffix in known.suffixes:
            return known
    raise UnknownNameError("suffix", suffix, (s for f in FORMATS.values() for s in f.suffixes))
