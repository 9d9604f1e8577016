"""Shards on the workers of a Dask cluster."""

from __future__ import annotations

import contextlib
import math
import queue
import time
import uuid
from collections import Counter, deque
from collections.abc import Generator, Iterable
from typing import Any

from pepper_kin.datasets.job import DatasetJob
from pepper_kin.datasets.pool import MOST_KILLS
from pepper_kin.datasets.shard import write_shard
from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, PepperKinError, optional

_AHEAD = 3  # shards for each thread that the scheduler knows: few enough for any number of shards
_LOOK = 2.0  # [s] between looks at how many workers there are
_GATHER = 5.0  # [s] in which an answer that is there comes
PATIENCE = 120.0
"""Time without any worker, after there were some, until the work is stopped [s]."""
_ADVICE = "start it again and resume: what is written stays"


def compute(values: dict[str, Any], shard: int, place: str) -> dict[str, Any]:
    """Compute and write a shard of the job of plain values; runs on a worker."""
    return write_shard(DatasetJob(**values), shard, Store(place))


class _ClusterRun:
    """Shards that wait, and futures of those that a cluster computes.

    Args:
        client: Of the cluster.
        job: The job.
        waiting: Numbers of the shards to compute.
        place: Where they go.
    """

    def __init__(self, client: Any, job: DatasetJob, waiting: deque[int], place: str) -> None:
        self.client, self.waiting, self.running = client, waiting, dict[Any, int]()
        self._values, self._place = job.as_dict(), place
        # A scheduler would take the same job in another folder for the same tasks.
        self._name = uuid.uuid4().hex
        self._tries = Counter[int]()
        self._threads, self._looked, self._seen = 0, -math.inf, math.inf
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def fill(self) -> None:
        """Submit as many shards as the workers of now can take soon.

        Raises:
            InfeasibleError: where all workers have been gone for long.
        """
        now = time.monotonic()
        if now - self._looked >= _LOOK:
            self._threads, self._looked = sum(self.client.nthreads().values()), now
            self._seen = now if self._threads else self._seen
        if now - self._seen > PATIENCE:
            raise InfeasibleError("data set", f"no worker was seen for {PATIENCE:g} s", _ADVICE)
        while self.waiting and len(self.running) < max(4, _AHEAD * self._threads):
            shard = self.waiting.popleft()
            options = {"pure": False, "key": f"{self._name}-{shard}-{self._tries[shard]}"}
            future = self.client.submit(compute, self._values, shard, self._place, **options)
            self.running[future] = shard
            future.add_done_callback(self._ended.put)

    def wait(self) -> None:
        """Wait until a shard ends, or for `_LOOK`.

        Not by `distributed.wait`, which asks the newest client of the process, whoever made it, and may hang
        when another thread closes that one.
        """
        with contextlib.suppress(queue.Empty):
            self._ended.get(timeout=_LOOK)

    def ended(self, future: Any, *, killed: type[Exception]) -> tuple[int, dict[str, Any]] | None:
        """Return number and summary of a shard that was written, None for one that is to be computed again.

        Raises:
            PepperKinError: what computing or writing it raised.
            InfeasibleError: where workers died over it again and again.
        """
        shard = self.running.pop(future)
        if future.status == "finished":
            try:
                found = future.result(timeout=_GATHER)
            except TimeoutError:  # the worker that held it is gone: Dask computes it again, or there is none
                self.running[future] = shard
                return None
            future.release()  # else Dask would compute it again when the worker dies that holds the answer
            return shard, found
        error = future.exception() if future.status == "error" else None
        if error is not None and not isinstance(error, killed):
            raise error if isinstance(error, PepperKinError) else PepperKinError(f"shard {shard}: {error}")
        self._tries[shard] += 1
        if self._tries[shard] >= MOST_KILLS:
            raise InfeasibleError("data set", f"workers died over shard {shard}", _ADVICE)
        self.waiting.appendleft(shard)
        return None


def on_dask(
    job: DatasetJob, shards: Iterable[int], store: Store, client: Any
) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Yield the number and the summary of each shard as soon as it is written, by a cluster.

    Args:
        job: The job.
        shards: Numbers of the shards to compute.
        store: Where they go; all workers must reach it by the same name.
        client: A `distributed.Client`, or the address of a scheduler.

    Raises:
        PepperKinError: what computing or writing a shard raised.
        InfeasibleError: where the scheduler is gone, or workers died over one shard again and again.
        MissingDependencyError: where Dask is not installed.
    """
    distributed = optional("distributed", extra="dask", need="a data set on many machines")
    if not isinstance(client, str | distributed.Client):
        raise InvalidValueError("client", repr(client), "a distributed.Client, or a scheduler's address")
    own = isinstance(client, str)
    try:
        client = distributed.Client(client, timeout="10s") if own else client
    except OSError as error:
        raise InfeasibleError("scheduler", str(error), "name the address that it prints") from error
    run = _ClusterRun(client, job, deque(shards), store.place)
    try:
        while run.waiting or run.running:
            run.fill()
            run.wait()
            for future in [future for future in run.running if future.status != "pending"]:
                found = run.ended(future, killed=distributed.scheduler.KilledWorker)
                if found is not None:
                    yield found
    except PepperKinError:
        raise
    except Exception as error:  # Dask has many: closed clients, closed streams, cancelled futures
        if client.status == "running":
            raise
        raise InfeasibleError("data set", f"the scheduler is gone ({error})", _ADVICE) from error
    finally:
        if client.status == "running":
            client.cancel(list(run.running))
        if own:
            client.close(timeout=5)
