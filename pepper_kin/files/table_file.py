"""Tables over time as CSV, with the meaning of columns in a companion file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import FileFormatError, InvalidValueError, shortened
from pepper_kin.file_access import atomic_file
from pepper_kin.file_access.atomic_file import PathName, as_path
from pepper_kin.file_access.reading import read_json, read_text, repeated
from pepper_kin.files.parquet_table import read_columns, write_columns
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.model.plain_number import plain_number
from pepper_kin.trajectory.samples import UNITS, unit_of

TIME = "time"
COLUMNS_FILE = "columns.json"
_KEYS = {"unit", "quantity", "joint"}


def save_table(
    columns: Mapping[str, ArrayLike], path: PathName, *, joint_units: Mapping[str, str] | None = None
) -> Path:
    """Write columns over time as CSV with their meaning in `columns.json` beside it, or as Parquet.

    The first line names the columns: `time` [s], then `<joint>.<quantity>` with a quantity of
    `pepper_kin.trajectory.samples.UNITS`.  Numbers are read back as the same floats. `columns.json` maps each
    column to {"unit", "quantity", "joint"}; tables in one folder share it. Each file is replaced atomically.
    A file .parquet has the same columns and contains their meaning.

    Args:
        columns: Name -> values, shape (T,); "time" comes first and increases.
        path: The file; its folder must exist.
        joint_units: Joint -> "rad" or "m"; "rad" for joints left out.

    Returns:
        The path.

    Raises:
        InvalidValueError: for an invalid name or value.
        UnknownNameError: for an unknown quantity.
        FileFormatError: if a file cannot be written, or `columns.json` has other contents.
    """
    target = as_path(path)
    names = list(columns)
    if not names or names[0] != TIME:
        raise InvalidValueError("columns", ", ".join(names[:3]), f"{TIME!r} as the first column")
    units = joint_units or {}
    meaning = {name: _meaning(name, units) for name in names}
    time = as_finite(columns[TIME], TIME, (None,))
    if np.any(np.diff(time) <= 0):
        raise InvalidValueError(TIME, "times that do not increase", "times that increase")
    if is_parquet(target):
        checked = {name: as_finite(values, name, (time.size,)) for name, values in columns.items()}
        write_columns(target, checked, meaning)
        return target
    table = np.column_stack([as_finite(values, name, (time.size,)) for name, values in columns.items()])
    companion = target.parent / COLUMNS_FILE
    known = load_columns(companion) if companion.exists() else {}
    lines = [",".join(names), *(",".join(map(repr, row)) for row in table.tolist())]
    atomic_file.write_text(target, "\n".join(lines) + "\n")
    atomic_file.write_text(companion, json.dumps({**known, **meaning}, indent=1) + "\n")
    return target


def _meaning(name: str, units: Mapping[str, str]) -> dict[str, str | None]:
    """Return unit, quantity and joint of a column."""
    if name == TIME:
        return {"unit": "s", "quantity": TIME, "joint": None}
    joint, dot, quantity = name.rpartition(".")
    if not dot or not joint or any(c in name for c in ',"\n\r'):
        raise InvalidValueError(
            "column", repr(name), "'<joint>.<quantity>' without commas, quotes or line ends"
        )
    return {"unit": unit_of(quantity, units.get(joint, "rad")), "quantity": quantity, "joint": joint}


def load_columns(path: PathName) -> dict[str, dict[str, Any]]:
    """Read a `columns.json`: column -> {"unit", "quantity", "joint"}.

    Raises:
        FileFormatError: if the file cannot be read or has other contents.
    """
    return _meanings(path, read_json(path)[0])


def _meanings(path: PathName, content: Any) -> dict[str, dict[str, Any]]:
    """Return the meaning of columns, after a check that each is complete."""
    rows = content.values() if isinstance(content, dict) else [None]
    if not all(isinstance(row, dict) and set(row) == _KEYS and _texts(row) for row in rows):
        raise FileFormatError(path, "does not map columns to unit, quantity and joint")
    return dict(content)


def _texts(row: dict[str, Any]) -> bool:
    """Whether unit and quantity are texts, and the joint a text or None."""
    joint = row["joint"]
    return isinstance(row["unit"], str) and isinstance(row["quantity"], str) and isinstance(joint, str | None)


def load_table(path: PathName, expected: Sequence[str] | None = None) -> dict[str, Array]:
    """Read a table that `save_table` wrote.

    Args:
        path: The file, CSV or Parquet.
        expected: Required columns in order; any well-formed columns if omitted.

    Returns:
        Column -> values, shape (T,), "time" first.

    Raises:
        FileFormatError: naming path and line, for a file that cannot be read or is not a table; columns that
            are missing, unknown, duplicate or in another order; a truncated line; NaN; times that do not
            increase.
    """
    if is_parquet(path):
        columns, _ = read_columns(path)
        _check_parquet(path, columns)
        _check_header(path, list(columns), expected)
        return columns
    names, rows = read_lines(path)
    _check_header(path, names, expected)
    return numbers_of(path, names, rows)


def is_parquet(path: PathName) -> bool:
    """Return whether a table has the suffix of Parquet."""
    return as_path(path).suffix.lower() == ".parquet"


def column_names(path: PathName) -> list[str]:
    """Return the names of a table's columns, "time" first.

    Raises:
        FileFormatError: if the file is not a table.
    """
    if not is_parquet(path):
        return read_lines(path)[0]
    columns, _ = read_columns(path)
    _check_parquet(path, columns)
    return list(columns)


def column_meaning(path: PathName) -> dict[str, dict[str, Any]]:
    """Return column -> {"unit", "quantity", "joint"} of a table, from the table or its companion file.

    Raises:
        FileFormatError: if the meanings are malformed.
    """
    companion = as_path(path).with_name(COLUMNS_FILE)
    if is_parquet(path):
        return _meanings(path, read_columns(path)[1])
    return load_columns(companion) if companion.exists() else {}


def _check_parquet(path: PathName, columns: Mapping[str, Array]) -> None:
    """Refuse columns that are not a table over time."""
    if next(iter(columns), None) != TIME:
        raise FileFormatError(path, f"is not a table: its first column is not {TIME!r}")
    if not columns[TIME].size:
        raise FileFormatError(path, "has no row of numbers")
    if np.any(np.diff(columns[TIME]) <= 0):
        raise FileFormatError(path, "times do not increase")


def numbers_of(path: PathName, names: list[str], rows: list[str]) -> dict[str, Array]:
    """Return the numbers in the lines of a table, column -> values, shape (T,).

    Raises:
        FileFormatError: naming path and line, for faults after the first line.
    """
    for i, row in enumerate(rows):  # check all rows before memory for the columns is allocated
        if row.count(",") != len(names) - 1:
            raise FileFormatError(path, f"{row.count(',') + 1} values for {len(names)} columns", i + 2)
    table = np.empty((len(rows), len(names)))
    for i, row in enumerate(rows):
        table[i] = _numbers(path, i + 2, row, names)
    falling = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if falling.size:
        at = int(falling[0]) + 1
        reason = (
            f"time {float(table[at, 0])!r} does not come after {float(table[at - 1, 0])!r} of the line before"
        )
        raise FileFormatError(path, reason, at + 2)
    return {name: table[:, i].copy() for i, name in enumerate(names)}


def read_lines(path: PathName) -> tuple[list[str], list[str]]:
    """Return the names of a table's columns, "time" first, and its lines of numbers.

    Raises:
        FileFormatError: for a file that cannot be read, is truncated, or lacks the names or numbers.
    """
    text = read_text(path)
    lines = text.split("\n")
    if lines[0].split(",")[0].strip() != TIME:
        raise FileFormatError(path, f"is not a table: its first line does not begin with {TIME!r}", 1)
    if lines[-1] != "":
        raise FileFormatError(path, "is truncated: its last line does not end with a newline", len(lines))
    if len(lines) < 3:
        raise FileFormatError(path, "has no line of numbers", 1)
    return lines[0].rstrip("\r").split(","), lines[1:-1]


def _check_header(path: PathName, names: list[str], expected: Iterable[str] | None) -> None:
    """Refuse column names that are duplicate, unknown, missing or in another order."""
    if len(set(names)) < len(names):
        doubled = repeated(names)[0]
        raise FileFormatError(path, f"column {shortened(repr(doubled))} occurs twice", 1)
    for name in names[1:]:
        joint, _, quantity = name.rpartition(".")
        if not joint or quantity not in UNITS:
            known = ", ".join(UNITS)
            raise FileFormatError(
                path,
                f"unknown column {shortened(repr(name))}, expected <joint>.<quantity>, one of {known}",
                1,
            )
    if expected is None:
        return
    wanted = list(expected)
    if not all(isinstance(name, str) for name in wanted):
        raise InvalidValueError("expected", repr(wanted), "names of columns")
    present, possible = set(names), set(wanted)
    missing, unknown = [n for n in wanted if n not in present], [n for n in names if n not in possible]
    if unknown:
        hint = _known(unknown[0], wanted)
        raise FileFormatError(path, f"unknown column {shortened(repr(unknown[0]))}{hint}", 1)
    if missing:
        raise FileFormatError(path, f"column {missing[0]!r} is missing", 1)
    if names != wanted:
        name, place = next((n, w) for n, w in zip(names, wanted, strict=True) if n != w)
        raise FileFormatError(path, f"columns in another order: {name!r} where {place!r} belongs", 1)


def _known(name: str, wanted: list[str]) -> str:
    """Return the known columns, for the message about an unknown column."""
    parts = [column.rpartition(".") for column in wanted if column != TIME]
    joint = name.rpartition(".")[0]
    kinds = ", ".join(quantity for owner, _, quantity in parts if owner == joint)
    joints = ", ".join(dict.fromkeys(owner for owner, _, _ in parts))
    return f"; of {joint} there can be {kinds}" if kinds else f"; the joints are {joints}" if joints else ""


def _numbers(path: PathName, line: int, row: str, names: list[str]) -> list[float]:
    """Return the finite numbers of a line."""
    cells = row.split(",")
    # Usual numbers are ASCII, without the other forms that `float` accepts: 1_0, infinity, other digits.
    try:
        values = [float(cell) for cell in cells] if row.isascii() and "_" not in row else []
    except ValueError:
        values = []
    if values and all(map(math.isfinite, values)):
        return values
    values = [plain_number(cell) for cell in cells]
    for name, cell, value in zip(names, cells, values, strict=True):
        if not math.isfinite(value):
            shown = shortened(repr(cell.strip()))
            raise FileFormatError(path, f"{shortened(name)} is {shown}, expected a finite number", line)
    return values
