"""Series of numbers packed without loss: neighbours in time differ little, so their differences pack well."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError

_HEAD = np.dtype("<i8")
_LEVEL = 6


def pack(values: ArrayLike) -> NDArray[np.uint8]:
    """Pack an array losslessly.

    Floats of 64 bits are taken as integers, of which the second difference in time is kept (exact, modulo
    2^64), and bytes of equal weight are put together before they are deflated: smooth series then need about
    half their size, constant ones nothing.  Other arrays are deflated as they are.

    Args:
        values: Numbers or booleans, shape (T, ...).

    Returns:
        Bytes that `unpack` reads.
    """
    array = np.ascontiguousarray(values)
    kind = array.dtype.str.encode()
    head = np.array([len(kind), array.ndim, *array.shape], dtype=_HEAD).tobytes() + kind
    if array.dtype == np.float64:
        words = array.reshape(len(array), -1).view(np.uint64)
        for _ in range(2):
            words = np.concatenate([words[:1], words[1:] - words[:-1]])
        body = np.ascontiguousarray(words.T).view(np.uint8).reshape(-1, 8).T.tobytes()
    else:
        body = array.tobytes()
    return np.frombuffer(head + zlib.compress(body, _LEVEL), dtype=np.uint8)


def unpack(packed: NDArray[np.uint8]) -> NDArray:
    """Return the array that was packed, to the last bit.

    Raises:
        InvalidValueError: where the bytes are damaged.
    """
    data = np.asarray(packed, dtype=np.uint8).tobytes()
    try:
        size, ndim = np.frombuffer(data[:16], _HEAD)
        shape = tuple(int(x) for x in np.frombuffer(data[16 : 16 + 8 * int(ndim)], _HEAD))
        begin = 16 + 8 * int(ndim)
        dtype = np.dtype(data[begin : begin + int(size)].decode())
        body = zlib.decompress(data[begin + int(size) :])
        if dtype != np.float64:
            return np.frombuffer(body, dtype).reshape(shape).copy()
        count = int(np.prod(shape[1:], dtype=int))
        words = (
            np.frombuffer(body, np.uint8).reshape(8, -1).T.copy().view(np.uint64).reshape(count, shape[0]).T
        )
        for _ in range(2):
            words = np.cumsum(words, axis=0, dtype=np.uint64)
        return np.ascontiguousarray(words).view(np.float64).reshape(shape)
    except (ValueError, TypeError, UnicodeDecodeError, zlib.error) as error:
        raise InvalidValueError("packed series", f"{len(data)} bytes", f"whole ones ({error})") from error
