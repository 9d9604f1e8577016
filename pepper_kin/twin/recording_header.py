"""The header of a recording: `recording.json`, with a checksum and a check of every entry."""

from __future__ import annotations

import json
import math
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pepper_kin.dynamics.load import Load, Loads
from pepper_kin.exceptions import FileFormatError, shortened
from pepper_kin.file_access import atomic_file
from pepper_kin.file_access.reading import read_json
from pepper_kin.twin.integrator import GREATEST_TIMESTEP
from pepper_kin.twin.twin import FEEDFORWARDS

HEADER = "recording.json"
FORMAT = "pepper_kin.recording 2"
_LOAD_TEXTS = 12  # number of texts that describe a load
STATES = ("position", "velocity", "torque")


def _whole(least: int) -> Callable[[Any], bool]:
    return lambda value: type(value) is int and value >= least


def _texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(text, str) for text in value)


def described(loads: Loads) -> list[list[Any]]:
    """Return loads for JSON: frame, mass, center of mass, inertia, name; numbers in hexadecimal."""
    return [
        [load.frame, *(float(x).hex() for x in (load.mass, *load.center, *load.inertia)), load.name]
        for load in loads
    ]


def loads_in(header: dict[str, Any]) -> Loads:
    """Return the loads of the robot in a recording."""
    found = []
    for frame, *texts, name in header["loads"]:
        mass, x, y, z, xx, xy, xz, yy, yz, zz = map(float.fromhex, texts)
        found.append(Load(frame, mass, (x, y, z), (xx, xy, xz, yy, yz, zz), name))
    return tuple(found)


def _are_loads(value: Any) -> bool:
    return isinstance(value, list) and all(
        _texts(row) and len(row) == _LOAD_TEXTS and all(map(_is_hex, row[1:-1])) for row in value
    )


_ENTRIES: dict[str, tuple[Callable[[Any], bool], str]] = {
    "format": (lambda value: value == FORMAT, repr(FORMAT)),
    "robot": (lambda value: isinstance(value, str), "the robot's name"),
    "joints": (lambda value: _texts(value) and 0 < len(set(value)) == len(value), "the joints, each once"),
    "units": (lambda value: _texts(value) and set(value) <= {"rad", "m"}, '"rad" or "m" for each joint'),
    "timestep": (
        lambda value: isinstance(value, float) and 0.0 < value <= GREATEST_TIMESTEP,
        f"a number in (0, {GREATEST_TIMESTEP}] [s]",
    ),
    "substeps": (_whole(1), "a whole number from 1"),
    "feedforward": (lambda value: value in FEEDFORWARDS, f"one of {', '.join(FEEDFORWARDS)}"),
    "chunk_steps": (_whole(1), "a whole number from 1"),
    "seed": (lambda value: type(value) is int, "a whole number"),
    "sensors": (_texts, "names of sensors"),
    "loads": (_are_loads, "frame, ten numbers in hexadecimal and name of each load"),
    "start": (lambda value: isinstance(value, dict), f"{', '.join(STATES)}"),
}


def write_header(folder: Path, header: dict[str, Any]) -> None:
    """Write the header of a recording, with its format and checksum.

    Raises:
        FileFormatError: if the file cannot be written.
    """
    whole = {"format": FORMAT, **header}
    whole["checksum"] = _checksum(whole)
    atomic_file.write_text(folder / HEADER, json.dumps(whole, indent=1) + "\n")


def read_header(folder: Path) -> dict[str, Any]:
    """Read and check the header of a recording.

    Raises:
        FileFormatError: for a missing or wrong entry, naming the file and the entry.
    """
    path = folder / HEADER
    if not os.path.isfile(path):
        raise FileFormatError(path, "no recording here: there is no such file")
    header, _ = read_json(path)
    needed = (*(name for name in _ENTRIES if name != "loads"), "checksum")
    missing = [name for name in needed if not isinstance(header, dict) or name not in header]
    if missing:
        raise FileFormatError(path, f"the header lacks {', '.join(missing)}")
    for name, (is_right, expected) in _ENTRIES.items():
        if name in header and not is_right(header[name]):
            raise FileFormatError(path, f"{name} is {shortened(repr(header[name]))}, expected {expected}")
    count = len(header["joints"])
    if len(header["units"]) != count:
        raise FileFormatError(path, f"expected a unit for each of {count} joints")
    for name in STATES:
        values = header["start"].get(name)
        if not isinstance(values, list) or len(values) != count or not all(map(_is_hex, values)):
            raise FileFormatError(path, f"start: {name} is not {count} finite numbers in hexadecimal")
    checksum = header.pop("checksum")
    if checksum != _checksum(header):
        raise FileFormatError(path, "its checksum is another: the header was changed after it was written")
    return {"loads": [], **header}


def _is_hex(value: Any) -> bool:
    try:
        return isinstance(value, str) and math.isfinite(float.fromhex(value))
    except (ValueError, OverflowError):
        return False


def _checksum(header: dict[str, Any]) -> int:
    return zlib.crc32(json.dumps(header, sort_keys=True).encode())
