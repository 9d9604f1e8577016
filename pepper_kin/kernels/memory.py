"""Memory for results.

New memory is slow: the system clears every page, which takes as long as a kernel.  Large arrays therefore
reuse the memory of an earlier result, once that result is no longer in use.
"""

from __future__ import annotations

import math
import os
import sys
import threading

import numpy as np

ALIGNMENT = 64
"""Alignment of all arrays [bytes]: one cache line, and the longest vector."""

KEEP_FROM = 1 << 22
"""Minimum size of memory that is kept for the next result [bytes]."""

KEEP_AT_MOST = 1 << 30
"""Maximum size of all memory kept [bytes], and at most a sixteenth of the machine's memory."""

_kept: list[np.ndarray] = []  # oldest first
_lock = threading.Lock()


def empty(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Return a new aligned array with arbitrary content, like `numpy.empty`."""
    size = math.prod(shape) * dtype.itemsize
    raw = _take(size) if size >= KEEP_FROM else np.empty(size + ALIGNMENT, np.uint8)
    begin = -raw.ctypes.data % ALIGNMENT
    # All views have `raw` as their base, so its reference count shows whether a view is in use.
    return raw[begin : begin + size].view(dtype).reshape(shape)


def release_memory() -> None:
    """Return memory kept for results to the system; results in use are not affected."""
    with _lock:
        _kept.clear()


def _take(size: int) -> np.ndarray:
    """Return unused kept memory of at least a size [bytes] plus the alignment, or new memory."""
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
    """Return the maximum size of all memory kept on this machine [bytes]."""
    try:
        physical = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return KEEP_AT_MOST // 4
    return min(KEEP_AT_MOST, physical // 16)


_EXAMPLE = [np.empty(0)]
_UNUSED = sys.getrefcount(_EXAMPLE[0])
"""Reference count of an array that is in a list and nowhere else."""
