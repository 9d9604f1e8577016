"""Motions given as points over time: what files hold, checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pepper_kin.atomic_file import PathName
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.samples import Samples
from pepper_kin.trajectory.trajectory import Trajectory, sample_times

Array = NDArray[np.float64]
Nanoseconds = NDArray[np.int64]

NANOSECONDS = 1_000_000_000


def nanosecond_samples(trajectory: Trajectory, dt: float) -> tuple[Nanoseconds, Samples]:
    """Return whole nanoseconds at 0, dt, 2 dt, ... and the duration, and the samples at exactly these times.

    Args:
        trajectory: The trajectory.
        dt: Time between samples, at least 1 ns [s].

    Raises:
        InvalidValueError: for a dt that is too small or not above zero.
    """
    stamps = np.round(sample_times(trajectory.duration, dt) * NANOSECONDS).astype(np.int64)
    if np.any(np.diff(stamps) <= 0):
        raise InvalidValueError("dt", f"{dt} s", "at least 1e-9 s, as the file counts whole nanoseconds")
    time = stamps / NANOSECONDS
    state = trajectory(np.minimum(time, trajectory.duration))
    return stamps, Samples(trajectory.joint_names, time, *state, joint_units=trajectory.joint_units)


def check_joint_names(
    path: PathName, names: Sequence[object], pepper: PepperModel | None, line: int | None = None
) -> tuple[str, ...]:
    """Return joint names that a file gave, once they are texts, unique, and the robot's in its order.

    Raises:
        FileFormatError: naming path, line and the joint.
    """
    for i, name in enumerate(names):
        if not isinstance(name, str) or not name:
            raise FileFormatError(path, f"joint name {i + 1} is {name!r}, expected a text", line)
        if name in names[:i]:
            raise FileFormatError(path, f"joint {name!r} occurs twice", line)
    found = tuple(str(name) for name in names)
    if not found:
        raise FileFormatError(path, "names no joint", line)
    if pepper is None or found == pepper.joint_names:
        return found
    unknown = [name for name in found if name not in pepper.joint_names]
    missing = [name for name in pepper.joint_names if name not in found]
    if unknown:
        raise FileFormatError(path, f"the robot has no joint {unknown[0]!r}", line)
    if missing:
        raise FileFormatError(path, f"joint {missing[0]!r} of the robot is missing", line)
    name, place = next((n, w) for n, w in zip(found, pepper.joint_names, strict=True) if n != w)
    raise FileFormatError(path, f"joints in another order: {name!r} where {place!r} belongs", line)


def units_for(names: Sequence[str], pepper: PepperModel | None) -> tuple[str, ...]:
    """Return the units of the robot's joints, or radians for all where no robot is given."""
    return pepper.joint_units if pepper is not None else ("rad",) * len(names)


def check_times(path: PathName, time: Array, line_of: Callable[[int], int | None]) -> None:
    """Refuse times that do not rise from 0, or fewer than two.

    Raises:
        FileFormatError: naming path, line and time.
    """
    if time.size < 2:
        raise FileFormatError(path, f"{time.size} points make no trajectory, expected at least 2", line_of(0))
    if time[0] != 0.0:
        raise FileFormatError(path, f"time begins at {float(time[0])!r} s, expected 0", line_of(0))
    falling = np.flatnonzero(np.diff(time) <= 0)
    if falling.size:
        i = int(falling[0]) + 1
        reason = f"time {float(time[i])!r} s does not come after {float(time[i - 1])!r} s of the point before"
        raise FileFormatError(path, reason, line_of(i))
