"""Writing and reading of trajectories in the format of the file's suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Unpack

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.files.certified import Conditions, certified_points, examination
from pepper_kin.files.csv_file import read_csv, write_csv
from pepper_kin.files.joint_states import recording_suffix
from pepper_kin.files.json_file import read_json, write_json
from pepper_kin.files.naoqi_file import STEP as NAOQI_STEP
from pepper_kin.files.naoqi_file import check_turning, read_naoqi, write_naoqi
from pepper_kin.files.npz_file import read_npz, write_npz
from pepper_kin.files.ros_file import STEP, read_ros, write_ros
from pepper_kin.model import PepperModel
from pepper_kin.plugins import plugins
from pepper_kin.trajectory.trajectory import Trajectory


class _Format(NamedTuple):
    """Suffixes, writer, reader and properties of a format."""

    suffixes: tuple[str, ...]
    write: Callable[..., Path]
    read: Callable[[PathName, PepperModel | None], Trajectory]
    step: float | None = STEP  # time between points that is tried first [s]; None for exact formats
    played: bool = False  # whether robots play the file, so that a robot must be known
    bezier: bool = False  # whether NAOqi interpolates the points


FORMATS: dict[str, _Format] = {
    "csv": _Format((".csv",), write_csv, read_csv),
    "parquet": _Format((".parquet",), write_csv, read_csv),
    "npz": _Format((".npz",), write_npz, read_npz, None),
    "json": _Format((".json",), write_json, read_json, None),
    "ros": _Format((".yaml", ".yml"), write_ros, read_ros, played=True),
    "naoqi": _Format((".py",), write_naoqi, read_naoqi, NAOQI_STEP, played=True, bezier=True),
}
"""Format by name; interfaces register further formats, such as "mcap"."""


def save(
    trajectory: Trajectory,
    path: PathName,
    *,
    format: str | None = None,
    dt: float | None = None,
    pepper: PepperModel | None = None,
    unchecked: bool = False,
    **conditions: Unpack[Conditions],
) -> Path:
    """Write a trajectory to a file atomically, after a check that the file's motion passes its certificate.

    "npz" and "json" store the polynomials and are exact. Other formats store points, between which `load`,
    ros2_control's controllers and NAOqi interpolate by polynomials of degree 5 if the points have
    accelerations, else of degree 3. `pepper_kin.trajectory.check` checks this curve with the robot, the scene
    and the other conditions; a curve that fails is not written.

    Without `dt` the points are chosen so that the curve passes: every 0.01 s, for "naoqi" 0.04 s, if that
    passes; else at jumps of acceleration and between them as dense as needed. A motion that uses a limit
    fully is then slowed by up to 0.01 %, since no interpolated curve keeps the limit exactly.

    Args:
        trajectory: The trajectory.
        path: The file; its folder must exist.
        format: "csv", "parquet", "npz", "json", "ros" (YAML for `ros2 topic pub`), "naoqi" (a Python script
            for the robot, which takes motions from rest) or "mcap"; by the suffix (.csv, .parquet, .npz,
            .json, .yaml, .py, .mcap) if omitted.
        dt: Time between points [s]; not used by exact formats.
        pepper: The robot of the check; if omitted, Pepper, for motions of its joints. A motion of an unknown
            robot is written without a check, and not to "ros" and "naoqi" files, which robots play.
        unchecked: Whether to skip the check.
        conditions: Options of `pepper_kin.trajectory.check`: `scene`, `payload`, `balance`, `hand_speed`,
            `jerk`, `collisions`.  They should be the options with which the motion was planned and timed.

    Returns:
        The path.

    Raises:
        UnknownNameError: for an unknown format or suffix.
        InvalidValueError: for a dt that is not above zero, or joints that the format cannot hold; for a
            motion that fails its certificate, with the failed checks, amounts and times; for a dt whose curve
            fails, with the largest dt that passes; or for an unknown robot.
        MissingDependencyError: for "mcap" or "parquet" without its package.
        FileFormatError: if the file cannot be written.
    """
    chosen = _chosen(path, format)
    examined = examination(trajectory, pepper, unchecked, conditions, needed=chosen.played)
    if chosen.step is None:
        if examined is not None:
            examined.refuse(trajectory, ", or unchecked=True")
        return chosen.write(path, trajectory)
    if chosen.bezier:
        check_turning(trajectory)
    return chosen.write(path, certified_points(trajectory, chosen.step, dt, examined, chosen.bezier))


def load(path: PathName, *, pepper: PepperModel | None = None, format: str | None = None) -> Trajectory:
    """Read a trajectory that `save` wrote.

    Args:
        path: The file; for a recording also a .db3 file, or the folder of a bag.
        pepper: The robot whose joints the file must have, in its order; any joints if omitted.
        format: Name of the format, see `save`; by the suffix if omitted.

    Returns:
        The trajectory.

    Raises:
        UnknownNameError: for an unknown format or suffix.
        MissingDependencyError: for "mcap" or "parquet" without its package.
        FileFormatError: naming path, line and fault: truncated, another order of joints, NaN, times that do
            not increase, or a missing file.
    """
    if format is None and recording_suffix(path) == ".mcap" and "mcap" in plugins("formats"):
        format = "mcap"
    return _chosen(path, format).read(path, pepper)


def _chosen(path: PathName, format: str | None) -> _Format:
    """Return the format of a name, or of a path's suffix."""
    suffix = Path(path).suffix.lower()
    for name, known in FORMATS.items():
        if name == format or (format is None and suffix in known.suffixes):
            if name in ("csv", "parquet") and (suffix == ".parquet") != (name == "parquet"):
                raise InvalidValueError("path", str(path), "a file .parquet for that format, and no other")
            return known
    registered = plugins("formats")
    chosen = suffix[1:] if format is None else format
    if chosen in registered:
        module = registered[chosen].load()
        return _Format((f".{chosen}",), module.write_trajectory, module.read_trajectory)
    if format is not None:
        raise UnknownNameError("format", format, (*FORMATS, *registered))
    suffixes = (s for f in FORMATS.values() for s in f.suffixes)
    raise UnknownNameError("suffix", suffix, (*suffixes, *(f".{name}" for name in registered)))
