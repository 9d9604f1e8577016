"""Python functions that compiled code calls back."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

_PROTOTYPE = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 4)


class Callback:
    """A Python function of four integers as a C function; what it raises is kept.

    Args:
        function: Returns an integer, below zero where it fails.

    Attributes:
        address: Of the C function, which returns -1 where the Python function raises; valid as long as the
            object.
    """

    def __init__(self, function: Callable[[int, int, int, int], int]) -> None:
        self._function, self._error = function, None  # type: tuple[Callable[..., int], BaseException | None]
        self._c_function = _PROTOTYPE(self._call)
        self.address = int(ctypes.cast(self._c_function, ctypes.c_void_p).value or 0)

    def raised(self) -> BaseException | None:
        """Return what the function has raised since the last time, and forget it."""
        error, self._error = self._error, None
        return error

    def _call(self, what: int, first: int, second: int, third: int) -> int:
        try:
            return self._function(what, first, second, third)
        except BaseException as error:  # nothing may pass through compiled code
            self._error = error
            return -1
