"""The module `mutex` of Python 2: functions that are called one after another."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

__all__ = ["mutex"]


class mutex:
    """Calls functions in the order in which they came, the next one at each `unlock`."""

    def __init__(self) -> None:
        self._locked = False
        self._waiting: deque[tuple[Callable[[Any], Any], Any]] = deque()

    def test(self) -> bool:
        """Return whether it is locked."""
        return self._locked

    def testandset(self) -> bool:
        """Lock it; return whether it was not locked."""
        free, self._locked = not self._locked, True
        return free

    def lock(self, function: Callable[[Any], Any], argument: Any) -> None:
        """Call a function now, or when those before it have unlocked."""
        if self.testandset():
            function(argument)
        else:
            self._waiting.append((function, argument))

    def unlock(self) -> None:
        """Call the next function that waits; unlock where none does."""
        if self._waiting:
            function, argument = self._waiting.popleft()
            function(argument)
        else:
            self._locked = False
