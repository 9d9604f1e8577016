"""Ctrl-C and SIGTERM as a request to end, for programs that serve until then."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

_PAUSE = 0.05
"""Between two looks [s]: what is locked, as by `threading.Event`, may not be set by a handler of signals."""


class EndRequest:
    """Whether a program has been requested to end."""

    def __init__(self) -> None:
        self._made = False

    def set(self) -> None:
        """Request the end; handlers of signals may do so."""
        self._made = True

    def wait(self, seconds: float | None = None) -> bool:
        """Return True once the end is requested, or False after a time [s]; without one wait for ever."""
        end = None if seconds is None else time.monotonic() + seconds
        while not self._made:
            left = _PAUSE if end is None else end - time.monotonic()
            if left <= 0:
                break
            time.sleep(min(left, _PAUSE))
        return self._made


@contextmanager
def ended_by_signals() -> Iterator[EndRequest]:
    """Yield a request that Ctrl-C and SIGTERM make, instead of what they do otherwise; in the main thread."""
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
