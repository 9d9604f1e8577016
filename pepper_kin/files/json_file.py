"""Trajectories as JSON: exact, and readable by other programs."""

from __future__ import annotations

import json
from pathlib import Path

from pepper_kin.exceptions import FileFormatError
from pepper_kin.file_access import atomic_file, reading
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.reading import line_of
from pepper_kin.files.npz_file import FORMAT, VERSION, build
from pepper_kin.files.sampled_motion import check_joint_names
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.trajectory import Trajectory

_FIELDS = ("format", "version", "joint_names", "joint_units", "breaks", "coefficients")


def write_json(path: PathName, trajectory: Trajectory) -> Path:
    """Write the polynomials of a trajectory as JSON, each segment on its own line.

    Fields: "format", "version", "joint_names", "joint_units", "breaks" (m + 1 times [s]) and "coefficients":
    for each of m pieces a list of powers of (t - break), constant term first, each a list over joints.

    Raises:
        FileFormatError: if the file cannot be written.
    """
    segments = ",\n".join("  " + json.dumps(segment) for segment in trajectory.coefficients.tolist())
    head = {
        "format": FORMAT,
        "version": VERSION,
        "joint_names": trajectory.joint_names,
        "joint_units": trajectory.joint_units,
        "breaks": trajectory.breaks.tolist(),
    }
    lines = [f'"{name}": {json.dumps(value)}' for name, value in head.items()]
    return atomic_file.write_text(
        path, "{\n" + ",\n".join(lines) + ',\n"coefficients": [\n' + segments + "\n]\n}\n"
    )


def read_json(path: PathName, pepper: PepperModel | None = None) -> Trajectory:
    """Read a trajectory that `write_json` wrote.

    Args:
        path: The file.
        pepper: The robot whose joints the file must have, in its order; any joints if omitted.

    Raises:
        FileFormatError: naming path, line or field, and fault.
    """
    content, text = reading.read_json(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise FileFormatError(path, f'is not a trajectory: it lacks "format": "{FORMAT}"', 1)
    for name in _FIELDS:
        if name not in content:
            raise FileFormatError(path, f"field {name!r} is missing")
    for name in content:
        if name not in _FIELDS:
            raise FileFormatError(path, f"unknown field {name!r}", line_of(text, f'"{name}"'))
    if content["version"] != VERSION or type(content["version"]) is not int:
        raise FileFormatError(path, f"version is {content['version']!r}, expected {VERSION}")
    for name in ("joint_names", "joint_units", "breaks", "coefficients"):
        if not isinstance(content[name], list):
            raise FileFormatError(path, f"{name} is not a list", line_of(text, f'"{name}"'))
    names = check_joint_names(path, content["joint_names"], pepper, line_of(text, '"joint_names"'))
    return build(path, names, content["joint_units"], content["breaks"], content["coefficients"], pepper)
