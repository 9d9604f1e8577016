"""Python functions that compiled code calls back."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator

import numpy as np

_PROTOTYPE = ctypes.CFUNCTYPE(ctypes.c_int64)


class Callback:
    """A Python function of three integers as a C function without arguments; what it raises is kept.

    Python handles signals as a function begins, before its first line, and ctypes drops what is raised there:
    Ctrl-C would be lost as often as not.  So the C function goes on with a generator that waits within `try`.

    Args:
        function: Returns an integer, below zero where it fails.

    Attributes:
        address: Of the C function, which returns -1 where the Python function raises; valid as long as the
            object.
        mail: Where the caller writes the three integers, shape (3,).
    """

    def __init__(self, function: Callable[[int, int, int], int]) -> None:
        self.mail = np.zeros(3, np.int64)
        self._raised: list[BaseException] = []
        answers = _answers(function, self.mail, self._raised)
        next(answers)
        self._c_function = _PROTOTYPE(answers.__next__)
        self.address = int(ctypes.cast(self._c_function, ctypes.c_void_p).value or 0)

    def raised(self) -> BaseException | None:
        """Return what the function has raised since the last time, and forget it."""
        error = self._raised[-1] if self._raised else None
        self._raised.clear()
        return error


def _answers(
    function: Callable[[int, int, int], int], mail: np.ndarray, raised: list[BaseException]
) -> Iterator[int]:
    """Yield what a function returns for what is in the mail, shape (3,), each time, or -1."""
    answer = 0
    while True:
        try:
            while True:
                yield answer
                answer = function(*mail.tolist())
        except GeneratorExit:
            return
        except BaseException as error:  # nothing may pass through compiled code
            raised.append(error)
            answer = -1
