"""Memory for results.

New memory is slow: the system clears every page of it, which takes as long as a kernel does.  Large arrays
are therefore taken from the memory of an earlier result, once that result is no longer in use.
"""

from __future__ import annotations

import math
import os
import sys
import threading

import numpy as np

ALIGNMENT = 64
"""Of all arrays [bytes]: one cache line, and the longest vector."""

KEEP_FROM = 1 << 22
"""Size from which on memory is kept for the next result [bytes]."""

KEEP_AT_MOST = 1 << 30
"""Size of all memory kept [bytes]; at most a sixteenth of what the machine has."""

_kept: list[np.ndarray] = []  # oldest first
_lock = threading.Lock()


def empty(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Return a new aligned array with arbitrary content, like `numpy.empty`."""
    size = math.prod(shape) * dtype.itemsize
    raw = _take(size) if size >= KEEP_FROM else np.empty(size + ALIGNMENT, np.uint8)
    begin = -raw.ctypes.data % ALIGNMENT
    # All views of it have `raw` as their base, so its reference count shows whether any of them is in use.
    return raw[begin : begin + size].view(dtype).reshape(shape)


def release_memory() -> None:
    """Give memory kept for results back to the system; results in use are not touched."""
    with _lock:
        _kept.clear()


def _take(size: int) -> np.ndarray:
    with _lock:
        for place in range(len(_kept)):
            fits = size + ALIGNMENT <= _kept[place].size <= 2 * size + ALIGNMENT
            if fits and sys.getrefcount(_kept[place]) == _UNUSED:
                raw = _kept.pop(place)
                _kept.append(raw)
                return raw
        raw = np.empty(size + ALIGNMENT, np.uint8)
        if raw.size <= _limit():
            _kept.append(raw)
            while sum(kept.size for kept in _kept) > _limit():
                del _kept[0]
        return raw


def _limit() -> int:
    try:
        physical = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return KEEP_AT_MOST // 4
    return min(KEEP_AT_MOST, physical // 16)


_EXAMPLE = [np.empty(0)]
_UNUSED = sys.getrefcount(_EXAMPLE[0])
"""Reference count of an array that is in a list and nowhere else."""
