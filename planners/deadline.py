"""The time budget of one run of a planner."""

from __future__ import annotations

import math
from time import perf_counter

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import CompiledFunction

TIME_SLICE = 0.25
"""How long machine code may run before Python listens to an interrupt from the keyboard again [s]."""


class Deadline:
    """A clock that starts when it is made and runs out after a number of seconds.

    Attributes:
        timeout: Budget [s]; infinite if there is none.
    """

    def __init__(self, timeout: float = math.inf) -> None:
        """Start the clock.

        Args:
            timeout: Budget [s], above zero; ``math.inf`` for none.

        Raises:
            InvalidValueError: The budget is NaN, or not above zero.
        """
        allowed = "a number of seconds above 0, or math.inf"
        if not (isinstance(timeout, int | float) and timeout > 0.0):
            raise InvalidValueError("timeout", timeout, allowed)
        try:
            self.timeout = float(timeout)
        except OverflowError:
            raise InvalidValueError("timeout", timeout, allowed) from None
        self._started = perf_counter()

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return perf_counter() - self._started

    @property
    def left(self) -> float:
        """Seconds that are left; none or less once the budget is used up."""
        return self.timeout - self.elapsed

    @property
    def time_slice(self) -> float:
        """Seconds that machine code may run before Python listens to an interrupt from the keyboard again."""
        return min(self.left, TIME_SLICE)

    @property
    def expired(self) -> bool:
        """Whether the budget is used up."""
        return self.elapsed >= self.timeout


def load_code(*functions: CompiledFunction) -> None:
    """Get the machine code of functions ready, which is not to be counted as time of a run."""
    for function in functions:
        function.native  # noqa: B018
