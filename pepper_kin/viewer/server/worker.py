"""A thread for long jobs: compiling, planning, curves."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Any

Job = Callable[[], Any]
Then = Callable[[Any, Exception | None], None]


class Worker:
    """A thread that does one job after the other, and does not keep Python from ending.

    Args:
        deliver: Runs a function in the thread that owns the results.
    """

    def __init__(self, deliver: Callable[[Callable[[], None]], None]) -> None:
        self._deliver = deliver
        self._jobs: queue.SimpleQueue[tuple[Job, Then] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="pepper-kin viewer worker", daemon=True)
        self._thread.start()

    def do(self, job: Job, then: Then) -> None:
        """Queue a job; `then` gets its result or its error, in the owner's thread."""
        self._jobs.put((job, then))

    def stop(self) -> None:
        """Stop after the present job and the queued ones."""
        self._jobs.put(None)

    def _run(self) -> None:
        while (item := self._jobs.get()) is not None:
            job, then = item
            result, fault = None, None
            try:
                result = job()
            except Exception as error:  # passed to `then`
                fault = error
            self._deliver(lambda then=then, result=result, fault=fault: then(result, fault))  # type: ignore[misc]
