"""Ctrl-C and SIGTERM as a shutdown request of serving programs."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

_PAUSE = 0.05
"""Time between two polls [s]: a signal handler may not set a `threading.Event`, which takes a lock."""


class EndRequest:
    """Shutdown request of a program."""

    def __init__(self) -> None:
        self._made = False

    def set(self) -> None:
        """Request the shutdown; signal handlers may call it."""
        self._made = True

    def wait(self, seconds: float | None = None) -> bool:
        """Wait for the request and return True, or False after a timeout [s]; None waits without limit."""
        end = None if seconds is None else time.monotonic() + seconds
        while not self._made:
            left = _PAUSE if end is None else end - time.monotonic()
            if left <= 0:
                break
            time.sleep(min(left, _PAUSE))
        return self._made


@contextmanager
def ended_by_signals() -> Iterator[EndRequest]:
    """Yield a request that Ctrl-C and SIGTERM set instead of their usual effect, in the main thread."""
    ended = EndRequest()
    if threading.current_thread() is not threading.main_thread():
        yield ended
        return
    kept = {
        number: signal.signal(number, lambda *_: ended.set()) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield ended
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
