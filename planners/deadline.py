"""Time budget of one run of a planner."""

from __future__ import annotations

import math
from collections.abc import Generator
from time import perf_counter
from typing import TypeAlias, TypeVar, cast

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import CompiledFunction
from pepper_kin.kernels.working_time import not_counted, working_time

TIME_SLICE = 0.25
"""Maximum time that machine code runs until Python checks for an interrupt from the keyboard [s]."""


LEAST_SLICE = 1e-4
"""Minimum time that machine code runs if a pause is due already [s]."""

Result = TypeVar("Result")

Slices: TypeAlias = Generator[None, None, Result]
"""A computation that pauses where its `PausedClock` says so, and returns a result at its end."""


def whole(slices: Slices[Result]) -> Result:
    """Return the result of a computation, in one go."""
    while True:
        try:
            next(slices)
        except StopIteration as end:
            return cast("Result", end.value)


class PausedClock:
    """Clock that runs only between `resume` and `pause`, and knows when the next pause is due."""

    def __init__(self) -> None:
        self._away, self._paused, self._until = 0.0, working_time(), -math.inf

    def now(self) -> float:
        """Return the time [s]."""
        return working_time() - self._away

    @property
    def left(self) -> float:
        """Time until a pause is due [s]; zero or negative once it is due."""
        return self._until - perf_counter()

    def resume(self, seconds: float) -> None:
        """Run the clock; the next pause is due after a time [s]."""
        self._away += working_time() - self._paused
        self._until = perf_counter() + seconds

    def pause(self) -> None:
        """Stop the clock until `resume`."""
        self._paused = working_time()


class Deadline:
    """Timer that starts when it is made and expires after a time budget.

    Attributes:
        timeout: Budget [s]; infinite for none.
    """

    def __init__(self, timeout: float = math.inf, clock: PausedClock | None = None) -> None:
        """Start the clock.

        Args:
            timeout: Budget [s], above zero; ``math.inf`` for none.
            clock: Clock that measures the time and knows when a pause is due; None for one without pauses.

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
        self._clock, self._now = clock, working_time if clock is None else clock.now
        self._started = self._now()

    @property
    def elapsed(self) -> float:
        """Time since the start [s]."""
        return self._now() - self._started

    @property
    def left(self) -> float:
        """Remaining time [s]; zero or negative once the budget is used up."""
        return self.timeout - self.elapsed

    @property
    def time_slice(self) -> float:
        """Time that machine code may run until a pause or an interrupt is checked [s]."""
        return min(self.left, TIME_SLICE if self._clock is None else max(self._clock.left, LEAST_SLICE))

    @property
    def pauses(self) -> bool:
        """Whether a pause is due."""
        return self._clock is not None and self._clock.left <= 0.0

    @property
    def expired(self) -> bool:
        """Whether the budget is used up."""
        return self.elapsed >= self.timeout


def load_code(*functions: CompiledFunction) -> None:
    """Load or build the machine code of functions; the time does not count towards a run."""
    with not_counted():
        for function in functions:
            function.native  # noqa: B018
