"""Checks of sampled motions in files, and interpolation between their points."""

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
    """Return joint names of a file after a check that they are unique, and equal to the robot's if given.

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
    """Return the trajectory through the points of a file, see `through_points`.

    Times [s] have shape (T,); positions [rad or m], velocities and accelerations have shape (T, n).

    Raises:
        FileFormatError: naming path and fault, such as points too close in time for finite speeds.
    """
    try:
        return through_points(names, units, time, position, velocity, acceleration)
    except InvalidValueError as error:
        raise FileFormatError(path, str(error)) from error


def units_for(names: Sequence[str], pepper: PepperModel | None) -> tuple[str, ...]:
    """Return the units of the robot's joints, or radians for all joints without a robot."""
    return pepper.joint_units if pepper is not None else ("rad",) * len(names)


def check_times(path: PathName, time: Array, line_of: Callable[[int], int | None]) -> None:
    """Refuse times [s], shape (T,), that do not increase from 0, and fewer than two times.

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
    """Return the trajectory through points with the known derivatives.

    Args:
        names: Names of the joints.
        units: Units of the joints.
        time: Times, increasing from 0 [s], shape (T,).
        position: Positions [rad or m], shape (T, n).
        velocity: Velocities [rad/s or m/s], shape (T, n); None for the cubic spline from rest to rest.
        acceleration: Accelerations [rad/s^2 or m/s^2], shape (T, n); None for cubic segments through the
            velocities.

    Returns:
        The trajectory; of degree 5 with accelerations.

    Raises:
        InvalidValueError: for points so close in time, or so far apart, that the polynomials overflow.
    """
    if velocity is not None and acceleration is not None:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return Samples(names, time, position, velocity, acceleration, units).to_trajectory()
    return Trajectory(names, time, cubic_pieces(time, position, velocity), units)
