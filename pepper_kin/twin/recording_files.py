"""Export of recordings of the twin to files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.exceptions import FileFormatError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.numpy_archive import write_arrays
from pepper_kin.plugins import plugins
from pepper_kin.twin.run import SERIES

if TYPE_CHECKING:
    from pepper_kin.twin.recording import Recording


def save_recording(recording: Recording, path: PathName) -> Path:
    """Write a recording in the format of the file's suffix.

    `.npz`: all arrays, with `reading.NAME.time`, `.value` and `.truth` for the sensors.  `.csv`: the table of
    `Run.save`.  `.mcap`: `/joint_states` (sensor_msgs/msg/JointState) at every step, `/external_wrench`
    (std_msgs/msg/Float64MultiArray) if external forces act, and for each sensor except cameras
    `/sensors/NAME` and `/truth/NAME` (of the same type).

    Args:
        recording: The recording.
        path: Path of the file; its folder must exist.

    Returns:
        The path.

    Raises:
        FileFormatError: for another suffix, or if the file cannot be written.
        MissingDependencyError: for .mcap if the package `mcap` is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".csv":
        return recording.run().save(path)
    if suffix == ".npz":
        return _write_npz(recording, path)
    if suffix[1:] in plugins("formats"):
        written: Path = plugins("formats")[suffix[1:]].load().write_recording(path, recording.run())
        return written
    known = (".npz", ".csv", *(f".{name}" for name in plugins("formats")))
    raise FileFormatError(path, f"suffix {suffix!r}: expected one of {', '.join(known)}")


def _write_npz(recording: Recording, path: PathName) -> Path:
    run = recording.run()
    arrays: dict[str, Any] = {name: getattr(run, name) for name in ("time", *SERIES)}
    arrays |= {"joint_names": np.array(run.joint_names), "joint_units": np.array(run.joint_units)}
    arrays |= {"status": np.array(run.status.value), "message": np.array(run.message)}
    for name, series in run.readings.items():
        arrays |= {f"reading.{name}.{what}": getattr(series, what) for what in ("time", "value", "truth")}
    return write_arrays(path, arrays)
