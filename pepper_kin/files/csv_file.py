"""Trajectories as tables in CSV, or in Parquet by the file's suffix."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pepper_kin.exceptions import FileFormatError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.files.motion_points import MotionPoints
from pepper_kin.files.sampled_motion import points_of_file
from pepper_kin.files.table_file import TIME, column_meaning, column_names, load_table, save_table
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.trajectory import Trajectory

_QUANTITIES = ("position", "velocity", "acceleration")


def write_csv(path: PathName, points: MotionPoints) -> Path:
    """Write a motion as CSV; see `save_table` for the format.

    Columns: `time`, then `<joint>.position`, `<joint>.velocity` and, if known, `<joint>.acceleration` of all
    joints.

    Args:
        path: The file; its folder must exist.
        points: The motion at discrete times.

    Returns:
        The path.

    Raises:
        FileFormatError: if the file cannot be written.
    """
    columns = {TIME: points.time}
    for quantity in _QUANTITIES:
        values = getattr(points, quantity)
        if values is not None:
            columns.update({f"{name}.{quantity}": values[:, j] for j, name in enumerate(points.joint_names)})
    units = dict(zip(points.joint_names, points.joint_units, strict=True))
    return save_table(columns, path, joint_units=units)


def read_csv(path: PathName, pepper: PepperModel | None = None) -> Trajectory:
    """Read a trajectory that `write_csv` wrote.

    The trajectory has the positions, velocities and accelerations of the rows at their times; between rows it
    is a polynomial of degree 5, or of degree 3 if the file has no accelerations.

    Args:
        path: The file.
        pepper: The robot whose joints the file must have, in its order; any joints if omitted.

    Returns:
        The trajectory.

    Raises:
        FileFormatError: naming path, line and fault.
    """
    found = column_names(path)
    names = pepper.joint_names if pepper is not None else _joints(found)
    kinds = _QUANTITIES if any(name.endswith(_QUANTITIES[2]) for name in found) else _QUANTITIES[:2]
    table = load_table(path, [TIME, *(f"{name}.{kind}" for kind in kinds for name in names)])
    time = table[TIME]
    if time.size < 2:
        raise FileFormatError(path, "has one line of numbers, expected at least 2", 2)
    if time[0] != 0.0:
        raise FileFormatError(path, f"time begins at {float(time[0])!r}, expected 0", 2)
    values = [np.column_stack([table[f"{name}.{kind}"] for name in names]) for kind in kinds]
    units = pepper.joint_units if pepper is not None else _units(path, names)
    return points_of_file(path, names, units, time, *values)


def _joints(header: Sequence[str]) -> tuple[str, ...]:
    """Return the joints with a position column."""
    suffix = ".position"
    return tuple(name.removesuffix(suffix) for name in header if name.endswith(suffix)) or ("<joint>",)


def _units(path: PathName, names: Sequence[str]) -> tuple[str, ...]:
    """Return the joints' units from the table or its companion file, else radians."""
    known = column_meaning(path)
    units = (known.get(f"{name}.position", {}).get("unit", "rad") for name in names)
    return tuple(unit if unit in ("rad", "m") else "rad" for unit in units)
