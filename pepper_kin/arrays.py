"""The types of arrays and curves that annotations name, and arrays that nobody can write to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, DTypeLike

Array: TypeAlias = NDArray[np.float64]
"""An array of float64; docstrings give the shape."""


@runtime_checkable
class PiecewiseCubic(Protocol):
    """Any piecewise cubic curve, such as `pepper_kin.planners.SmoothPath`.

    On piece i, where breaks[i] <= s <= breaks[i + 1],
        q(s) = sum_p coefficients[i, p] (s - breaks[i])^p,   p = 0 ... 3: constant term first.
    """

    @property
    def breaks(self) -> Array:
        """Ends of the pieces, rising, shape (m + 1,)."""

    @property
    def coefficients(self) -> Array:
        """Constant term first, shape (m, 4, n)."""


def read_only(array: ArrayLike, dtype: DTypeLike = float) -> NDArray[Any]:
    """Copy an array of numbers, of any shape, to memory that cannot be written to.

    The memory is that of a `bytes`, so `setflags(write=True)` raises an error.
    """
    values = np.asarray(array, dtype=dtype)
    return np.ndarray(values.shape, values.dtype, buffer=values.tobytes())


def kept_read_only(array: ArrayLike) -> Array:
    """Return an array of any shape as a read-only one of float64.

    It is the array itself where that is of float64, may not be written to, and has its own memory or that of
    a `bytes`; else a copy.
    """
    if (
        type(array) is np.ndarray
        and array.dtype == np.float64
        and (array.base is None or isinstance(array.base, bytes))
        and not array.flags.writeable
    ):
        return array
    return read_only(array)


class FrozenArrays:
    """A frozen value whose arrays are read-only in copies, too.

    NumPy forgets that an array is read-only where it is pickled or copied deeply.
    """

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, _frozen(value))


def _frozen(value: Any) -> Any:
    """Return arrays, and those in tuples and dictionaries, as read-only ones; anything else as it is."""
    if type(value) is tuple:
        return tuple(map(_frozen, value))
    if type(value) is dict:
        return {key: _frozen(item) for key, item in value.items()}
    if type(value) is np.ndarray and value.flags.writeable:
        if value.dtype.hasobject:
            value.setflags(write=False)
            return value
        return read_only(value, value.dtype)
    return value
