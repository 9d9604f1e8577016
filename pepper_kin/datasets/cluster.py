"""Computation of shards by the workers of a Dask cluster."""

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

_AHEAD = 3  # number of submitted shards per thread, small so that the number of shards is unlimited
_LOOK = 2.0  # interval between checks of the number of workers [s]
_GATHER = 5.0  # maximum time to fetch an available result [s]
PATIENCE = 120.0
"""Maximum time without any worker, after there were some, until the computation is stopped [s]."""
_ADVICE = "start it again and resume: what is written stays"


def compute(values: dict[str, Any], shard: int, place: str) -> dict[str, Any]:
    """Compute and write a shard on a worker, given the job as plain values; return its summary."""
    return write_shard(DatasetJob(**values), shard, Store(place))


class _ClusterRun:
    """Shards that wait, and futures of the shards that a cluster computes.

    Args:
        client: Client of the cluster.
        job: The job.
        waiting: Indices of the shards to compute.
        place: Folder or address of the dataset.
    """

    def __init__(self, client: Any, job: DatasetJob, waiting: deque[int], place: str) -> None:
        self.client, self.waiting, self.running = client, waiting, dict[Any, int]()
        self._values, self._place = job.as_dict(), place
        # A unique name, since a scheduler would confuse the tasks of equal jobs in different folders.
        self._name = uuid.uuid4().hex
        self._tries = Counter[int]()
        self._threads, self._looked, self._seen = 0, -math.inf, math.inf
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def fill(self) -> None:
        """Submit as many shards as the present workers can start soon.

        Raises:
            InfeasibleError: if there has been no worker for `PATIENCE`.
        """
        now = time.monotonic()
        if now - self._looked >= _LOOK:
            self._threads, self._looked = sum(self.client.nthreads().values()), now
            self._seen = now if self._threads else self._seen
        if now - self._seen > PATIENCE:
            raise InfeasibleError("dataset", f"no worker was seen for {PATIENCE:g} s", _ADVICE)
        while self.waiting and len(self.running) < max(4, _AHEAD * self._threads):
            shard = self.waiting.popleft()
            options = {"pure": False, "key": f"{self._name}-{shard}-{self._tries[shard]}"}
            future = self.client.submit(compute, self._values, shard, self._place, **options)
            self.running[future] = shard
            future.add_done_callback(self._ended.put)

    def wait(self) -> None:
        """Wait until a shard ends, or for `_LOOK`.

        `distributed.wait` is not used: it asks the newest client of the process, of any thread, and may hang
        when another thread closes that client.
        """
        with contextlib.suppress(queue.Empty):
            self._ended.get(timeout=_LOOK)

    def ended(self, future: Any, *, killed: type[Exception]) -> tuple[int, dict[str, Any]] | None:
        """Return index and summary of a shard that was written, None if it is to be computed again.

        Raises:
            PepperKinError: raised by computing or writing the shard.
            InfeasibleError: if workers died repeatedly while computing the shard.
        """
        shard = self.running.pop(future)
        if future.status == "finished":
            try:
                found = future.result(timeout=_GATHER)
            except TimeoutError:  # the worker with the result is gone; Dask may compute it again
                self.running[future] = shard
                return None
            future.release()  # else Dask would recompute it after the death of the worker with the result
            return shard, found
        error = future.exception() if future.status == "error" else None
        if error is not None and not isinstance(error, killed):
            raise error if isinstance(error, PepperKinError) else PepperKinError(f"shard {shard}: {error}")
        self._tries[shard] += 1
        if self._tries[shard] >= MOST_KILLS:
            raise InfeasibleError("dataset", f"workers died over shard {shard}", _ADVICE)
        self.waiting.appendleft(shard)
        return None


def on_dask(
    job: DatasetJob, shards: Iterable[int], store: Store, client: Any
) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Yield the index and the summary of each shard as soon as a cluster has written it.

    Args:
        job: The job.
        shards: Indices of the shards to compute.
        store: Store of the dataset; all workers must reach it by the same name.
        client: A `distributed.Client`, or the address of a scheduler.

    Raises:
        PepperKinError: raised by computing or writing a shard.
        InfeasibleError: if the scheduler is gone, or workers died repeatedly while computing one shard.
        MissingDependencyError: if Dask is not installed.
    """
    distributed = optional("distributed", extra="dask", need="a dataset on many machines")
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
        raise InfeasibleError("dataset", f"the scheduler is gone ({error})", _ADVICE) from error
    finally:
        if client.status == "running":
            client.cancel(list(run.running))
        if own:
            client.close(timeout=5)
