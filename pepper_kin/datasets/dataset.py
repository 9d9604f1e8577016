"""Reading of datasets: rows by index or one after the other, as NumPy arrays or Arrow tables."""

from __future__ import annotations

import json
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import accumulate
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pepper_kin.datasets.columns import Column, Moments, decoded
from pepper_kin.datasets.job import DatasetJob, job_of_text
from pepper_kin.datasets.shard import DATA, read_footer
from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError, optional
from pepper_kin.file_access.atomic_file import PathName

JOB, MANIFEST, VERSION = "job.yaml", "manifest.json", 1
_SHARD = re.compile(rf"{DATA}/shard-[\w-]+\.parquet")
_OPEN = 8  # maximum number of files that are kept open
_MOST_GROUP = 65_536  # maximum number of rows that are read at once


class Dataset:
    """Rows of a dataset, read on demand.

    Args:
        store: Store of the files.
        job: Job of the dataset.
        manifest: Content of the manifest.
        verify: Whether the SHA-256 of each file is compared before its first row is read.

    Attributes:
        store: Store of the files.
        job: Job of the dataset.
        shards: Name, first row, rows, size, SHA-256 and statuses of each file.
    """

    def __init__(
        self, store: Store, job: DatasetJob, manifest: dict[str, Any], *, verify: bool = True
    ) -> None:
        self.store, self.job, self._verify = store, job, verify
        self.shards: list[dict[str, Any]] = manifest["shards"]
        self._firsts = [shard["first"] for shard in self.shards]
        self._files: dict[int, pq.ParquetFile] = {}
        self._verified: set[int] = set()
        self._edges: dict[int, list[int]] = {}

    def __len__(self) -> int:
        return self.job.rows

    def __repr__(self) -> str:
        """Return the folder, the kind and the number of rows."""
        return f"Dataset({self.store.place!r}, {self.job.kind}, {len(self)} rows)"

    @cached_property
    def schema(self) -> pa.Schema:
        """Arrow's schema of the rows."""
        some = next(iter(self._files.values()), None)  # if one is open: the first may be damaged
        return (self.file(0) if some is None else some).schema_arrow

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """The columns, with shapes, units and names.

        Raises:
            FileFormatError: for a file with columns of another format.
        """
        try:
            return tuple(Column.of(found) for found in self.schema)
        except (ValueError, KeyError, TypeError) as error:
            raise FileFormatError(self.store.path(self.shards[0]["name"]), f"is no shard: {error}") from error

    @property
    def statuses(self) -> dict[str, int]:
        """Number of rows per status."""
        counts: Counter[str] = Counter()
        for shard in self.shards:
            counts.update(shard["statuses"])
        return dict(counts.most_common())

    @cached_property
    def statistics(self) -> dict[str, dict[str, list[Any]]]:
        """Count, min, max, mean and std of the finite numbers of each column, except pictures."""
        found: dict[str, Moments] = {}
        for shard in self.shards:
            for name, parts in read_footer(self.store, shard["name"])[1].items():
                found.setdefault(name, Moments()).merge(Moments(parts).parts)  # type: ignore[arg-type]
        return {name: each.as_dict() for name, each in found.items()}

    def __getitem__(self, row: int) -> dict[str, Any]:
        """Return a row by its index, from the end if negative, as arrays, numbers and texts by column.

        Raises:
            IndexError: for an index out of range.
            FileFormatError: naming the damaged file.
        """
        number = row + len(self) if row < 0 else row
        if not 0 <= number < len(self):
            raise IndexError(f"row {row} of {len(self)}")
        shard = bisect_right(self._firsts, number) - 1
        file, edges = self.file(shard), self._edges[shard]
        group = bisect_right(edges, number - self._firsts[shard]) - 1
        table = self._group(shard, file, group)
        offset = number - self._firsts[shard] - edges[group]
        return self._row(table.slice(offset, 1))

    def row(self, number: int) -> dict[str, Any]:
        """Return a row by its index, as `[number]` does.

        Raises:
            InvalidValueError: for an index out of range.
        """
        try:
            return self[number]
        except IndexError:
            raise InvalidValueError("row", number, f"a number of 0 to {len(self) - 1}") from None

    def about(self) -> dict[str, Any]:
        """Return folder, job, sizes, statuses and columns as plain values."""
        job = self.job
        columns = {c.name: [c.dtype, *(["T"] if c.frames else []), *c.shape] for c in self.columns}
        return {
            "folder": self.store.place, "name": job.name, "kind": job.kind, "rows": len(self),
            "shards": len(self.shards), "bytes": sum(shard["bytes"] for shard in self.shards),
            "statuses": self.statuses, "seed": job.seed, "job": job.hash, "license": job.license,
            "columns": columns,
        }  # fmt: skip

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield row after row; one group of a file is in memory at a time."""
        for batch in self.batches():
            for offset in range(batch.num_rows):
                yield self._row(batch.slice(offset, 1))

    def batches(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """Yield the rows as Arrow tables: a motion each, or up to 65,536 solutions.

        Raises:
            UnknownNameError: for an unknown column.
            FileFormatError: naming the damaged file.
        """
        self._check(columns)
        for shard in range(len(self.shards)):
            file = self.file(shard)
            for group in range(file.num_row_groups):
                table = self._group(shard, file, group, columns)
                for begin in range(0, table.num_rows, _MOST_GROUP):
                    yield table.slice(begin, _MOST_GROUP)

    def arrow(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return all rows as one Arrow table in memory."""
        return pa.concat_tables(self.batches(columns))

    def numpy(self, columns: Sequence[str] | None = None) -> dict[str, Any]:
        """Return all rows in memory, by column: an array (N, ...), or for motions a list of (T, ...)."""
        table = self.arrow(columns)
        return {c.name: decoded(c, table[c.name]) for c in self.columns if c.name in table.column_names}

    def pandas(self, columns: Sequence[str] | None = None) -> Any:
        """Return all rows as a DataFrame of pandas."""
        optional("pandas", need="a DataFrame of pandas")
        return self.arrow(columns).to_pandas()

    def polars(self, columns: Sequence[str] | None = None) -> Any:
        """Return all rows as a DataFrame of polars."""
        return optional("polars", need="a DataFrame of polars").from_arrow(self.arrow(columns))

    def file(self, shard: int) -> pq.ParquetFile:
        """Return an open file.

        Raises:
            FileFormatError: naming the file, if it is missing or not the file that was written.
        """
        if shard not in self._files:
            about = self.shards[shard]
            name = about["name"]
            if self._verify and shard not in self._verified:
                if not self.store.exists(name):
                    raise FileFormatError(self.store.path(name), f"is missing, and {MANIFEST} names it")
                digest = self.store.sha256(name)[0]
                if digest != about["sha256"]:
                    reason = f"is damaged: its SHA-256 is {digest}, that of the manifest {about['sha256']}"
                    raise FileFormatError(self.store.path(name), reason)
                self._verified.add(shard)
            if len(self._files) >= _OPEN:
                self._files.pop(next(iter(self._files))).close(force=True)
            with self._named(shard):
                found = pq.ParquetFile(self.store.open(name))
                sizes = [found.metadata.row_group(k).num_rows for k in range(found.num_row_groups)]
                self._edges[shard] = [0, *accumulate(sizes[:-1])]
                if sum(sizes) != about["rows"]:
                    raise ValueError(f"{sum(sizes)} rows in place of {about['rows']}")
            self._files[shard] = found
        return self._files[shard]

    def _group(
        self, shard: int, file: pq.ParquetFile, group: int, columns: Sequence[str] | None = None
    ) -> pa.Table:
        with self._named(shard):
            return file.read_row_group(group, None if columns is None else list(columns))

    def _named(self, shard: int) -> Any:
        return _Named(self.store.path(self.shards[shard]["name"]))

    def _row(self, table: pa.Table) -> dict[str, Any]:
        found = {c.name: decoded(c, table[c.name])[0] for c in self.columns}
        return {
            name: value.item() if getattr(value, "shape", None) == () else value
            for name, value in found.items()
        }

    def _check(self, columns: Sequence[str] | None) -> None:
        for name in columns or ():
            if name not in self.schema.names:
                raise UnknownNameError("column", name, self.schema.names)


class _Named:
    """Context that turns Arrow's errors about a file's content into a `FileFormatError` naming the file."""

    def __init__(self, path: str) -> None:
        self._path = path

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if isinstance(error, pa.ArrowException | OSError | ValueError | KeyError) and not isinstance(
            error, FileFormatError
        ):
            raise FileFormatError(self._path, f"is damaged: {error}") from error


def open_dataset(folder: PathName, *, verify: bool = True) -> Dataset:
    """Open a complete dataset; `pepper_kin.datasets.open` is another name of this function.

    Args:
        folder: Folder of the dataset, or an address that fsspec knows.
        verify: Whether the SHA-256 of each file is compared before its first row is read.

    Raises:
        FileFormatError: naming the file, if the dataset is not complete, or its manifest is damaged.
    """
    store = Store(folder)
    if not store.exists(MANIFEST):
        reason = "is a dataset that is not complete: resume it" if store.exists(JOB) else "holds no dataset"
        raise FileFormatError(store.place, reason)
    job = job_of_text(store.read_text(JOB), store.path(JOB))
    try:
        manifest = json.loads(store.read_text(MANIFEST))
        firsts = [(shard["first"], shard["first"] + shard["rows"]) for shard in manifest["shards"]]
        if manifest["data set"] != VERSION:
            raise ValueError(f"version {manifest['data set']}, this library reads {VERSION}")
        if firsts != [job.bounds(k) for k in range(job.shards)] or manifest["rows"] != job.rows:
            raise ValueError("its rows are not those of the job")
        for k, shard in enumerate(manifest["shards"]):
            if not _SHARD.fullmatch(shard["name"]):
                raise ValueError(f"the name of file {k}")
            if sum(shard["statuses"].values()) != shard["rows"] or not isinstance(shard["sha256"], str):
                raise ValueError(f"the entry of {shard['name']}")
            shard["bytes"] + 0
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, InvalidValueError) as error:
        raise FileFormatError(store.path(MANIFEST), f"is damaged: {error}") from error
    return Dataset(store, job, manifest, verify=verify)
