"""Trajectories as JSON: exact, and readable by other programs."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any, NoReturn

from pepper_kin import atomic_file
from pepper_kin.atomic_file import PathName
from pepper_kin.exceptions import FileFormatError
from pepper_kin.files.npz_file import FORMAT, VERSION, build
from pepper_kin.files.sampled_motion import check_joint_names
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.trajectory import Trajectory

_FIELDS = ("format", "version", "joint_names", "joint_units", "breaks", "coefficients")


def write_json(path: PathName, trajectory: Trajectory) -> Path:
    """Write the polynomials of a trajectory as JSON, each piece on its own line.

    Fields: "format", "version", "joint_names", "joint_units", "breaks" (m + 1 times [s]) and "coefficients":
    for each of m pieces a list of powers of (t - break), constant term first, each a list over joints.

    Raises:
        FileFormatError: where the file cannot be written.
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
        FileFormatError: naming path, and line or field, and what is wrong.
    """
    text = read_utf8(path)

    def refuse(word: str) -> NoReturn:
        raise FileFormatError(path, f"holds {word}, expected finite numbers", _line_of(text, word))

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        names = [name for name, _ in pairs]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise FileFormatError(path, f"field {name!r} occurs twice", _line_of(text, f'"{name}"', 2))
        return dict(pairs)

    def number(digits: str) -> float:
        value = float(digits)
        return value if math.isfinite(value) else refuse(digits)

    try:
        content = json.loads(text, parse_constant=refuse, parse_float=number, object_pairs_hook=unique)
    except json.JSONDecodeError as error:
        raise FileFormatError(path, f"is not whole JSON: {error.msg}", error.lineno) from error
    except (RecursionError, ValueError) as error:
        raise FileFormatError(path, f"is not JSON of a trajectory: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise FileFormatError(path, f'is not a trajectory: it lacks "format": "{FORMAT}"', 1)
    for name in _FIELDS:
        if name not in content:
            raise FileFormatError(path, f"field {name!r} is missing")
    for name in content:
        if name not in _FIELDS:
            raise FileFormatError(path, f"unknown field {name!r}", _line_of(text, f'"{name}"'))
    if content["version"] != VERSION:
        raise FileFormatError(path, f"version is {content['version']!r}, expected {VERSION}")
    for name in ("joint_names", "joint_units", "breaks", "coefficients"):
        if not isinstance(content[name], list):
            raise FileFormatError(path, f"{name} is not a list", _line_of(text, f'"{name}"'))
    names = check_joint_names(path, content["joint_names"], pepper, _line_of(text, '"joint_names"'))
    return build(path, names, content["joint_units"], content["breaks"], content["coefficients"], pepper)


def read_utf8(path: PathName) -> str:
    """Return the text of a file.

    Raises:
        FileFormatError: where it cannot be read, or is not UTF-8.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise FileFormatError(path, f"cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise FileFormatError(path, "is not text in UTF-8") from error


def _line_of(text: str, word: str, occurrence: int = 1) -> int | None:
    places = [match.start() for match in re.finditer(re.escape(word), text)]
    return text.count("\n", 0, places[occurrence - 1]) + 1 if len(places) >= occurrence else None
