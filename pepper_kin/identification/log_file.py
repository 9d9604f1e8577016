"""Reading of robots' logs from files."""

from __future__ import annotations

import lzma
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.exceptions import FileFormatError, UnknownNameError, shortened
from pepper_kin.file_access.atomic_file import PathName, as_path
from pepper_kin.file_access.reading import read_bytes
from pepper_kin.files.joint_states import StateMessage
from pepper_kin.files.table_file import TIME, numbers_of
from pepper_kin.identification.robot_log import RobotLog
from pepper_kin.plugins import plugins

COMMANDS_FROM = 2.0
"""Warm-up time of a table without commands, in which the filters of its program settled [s]."""

CALLS_BEFORE = 2.5
"""Number of round trips from the time of a row to the first reading: two calls, and the answer's half."""

LARGEST = 250_000_000
"""Maximum unpacked size of a compressed table [bytes]."""

_PAIRS = (("_command", "_measured"), (".reference", ".position"))
_MOST = 2.0 * np.pi
"""Maximum angle that counts as radians: no joint of Pepper turns by half of it [rad]."""
_STEPS = (1e-4, 10.0)
"""Minimum and maximum median time between rows that counts as seconds [s]."""


def read_log(
    path: PathName,
    *,
    share: float | None = None,
    person: str | None = None,
    commands_from: float = COMMANDS_FROM,
    topic: str = "/joint_states",
    command_topic: str = "/joint_commands",
) -> RobotLog:
    """Read a robot's log.

    A table (.csv, .csv.xz) has a first line that names its columns: `time` [s] first, then for each joint
    `<joint>_command` and `<joint>_measured` [rad].  A row's command is sent at its time, and the joints are
    read after it, one after the other in the order of the columns, by a program outside the robot.
    A table of a run of the twin (`Run.save`) has `<joint>.reference` and `<joint>.position`, which
    belong to the row's time.  An .mcap file has `sensor_msgs/msg/JointState` on two topics.

    Args:
        path: The file.
        share: Ratio of the maximum speed given with the commands; if omitted, 0.15 for a table of commands,
            else 1.
        person: Person of the session; if omitted, `X` of a name `person_X_...`, else the name.
        commands_from: Time before which commands of a table were not sent [s].
        topic: Topic of the measured angles in an .mcap file.
        command_topic: Topic of the commanded angles in an .mcap file.

    Raises:
        FileFormatError: naming file, column and row, for a joint without one of its columns, NaN, times that
            do not rise, degrees or milliseconds; or a file that cannot be read.
        UnknownNameError: for another suffix, or a topic that the file lacks.
        InvalidValueError: for a share that is not allowed.
    """
    source = as_path(path)
    suffixes = tuple(suffix.lower() for suffix in source.suffixes)
    stem = source.name.split(".")[0]
    parts = stem.split("_")
    whose = person or (parts[1] if parts[0] == "person" and len(parts) > 2 else stem)
    if suffixes[-1:] == (".csv",) or suffixes[-2:] == (".csv", ".xz"):
        return _from_table(source, stem, whose, share, commands_from)
    if suffixes and suffixes[-1][1:] in plugins("formats"):
        states = plugins("formats")[suffixes[-1][1:]].load().read_states(source)
        return _from_states(source, stem, whose, share, (states, topic, command_topic))
    known = (".csv", ".csv.xz", *(f".{name}" for name in plugins("formats")))
    raise UnknownNameError("suffix", "".join(suffixes), known)


def _from_table(path: Path, name: str, person: str, share: float | None, commands_from: float) -> RobotLog:
    """Return the log of a table of commands, or of a run of the twin."""
    names, rows = _lines(path)
    command_end, measured_end = _PAIRS[0]
    if not any(column.endswith(command_end) or column.endswith(measured_end) for column in names):
        command_end, measured_end = _PAIRS[1]
    joints = [column.removesuffix(measured_end) for column in names if column.endswith(measured_end)]
    others = [column.removesuffix(command_end) for column in names if column.endswith(command_end)]
    for joint in dict.fromkeys([*joints, *others]):
        for end in (command_end, measured_end):
            if joint + end not in names:
                raise FileFormatError(path, f"column {shortened(repr(joint + end))} is missing", 1)
    if not joints:
        raise FileFormatError(path, "has no columns <joint>_command and <joint>_measured", 1)
    if len(set(names)) < len(names):
        twice = next(column for column in names if names.count(column) > 1)
        raise FileFormatError(path, f"column {shortened(repr(twice))} occurs twice", 1)
    table = numbers_of(path, names, rows)
    time = table[TIME]
    for joint in joints:
        for column in (joint + command_end, joint + measured_end):
            _refuse_degrees(path, column, table[column])
    _refuse_other_units(path, time)
    sends = command_end == _PAIRS[0][0]
    given = time >= commands_from if sends else np.ones(time.size, dtype=bool)
    if not given.any():
        raise FileFormatError(path, f"ends before {commands_from:g} s, where commands begin", len(rows) + 1)
    order: Array = CALLS_BEFORE + np.arange(len(joints), dtype=float) if sends else np.zeros(len(joints))
    return RobotLog(
        name,
        tuple(joints),
        time[given],
        np.column_stack([table[joint + command_end] for joint in joints])[given],
        time,
        np.column_stack([table[joint + measured_end] for joint in joints]),
        (0.15 if sends else 1.0) if share is None else share,
        order,
        person,
    )


def _lines(path: Path) -> tuple[list[str], list[str]]:
    """Return the column names and the lines of numbers of a table."""
    content = read_bytes(path)
    try:
        text = (_unpacked(path, content) if path.suffix.lower() == ".xz" else content).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(path, f"is not text in UTF-8: {error.reason} at byte {error.start}") from error
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if lines[0].split(",")[0].strip() != TIME:
        raise FileFormatError(path, f"is not a log: its first line does not begin with {TIME!r}", 1)
    if lines[-1] != "":
        raise FileFormatError(path, "is truncated: its last line does not end with a newline", len(lines))
    if len(lines) < 4:
        raise FileFormatError(path, "has fewer than two rows of numbers", 1)
    return [column.strip() for column in lines[0].split(",")], lines[1:-1]


def _unpacked(path: Path, content: bytes) -> bytes:
    """Return the unpacked content of an xz file."""
    unpacker = lzma.LZMADecompressor()
    try:
        text = unpacker.decompress(content, max_length=LARGEST + 1)
    except lzma.LZMAError as error:
        raise FileFormatError(path, f"is not xz: {error}") from error
    if len(text) > LARGEST:
        raise FileFormatError(path, f"holds more than {LARGEST // 1_000_000} MB")
    if not unpacker.eof:
        raise FileFormatError(path, "is truncated: it ends within its xz stream")
    return text


def _refuse_degrees(path: Path, column: str, values: Array) -> None:
    """Refuse a column with a value too large for radians, naming its row."""
    wrong = np.flatnonzero(np.abs(values) > _MOST)
    if wrong.size:
        row = int(wrong[0])
        reason = f"{column} is {values[row]:g}, expected radians of at most {_MOST:.2f}: are these degrees?"
        raise FileFormatError(path, reason, row + 2)


def _refuse_other_units(path: Path, time: Array) -> None:
    """Refuse times whose median step is not plausible in seconds."""
    step = float(np.median(np.diff(time)))
    if not _STEPS[0] <= step <= _STEPS[1]:
        reason = (
            f"{TIME}: rows are {step:g} s apart in the median, "
            f"expected {_STEPS[0]:g} to {_STEPS[1]:g} s: are these seconds?"
        )
        raise FileFormatError(path, reason, 2)


def _from_states(
    path: Path,
    name: str,
    person: str,
    share: float | None,
    source: tuple[list[StateMessage], str, str],
) -> RobotLog:
    """Return a log from messages; `source` is (messages, measured topic, command topic)."""
    states, topic, command_topic = source
    topics = sorted({state.topic for state in states})
    for wanted in (topic, command_topic):
        if wanted not in topics:
            raise UnknownNameError("topic with joint states", wanted, topics)
    chosen = {t: [state for state in states if state.topic == t] for t in (topic, command_topic)}
    joints = chosen[command_topic][0].names
    stamps: dict[str, NDArray[np.int64]] = {}
    tables: dict[str, Array] = {}
    for wanted, messages in chosen.items():
        stamps[wanted] = np.array([message.stamp for message in messages], dtype=np.int64)
        tables[wanted] = np.array(
            [_row(path, wanted, place, message, joints) for place, message in enumerate(messages)]
        )
        falling = np.flatnonzero(np.diff(stamps[wanted]) <= 0)
        if falling.size:
            place = int(falling[0]) + 2
            reason = f"message {place} of {wanted}: its time does not come after that of the message before"
            raise FileFormatError(path, reason)
    first = min(int(values[0]) for values in stamps.values())
    seconds = {wanted: (values - first) / 1e9 for wanted, values in stamps.items()}
    return RobotLog(
        name,
        tuple(joints),
        seconds[command_topic],
        tables[command_topic],
        seconds[topic],
        tables[topic],
        1.0 if share is None else share,
        None,  # type: ignore[arg-type]
        person,
    )


def _row(path: Path, topic: str, place: int, message: StateMessage, joints: tuple[str, ...]) -> list[float]:
    """Return the positions of joints in a message."""
    angles = dict(zip(message.names, message.position, strict=False))
    for joint in joints:
        where = f"message {place + 1} of {topic}"
        if joint not in angles:
            raise FileFormatError(path, f"{where} has no position of {joint}")
        if not np.isfinite(angles[joint]):
            raise FileFormatError(path, f"{where}: position of {joint} is {angles[joint]}, expected a number")
        if abs(angles[joint]) > _MOST:
            reason = (
                f"{where}: position of {joint} is {angles[joint]:g}, expected radians: are these degrees?"
            )
            raise FileFormatError(path, reason)
    return [angles[joint] for joint in joints]
