"""Sampled motions in files, and their checks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import FileFormatError, InvalidValueError, shortened
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.reading import is_real_text
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.interpolation import cubic_pieces
from pepper_kin.trajectory.samples import Samples
from pepper_kin.trajectory.trajectory import Trajectory


def check_joint_names(
    path: PathName, names: Sequence[object], pepper: PepperModel | None, line: int | None = None
) -> tuple[str, ...]:
    """Return joint names of a file after checking that they are unique texts, and the robot's in its order.

    Raises:
        FileFormatError: naming path, line and the joint.
    """
    visited: set[str] = set()
    for i, name in enumerate(names):
        if not isinstance(name, str) or not is_real_text(name):
            raise FileFormatError(
                path, f"joint name {i + 1} is {shortened(ascii(name))}, expected a text", line
            )
        if name in visited:
            raise FileFormatError(path, f"joint {shortened(repr(name))} occurs twice", line)
        visited.add(name)
    found = tuple(str(name) for name in names)
    if not found:
        raise FileFormatError(path, "contains no joint name", line)
    if pepper is None or found == pepper.joint_names:
        return found
    unknown = next((name for name in found if name not in pepper.joint_names), None)
    missing = [name for name in pepper.joint_names if name not in visited]
    if unknown is not None:
        raise FileFormatError(path, f"the robot has no joint {shortened(repr(unknown))}", line)
    if missing:
        raise FileFormatError(path, f"joint {missing[0]!r} of the robot is missing", line)
    name, place = next((n, w) for n, w in zip(found, pepper.joint_names, strict=True) if n != w)
    raise FileFormatError(path, f"joints in another order: {name!r} where {place!r} belongs", line)


def points_of_file(
    path: PathName,
    names: tuple[str, ...],
    units: tuple[str, ...],
    time: Array,
    position: Array,
    velocity: Array | None = None,
    acceleration: Array | None = None,
) -> Trajectory:
    """Return the trajectory of `through_points` through what a file gave.

    Times [s] have shape (T,); positions [rad or m], velocities and accelerations have shape (T, n).

    Raises:
        FileFormatError: naming path and what is wrong, such as points too near in time for finite speeds.
    """
    try:
        return through_points(names, units, time, position, velocity, acceleration)
    except InvalidValueError as error:
        raise FileFormatError(path, str(error)) from error


def units_for(names: Sequence[str], pepper: PepperModel | None) -> tuple[str, ...]:
    """Return the units of the robot's joints, or radians for all where no robot is given."""
    return pepper.joint_units if pepper is not None else ("rad",) * len(names)


def check_times(path: PathName, time: Array, line_of: Callable[[int], int | None]) -> None:
    """Refuse times [s], shape (T,), that do not increase from 0, or fewer than two.

    Raises:
        FileFormatError: naming path, line and time.
    """
    if time.size < 2:
        raise FileFormatError(path, f"has {time.size} points, expected at least 2", line_of(0))
    if time[0] != 0.0:
        raise FileFormatError(path, f"time begins at {float(time[0])!r} s, expected 0", line_of(0))
    falling = np.flatnonzero(np.diff(time) <= 0)
    if falling.size:
        i = int(falling[0]) + 1
        reason = f"time {float(time[i])!r} s does not come after {float(time[i - 1])!r} s of the point before"
        raise FileFormatError(path, reason, line_of(i))


def through_points(
    names: tuple[str, ...],
    units: tuple[str, ...],
    time: Array,
    position: Array,
    velocity: Array | None = None,
    acceleration: Array | None = None,
) -> Trajectory:
    """Return the trajectory through points, by as much as is known of them.

    Args:
        names: Joints.
        units: Of the joints.
        time: Rising from 0 [s], shape (T,).
        position: [rad or m], shape (T, n).
        velocity: [rad/s or m/s], shape (T, n), or None: the cubic spline that starts and ends at rest.
        acceleration: [rad/s^2 or m/s^2], shape (T, n), or None: cubic pieces through the velocities.

    Returns:
        The trajectory; of degree 5 where all three are known.

    Raises:
        InvalidValueError: for points so near in time, or so far apart, that the polynomials overflow.
    """
    if velocity is not None and acceleration is not None:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return Samples(names, time, position, velocity, acceleration, units).to_trajectory()
    return Trajectory(names, time, cubic_pieces(time, position, velocity), units)
