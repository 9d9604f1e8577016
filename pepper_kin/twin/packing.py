"""Lossless packing of time series: neighboring values differ little, so their differences pack well."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.numpy_archive import decompressed

_HEAD = np.dtype("<i8")
_LEVEL = 6
_DIFFERENCES = b"differences"
_MOST_DIFFERENCES = 6


def pack(values: ArrayLike) -> NDArray[np.uint8]:
    """Pack an array losslessly.

    64-bit floats are treated as integers, whose differences in time (exact, modulo 2^64) are stored, for each
    column of the order with the smallest result, at most 6; signs go to the lowest bit, and bytes of equal
    weight are grouped before they are deflated.  A series that follows a polynomial shrinks to the rounding
    errors of its samples, a constant series to nothing.  Other arrays are deflated unchanged.

    Args:
        values: Numbers or booleans, shape (T, ...).

    Returns:
        Bytes that `unpack` reads.
    """
    array = np.ascontiguousarray(values)
    floats = array.dtype == np.float64
    kind = _DIFFERENCES if floats else array.dtype.str.encode()
    head = np.array([len(kind), array.ndim, *array.shape], dtype=_HEAD).tobytes() + kind
    body = _differences(array) if floats else array.tobytes()
    return np.frombuffer(head + zlib.compress(body, _LEVEL), dtype=np.uint8)


def _differences(array: NDArray[np.float64]) -> bytes:
    """Return the order of each column, followed by all bytes of the differences, the lowest first.

    Args:
        array: Floats, shape (T, ...).
    """
    words = array.reshape(len(array), math.prod(array.shape[1:])).view(np.int64)
    best, orders = words, np.zeros(words.shape[1], dtype=np.uint8)
    least = _bits(words)
    for order in range(1, _MOST_DIFFERENCES + 1):
        words = np.concatenate([words[:1], words[1:] - words[:-1]])
        bits = _bits(words)
        fewer = bits < least
        best, orders[fewer] = np.where(fewer, words, best), order
        least = np.where(fewer, bits, least)
    unsigned = ((best << 1) ^ (best >> 63)).view(np.uint64)
    planes = np.ascontiguousarray(unsigned.T).view(np.uint8).reshape(unsigned.size, 8).T
    return orders.tobytes() + planes.tobytes()


def _bits(words: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the approximate number of bits in each column of words, shape (T, columns), shape (columns,)."""
    return np.log2(1.0 + np.abs(words.astype(np.float64))).sum(axis=0)


def unpack(packed: NDArray[np.uint8]) -> NDArray[Any]:
    """Return the array that was packed, to the last bit.

    Args:
        packed: Bytes that `pack` returned, shape (k,).

    Raises:
        InvalidValueError: for damaged bytes.
    """
    if packed.dtype != np.uint8 or packed.ndim != 1:
        raise InvalidValueError("packed series", f"{packed.dtype} of shape {packed.shape}", "bytes")
    data = packed.tobytes()
    try:
        size, ndim = np.frombuffer(data[:16], _HEAD)
        shape = tuple(int(x) for x in np.frombuffer(data[16 : 16 + 8 * int(ndim)], _HEAD))
        begin = 16 + 8 * int(ndim)
        kind = data[begin : begin + int(size)]
        body = decompressed(data[begin + int(size) :])
        if kind == _DIFFERENCES:
            return _summed(body, shape)
        return np.frombuffer(body, np.dtype(kind.decode())).reshape(shape).copy()
    except (ValueError, TypeError, OverflowError, IndexError) as error:
        raise InvalidValueError("packed series", f"{len(data)} bytes", f"whole ones ({error})") from error


def pack_moved(
    position: NDArray[np.float64], velocity: NDArray[np.float64], start: NDArray[np.float64], h: float
) -> NDArray[np.uint8]:
    """Pack positions that follow from velocities, q = q_before + h v, by their rounding differences.

    Args:
        position: Positions [rad or m], shape (T, n).
        velocity: Velocities [rad/s or m/s], shape (T, n).
        start: Position before the first [rad or m], shape (n,).
        h: Timestep [s].

    Returns:
        Bytes that `unpack_moved` reads, with the same velocities, start and h.
    """
    before = np.concatenate([start[np.newaxis], position[:-1]])
    expected = np.ascontiguousarray(before + h * velocity)
    left = np.ascontiguousarray(position).view(np.int64) - expected.view(np.int64)
    return pack(left.view(np.float64))


def unpack_moved(
    packed: NDArray[np.uint8], velocity: NDArray[np.float64], start: NDArray[np.float64], h: float
) -> NDArray[np.float64]:
    """Return the positions that `pack_moved` packed, to the last bit.

    Args:
        packed: Bytes that `pack_moved` returned, shape (k,).
        velocity: Velocities [rad/s or m/s], shape (T, n).
        start: Position before the first [rad or m], shape (n,).
        h: Timestep [s].

    Returns:
        Positions [rad or m], shape (T, n).

    Raises:
        InvalidValueError: for damaged bytes.
    """
    rest = unpack(packed)
    if rest.shape != velocity.shape or rest.dtype != np.float64:
        raise InvalidValueError("packed series", f"shape {rest.shape}", f"shape {velocity.shape}")
    left, position, now = rest.view(np.int64), np.empty_like(velocity), start
    for k in range(len(velocity)):
        now = ((now + h * velocity[k]).view(np.int64) + left[k]).view(np.float64)
        position[k] = now
    return position


def pack_together(series: Mapping[str, tuple[list[str], list[NDArray[np.uint8]]]]) -> NDArray[np.uint8]:
    """Pack many packed series into one, since each member of an archive would take some hundred bytes more.

    Args:
        series: Name -> its metadata, and its parts as packed by `pack`, shape (k,) each.

    Returns:
        Bytes that `unpack_together` reads.
    """
    index = {name: [about, [len(part) for part in parts]] for name, (about, parts) in series.items()}
    body = b"".join(part.tobytes() for _, parts in series.values() for part in parts)
    packed = json.dumps(index, separators=(",", ":")).encode() + b"\n" + body
    return np.frombuffer(zlib.compress(packed, _LEVEL), dtype=np.uint8)


def unpack_together(packed: NDArray[np.uint8]) -> dict[str, tuple[list[str], list[NDArray[np.uint8]]]]:
    """Return the arguments of `pack_together`.

    Args:
        packed: Bytes that `pack_together` returned, shape (k,).

    Raises:
        InvalidValueError: for damaged bytes.
    """
    found: dict[str, tuple[list[str], list[NDArray[np.uint8]]]] = {}
    try:
        line, _, body = decompressed(np.asarray(packed, dtype=np.uint8).tobytes()).partition(b"\n")
        start = 0
        for name, (about, sizes) in json.loads(line).items():
            ends = (start + np.cumsum([0, *sizes])).tolist()
            parts = [np.frombuffer(body[a:b], np.uint8) for a, b in pairwise(ends)]
            found[name], start = (about, parts), ends[-1]
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise InvalidValueError(
            "packed series", f"{np.size(packed)} bytes", f"whole ones ({error})"
        ) from error
    if start != len(body):
        raise InvalidValueError("packed series", f"{len(body)} bytes", f"{start} bytes")
    return found


def _summed(body: bytes, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the array, of a given shape, from the bytes that `_differences` returned."""
    count = math.prod(shape[1:])
    orders = np.frombuffer(body[:count], np.uint8)
    unsigned = _words(body[count:], count, shape[0])
    words = (unsigned >> np.uint64(1)) ^ (np.uint64(0) - (unsigned & np.uint64(1)))
    for order in range(1, int(orders.max(initial=0)) + 1):
        part = orders >= order
        words[:, part] = np.cumsum(words[:, part], axis=0, dtype=np.uint64)
    return np.ascontiguousarray(words).view(np.float64).reshape(shape)


def _words(planes: bytes, columns: int, rows: int) -> NDArray[np.uint64]:
    """Return the words, shape (rows, columns), from bytes grouped by weight."""
    bytes_of_words = np.frombuffer(planes, np.uint8).reshape(8, rows * columns).T.copy()
    return np.ascontiguousarray(bytes_of_words.view(np.uint64).reshape(columns, rows).T)
