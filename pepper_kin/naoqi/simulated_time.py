"""The clock of the simulation: cycles of 20 ms, by the wall clock or as fast as they can be computed."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from pepper_kin.naoqi.thread_priority import wake_promptly

CYCLE = 0.02
"""Period of ALMotion [s]."""

LEAST_PAUSE = 1e-4
"""Minimum time between two cycles in which the lock is free [s]."""

GRACE = 10.0
"""Time in which an interrupted thread may clean up before it is interrupted again [s]."""

PATIENCE = 0.1
"""Time without computing after which simulated time no longer waits for a worker [s]."""

COMPUTES = 0.05
"""Minimum fraction of the time for which a computing worker has the processor."""

LATEST = 5000
"""Number of cycles whose delays are kept (100 s)."""


class TimeIsUp(KeyboardInterrupt):
    """The time of a script is over; to the script it looks like Ctrl-C."""


class SimulatedTime:
    """Simulated time, which passes in cycles of 20 ms; each cycle calls a function.

    With `real_time` a thread runs the cycles by the wall clock; otherwise time passes only while a thread
    waits, and then as fast as the computer can: a script's `sleep(10)` takes as long as 500 cycles.  Only one
    of the threads that are `workers` computes at a time, and no time passes meanwhile, so that their effects
    do not depend on their speed.

    Args:
        on_cycle: Called once a cycle, with the lock held.
        real_time: Whether the wall clock drives the cycles.

    Attributes:
        lock: Lock that is held during a cycle, and by every reader and writer of the cycles' data.
        delays: Delays of the last cycles' starts [s].
        interrupted: Whether the time of `limit` has interrupted a thread.
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
        self._workers: dict[object, bool] = {}  # worker -> whether it computes
        self._looks: dict[object, tuple[float, float]] = {}  # worker -> last check's time, processor time
        self._threads: dict[object, int] = {}
        self._waiting: dict[object, list[Callable[[], bool]]] = {}  # its conditions, the innermost last
        self._thread_worker = threading.local()
        self.interrupted = False

    @property
    def failure(self) -> BaseException | None:
        """The error that ended the cycles, or None."""
        return self._error

    @property
    def ended(self) -> bool:
        """Whether the time was stopped, which ends all waits."""
        return self._ended

    @property
    def now(self) -> float:
        """Time since the start [s]."""
        return self._cycles * CYCLE

    @property
    def is_up(self) -> bool:
        """Whether the time of `limit` is over."""
        return self.now >= self._limit - 1e-9

    def start(self) -> None:
        """Start the thread of the cycles; without effect unless `real_time`."""
        if self.real_time and self._thread is None:
            self._thread = threading.Thread(target=self._run, name="naoqi-cycle", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """End the thread of the cycles and all waits."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(5.0)

    def release(self) -> None:
        """End all present waits, as if their timeouts were over."""
        with self._changed:
            self._released += 1
            self._changed.notify_all()

    def limit(self, end: float) -> None:
        """Set the time from which waits of this thread raise `TimeIsUp` [s]; infinite for never."""
        self._limited, self._limit = threading.get_ident(), end
        self.interrupted = False

    def wait_until(self, done: Callable[[], bool], timeout: float | None = None) -> bool:
        """Wait until a condition holds; return whether it came to hold.

        Args:
            done: The condition; called with the lock held, once a cycle.
            timeout: Maximum simulated time to wait [s]; unlimited if omitted.

        Raises:
            TimeIsUp: from the time of `limit` on, and in dismissed workers.
        """
        end = math.inf if timeout is None else self.now + timeout - 1e-9
        worker = getattr(self._thread_worker, "value", None)
        with self._changed:
            released = self._released

            def released_or_late() -> bool:
                return self._ended or self._released != released or self.now >= end

            self._set_aside(worker, lambda: done() or released_or_late())
            try:
                while not done() or not self._is_next(worker):
                    if released_or_late() and self._is_next(worker):
                        return done()
                    if worker is not None and worker not in self._workers:
                        raise TimeIsUp("nobody waits for this thread any more")
                    if self._error is not None:
                        raise self._error
                    if self.is_up and self._limited == threading.get_ident():
                        self._limit += GRACE
                        self.interrupted = True
                        raise TimeIsUp(f"at {self.now:g} s")
                    if self.real_time and self._thread is not None:
                        self._changed.wait(1.0)
                    elif any(self._workers.values()) or not self._is_last(worker):
                        if not self._changed.wait(PATIENCE):
                            self._look_who_computes()
                    else:
                        self._advance()
                        self._changed.notify_all()
                        self._let_others_in()
            finally:
                self._go_on(worker)
        return True

    def new_worker(self) -> object:
        """Return a new worker, which counts as computing, for `working`."""
        worker = object()
        with self._changed:
            self._workers[worker] = True
        return worker

    @contextmanager
    def working(self, worker: object) -> Iterator[None]:
        """Make this thread a worker until the context ends."""
        self._thread_worker.value = worker
        self._threads[worker] = threading.get_ident()
        try:
            yield
        finally:
            self._thread_worker.value = None
            with self._changed:
                for known in (self._workers, self._threads, self._looks):
                    known.pop(worker, None)
                self._changed.notify_all()

    def dismiss(self, workers: Iterable[object]) -> None:
        """Dismiss workers: their present and future waits raise `TimeIsUp`."""
        with self._changed:
            for worker in workers:
                self._workers.pop(worker, None)
            self._changed.notify_all()

    def follow(self, worker: object) -> None:
        """Wait until a worker waits or has ended, while no time passes; without effect if `real_time`."""
        if not self.real_time:
            self.wait_until(lambda: not self._workers.get(worker, False))

    @property
    def works(self) -> bool:
        """Whether this thread is a worker."""
        return getattr(self._thread_worker, "value", None) is not None

    @property
    def worker_count(self) -> int:
        """Number of workers."""
        return len(self._workers)

    def _look_who_computes(self) -> None:
        """Mark workers as waiting that have hardly used the processor since the last call."""
        now = time.monotonic()
        for worker, computes in self._workers.items():
            if computes and worker in self._threads:
                used = _processor_time(self._threads[worker])
                at, before = self._looks.setdefault(worker, (now, used))
                if now - at >= PATIENCE / 2:
                    self._looks[worker] = now, used
                    self._workers[worker] = used - before >= COMPUTES * (now - at)

    def _set_aside(self, worker: object, ready: Callable[[], bool]) -> None:
        if worker is not None:
            if worker in self._workers:
                self._workers[worker] = False
            self._waiting.setdefault(worker, []).append(ready)
            self._changed.notify_all()

    def _is_next(self, worker: object) -> bool:
        """Return whether no worker computes, and no worker that has waited longer is ready."""
        if worker is None or self.real_time:
            return True
        ready = next(one for one, waits in self._waiting.items() if one is worker or waits[-1]())
        return ready is worker and not any(self._workers.values())

    def _is_last(self, worker: object) -> bool:
        """Return whether no other worker is ready."""
        return not any(waits[-1]() for one, waits in self._waiting.items() if one is not worker)

    def _go_on(self, worker: object) -> None:
        if worker is not None:
            self._waiting[worker].pop()
            if not self._waiting[worker]:  # else the wait was inside a cycle that another wait runs
                del self._waiting[worker]
                self._looks.pop(worker, None)
                if worker in self._workers:  # else the worker was dismissed
                    self._workers[worker] = True

    def spend(self, seconds: float) -> None:
        """Let the time of a call pass [s], unless `real_time`.

        So a caller that polls in a loop, without a pause, sees changes.
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
        """Release the lock for a moment, so that other threads can take it between two cycles."""
        self._changed.release()
        try:
            time.sleep(0)
        finally:  # also after Ctrl-C
            self._changed.acquire()

    def _advance(self) -> None:
        self._on_cycle()
        self._cycles += 1

    def _run(self) -> None:
        """Run the cycles by the wall clock, in the thread of the cycles."""
        wake_promptly()
        due = time.perf_counter()
        while not self._ended:
            now = time.perf_counter()
            time.sleep(max(due - now, LEAST_PAUSE))  # others need the lock even if cycles take too long
            late = time.perf_counter() - due
            with self._changed:
                if self._ended:
                    return
                try:
                    self._advance()
                except BaseException as error:  # raised again in the waiting threads
                    self._error = error
                    self._changed.notify_all()
                    return
                self.delays.append(late)
                self._changed.notify_all()
            due += CYCLE
            if time.perf_counter() > due + 10 * CYCLE:  # the machine slept: do not catch up
                due = time.perf_counter()


def _processor_time(thread: int) -> float:
    """Return the time for which a thread has had the processor [s]; 0 if the system does not report it."""
    clock = getattr(time, "pthread_getcpuclockid", None)
    return 0.0 if clock is None else time.clock_gettime(clock(thread))
