"""NumPy archives, read within a memory limit: a compressed file can expand to a thousand times its size."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import FileFormatError, shortened
from pepper_kin.file_access.atomic_file import PathName, write_bytes
from pepper_kin.file_access.reading import read_bytes

MOST_BYTES = 500_000_000
"""Maximum size of the arrays of a file [bytes]."""


def write_arrays(path: PathName, arrays: Mapping[str, Any], *, compressed: bool = True) -> Path:
    """Write a NumPy archive atomically and return its path.

    Args:
        path: The file.
        arrays: Arrays, numbers and texts by name.
        compressed: Whether to compress the arrays.

    Raises:
        FileFormatError: naming the path and the reason why it cannot be written.
    """
    content = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(content, **arrays)
    return write_bytes(path, content.getvalue())


def read_kinds(path: PathName, tag: str, kinds: Mapping[str, tuple[str, int] | None]) -> dict[str, Any]:
    """Read an archive with a text `format` and arrays of known types.

    Args:
        path: The file.
        tag: Expected text of `format`.
        kinds: Array name -> allowed kinds of its dtype and number of axes; None for any.

    Returns:
        Arrays by name without `format`; arrays without axes as Python values.

    Raises:
        FileFormatError: for the faults of `read_arrays`, another format, dtype or number of axes, or floats
            that are not finite.
    """
    arrays: dict[str, Any] = read_arrays(path, ("format", *kinds))
    found = arrays.pop("format")
    if found.shape != () or str(found) != tag:
        raise FileFormatError(path, f"format is {shortened(repr(found))}, expected {tag!r}")
    for name, kind in kinds.items():
        array = arrays[name]
        if kind is None:
            continue
        if array.dtype.kind not in kind[0] or array.ndim != kind[1]:
            reason = f"{name} is {array.dtype} of shape {array.shape}, expected another kind"
            raise FileFormatError(path, reason)
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise FileFormatError(path, f"{name} holds numbers that are not finite")
        if array.ndim == 0:
            arrays[name] = array.item()
    return arrays


def read_arrays(path: PathName, expected: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Read all arrays of a NumPy archive; nothing in the file is executed.

    Args:
        path: The file.
        expected: Exact set of array names; any if omitted.

    Returns:
        The arrays by name.

    Raises:
        FileFormatError: naming the file, if it cannot be read, is damaged, has other arrays, or more than
            MOST_BYTES.
    """
    content = read_bytes(path)
    try:
        loaded = np.load(io.BytesIO(content), allow_pickle=False)
        if not isinstance(loaded, np.lib.npyio.NpzFile):
            raise FileFormatError(path, "is one array, expected a NumPy archive of several")
        with loaded as archive:
            names = sorted(archive.files)
            if len(set(names)) != len(names):
                raise FileFormatError(path, "holds two arrays of one name")
            if expected is not None and names != sorted(expected):
                listed = shortened(", ".join(names))
                raise FileFormatError(path, f"holds {listed}, expected {', '.join(sorted(expected))}")
            assert archive.zip is not None
            size = sum(int(member.file_size) for member in archive.zip.infolist())
            if size > MOST_BYTES:
                raise FileFormatError(path, f"holds {size} bytes of arrays, at most {MOST_BYTES} are read")
            arrays = {name: archive[name] for name in names}
            other = next((name for name, array in arrays.items() if not isinstance(array, np.ndarray)), None)
            if other is not None:  # NumPy returns bytes for a member that is not an array
                raise FileFormatError(path, f"is damaged: {shortened(repr(other))} is no array")
            return arrays
    except FileFormatError:
        raise
    except (ValueError, TypeError, AttributeError, EOFError, zipfile.BadZipFile, KeyError) as error:
        raise FileFormatError(path, f"is not a complete NumPy archive: {error}") from error
    except MemoryError as error:  # a damaged member may declare any size
        raise FileFormatError(path, f"announces too much: {error}") from error
    except Exception as error:  # such as zlib.error, which has no common base with the errors above
        raise FileFormatError(path, f"is damaged: {error}") from error


def decompressed(data: bytes, most: int = MOST_BYTES) -> bytes:
    """Return data decompressed by zlib.

    Raises:
        ValueError: if the content exceeds `most` bytes, or the data are damaged or truncated.
    """
    engine = zlib.decompressobj()
    try:
        content = engine.decompress(data, most)
    except zlib.error as error:
        raise ValueError(str(error)) from error
    if not engine.eof:
        long = engine.unconsumed_tail
        raise ValueError(f"more than {most} bytes when decompressed" if long else "cut short")
    return content
