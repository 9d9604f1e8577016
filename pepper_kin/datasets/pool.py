"""Pool of processes on this machine that compute shards, and are replaced when they are killed."""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
from collections import Counter, deque
from collections.abc import Generator, Iterable
from contextlib import suppress
from typing import Any

from pepper_kin.datasets.job import DatasetJob
from pepper_kin.datasets.shard import write_shard
from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import InfeasibleError, PepperKinError

MOST_KILLS = 5
"""Number of processes killed while computing one shard after which the shard is abandoned."""


class _Worker:
    """A process that computes one shard at a time."""

    def __init__(self, job: DatasetJob, store: Store) -> None:
        path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C reaches only the driver, which ends the workers
            env={"OPENBLAS_NUM_THREADS": "1", **os.environ, "PYTHONPATH": path},
        )
        self.shard: int | None = None
        self._send({"job": job.as_dict(), "folder": store.place})

    def give(self, shard: int) -> None:
        """Make the process compute a shard."""
        self.shard = shard
        self._send({"shard": shard})

    def answer(self) -> dict[str, Any] | None:
        """Return the answer of the process, None if it has died."""
        line = self.process.stdout.readline()  # type: ignore[union-attr]
        return json.loads(line) if line.endswith(b"\n") else None

    def end(self, *, kill: bool = False) -> None:
        """End the process, at once if `kill`, else after its shard."""
        if kill:
            self.process.kill()
        for pipe in (self.process.stdin, self.process.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]
        self.process.wait()

    def _send(self, message: dict[str, Any]) -> None:
        with suppress(OSError):  # the process has died; `answer` reports it
            self.process.stdin.write(json.dumps(message).encode() + b"\n")  # type: ignore[union-attr]
            self.process.stdin.flush()  # type: ignore[union-attr]


def on_pool(
    job: DatasetJob, shards: Iterable[int], store: Store, workers: int
) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Yield the index and the summary of each shard as soon as one of several processes has written it.

    A process that is killed is replaced, and its shard computed again.  If the caller ends in any way, the
    processes end after their shards.

    Raises:
        PepperKinError: raised by computing or writing a shard.
        InfeasibleError: if MOST_KILLS processes died while computing one shard.
    """
    waiting, kills = deque(shards), Counter[int]()
    team: dict[int, _Worker] = {}
    with selectors.DefaultSelector() as ready:

        def start(number: int) -> None:
            if waiting:
                team[number] = _Worker(job, store)
                ready.register(team[number].process.stdout, selectors.EVENT_READ, number)  # type: ignore[arg-type]
                team[number].give(waiting.popleft())

        def remove(number: int, *, kill: bool) -> None:
            worker = team.pop(number)
            ready.unregister(worker.process.stdout)  # type: ignore[arg-type]
            worker.end(kill=kill)

        try:
            for number in range(workers):
                start(number)
            while team:
                for event, _ in ready.select():
                    number, worker = event.data, team[event.data]
                    shard, found = worker.shard, worker.answer()
                    assert shard is not None
                    if found is None:
                        remove(number, kill=True)
                        kills[shard] += 1
                        if kills[shard] >= MOST_KILLS:
                            reason = f"{MOST_KILLS} processes died over shard {shard}"
                            advice = (
                                "look for what killed them, such as a lack of memory: fewer rows_per_shard"
                            )
                            raise InfeasibleError("dataset", reason, advice)
                        waiting.appendleft(shard)
                        start(number)
                    elif "error" in found:
                        raise PepperKinError(f"shard {shard}: {found['error']}")
                    else:
                        if waiting:
                            worker.give(waiting.popleft())
                        else:
                            remove(number, kill=False)
                        yield shard, found
        finally:
            for number in list(team):
                remove(number, kill=True)


def serve() -> None:
    """Compute the shards whose indices are read from standard input, until it ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output printed by libraries must not mix with answers
    first = json.loads(sys.stdin.buffer.readline() or "null")
    if first is None:
        return
    store, job = Store(first["folder"]), None
    for line in sys.stdin.buffer:
        shard = json.loads(line)["shard"]
        try:
            job = DatasetJob(**first["job"]) if job is None else job
            answer = write_shard(job, shard, store)
        except Exception as error:
            kind = "" if isinstance(error, PepperKinError) else f"{type(error).__name__}: "
            answer = {"error": f"{kind}{error}"}
        with suppress(BrokenPipeError):
            answers.write(json.dumps(answer).encode() + b"\n")
            answers.flush()
