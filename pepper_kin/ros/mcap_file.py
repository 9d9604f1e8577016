"""Trajectories, joint states and runs of the twin as MCAP files with ROS 2 messages, which Foxglove opens."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import FileFormatError, shortened
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.files.joint_states import StateMessage
from pepper_kin.files.motion_points import NANOSECONDS, MotionPoints
from pepper_kin.files.sampled_motion import (
    check_joint_names,
    check_times,
    points_of_file,
    units_for,
)
from pepper_kin.model import PepperModel
from pepper_kin.ros_messages import message_type
from pepper_kin.ros_messages.bags import Bag, BagMessage, BagWriter
from pepper_kin.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from pepper_kin.twin import Run


STATES_TOPIC = "/joint_states"
TRAJECTORY_TOPIC = "/joint_trajectory"
STATE_TYPE = "sensor_msgs/msg/JointState"
_TRAJECTORY_TYPE = "trajectory_msgs/msg/JointTrajectory"
_POINT_TYPE = "trajectory_msgs/msg/JointTrajectoryPoint"
_ARRAY_TYPE = "std_msgs/msg/Float64MultiArray"
_LARGEST = 4096  # numbers in a sample of a sensor; images have more and are not written


def write_trajectory(path: PathName, points: MotionPoints) -> Path:
    """Write a motion as an MCAP recording.

    Topic `/joint_states` (`sensor_msgs/msg/JointState`) has one message a sample, for plots and playback;
    topic `/joint_trajectory` (`trajectory_msgs/msg/JointTrajectory`) has the whole motion in one message,
    with accelerations if they are known, for `read_trajectory`.  Time starts at 0.

    Args:
        path: The file; its folder must exist.
        points: Points of the motion.

    Raises:
        MissingDependencyError: if the package `mcap` is not installed.
        FileFormatError: if the file cannot be written.
    """
    names, point = list(points.joint_names), message_type(_POINT_TYPE)
    whole = message_type(_TRAJECTORY_TYPE)(joint_names=names)
    whole.points = [
        point(
            positions=points.position[i],
            velocities=points.velocity[i],
            accelerations=[] if points.acceleration is None else points.acceleration[i],
            time_from_start=_duration_of(stamp),
        )
        for i, stamp in enumerate(points.stamps.tolist())
    ]
    with BagWriter(path) as bag:
        bag.write(TRAJECTORY_TOPIC, whole, 0)
        for i, stamp in enumerate(points.stamps.tolist()):
            state = _state_message(stamp, names, points.position[i], points.velocity[i])
            bag.write(STATES_TOPIC, state, stamp)
    return Path(path)


def read_trajectory(path: PathName, pepper: PepperModel | None = None) -> Trajectory:
    """Read the first `trajectory_msgs/msg/JointTrajectory` of an MCAP recording.

    Args:
        path: The file.
        pepper: Model whose joints it must have, in order; any joints, in radians, if omitted.

    Raises:
        MissingDependencyError: if the package `mcap` is not installed.
        FileFormatError: with path, point and reason.
    """
    message = _first(path)
    names = check_joint_names(path, list(message.joint_names), pepper)
    stamps = [_nanoseconds(point.time_from_start) for point in message.points]
    time = np.array(stamps, dtype=float) / NANOSECONDS
    check_times(path, time, lambda _: None)
    position, velocity, acceleration = (
        _table(path, name, [getattr(point, name) for point in message.points], len(names))
        for name in ("positions", "velocities", "accelerations")
    )
    if position is None:
        raise FileFormatError(path, "points have no positions")
    if velocity is None and acceleration is not None:
        raise FileFormatError(path, "points have accelerations but no velocities")
    return points_of_file(path, names, units_for(names, pepper), time, position, velocity, acceleration)


def read_states(path: PathName) -> list[StateMessage]:
    """Return all `sensor_msgs/msg/JointState` with positions of a recording, in its order.

    Times are from the headers, of which one may be 0; if all of a topic are 0, from the recording.

    Raises:
        MissingDependencyError: if the package `mcap` is not installed.
        FileFormatError: for a file that cannot be read, is damaged or has no message with positions.
    """
    bag, found, stamped = Bag(path), [], set()
    for topic, time, message in _messages(bag, STATE_TYPE):
        if len(message.position):
            stamp = _nanoseconds(message.header.stamp)
            stamped |= {topic} if stamp else set()
            state = StateMessage(topic, stamp, tuple(message.name), message.position.tolist())
            found.append((time, state))
    if not found:
        raise FileFormatError(path, f"holds no positions in messages of {STATE_TYPE}, only: {_held(bag)}")
    return [state if state.topic in stamped else state._replace(stamp=time) for time, state in found]


def write_recording(path: PathName, run: Run) -> Path:
    """Write a run of the twin.

    Topics are `/joint_states` (`sensor_msgs/msg/JointState`) at every step, `/external_wrench`
    (`std_msgs/msg/Float64MultiArray`) at times with external forces, and for each sensor `/sensors/NAME` and
    `/truth/NAME` (of the same type), except images.

    Raises:
        MissingDependencyError: if the package `mcap` is not installed.
        FileFormatError: if the file cannot be written.
    """
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
            bag.write(STATES_TOPIC, _state_message(stamp, names, *values), stamp)
        for topic, times, rows in topics:
            for i, time in enumerate(times.tolist()):
                data = np.asarray(rows[i], dtype=float)
                bag.write(topic, array(data=data), round(time * NANOSECONDS))
    return Path(path)


def _first(path: PathName) -> Any:
    """Return the first trajectory of a recording."""
    bag = Bag(path)
    for found in _messages(bag, _TRAJECTORY_TYPE):
        return found.message
    raise FileFormatError(path, f"holds no message of {_TRAJECTORY_TYPE}, only: {_held(bag)}")


def _messages(bag: Bag, type_name: str) -> Iterator[BagMessage]:
    """Yield the messages of a type, which must have ROS 2's fields."""
    for found in bag.messages(types=[type_name]):
        if not isinstance(found.message, message_type(type_name)):
            reason = f"{shortened(found.topic)} has messages {type_name} with other fields than ROS 2's"
            raise FileFormatError(bag.path, reason)
        yield found


def _held(bag: Bag) -> str:
    return ", ".join(sorted(set(bag.topics.values()))) or "no message"


def _table(path: PathName, name: str, rows: list[Array], n: int) -> Array | None:
    """Return T rows of n values as one array, shape (T, n); None if all rows are empty.

    Args:
        path: The file, for errors.
        name: Name of the quantity, for errors.
        rows: T arrays, shape (n,) each.
        n: Number of joints.

    Raises:
        FileFormatError: for the first row of another length, or with a value that is not finite.
    """
    if not any(len(row) for row in rows):
        return None
    for i, row in enumerate(rows):
        if len(row) != n:
            raise FileFormatError(path, f"point {i + 1} has {len(row)} {name} for {n} joints")
        if not np.isfinite(row).all():
            raise FileFormatError(path, f"point {i + 1} has {name} that are not finite")
    return np.array(rows, dtype=float)


def _state_message(
    stamp: int, names: list[str], position: Array, velocity: Array, effort: Array | None = None
) -> Any:
    """Return a sensor_msgs/msg/JointState without a frame.

    Args:
        stamp: Time [ns].
        names: Names of the joints.
        position: Positions [rad or m], shape (n,).
        velocity: Velocities [rad/s or m/s], shape (n,).
        effort: Torques or forces [N m or N], shape (n,); none if omitted.
    """
    message = message_type(STATE_TYPE)(name=names, position=position, velocity=velocity, effort=effort)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANOSECONDS)
    return message


def _duration_of(stamp: int) -> Any:
    """Return a builtin_interfaces/msg/Duration of a time [ns]."""
    seconds, nanoseconds = divmod(stamp, NANOSECONDS)
    return message_type("builtin_interfaces/msg/Duration")(sec=seconds, nanosec=nanoseconds)


def _nanoseconds(time: Any) -> int:
    """Return a Time or Duration message [ns]."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)
