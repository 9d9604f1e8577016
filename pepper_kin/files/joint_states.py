"""Recorded joint states, in CSV or MCAP, as trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError, shortened
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.files.motion_points import NANOSECONDS
from pepper_kin.files.table_file import numbers_of, read_lines
from pepper_kin.model.joint_vectors import as_finite, check_choice, check_positive
from pepper_kin.plugins import plugins
from pepper_kin.trajectory.interpolation import INTERPOLATIONS, OVERSHOOT, from_positions
from pepper_kin.trajectory.samples import UNITS
from pepper_kin.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from pepper_kin.model import PepperModel


IGNORED = ("LHand", "RHand", "WheelFL", "WheelFR", "WheelB")
"""Joints that Pepper reports and that most models of this library do not have."""

_POSITION = "position"


class StateMessage(NamedTuple):
    """A `sensor_msgs/msg/JointState` as plain values.

    Attributes:
        topic: Topic of the message.
        stamp: Time of the header [ns], or of the recording if all headers of the topic are zero.
        names: Names of the joints.
        position: Position of each joint [rad or m].
    """

    topic: str
    stamp: int
    names: tuple[str, ...]
    position: list[float]


def read_joint_states(
    pepper: PepperModel,
    path: PathName,
    *,
    topic: str | None = None,
    ignore: Sequence[str] = IGNORED,
    rest: ArrayLike | None = None,
    interpolation: str = "cubic",
    overshoot: float = OVERSHOOT,
) -> Trajectory:
    """Read recorded joint positions of a robot, from any program, as a trajectory through all samples.

    For files written by this library, `load` is exact.

    A .csv file has a first line that names its columns: `time` [s] first, then `<joint>` or
    `<joint>.position` [rad or m]; columns of other quantities, such as in `run.csv`, are left out.  An .mcap
    file, a .db3 file or the folder of a bag has messages `sensor_msgs/msg/JointState`; their headers' times
    are used unless all are zero. Joints may be in any order; missing joints stay at `rest`.

    Args:
        pepper: The robot.
        path: The file.
        topic: Topic of the recording; the only one with joint states if omitted.
        ignore: Names of joints in the file that are skipped if the robot lacks them.
        rest: Positions of joints that the file lacks [rad or m], shape (n,); `pepper.neutral()` if omitted.
        interpolation: "cubic" or "monotone", see `Trajectory.from_positions`.
        overshoot: Maximum distance of a joint beyond the range of its samples, or its limits, without a
            warning [rad or m].

    Returns:
        The trajectory of all joints of the robot; the first sample is at time 0.

    Raises:
        UnknownNameError: for another suffix, or a topic that the file lacks.
        FileFormatError: naming path and line or message, for a file that cannot be read, a joint that the
            robot lacks and `ignore` does not name, no joint of the robot, NaN, or times that do not increase.
        MissingDependencyError: for .mcap without its package.
        InvalidValueError: for a `rest` of the wrong shape, or an option out of range.

    Warns:
        OvershootWarning: if the trajectory overshoots, see `Trajectory.from_positions`.
    """
    suffix = recording_suffix(path)
    if suffix == ".csv":
        time, columns = _from_csv(path)
    elif suffix[1:] in plugins("formats"):
        time, columns = _of_topic(path, plugins("formats")[suffix[1:]].load().read_states(path), topic)
    else:
        raise UnknownNameError("suffix", suffix, (".csv", *(f".{name}" for name in plugins("formats"))))
    known = [name for name in columns if name in pepper.joint_names]
    unknown = [name for name in columns if name not in pepper.joint_names and name not in ignore]
    if unknown:
        name = shortened(repr(unknown[0]))
        raise FileFormatError(path, f"the robot has no joint {name}; ignore=[...] skips joints")
    if not known:
        raise FileFormatError(path, f"has no position of the robot's joints, {', '.join(pepper.joint_names)}")
    if time.size < 2:
        raise FileFormatError(path, "has one sample only, expected at least 2")
    others = pepper.neutral() if rest is None else as_finite(rest, "rest", (pepper.n,))
    check_choice("interpolation", interpolation, INTERPOLATIONS)
    check_positive("overshoot", overshoot, "rad or m")
    try:
        return from_positions(
            Trajectory,
            pepper,
            time,
            np.column_stack([columns[name] for name in known]),
            joints=known,
            rest=others,
            interpolation=interpolation,
            overshoot=overshoot,
        )
    except InvalidValueError as error:
        raise FileFormatError(path, str(error)) from error


def recording_suffix(path: PathName) -> str:
    """Return the suffix of a file; ".mcap" for .db3 files and folders, which the same module reads."""
    suffix = Path(path).suffix.lower()
    return ".mcap" if suffix == ".db3" or Path(path).is_dir() else suffix


def _from_csv(path: PathName) -> tuple[Array, dict[str, Array]]:
    """Return times [s], shape (T,), and positions by joint, shape (T,) each."""
    names, rows = read_lines(path)
    joints: dict[str, str] = {}
    for name in names[1:]:
        joint, dot, quantity = name.strip().rpartition(".")
        if not dot or quantity not in UNITS:
            joint, quantity = name.strip(), _POSITION
        if quantity == _POSITION:
            if joint in joints or not joint:
                raise FileFormatError(
                    path, f"two columns, {joint!r} twice" if joint else "a column without name", 1
                )
            joints[joint] = name
    table = numbers_of(path, names, rows)
    return table[names[0]], {joint: table[name] for joint, name in joints.items()}


def _of_topic(
    path: PathName, states: list[StateMessage], topic: str | None
) -> tuple[Array, dict[str, Array]]:
    """Return times since the first message [s], shape (T,), and positions by joint, shape (T,) each."""
    topics = sorted({state.topic for state in states})
    if topic is not None and topic not in topics:
        raise UnknownNameError("topic with joint states", topic, topics)
    if topic is None and len(topics) > 1:
        raise FileFormatError(path, f"has joint states on {', '.join(topics)}: choose one by topic=")
    chosen = [state for state in states if topic is None or state.topic == topic]
    _check(path, chosen)
    stamps = np.array([state.stamp for state in chosen], dtype=np.int64)
    order = list(chosen[0].names)
    rows = [[dict(zip(s.names, s.position, strict=True))[name] for name in order] for s in chosen]
    table = np.array(rows, dtype=float)
    return (stamps - stamps[0]) / NANOSECONDS, {name: table[:, j] for j, name in enumerate(order)}


def _check(path: PathName, states: list[StateMessage]) -> None:
    """Refuse messages with other joints, wrong numbers of positions, NaN, or times that do not increase."""
    first = states[0]
    for i, state in enumerate(states):
        place = f"message {i + 1} of {state.topic}"
        if len(state.position) != len(state.names) or len(set(state.names)) != len(state.names):
            reason = f"has {len(state.position)} positions for {len(set(state.names))} different joints"
            raise FileFormatError(path, f"{place} {reason}")
        if set(state.names) != set(first.names):
            raise FileFormatError(path, f"{place} has other joints than the first: {', '.join(state.names)}")
        if not np.isfinite(state.position).all():
            wrong = state.names[int(np.argmin(np.isfinite(state.position)))]
            raise FileFormatError(path, f"{place}: position of {wrong} is not finite")
        if i and state.stamp <= states[i - 1].stamp:
            raise FileFormatError(path, f"{place}: its time does not come after that of the message before")
