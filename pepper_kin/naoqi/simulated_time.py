"""The clock of the simulation: cycles of 20 ms, against the wall or as fast as they can be computed."""

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
"""Time between two cycles in which the lock is free, at least [s]."""

GRACE = 10.0
"""Time in which an interrupted thread may clean up before it is interrupted again [s]."""

PATIENCE = 0.1
"""How long time waits for a worker that does not compute: it waits for something else [s]."""

COMPUTES = 0.05
"""Share of that time for which a worker that computes has the processor, at least."""

LATEST = 5000
"""Cycles of which the delay is kept (100 s)."""


class TimeIsUp(KeyboardInterrupt):
    """The time that a script was given is over; to the script it looks like Ctrl-C."""


class SimulatedTime:
    """Time that passes in cycles of 20 ms, each of which calls a function.

    With `real_time` a thread runs the cycles against the wall clock; otherwise time passes only while
    somebody waits, and then as fast as the computer can: a script's `sleep(10)` takes what 500 cycles take.
    Of threads that are `workers` one computes at a time, and no time passes meanwhile, so that what they do
    does not depend on how fast they compute.

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
        self._workers: dict[object, bool] = {}  # whether it computes
        self._looks: dict[object, tuple[float, float]] = {}  # at those that compute: when, and processor time
        self._threads: dict[object, int] = {}
        self._waiting: dict[object, list[Callable[[], bool]]] = {}  # what workers wait for, the last first
        self._thread_worker = threading.local()
        self.interrupted = False

    @property
    def failure(self) -> BaseException | None:
        """What ended the cycles, if something did."""
        return self._error

    @property
    def ended(self) -> bool:
        """Whether it was stopped: nobody waits any more."""
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
            TimeIsUp: from the time of `limit` on, and in workers that were dismissed.
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
        """Return a worker that computes from now on, for `working`."""
        worker = object()
        with self._changed:
            self._workers[worker] = True
        return worker

    @contextmanager
    def working(self, worker: object) -> Iterator[None]:
        """Let this thread be a worker, which is none any more afterwards."""
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
        """Let workers have no more time: their waits, and those that they begin, raise `TimeIsUp`."""
        with self._changed:
            for worker in workers:
                self._workers.pop(worker, None)
            self._changed.notify_all()

    def follow(self, worker: object) -> None:
        """Wait until a worker waits or is over, while no time passes; not where the wall clock drives it."""
        if not self.real_time:
            self.wait_until(lambda: not self._workers.get(worker, False))

    @property
    def works(self) -> bool:
        """Whether this thread is a worker."""
        return getattr(self._thread_worker, "value", None) is not None

    @property
    def worker_count(self) -> int:
        """How many workers there are."""
        return len(self._workers)

    def _look_who_computes(self) -> None:
        """Wait no longer for workers that have not used the processor since this was called last."""
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
        """Return whether no worker computes, and none that has waited longer is ready."""
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
            if not self._waiting[worker]:  # else it waits in a cycle that it runs while it waits
                del self._waiting[worker]
                self._looks.pop(worker, None)
                if worker in self._workers:  # else it was dismissed
                    self._workers[worker] = True

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
        try:
            time.sleep(0)
        finally:  # also where Ctrl-C comes
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


def _processor_time(thread: int) -> float:
    """Return the time for which a thread has had the processor [s]; 0 where the system does not say."""
    clock = getattr(time, "pthread_getcpuclockid", None)
    return 0.0 if clock is None else time.clock_gettime(clock(thread))
