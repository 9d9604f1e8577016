"""Check that a dataset is whole: no row missing or double, and recomputed rows equal bit by bit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from pepper_kin.datasets.columns import Column, decoded
from pepper_kin.datasets.dataset import JOB, MANIFEST, Dataset, open_dataset
from pepper_kin.datasets.export import export_faults
from pepper_kin.datasets.making import read_job
from pepper_kin.datasets.shard import DATA, name_of, rows_of
from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import FileFormatError, PepperKinError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.model.joint_vectors import check_seed, check_whole


@dataclass(frozen=True)
class DatasetCheck:
    """Result of a check.

    Attributes:
        rows: Number of rows of the job.
        shards: Number of files of the job.
        written: Number of files that exist.
        again: Indices of the rows that were recomputed.
        faults: Faults, one sentence each.
    """

    rows: int
    shards: int
    written: int
    again: tuple[int, ...]
    faults: tuple[str, ...]

    @property
    def success(self) -> bool:
        """Whether there are no faults."""
        return not self.faults

    def report(self) -> str:
        """Return the result as text."""
        lines = [f"{self.written} of {self.shards} files are there, for {self.rows} rows."]
        if self.success:
            lines.append("No row is missing or there twice, and every file is the one that was written.")
            lines.append(f"{len(self.again)} rows were recomputed and are the same to the last bit.")
        return "\n".join([*lines, *self.faults])

    def as_dict(self) -> dict[str, Any]:
        """Return the result as plain values."""
        found = {"success": self.success, "rows": self.rows, "shards": self.shards, "written": self.written}
        return {**found, "again": list(self.again), "faults": list(self.faults)}


def check(
    folder: PathName,
    *,
    sample: int = 5,
    seed: int = 0,
    on_progress: Callable[[int, int], None] | None = None,
) -> DatasetCheck:
    """Examine every file of a dataset, and recompute some of its rows.

    Args:
        folder: Folder of the dataset, or an address that fsspec knows.
        sample: Number of rows that are recomputed, each once; all files are read in any case.
        seed: Seed by which the rows are drawn.
        on_progress: Function that is called with the number of files read, and the number of all files.

    Raises:
        FileFormatError: for a folder without a dataset, or a damaged manifest.
    """
    check_whole("sample", sample, 0)
    store = Store(folder)
    job = read_job(store)
    names = [name_of(job, i) for i in range(job.shards)]
    there = {f"{DATA}/{name}" for name in store.names(DATA) if not name.startswith(".")}
    faults = [f"{store.path(name)}: is missing: resume" for name in names if name not in there]
    faults += [f"{store.path(name)}: is of no row of this job" for name in sorted(there - {*names})]
    if not store.exists(MANIFEST):
        faults.append(f"{store.place}: is not complete, it has no {MANIFEST}: resume")
        return DatasetCheck(job.rows, job.shards, len(there & {*names}), (), tuple(faults))
    dataset, sound = open_dataset(folder), []
    if [shard["name"] for shard in dataset.shards] != names:
        faults.append(f"{store.path(MANIFEST)}: is of another job than {JOB}")
        return DatasetCheck(job.rows, job.shards, len(there & {*names}), (), tuple(faults))
    for shard, name in enumerate(names):
        if name in there:
            try:
                _check_rows(dataset, shard)
                sound.append(shard)
            except FileFormatError as error:
                faults.append(f"{error}: remove it and {MANIFEST}, then resume")
        if on_progress is not None:
            on_progress(shard + 1, len(names))
    if job.format != "parquet":
        faults += export_faults(store, job.format)
    again = _sampled(dataset, sound, sample, seed)
    for row in again:
        faults += _compared(dataset, row)
    return DatasetCheck(job.rows, job.shards, len(there & {*names}), tuple(again), tuple(faults))


def _check_rows(dataset: Dataset, shard: int) -> None:
    """Refuse a file that is damaged, or whose row numbers are not the shard's in ascending order."""
    about, file = dataset.shards[shard], dataset.file(shard)
    try:
        rows = file.read(["row"])["row"].to_numpy()
    except (pa.ArrowException, OSError, KeyError) as error:
        raise FileFormatError(dataset.store.path(about["name"]), f"is damaged: {error}") from error
    if not np.array_equal(rows, np.arange(about["first"], about["first"] + about["rows"])):
        raise FileFormatError(dataset.store.path(about["name"]), "has rows that are missing or there twice")


def _sampled(dataset: Dataset, shards: list[int], count: int, seed: int) -> list[int]:
    """Return the indices of some rows of files, each once, in ascending order; all if there are no more."""
    begins = np.array([dataset.shards[shard]["first"] for shard in shards], dtype=np.int64)
    ends = np.cumsum([dataset.shards[shard]["rows"] for shard in shards], dtype=np.int64)
    if not len(ends):
        return []
    drawn = np.random.default_rng(check_seed(seed)).choice(ends[-1], min(count, ends[-1]), replace=False)
    at = np.searchsorted(ends, drawn, side="right")
    rows = begins[at] + drawn - np.concatenate([[0], ends])[at]
    return sorted(map(int, rows))


def _compared(dataset: Dataset, row: int) -> list[str]:
    """Return the differences of a row from its recomputed values, one text each."""
    kept = dataset[row]
    try:
        (batch,) = rows_of(dataset.job, row, row + 1)
    except PepperKinError as error:
        return [f"row {row} cannot be recomputed: {error}"]
    anew = {field.name: decoded(Column.of(field), batch[field.name])[0] for field in batch.schema}
    wrong = [
        name for name, value in anew.items()
        if not np.array_equal(np.asarray(value), np.asarray(kept[name]), equal_nan=_is_real(value))
    ]  # fmt: skip
    if not wrong:
        return []
    return [f"row {row} is another one when it is recomputed, in {', '.join(wrong)}"]


def _is_real(value: Any) -> bool:
    return np.asarray(value).dtype.kind == "f"
