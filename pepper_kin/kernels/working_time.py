"""Clock of time limits, which is paused while machine code is made or another library is loaded."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from time import perf_counter
from typing import NamedTuple


class _ClockState(NamedTuple):
    """State of the clock.

    Attributes:
        holders: Number of calls that pause the clock.
        since: Start of the pause, on `perf_counter` [s].
        stood: Total time of earlier pauses [s].
    """

    holders: int
    since: float
    stood: float


_lock = threading.Lock()
_state = _ClockState(0, 0.0, 0.0)


def working_time() -> float:
    """Return the time of `perf_counter` minus the time of all pauses, in any thread [s]."""
    holders, since, stood = _state
    return (since if holders else perf_counter()) - stood


def on_perf_counter(time: float) -> float:
    """Return the time on `perf_counter` at which the clock shows a time, without further pauses [s]."""
    holders, since, stood = _state
    return time + stood + (perf_counter() - since if holders else 0.0)


@contextlib.contextmanager
def not_counted() -> Iterator[None]:
    """Pause the clock for all threads within a `with` block: a thread that makes code delays the others."""
    global _state
    with _lock:
        holders, since, stood = _state
        _state = _ClockState(holders + 1, since if holders else perf_counter(), stood)
    try:
        yield
    finally:
        with _lock:
            holders, since, stood = _state
            _state = _ClockState(holders - 1, since, stood if holders > 1 else stood + perf_counter() - since)
