"""Generation of datasets, and its resumption after an interruption."""

from __future__ import annotations

import json
import math
import os
import re
import time
from collections import Counter
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any

from pepper_kin import __version__
from pepper_kin.datasets.card import write_card
from pepper_kin.datasets.cluster import on_dask
from pepper_kin.datasets.dataset import JOB, MANIFEST, VERSION, Dataset, open_dataset
from pepper_kin.datasets.export import export
from pepper_kin.datasets.job import MADE_BY, DatasetJob, job_of_text
from pepper_kin.datasets.pool import on_pool
from pepper_kin.datasets.shard import DATA, kind_of, name_of, summary_of, write_shard
from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.model.joint_vectors import check_whole


@dataclass
class Progress:
    """Progress of the generation of a dataset.

    Attributes:
        done: Number of rows that are written.
        total: Number of rows of the complete dataset.
        new: Number of rows that this call has made.
        seconds: Time since the call began, on a monotonic clock [s].
        statuses: Number of rows that this call has made, per status.
    """

    done: int
    total: int
    new: int = 0
    seconds: float = 0.0
    statuses: Counter[str] = field(default_factory=Counter)

    @property
    def rate(self) -> float:
        """Rate of this call [rows/s]."""
        return self.new / self.seconds if self.seconds > 0 else 0.0

    @property
    def left(self) -> float:
        """Remaining time at this rate [s]; infinity before the first shard."""
        return (self.total - self.done) / self.rate if self.rate > 0 else math.inf

    def sentence(self) -> str:
        """Return the progress in a line."""
        ends = ", ".join(f"{count} {status}" for status, count in self.statuses.most_common())
        left = f"{self.left:.0f} s left" if math.isfinite(self.left) else "the time left is not known yet"
        return f"{self.done} of {self.total} rows, {self.rate:.0f} a second, {left}" + (ends and f"; {ends}")


def make(
    job: DatasetJob,
    folder: PathName,
    *,
    workers: int | None = None,
    client: Any = None,
    on_progress: Callable[[Progress], None] | None = None,
) -> Dataset:
    """Make a dataset, or the missing part of it in a folder.

    Every shard is a file with a name made of job and rows, written whole or not at all, so no row is lost or
    doubled, even if processes are killed and the call is repeated; the manifest comes last.

    Args:
        job: Specification of the dataset.
        folder: Folder of the dataset, or an address that fsspec knows.
        workers: Number of processes on this machine, one per core if omitted; 0 computes in this process.
        client: A `distributed.Client` or the address of a Dask scheduler, whose workers are used instead.
        on_progress: Function that is called after each shard.

    Returns:
        The dataset.

    Raises:
        InvalidValueError: for a folder with another dataset, or in use by another process.
        FileFormatError: for files that are damaged, or cannot be written: call again when there is space.
        InfeasibleError: if processes or the scheduler died repeatedly.
        PepperKinError: naming the invalid option of the job, before anything is written.
    """
    count = os.cpu_count() or 1 if workers is None else check_whole("workers", workers, 0, 4096)
    store = Store(folder)
    kind_of(job)  # refuses options that the robot, planner or twin does not accept
    with store.locked():
        _claim(store, job)
        store.clean(DATA)
        there = set(store.names(DATA))
        missing = [i for i in range(job.shards) if name_of(job, i).partition("/")[2] not in there]
        found: dict[int, dict[str, Any]] = {}
        if missing:
            run = _runner(job, missing, store, count, client)
            rows = {i: job.bounds(i)[1] - job.bounds(i)[0] for i in missing}
            state, begin = Progress(job.rows - sum(rows.values()), job.rows), time.monotonic()
            try:
                for shard, summary in run:
                    found[shard] = summary
                    state.done, state.new = state.done + rows[shard], state.new + rows[shard]
                    state.seconds = time.monotonic() - begin
                    state.statuses.update(summary["statuses"])
                    if on_progress is not None:
                        on_progress(state)
            finally:
                run.close()
        store.clean(DATA)
        _finish(store, job, found)
    return open_dataset(folder)


def resume(folder: PathName, **options: Any) -> Dataset:
    """Make the missing part of the dataset that was begun in a folder; see `make`.

    Raises:
        FileFormatError: for a folder in which no dataset was begun.
    """
    return make(read_job(Store(folder)), folder, **options)


def read_job(store: Store) -> DatasetJob:
    """Return the job of a dataset that was begun.

    Raises:
        FileFormatError: if there is no job, or another version of the library began the dataset.
    """
    if not store.exists(JOB):
        raise FileFormatError(store.place, f"holds no dataset that was begun: it has no {JOB}")
    text = store.read_text(JOB)
    made_by = re.search(rf"^{MADE_BY}: (.+)$", text, re.MULTILINE)
    if made_by is None or made_by[1].strip("'") != __version__:
        found = "no version" if made_by is None else made_by[1]
        reason = f"was begun by pepper_kin {found}, whose rows may be others: this is {__version__}"
        raise FileFormatError(store.path(JOB), reason)
    return job_of_text(text, store.path(JOB))


def _runner(
    job: DatasetJob, missing: list[int], store: Store, workers: int, client: Any
) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Return the generator that computes shards: on a cluster, in this process, or in a pool."""
    if client is not None:
        return on_dask(job, missing, store, client)
    if workers == 0:
        return ((shard, write_shard(job, shard, store)) for shard in missing)
    return on_pool(job, missing, store, min(workers, len(missing)))


def _claim(store: Store, job: DatasetJob) -> None:
    """Write the job into a new folder, or refuse a folder with another job."""
    if store.exists(JOB):
        other = read_job(store)
        if any(getattr(other, name) != getattr(job, name) for name in ("hash", "rows_per_shard", "format")):
            raise InvalidValueError("folder", store.place, f"a new one, or one with this very job in {JOB}")
        return
    others = [name for name in store.names("") if name != ".lock"]
    if others:
        raise InvalidValueError("folder", store.place, f"an empty one: it holds {', '.join(others[:3])}")
    store.write_text(JOB, job.text(**{MADE_BY: __version__}))


def _finish(store: Store, job: DatasetJob, found: dict[int, dict[str, Any]]) -> None:
    """Write statistics, card and exports of a complete dataset, and last the manifest that marks it so."""
    known: dict[int, dict[str, Any]] = {}
    if store.exists(MANIFEST):
        known = dict(enumerate(open_dataset(store.place).shards))
        if all(known[i] == summary for i, summary in found.items()):
            return  # else another pyarrow wrote the same rows in other bytes
    known |= found
    shards = [known[i] if i in known else summary_of(job, i, store) for i in range(job.shards)]
    content = {"data set": VERSION, "job": job.hash, "rows": job.rows, "shards": shards}
    text = json.dumps(content, indent=1) + "\n"
    dataset = Dataset(store, job, content)
    if not store.exists(MANIFEST):
        write_card(store, dataset)
        if job.format != "parquet":
            export(dataset, store, job.format)
    store.write_text(MANIFEST, text)
