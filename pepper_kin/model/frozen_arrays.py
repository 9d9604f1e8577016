"""Arrays that nobody can write to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def read_only(array: ArrayLike) -> NDArray[np.float64]:
    """Copy an array of floats, of any shape, and forbid writing to the copy."""
    copy = np.array(array, dtype=float)
    copy.setflags(write=False)
    return copy


def kept_read_only(array: ArrayLike) -> NDArray[np.float64]:
    """Return an array of any shape as a read-only one of float64.

    It is the array itself where that is of float64, owns its memory and may not be written to, else a copy.
    """
    if (
        type(array) is np.ndarray
        and array.dtype == np.float64
        and array.base is None
        and not array.flags.writeable
    ):
        return array
    return read_only(array)
