"""Shards on the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

from pepper_kin.datasets.job import DatasetJob
from pepper_kin.datasets.pool import MOST_KILLS
from pepper_kin.datasets.shard import write_shard
from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, MissingDependencyError, PepperKinError

_AHEAD = 3  # shards for each thread that the scheduler knows: few enough for any number of shards


def compute(values: dict[str, Any], shard: int, place: str) -> dict[str, Any]:
    """Compute and write a shard of the job of plain values; runs on a worker."""
    return write_shard(DatasetJob(**values), shard, Store(place))


def on_dask(
    job: DatasetJob, shards: Iterable[int], store: Store, client: Any
) -> Iterator[tuple[int, dict[str, Any]]]:
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
    try:
        import distributed
    except ImportError as error:
        command = 'pip install "pepper_kin[dask]"'
        raise MissingDependencyError("distributed", command, "a data set on many machines") from error
    if not isinstance(client, str | distributed.Client):
        raise InvalidValueError("client", repr(client), "a distributed.Client, or a scheduler's address")
    own = isinstance(client, str)
    advice = "start it again and resume: what is written stays"
    try:
        client = distributed.Client(client, timeout="10s") if own else client
    except OSError as error:
        raise InfeasibleError("scheduler", str(error), "name the address that it prints") from error
    values, waiting, numbers, tries = job.as_dict(), iter(shards), {}, dict[int, int]()

    def submit(shard: int) -> Any:
        options = {"pure": False, "key": f"{job.hash[:12]}-{shard}-{tries.get(shard, 0)}"}
        future = client.submit(compute, values, shard, store.place, **options)
        numbers[future.key] = shard
        return future

    try:
        threads = sum(client.nthreads().values())
        running = distributed.as_completed(map(submit, islice(waiting, max(4, _AHEAD * threads))))
        for future in running:
            shard, error = (
                numbers.pop(future.key),
                future.exception() if future.status != "cancelled" else None,
            )
            if future.status == "cancelled" or isinstance(error, distributed.scheduler.KilledWorker):
                tries[shard] = tries.get(shard, 0) + 1
                if client.status != "running":
                    raise InfeasibleError("data set", "the scheduler is gone", advice)
                if tries[shard] >= MOST_KILLS:
                    raise InfeasibleError("data set", f"workers died over shard {shard}", advice)
                running.add(submit(shard))
                continue
            if error is not None:
                raise (
                    error if isinstance(error, PepperKinError) else PepperKinError(f"shard {shard}: {error}")
                )
            found = future.result()
            future.release()  # else Dask would compute it again when the worker dies that holds the answer
            yield shard, found
            for following in islice(waiting, 1):
                running.add(submit(following))
    except PepperKinError:
        raise
    except Exception as error:  # Dask has many: closed clients, closed streams, cancelled futures
        if client.status == "running":
            raise
        raise InfeasibleError("data set", f"the scheduler is gone ({error})", advice) from error
    finally:
        for key in numbers:
            if client.status == "running":
                distributed.Future(key, client).cancel()
        if own:
            client.close(timeout=5)
