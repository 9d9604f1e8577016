"""Trajectories as NumPy archives: exact."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from pepper_kin.exceptions import FileFormatError, InvalidValueError, shortened
from pepper_kin.file_access import atomic_file
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.numpy_archive import read_arrays
from pepper_kin.files.sampled_motion import check_joint_names
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.trajectory import Trajectory

FORMAT = "pepper_kin.trajectory"
VERSION = 1
_ARRAYS = ("breaks", "coefficients", "format", "joint_names", "joint_units", "version")


def write_npz(path: PathName, trajectory: Trajectory) -> Path:
    """Write the polynomials of a trajectory as a compressed NumPy archive.

    Arrays: `breaks` (m + 1,) [s], `coefficients` (m, k, n), constant term first, `joint_names` and
    `joint_units` (n,) texts, `format` and `version`.

    Raises:
        FileFormatError: where the file cannot be written.
    """
    content = io.BytesIO()
    np.savez_compressed(
        content,
        format=np.array(FORMAT),
        version=np.array(VERSION),
        joint_names=np.array(trajectory.joint_names),
        joint_units=np.array(trajectory.joint_units),
        breaks=trajectory.breaks,
        coefficients=trajectory.coefficients,
    )
    return atomic_file.write_bytes(path, content.getvalue())


def read_npz(path: PathName, pepper: PepperModel | None = None) -> Trajectory:
    """Read a trajectory that `write_npz` wrote; nothing in the file is executed.

    Args:
        path: The file.
        pepper: The robot whose joints the file must have, in its order; any joints if omitted.

    Raises:
        FileFormatError: naming path and array and what is wrong.
    """
    arrays = read_arrays(path, _ARRAYS)
    _check_tag(path, arrays["format"], arrays["version"])
    names, units = arrays["joint_names"], arrays["joint_units"]
    for name, texts in (("joint_names", names), ("joint_units", units)):
        if texts.dtype.kind != "U" or texts.ndim != 1:
            raise FileFormatError(path, f"{name} is {texts.dtype} of shape {texts.shape}, expected texts")
    joints = check_joint_names(path, names.tolist(), pepper)
    return build(path, joints, units.tolist(), arrays["breaks"], arrays["coefficients"], pepper)


def _check_tag(path: PathName, tag: Any, version: Any) -> None:
    if tag.shape != () or str(tag) != FORMAT:
        raise FileFormatError(path, f"format is {tag!r}, expected {FORMAT!r}")
    if version.shape != () or version.dtype.kind not in "iu" or int(version) != VERSION:
        raise FileFormatError(path, f"version is {version!r}, expected {VERSION}")


def build(
    path: PathName,
    names: tuple[str, ...],
    units: list[Any],
    breaks: Any,
    coefficients: Any,
    pepper: PepperModel | None,
) -> Trajectory:
    """Return the trajectory of what a file holds.

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
