"""Motions from files: trajectories in all formats, and runs of the twin."""

from __future__ import annotations

import os
from pathlib import Path

from pepper_kin.exceptions import FileFormatError
from pepper_kin.files import load
from pepper_kin.files.table_file import column_names
from pepper_kin.model import PepperModel
from pepper_kin.trajectory import Trajectory
from pepper_kin.twin import Run, load_recording, load_run

_RUN_COLUMN = ".torque"
SCENE_FILE = "scene.json"
"""Name of the file with the scene of the motions in the same folder."""


def load_motion(pepper: PepperModel, path: str | Path) -> Trajectory | Run:
    """Read a trajectory or a run of the twin.

    Args:
        pepper: The robot whose joints the file must have.
        path: A file of `pepper_kin.files.save` or `Run.save` (a table with columns of torque is a run), or
            the folder of a `Recorder`.

    Returns:
        A trajectory or a run.

    Raises:
        UnknownNameError: for an unknown suffix.
        MissingDependencyError: for .mcap without its package.
        FileFormatError: naming path, line and fault.
    """
    if os.path.isdir(path):
        recording = load_recording(path)
        if recording.joint_names != pepper.joint_names:
            raise FileFormatError(path, f"has other joints: {', '.join(recording.joint_names)}")
        return recording.run()
    suffix = Path(path).suffix.lower()
    columns = ",".join(column_names(path)) if suffix == ".parquet" else ""
    if _RUN_COLUMN in (_first_line(path) if suffix == ".csv" else columns):
        return load_run(pepper, path)
    return load(path, pepper=pepper)


def scene_beside(path: str | Path) -> Path | None:
    """Return the file of the scene of a motion: `scene.json` in its folder; None without one.

    Args:
        path: File or folder of the motion, as for `load_motion`.
    """
    folder = Path(path) if os.path.isdir(path) else Path(path).parent
    file = folder / SCENE_FILE
    return file if os.path.isfile(file) else None


def _first_line(path: str | Path) -> str:
    """Return the first line of a table; empty if it cannot be read, which the table's reader will report."""
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return file.readline()
    except OSError:
        return ""
