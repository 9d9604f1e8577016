"""Python functions that compiled code calls back."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator

import numpy as np

_PROTOTYPE = ctypes.CFUNCTYPE(ctypes.c_int64)


class Callback:
    """A Python function of three integers as a C function without arguments; its exception is kept.

    Python handles signals when a function begins, before its first line, and ctypes drops an exception raised
    there: Ctrl-C would often be lost.  So the C function resumes a generator that waits within `try`.

    Args:
        function: Function that returns an integer, below zero if it fails.

    Attributes:
        address: Address of the C function, which returns -1 if the Python function raises; valid as long as
            the object.
        mail: Memory to which the caller writes the three integers, shape (3,).
    """

    def __init__(self, function: Callable[[int, int, int], int]) -> None:
        self.mail = np.zeros(3, np.int64)
        self._raised: list[BaseException] = []
        answers = _answers(function, self.mail, self._raised)
        next(answers)
        self._c_function = _PROTOTYPE(answers.__next__)
        self.address = int(ctypes.cast(self._c_function, ctypes.c_void_p).value or 0)

    def raised(self) -> BaseException | None:
        """Return the function's exception since the last call of `raised`, or None, and forget it."""
        error = self._raised[-1] if self._raised else None
        self._raised.clear()
        return error


def _answers(
    function: Callable[[int, int, int], int], mail: np.ndarray, raised: list[BaseException]
) -> Iterator[int]:
    """Yield a function's result for the integers in `mail`, shape (3,), each time, or -1 on an exception."""
    answer = 0
    while True:
        try:
            while True:
                yield answer
                answer = function(*mail.tolist())
        except GeneratorExit:
            return
        except BaseException as error:  # no exception may pass through compiled code
            raised.append(error)
            answer = -1
