"""The module `mutex` of Python 2: a queue of functions."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

__all__ = ["mutex"]


class mutex:
    """A lock with a queue of functions; each `unlock` calls the next one."""

    def __init__(self) -> None:
        self._locked = False
        self._waiting: deque[tuple[Callable[[Any], Any], Any]] = deque()

    def test(self) -> bool:
        """Return whether the mutex is locked."""
        return self._locked

    def testandset(self) -> bool:
        """Lock the mutex; return whether it was unlocked before."""
        free, self._locked = not self._locked, True
        return free

    def lock(self, function: Callable[[Any], Any], argument: Any) -> None:
        """Call a function now if unlocked, else queue it."""
        if self.testandset():
            function(argument)
        else:
            self._waiting.append((function, argument))

    def unlock(self) -> None:
        """Call the next queued function; unlock if there is none."""
        if self._waiting:
            function, argument = self._waiting.popleft()
            function(argument)
        else:
            self._locked = False
