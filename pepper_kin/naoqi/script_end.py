"""The end of a script that neither waits nor asks for the time."""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from pepper_kin.naoqi.simulated_time import SimulatedTime

STANDSTILL = 10.0
"""Wall time after which a script counts as without an end where the twin's clock stands still [s]."""
_GRACE = 1.0  # [s] of wall time, after the end on the twin's clock, in which a script ends at its next wait
_EVERY = 0.05  # [s]


@contextmanager
def interrupted(clock: SimulatedTime, end: float | None, error: type[BaseException]) -> Iterator[None]:
    """Raise an error in this thread where it goes on after its end, or while no time of the twin passes.

    A loop without waits stays at one time of the twin for ever, so that wall time has to count: as much of
    it as was given of the twin's time, and `STANDSTILL` at least.

    Args:
        clock: The twin's.
        end: When what runs inside has to end, on that clock [s]; None for never.
        error: What is raised.
    """
    if end is None:
        yield
        return
    patience, thread = max(end - clock.now, STANDSTILL), ctypes.c_ulong(threading.get_ident())
    lock, over = threading.Lock(), threading.Event()
    raise_in = ctypes.pythonapi.PyThreadState_SetAsyncExc

    def watch() -> None:
        latest, since = clock.now, time.monotonic()
        while not over.wait(_EVERY):
            now, wall = clock.now, time.monotonic()
            late = now >= end
            if now != latest and not (late and latest >= end):
                latest, since = now, wall
            if wall - since >= (_GRACE if late else patience):
                with lock:
                    if not over.is_set():
                        raise_in(thread, ctypes.py_object(error))
                since = wall + patience - _GRACE  # what it does as it ends takes time, too

    watcher = threading.Thread(target=watch, name="script-end", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        with lock:
            over.set()
            raise_in(thread, None)  # one on its way is none for whoever called
        watcher.join()
