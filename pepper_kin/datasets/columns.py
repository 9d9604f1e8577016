"""Columns of a dataset, and their conversion to and from Arrow arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

MOST_FOR_STATISTICS = 4096
"""Maximum size of an item with statistics; a larger item is a picture."""


@dataclass(frozen=True)
class Column:
    """A column: a number, a text or an array in each row, or in each frame of a row's motion.

    Attributes:
        name: Name of the column.
        dtype: NumPy dtype of the numbers, or "str".
        shape: Shape of an item; () for a number.
        frames: Whether rows hold a sequence of items, one per frame.
        unit: Unit of the numbers; empty for none.
        names: Names of the entries of the last axis, such as joints; empty for none.
    """

    name: str
    dtype: str = "float64"
    shape: tuple[int, ...] = ()
    frames: bool = False
    unit: str = ""
    names: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of elements of an item."""
        return int(np.prod(self.shape, dtype=int))

    @property
    def counted(self) -> bool:
        """Whether the column has statistics."""
        return self.dtype != "str" and self.size <= MOST_FOR_STATISTICS

    def field(self) -> pa.Field:
        """Return the column as an Arrow field, whose metadata hold shape, unit and names."""
        kind = pa.string() if self.dtype == "str" else pa.from_numpy_dtype(np.dtype(self.dtype))
        if self.shape:
            kind = pa.list_(kind, self.size)
        about = {"shape": list(self.shape), "frames": self.frames, "unit": self.unit, "names": self.names}
        kind = pa.list_(kind) if self.frames else kind
        return pa.field(self.name, kind, nullable=False, metadata={"pepper_kin": json.dumps(about)})

    @classmethod
    def of(cls, field: pa.Field) -> Column:
        """Return the column of a field.

        Raises:
            ValueError, KeyError: for a field that is not from `field`.
        """
        about = json.loads((field.metadata or {})[b"pepper_kin"])
        kind = field.type.value_type if about["frames"] else field.type
        kind = kind.value_type if about["shape"] else kind
        dtype = "str" if pa.types.is_string(kind) else np.dtype(kind.to_pandas_dtype()).name
        rest = (tuple(about["shape"]), about["frames"], about["unit"], tuple(about["names"]))
        column = cls(field.name, dtype, *rest)
        if not column.field().equals(field):
            raise ValueError(f"column {field.name} is {field.type}, not as described")
        return column


def schema_of(columns: Sequence[Column], about: Mapping[str, str]) -> pa.Schema:
    """Return the Arrow schema of a file, with `about` as metadata."""
    return pa.schema([column.field() for column in columns], metadata=dict(about))


def batch_of(schema: pa.Schema, columns: Sequence[Column], values: Mapping[str, Any]) -> pa.RecordBatch:
    """Return rows as an Arrow batch: arrays of shape (N, ...), or (T, ...) of the frames of a single row."""
    return pa.RecordBatch.from_arrays([_encoded(c, values[c.name]) for c in columns], schema=schema)


def _encoded(column: Column, value: Any) -> pa.Array:
    """Return the values of a column as an Arrow array."""
    if column.dtype == "str":
        texts = [text.encode() for text in value]
        ends = np.cumsum([0, *map(len, texts)], dtype=np.int32)
        buffers = [None, pa.py_buffer(ends), pa.py_buffer(b"".join(texts))]
        return pa.Array.from_buffers(pa.string(), len(texts), buffers)
    array = np.ascontiguousarray(value, dtype=column.dtype)
    if array.shape[1:] != column.shape:
        raise ValueError(f"{column.name} has items of shape {array.shape[1:]}, not {column.shape}")
    found = _plain(array.reshape(-1))
    if column.shape:
        found = pa.FixedSizeListArray.from_arrays(found, column.size)
    edges = np.array([0, len(array)], np.int32)
    return pa.ListArray.from_arrays(_plain(edges), found) if column.frames else found


def _plain(array: NDArray[Any]) -> pa.Array:
    """Return numbers as an Arrow array, without `pa.array`, which imports pandas, half of a start's time."""
    if array.dtype == bool:
        return pa.array(array)
    return pa.Array.from_buffers(pa.from_numpy_dtype(array.dtype), array.size, [None, pa.py_buffer(array)])


def decoded(column: Column, array: pa.Array | pa.ChunkedArray) -> Any:
    """Return a column as a NumPy array, (N, ...), a list of texts, or for frames a list of (T, ...)."""
    if isinstance(array, pa.ChunkedArray):
        array = array.combine_chunks() if array.num_chunks != 1 else array.chunk(0)
    if column.dtype == "str":
        return array.to_pylist()
    if column.frames:
        edges = array.offsets.to_numpy()
        items = _items(column, array.values)
        return [items[begin:end] for begin, end in pairwise(edges)]
    return _items(column, array)


def _items(column: Column, array: pa.Array) -> NDArray[Any]:
    """Return the items of an Arrow array as a NumPy array, shape (N, ...)."""
    flat = array.flatten() if column.shape else array
    if column.dtype == "bool":
        return np.asarray(flat.to_numpy(zero_copy_only=False)).reshape(-1, *column.shape)
    return np.asarray(flat.to_numpy()).reshape(-1, *column.shape)


class Moments:
    """Count, minimum, maximum, mean and standard deviation of the finite numbers of a column.

    For two parts a and b:  mean = (n_a m_a + n_b m_b) / n,
    M = M_a + M_b + (m_b - m_a)^2 n_a n_b / n,  std = sqrt(M / n)   (T. F. Chan et al., 1983).

    Args:
        parts: count, min, max, mean and M, shape (size,) each; no items if omitted.
    """

    def __init__(self, parts: Sequence[Any] | None = None) -> None:
        self.parts = None if parts is None else np.array(parts, dtype=float)

    def add(self, items: NDArray[Any]) -> None:
        """Add items to the statistics, shape (N, ...)."""
        if not len(items):
            return
        flat = np.asarray(items, dtype=float).reshape(len(items), -1)
        good = np.isfinite(flat)
        count = good.sum(axis=0)
        some = np.maximum(count, 1)
        mean = np.where(good, flat, 0.0).sum(axis=0) / some
        squares = (np.where(good, flat - mean, 0.0) ** 2).sum(axis=0)
        least = np.where(good, flat, np.inf).min(axis=0)
        self.merge(np.array([count, least, np.where(good, flat, -np.inf).max(axis=0), mean, squares]))

    def merge(self, parts: NDArray[Any]) -> None:
        """Add the statistics of other items, shape (5, size)."""
        if self.parts is None:
            self.parts = parts.copy()
            return
        (a, low, high, mean_a, m_a), (b, low_b, high_b, mean_b, m_b) = self.parts, parts
        count = np.maximum(a + b, 1)
        mean, way = (a * mean_a + b * mean_b) / count, mean_b - mean_a
        squares = m_a + m_b + way**2 * a * b / count
        self.parts = np.array([a + b, np.minimum(low, low_b), np.maximum(high, high_b), mean, squares])

    def as_dict(self) -> dict[str, list[Any]]:
        """Return the statistics by name, None for entries without a finite number."""
        count, low, high, mean, squares = self.parts  # type: ignore[misc]
        some = count > 0
        rows = {"min": low, "max": high, "mean": mean, "std": np.sqrt(squares / np.maximum(count, 1))}
        found = {k: [float(x) if s else None for x, s in zip(v, some, strict=True)] for k, v in rows.items()}
        return {"count": count.astype(int).tolist(), **found}
