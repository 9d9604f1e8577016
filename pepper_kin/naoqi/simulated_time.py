"""The clock of the simulation: cycles of 20 ms, against the wall or as fast as they can be computed."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable

from pepper_kin.naoqi.thread_priority import wake_promptly

CYCLE = 0.02
"""Period of ALMotion [s]."""

LEAST_PAUSE = 1e-4
"""Time between two cycles in which the lock is free, at least [s]."""

GRACE = 10.0
"""Time in which an interrupted thread may clean up before it is interrupted again [s]."""

LATEST = 5000
"""Cycles of which the delay is kept (100 s)."""


class TimeIsUp(KeyboardInterrupt):
    """The time that a script was given is over; to the script it looks like Ctrl-C."""


class SimulatedTime:
    """Time that passes in cycles of 20 ms, each of which calls a function.

    With `real_time` a thread runs the cycles against the wall clock; otherwise time passes only while
    somebody
    waits, and then as fast as the computer can: a script's `sleep(10)` takes what 500 cycles take.

    Args:
        on_cycle: Called once a cycle, with the lock held.
        real_time: Whether the wall clock drives it.

    Attributes:
        lock: Held during a cycle; whoever reads or changes what the cycles change holds it, too.
        delays: How late the last cycles began [s].
        interrupted: Whether the time of `limit` has interrupted somebody.
    """

    def __init__(self, on_cycle: Callable[[], None], real_time: bool) -> None:
        self.lock = threading.RLock()
        self.real_time = real_time
        self.delays: deque[float] = deque(maxlen=LATEST)
        self._changed = threading.Condition(self.lock)
        self._on_cycle = on_cycle
        self._cycles = 0
        self._spent = 0.0
        self._thread: threading.Thread | None = None
        self._ended = False
        self._error: BaseException | None = None
        self._released = 0
        self._limited, self._limit = 0, math.inf
        self.interrupted = False

    @property
    def failure(self) -> BaseException | None:
        """What ended the cycles, if something did."""
        return self._error

    @property
    def now(self) -> float:
        """Time since the start [s]."""
        return self._cycles * CYCLE

    def start(self) -> None:
        """Let the wall clock drive the cycles; without effect where time passes by waiting."""
        if self.real_time and self._thread is None:
            self._thread = threading.Thread(target=self._run, name="naoqi-cycle", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """End the thread; those who wait are released."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(5.0)

    def release(self) -> None:
        """Let all who wait now return, as if their time were over."""
        with self._changed:
            self._released += 1
            self._changed.notify_all()

    def limit(self, end: float) -> None:
        """Let waits of this thread raise `TimeIsUp` from a time on [s]; infinite for never."""
        self._limited, self._limit = threading.get_ident(), end
        self.interrupted = False

    def wait_until(self, done: Callable[[], bool], timeout: float | None = None) -> bool:
        """Let time pass until something is so; return whether it came to be.

        Args:
            done: What is waited for; called with the lock held, once a cycle.
            timeout: The longest time to wait, on this clock [s]; for ever if omitted.

        Raises:
            TimeIsUp: from the time of `limit` on.
        """
        end = None if timeout is None else self.now + timeout
        with self._changed:
            released = self._released
            while not done():
                if self._ended or self._released != released or (end is not None and self.now >= end - 1e-9):
                    return False
                if self._error is not None:
                    raise self._error
                if self.now >= self._limit - 1e-9 and self._limited == threading.get_ident():
                    self._limit += GRACE
                    self.interrupted = True
                    raise TimeIsUp(f"at {self.now:g} s")
                if self.real_time and self._thread is not None:
                    self._changed.wait(1.0)
                else:
                    self._advance()
                    self._changed.notify_all()
                    self._let_others_in()
        return True

    def spend(self, seconds: float) -> None:
        """Let the time pass that a call takes [s], where it passes by waiting only.

        So that whoever asks in a loop, without a pause, sees something change.
        """
        if self.real_time:
            return
        with self.lock:
            self._spent += seconds
            cycles, self._spent = divmod(self._spent, CYCLE)
        if cycles:
            self.sleep(cycles * CYCLE)

    def sleep(self, seconds: float) -> None:
        """Let time pass [s]."""
        end = self.now + seconds
        self.wait_until(lambda: self.now >= end - 1e-9)

    def _let_others_in(self) -> None:
        """Give other threads a chance to take the lock between two cycles."""
        self._changed.release()
        time.sleep(0)
        self._changed.acquire()

    def _advance(self) -> None:
        self._on_cycle()
        self._cycles += 1

    def _run(self) -> None:
        wake_promptly()
        due = time.perf_counter()
        while not self._ended:
            now = time.perf_counter()
            time.sleep(max(due - now, LEAST_PAUSE))  # where cycles take too long, others need the lock, too
            late = time.perf_counter() - due
            with self._changed:
                if self._ended:
                    return
                try:
                    self._advance()
                except BaseException as error:  # raised again in the threads that wait
                    self._error = error
                    self._changed.notify_all()
                    return
                self.delays.append(late)
                self._changed.notify_all()
            due += CYCLE
            if time.perf_counter() > due + 10 * CYCLE:  # the machine slept: do not run after it
                due = time.perf_counter()
