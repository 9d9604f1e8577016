"""Trajectories as MCAP recordings with ROS 2 messages, which Foxglove and ROS 2 open."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from pepper_kin import atomic_file
from pepper_kin.atomic_file import PathName
from pepper_kin.exceptions import FileFormatError, MissingDependencyError, shortened
from pepper_kin.file_reading import read_bytes
from pepper_kin.files.sampled_motion import (
    NANOSECONDS,
    check_joint_names,
    check_times,
    nanosecond_samples,
    points_of_file,
    units_for,
)
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.trajectory import Trajectory

Array = NDArray[np.float64]
_Content = TypeVar("_Content")

STATES_TOPIC = "/joint_states"
TRAJECTORY_TOPIC = "/joint_trajectory"
STATE_TYPE = "sensor_msgs/msg/JointState"
_TRAJECTORY_TYPE = "trajectory_msgs/msg/JointTrajectory"

_RULE = "=" * 80
_HEADER = f"""{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
STATE_SCHEMA = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_HEADER}"""
_TRAJECTORY_SCHEMA = f"""std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint[] points
{_HEADER}{_RULE}
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
{_RULE}
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
"""


def write_mcap(path: PathName, trajectory: Trajectory, dt: float = 0.01) -> Path:
    """Write a trajectory, sampled, as an MCAP recording.

    Topic `/joint_states` (`sensor_msgs/msg/JointState`) has one message a sample, for plots and for playing
    it; topic `/joint_trajectory` (`trajectory_msgs/msg/JointTrajectory`) has the whole motion in one message,
    accelerations included, which is what `read_mcap` reads.  Time begins at 0.

    Args:
        path: The file; its folder must exist.
        trajectory: The trajectory.
        dt: Time between samples [s]; the last is at the duration, rounded to a nanosecond.

    Raises:
        MissingDependencyError: where the package `mcap-ros2-support` is not installed.
        InvalidValueError: for a dt that is not above zero.
        FileFormatError: where the file cannot be written.
    """
    try:
        from mcap_ros2.writer import Writer
    except ImportError as error:
        raise _missing() from error
    stamps, samples = nanosecond_samples(trajectory, dt)
    content = io.BytesIO()
    writer = Writer(content)
    state_schema = writer.register_msgdef(STATE_TYPE, STATE_SCHEMA)
    trajectory_schema = writer.register_msgdef(_TRAJECTORY_TYPE, _TRAJECTORY_SCHEMA)
    names = list(samples.joint_names)
    points = [
        {
            "positions": samples.position[i].tolist(),
            "velocities": samples.velocity[i].tolist(),
            "accelerations": samples.acceleration[i].tolist(),
            "effort": [],
            "time_from_start": _time(stamp),
        }
        for i, stamp in enumerate(stamps.tolist())
    ]
    message: dict[str, Any] = {"header": message_header(0), "joint_names": names, "points": points}
    writer.write_message(TRAJECTORY_TOPIC, trajectory_schema, message, log_time=0)
    for i, stamp in enumerate(stamps.tolist()):
        message = {
            "header": message_header(stamp),
            "name": names,
            "position": samples.position[i].tolist(),
            "velocity": samples.velocity[i].tolist(),
            "effort": [],
        }
        writer.write_message(STATES_TOPIC, state_schema, message, log_time=stamp, sequence=i)
    writer.finish()
    return atomic_file.write_bytes(path, content.getvalue())


def read_mcap(path: PathName, pepper: PepperModel | None = None) -> Trajectory:
    """Read the first `trajectory_msgs/msg/JointTrajectory` of an MCAP recording.

    Args:
        path: The file.
        pepper: The robot whose joints it must have, in its order; any joints, in radians, if omitted.

    Raises:
        MissingDependencyError: where the package `mcap-ros2-support` is not installed.
        FileFormatError: naming path and point and what is wrong.
    """
    message = _message(path)
    names = check_joint_names(path, message.names, pepper)
    time = np.array(message.stamps, dtype=float) / NANOSECONDS
    check_times(path, time, lambda _: None)
    values = {name: _table(path, name, rows, len(names)) for name, rows in message.lists.items()}
    position = values["positions"]
    if position is None:
        raise FileFormatError(path, "points have no positions")
    if values["velocities"] is None and values["accelerations"] is not None:
        raise FileFormatError(path, "points have accelerations but no velocities")
    units = units_for(names, pepper)
    return points_of_file(path, names, units, time, position, values["velocities"], values["accelerations"])


class _Message(NamedTuple):
    """Contents of a JointTrajectory as plain values."""

    names: list[str]
    stamps: list[int]  # [ns]
    lists: dict[str, list[list[float]]]


def _taken_apart(message: Any) -> _Message:
    points = list(message.points)
    times = [p.time_from_start for p in points]
    return _Message(
        list(message.joint_names),
        [int(t.sec) * NANOSECONDS + int(t.nanosec) for t in times],
        {
            name: [list(getattr(p, name)) for p in points]
            for name in ("positions", "velocities", "accelerations")
        },
    )


class StateMessage(NamedTuple):
    """A `sensor_msgs/msg/JointState` as plain values.

    Attributes:
        topic: Where it was published.
        stamp: Time of its header [ns]; the recording's where that is zero.
        names: Joints.
        position: [rad or m], one for each of them.
    """

    topic: str
    stamp: int
    names: tuple[str, ...]
    position: list[float]


def read_states(path: PathName) -> list[StateMessage]:
    """Return all `sensor_msgs/msg/JointState` of an MCAP recording that hold positions, in its order.

    Raises:
        MissingDependencyError: where the package `mcap-ros2-support` is not installed.
        FileFormatError: for a file that cannot be read, is damaged or has no such message.
    """
    found = []
    types: set[str] = set()
    for topic, log_time, state in _messages(path, STATE_TYPE, types, _state_of):
        if state.position:
            found.append(state._replace(topic=topic, stamp=state.stamp or log_time))
    if not found:
        raise FileFormatError(path, f"holds no positions in messages of {STATE_TYPE}, only: {_held(types)}")
    return found


def _state_of(message: Any) -> StateMessage:
    stamp = int(message.header.stamp.sec) * NANOSECONDS + int(message.header.stamp.nanosec)
    return StateMessage("", stamp, tuple(map(str, message.name)), list(message.position))


def _message(path: PathName) -> _Message:
    types: set[str] = set()
    for _, _, message in _messages(path, _TRAJECTORY_TYPE, types, _taken_apart):
        return message
    raise FileFormatError(path, f"holds no message of {_TRAJECTORY_TYPE}, only: {_held(types)}")


def _held(types: set[str]) -> str:
    return ", ".join(sorted(types)) or "no message"


def _messages(
    path: PathName, kind: str, types: set[str], read: Callable[[Any], _Content]
) -> Iterator[tuple[str, int, _Content]]:
    """Yield topic, time of recording [ns] and content of messages of a type; collect all types."""
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError as error:
        raise _missing() from error
    content = read_bytes(path)
    factory = DecoderFactory()
    try:
        reader = make_reader(io.BytesIO(content), validate_crcs=True, decoder_factories=[factory])
        summary = reader.get_summary()
        for schema, channel, record in reader.iter_messages():
            types.add("" if schema is None else schema.name)
            if schema is not None and schema.name == kind and summary is not None:
                decode = factory.decoder_for(channel.message_encoding, schema)
                if decode is not None:
                    yield channel.topic, int(record.log_time), read(decode(record.data))
    except Exception as error:  # a damaged file makes the libraries fail in ways without a common base
        raise FileFormatError(
            path, f"is not a complete MCAP file: {type(error).__name__}: {shortened(error)}"
        ) from error


def _table(path: PathName, name: str, rows: list[list[float]], n: int) -> Array | None:
    if not any(rows):
        return None
    for i, row in enumerate(rows):
        if len(row) != n:
            raise FileFormatError(path, f"point {i + 1} has {len(row)} {name} for {n} joints")
        if not np.isfinite(row).all():
            raise FileFormatError(path, f"point {i + 1} has {name} that are not finite")
    return np.array(rows, dtype=float)


def message_header(stamp: int) -> dict[str, Any]:
    """Return a std_msgs/msg/Header without a frame, at a time [ns]."""
    return {"stamp": _time(stamp), "frame_id": ""}


def _time(stamp: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(stamp, NANOSECONDS)
    return {"sec": seconds, "nanosec": nanoseconds}


def _missing() -> MissingDependencyError:
    return MissingDependencyError("mcap-ros2-support", 'pip install "pepper_kin[mcap]"', "an MCAP file")
