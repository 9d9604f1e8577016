"""Tables over time as Parquet, with unit, quantity and joint of each column in its schema."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import FileFormatError, optional, shortened
from pepper_kin.file_access.atomic_file import PathName, write_bytes
from pepper_kin.file_access.numpy_archive import MOST_BYTES
from pepper_kin.file_access.reading import read_bytes

_MEANING = b"pepper_kin"


def write_columns(path: PathName, columns: Mapping[str, Array], meaning: Mapping[str, Any]) -> None:
    """Write columns, shape (T,) each, and their meanings, values for JSON.

    Raises:
        MissingDependencyError: if pyarrow is not installed.
        FileFormatError: if the file cannot be written.
    """
    parquet = _parquet()
    import pyarrow as arrow

    fields = [
        arrow.field(name, arrow.float64(), False, {_MEANING: json.dumps(meaning[name]).encode()})
        for name in columns
    ]
    table = arrow.table([arrow.array(values) for values in columns.values()], schema=arrow.schema(fields))
    content = io.BytesIO()
    parquet.write_table(table, content, compression="zstd")
    write_bytes(path, content.getvalue())


def read_columns(path: PathName) -> tuple[dict[str, Array], dict[str, Any]]:
    """Read columns of floating-point numbers, such as from `write_columns`.

    Returns:
        Column -> values, shape (T,), in the file's order; and column -> meaning, if the file has it.

    Raises:
        MissingDependencyError: if pyarrow is not installed.
        FileFormatError: for a file that cannot be read, is damaged, has columns of other types, duplicate
            columns, values that are missing or not finite, or too much data.
    """
    parquet, content = _parquet(), read_bytes(path)
    import pyarrow as arrow

    try:
        file = parquet.ParquetFile(io.BytesIO(content))
        schema, rows = file.schema_arrow, file.metadata.num_rows
        if rows * len(schema) * 8 > MOST_BYTES:
            raise FileFormatError(path, f"announces {rows} rows of {len(schema)} columns: too much")
        for field in schema:
            if not arrow.types.is_floating(field.type):
                name = shortened(field.name)
                raise FileFormatError(path, f"column {name} is {shortened(str(field.type))}, expected floats")
        table = file.read()
        names = list(schema.names)
        columns = {name: np.array(table.column(k), dtype=float) for k, name in enumerate(names)}
        meaning = {
            field.name: json.loads(field.metadata[_MEANING])
            for field in schema
            if field.metadata and _MEANING in field.metadata
        }
    except FileFormatError:
        raise
    except MemoryError as error:
        raise FileFormatError(path, f"announces too much: {shortened(str(error))}") from error
    except Exception as error:  # pyarrow raises children of several bases
        raise FileFormatError(path, f"is not a complete Parquet file: {shortened(str(error))}") from error
    if len(columns) < len(names):
        raise FileFormatError(path, "has two columns of one name")
    for name, values in columns.items():
        if values.shape != (rows,) or not np.isfinite(values).all():
            raise FileFormatError(path, f"column {shortened(name)} holds what is no finite number")
    return columns, meaning


def _parquet() -> Any:
    """Return the module `pyarrow.parquet`."""
    return optional("pyarrow.parquet", extra="datasets", need="Parquet")
