"""Recordings of the twin as files of other programs."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from pepper_kin import atomic_file
from pepper_kin.atomic_file import PathName
from pepper_kin.exceptions import FileFormatError
from pepper_kin.files.mcap_file import STATES_TOPIC, state_message
from pepper_kin.files.motion_points import NANOSECONDS
from pepper_kin.ros_messages import message_type
from pepper_kin.ros_messages.bags import BagWriter
from pepper_kin.twin.recording import Recording

SUFFIXES = (".npz", ".csv", ".mcap")
_LARGEST = 4096  # numbers in a sample; pictures have more and are left out of MCAP files
_ARRAY_TYPE = "std_msgs/msg/Float64MultiArray"


def save_recording(recording: Recording, path: PathName) -> Path:
    """Write a recording by suffix.

    `.npz`: every array, `reading.NAME.time`, `.value` and `.truth` for the sensors.  `.csv`: what `Run.save`
    writes.  `.mcap`: `/joint_states` (sensor_msgs/msg/JointState) at every step,
    `/external_wrench` (std_msgs/msg/Float64MultiArray) where forces act from outside, and for each sensor
    `/sensors/NAME` and `/truth/NAME` (the same type), pictures excepted.

    Args:
        recording: The recording.
        path: The file; its folder must exist.

    Returns:
        The path.

    Raises:
        FileFormatError: for another suffix, or where it cannot be written.
        MissingDependencyError: for .mcap where the package `mcap` is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".csv":
        return recording.run().save(path)
    if suffix == ".npz":
        return _write_npz(recording, path)
    if suffix == ".mcap":
        return _write_mcap(recording, path)
    raise FileFormatError(path, f"suffix {suffix!r}: expected one of {', '.join(SUFFIXES)}")


def _write_npz(recording: Recording, path: PathName) -> Path:
    run = recording.run()
    names = (
        "time",
        "position",
        "velocity",
        "torque",
        "reference_position",
        "reference_velocity",
        "external_wrench",
    )
    arrays: dict[str, Any] = {name: getattr(run, name) for name in names}
    arrays |= {"joint_names": np.array(run.joint_names), "joint_units": np.array(run.joint_units)}
    arrays |= {"status": np.array(run.status.value), "message": np.array(run.message)}
    for name, series in run.readings.items():
        arrays |= {f"reading.{name}.{what}": getattr(series, what) for what in ("time", "value", "truth")}
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    return atomic_file.write_bytes(path, content.getvalue())


def _write_mcap(recording: Recording, path: PathName) -> Path:
    run = recording.run()
    names, array = list(run.joint_names), message_type(_ARRAY_TYPE)
    acting = (run.external_wrench != 0.0).any(axis=1)
    topics = [("/external_wrench", run.time[acting], run.external_wrench[acting])]
    for name, series in run.readings.items():
        if series.value[0].size <= _LARGEST:
            topics.append((f"/sensors/{name}", series.time, series.value))
            topics.append((f"/truth/{name}", series.time, series.truth))
    with BagWriter(path) as bag:
        for i, stamp in enumerate(np.round(run.time * NANOSECONDS).astype(np.int64).tolist()):
            values = (run.position[i], run.velocity[i], run.torque[i])
            bag.write(STATES_TOPIC, state_message(stamp, names, *values), stamp)
        for topic, times, rows in topics:
            for i, time in enumerate(times.tolist()):
                data = np.asarray(rows[i], dtype=float)
                bag.write(topic, array(data=data), round(time * NANOSECONDS))
    return Path(path)
