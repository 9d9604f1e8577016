"""Shards: files of a few rows each, the same in every process that computes them."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pepper_kin import __version__
from pepper_kin.datasets import kinds
from pepper_kin.datasets.columns import Moments, batch_of, schema_of
from pepper_kin.datasets.job import DatasetJob
from pepper_kin.datasets.recipe import Recipe
from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import FileFormatError

DATA = "data"
_ABOUT, _SUMMARY = b"pepper_kin.shard", b"pepper_kin.summary"
_KEPT = 8  # maximum number of jobs whose robots and scenes a process keeps


def key_of(job: DatasetJob, shard: int) -> str:
    """Return the key of a shard, a hash of the job and of the rows in it."""
    return hashlib.sha256(f"{job.hash} {job.bounds(shard)}".encode()).hexdigest()[:16]


def name_of(job: DatasetJob, shard: int) -> str:
    """Return the name of a shard's file in the dataset: its number and key."""
    return f"{DATA}/shard-{shard:06d}-{key_of(job, shard)}.parquet"


def kind_of(job: DatasetJob) -> kinds.DatasetKind:
    """Return the object that computes the rows of a job, cached.

    Raises:
        PepperKinError: naming the option of the job that the robot, planner or twin does not accept.
    """
    return _kind_of(json.dumps(job.as_dict()))


@lru_cache(_KEPT)
def _kind_of(text: str) -> kinds.DatasetKind:
    job = DatasetJob(**json.loads(text))
    return kinds.ALL[job.kind](Recipe(job))


def schema(job: DatasetJob, shard: int) -> pa.Schema:
    """Return the schema of a shard, with the hash of the job, the key and the versions in its metadata."""
    first, end = job.bounds(shard)
    about = {
        "job": job.hash, "shard": shard, "key": key_of(job, shard), "first": first, "rows": end - first,
        "pepper_kin": __version__, "pyarrow": pa.__version__,
    }  # fmt: skip
    return schema_of(kind_of(job).columns, {_ABOUT.decode(): json.dumps(about)})


def rows_of(job: DatasetJob, begin: int, end: int) -> Iterator[pa.RecordBatch]:
    """Yield rows from `begin` to before `end` as batches of one motion each, or of all solutions."""
    kind = kind_of(job)
    plain = pa.schema([column.field() for column in kind.columns])
    for values in kind.rows(begin, end):
        yield batch_of(plain, kind.columns, values)


def run_shard(job: DatasetJob, shard: int) -> pa.Table:
    """Compute the rows of a shard: a pure function with the same result in every process.

    Args:
        job: The job.
        shard: Index of the shard, from 0.

    Returns:
        The rows; `Column.of` describes a field's shape, unit and names.

    Raises:
        InvalidValueError: for a shard out of range.
        PepperKinError: naming the invalid option of the job.
    """
    batches = list(rows_of(job, *job.bounds(shard)))
    return pa.Table.from_batches(batches).replace_schema_metadata(schema(job, shard).metadata)


def write_shard(job: DatasetJob, shard: int, store: Store) -> dict[str, Any]:
    """Compute a shard and write it, motion by motion; return its summary.

    The file gets its name when all of it is on the disk: a killed process leaves no file, and a second
    process replaces the file by the same bytes.

    Raises:
        FileFormatError: if it cannot be written.
    """
    kind, found = kind_of(job), schema(job, shard)
    counts: Counter[str] = Counter()
    moments = {column.name: Moments() for column in kind.columns if column.counted}
    with (
        store.write(name_of(job, shard)) as file,
        pq.ParquetWriter(file, found, compression="zstd", use_dictionary=["status", "reason"]) as writer,
    ):
        for values in kind.rows(*job.bounds(shard)):
            writer.write_batch(batch_of(found, kind.columns, values))
            counts.update(values["status"])
            for column in kind.columns:
                if column.name in moments:
                    moments[column.name].add(np.asarray(values[column.name], column.dtype))
        parts = {name: each.parts.tolist() for name, each in moments.items() if each.parts is not None}
        summary = {"statuses": dict(sorted(counts.items())), "moments": parts}
        writer.add_key_value_metadata({_SUMMARY.decode(): json.dumps(summary)})
    return summary_of(job, shard, store)


def summary_of(job: DatasetJob, shard: int, store: Store) -> dict[str, Any]:
    """Return the manifest entry of a written shard: name, rows, size, SHA-256, statuses.

    Raises:
        FileFormatError: naming the file, if it is missing, damaged, or belongs to another job.
    """
    name = name_of(job, shard)
    digest, size = store.sha256(name)
    about, _, statuses = read_footer(store, name)
    first, end = job.bounds(shard)
    wanted = {"job": job.hash, "shard": shard, "first": first, "rows": end - first}
    for what, value in wanted.items():
        if about.get(what) != value:
            reason = f"is of another dataset: its {what} is {about.get(what)}, expected {value}"
            raise FileFormatError(store.path(name), reason)
    return {
        "name": name, "first": first, "rows": end - first, "bytes": size, "sha256": digest,
        "statuses": statuses,
    }  # fmt: skip


def read_footer(store: Store, name: str) -> tuple[dict[str, Any], dict[str, Any], dict[str, int]]:
    """Return the content of a shard's footer: the shard, the moments of its columns, and its statuses.

    Raises:
        FileFormatError: naming the file, if it is damaged or not a shard.
    """
    with store.open(name) as file:
        try:
            found = pq.read_metadata(file)
            about = json.loads(found.metadata[_ABOUT])
            summary = json.loads(found.metadata[_SUMMARY])
            if found.num_rows != about["rows"] or sum(summary["statuses"].values()) != about["rows"]:
                raise ValueError(f"{found.num_rows} rows in place of {about['rows']}")
            return about, summary["moments"], summary["statuses"]
        except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
            raise FileFormatError(store.path(name), f"is damaged, or no shard: {error}") from error
