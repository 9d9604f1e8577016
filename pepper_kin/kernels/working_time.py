"""The clock of time limits, which stands while machine code is made or another library is loaded."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from time import perf_counter
from typing import NamedTuple


class _ClockState(NamedTuple):
    """How the clock stands.

    Attributes:
        holders: How many calls keep it standing.
        since: Since when, on `perf_counter` [s].
        stood: How long it stood before [s].
    """

    holders: int
    since: float
    stood: float


_lock = threading.Lock()
_state = _ClockState(0, 0.0, 0.0)


def working_time() -> float:
    """Return the time of `perf_counter` less the time that the clock stood, in any thread [s]."""
    holders, since, stood = _state
    return (since if holders else perf_counter()) - stood


def on_perf_counter(time: float) -> float:
    """Return when the clock shows a time, on `perf_counter`, unless it stands meanwhile [s]."""
    holders, since, stood = _state
    return time + stood + (perf_counter() - since if holders else 0.0)


@contextlib.contextmanager
def not_counted() -> Iterator[None]:
    """Let the clock stand, for all threads: one that makes code holds up those that need it."""
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
