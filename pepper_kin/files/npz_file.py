"""Trajectories as NumPy archives, which are exact."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pepper_kin.exceptions import FileFormatError, InvalidValueError, shortened
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.numpy_archive import read_kinds, write_arrays
from pepper_kin.files.sampled_motion import check_joint_names
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.trajectory import Trajectory

FORMAT = "pepper_kin.trajectory"
VERSION = 1
_ARRAYS = {"version": ("iu", 0), "joint_names": ("U", 1), "joint_units": ("U", 1)}
_POLYNOMIALS = {"breaks": None, "coefficients": None}  # a trajectory checks them


def write_npz(path: PathName, trajectory: Trajectory) -> Path:
    """Write the polynomials of a trajectory as a compressed NumPy archive.

    Arrays: `breaks` (m + 1,) [s], `coefficients` (m, k, n), constant term first, `joint_names` and
    `joint_units` (n,) texts, `format` and `version`.

    Raises:
        FileFormatError: if the file cannot be written.
    """
    named = {name: getattr(trajectory, name) for name in (*_ARRAYS, *_POLYNOMIALS) if name != "version"}
    return write_arrays(path, {"format": FORMAT, "version": VERSION, **named})


def read_npz(path: PathName, pepper: PepperModel | None = None) -> Trajectory:
    """Read a trajectory that `write_npz` wrote; nothing in the file is executed.

    Args:
        path: The file.
        pepper: The robot whose joints the file must have, in its order; any joints if omitted.

    Raises:
        FileFormatError: naming path, array and fault.
    """
    arrays = read_kinds(path, FORMAT, {**_ARRAYS, **_POLYNOMIALS})
    if arrays["version"] != VERSION:
        raise FileFormatError(path, f"version is {arrays['version']}, expected {VERSION}")
    joints = check_joint_names(path, arrays["joint_names"].tolist(), pepper)
    units = arrays["joint_units"].tolist()
    return build(path, joints, units, arrays["breaks"], arrays["coefficients"], pepper)


def build(
    path: PathName,
    names: tuple[str, ...],
    units: list[Any],
    breaks: Any,
    coefficients: Any,
    pepper: PepperModel | None,
) -> Trajectory:
    """Return the trajectory from the contents of a file.

    Raises:
        FileFormatError: naming path and field, for NaN, wrong shapes, times that do not increase, or
            units other than the robot's.
    """
    if not all(isinstance(unit, str) for unit in units):
        raise FileFormatError(path, f"joint_units are {shortened(units)}, expected texts")
    try:
        trajectory = Trajectory(names, breaks, coefficients, tuple(units))
    except InvalidValueError as error:
        raise FileFormatError(path, str(error)) from error
    if pepper is not None and trajectory.joint_units != pepper.joint_units:
        raise FileFormatError(path, f"joint_units are {trajectory.joint_units}, not those of the robot")
    return trajectory
