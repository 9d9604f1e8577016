"""Writer of LeRobotDataset v3.0 that needs only pyarrow."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import ArrayLike, NDArray

from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import FileFormatError, InvalidValueError, optional
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.model.joint_vectors import check_positive

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
_NAMES = ("min", "max", "mean", "std", "count", *(f"q{round(100 * q):02d}" for q in QUANTILES))
_INDICES = ("frame_index", "episode_index", "index", "task_index")
RESERVED = ("timestamp", *_INDICES, "task", "language_persistent", "language_events")
"""Columns that LeRobot adds to the features or reads as language; its items also have the task as text."""
_CHUNK = 1000  # maximum number of files in a folder
_TOGETHER = 1000  # maximum number of episodes whose statistics are in memory
_STILLS = 32  # maximum number of pictures of an episode in its statistics
_DATA = "data/chunk-{:03d}/file-{:03d}.parquet"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_VIDEO = "videos/{}/chunk-{:03d}/file-{:03d}.mp4"


@dataclass(frozen=True)
class Feature:
    """Feature of a frame: numbers or a picture.

    Attributes:
        size: Number of float32 numbers; 0 for a picture.
        names: Names of the numbers.
        picture: Height and width of a picture [pixel], both even; its frames are a film.
    """

    size: int = 0
    names: tuple[str, ...] = ()
    picture: tuple[int, int] = (0, 0)


class LeRobotWriter:
    """Writer of episodes; a context manager, which completes the dataset: `meta/info.json` comes last.

    Args:
        place: A new folder, or an address that fsspec knows.
        fps: Frame rate [1/s], an integer.
        features: Name, such as `observation.state` and `action` -> feature.
        robot_type: Name of the robot.
        frames_per_file: Number of frames after which a new file begins.

    Raises:
        InvalidValueError: for a folder that is not empty, features without any numbers, feature names that
            LeRobot reserves or cannot store ("/"), or another number of names than of numbers.
        MissingDependencyError: for films if PyAV is not installed.
    """

    def __init__(
        self,
        place: PathName | Store,
        fps: float,
        features: Mapping[str, Feature],
        *,
        robot_type: str = "pepper",
        frames_per_file: int = 500_000,
    ) -> None:
        self.store = place if isinstance(place, Store) else Store(place)
        if self.store.names(""):
            raise InvalidValueError("place", self.store.place, "an empty folder, or a new one")
        self.fps = round(check_positive("fps", fps))
        if self.fps != fps or self.fps < 1:
            raise InvalidValueError("fps", fps, "a whole number: LeRobot has no other")
        self.features, self.robot_type, self._most = dict(features), robot_type, frames_per_file
        _check_features(self.features)
        self._numbers = {name: f for name, f in self.features.items() if f.size}
        self._films = {name: f for name, f in self.features.items() if not f.size}
        if not self._numbers:
            raise InvalidValueError("features", sorted(features), "one of numbers, at least")
        if self._films:
            _av()
        # One number is a plain column: lerobot refuses lists of length one.
        fields = [
            pa.field(name, pa.float32() if f.size == 1 else pa.list_(pa.float32(), f.size))
            for name, f in self._numbers.items()
        ]
        fields += [pa.field("timestamp", pa.float32()), *(pa.field(name, pa.int64()) for name in _INDICES)]
        self._schema = pa.schema(fields)
        self._edges = np.cumsum([0, *(f.size for f in self._numbers.values())])
        self.episodes = self.frames = self._file = self._in_file = 0
        self._tasks: dict[str, int] = {}
        self._rows: list[tuple[Any, ...]] = []
        self._statistics: list[NDArray[np.float64]] = []
        self._totals: NDArray[np.float64] | None = None
        self._open: dict[str, tuple[Any, pq.ParquetWriter]] = {}

    def add(self, task: str, /, **frames: ArrayLike) -> None:
        """Append an episode.

        Args:
            task: Description of the episode's task.
            **frames: Frames of each feature: (T, size) numbers, or (T, height, width, 3) colors, 0 to 255.

        Raises:
            InvalidValueError: naming the feature, for another shape, no frame, or NaN.
            FileFormatError: if a file cannot be written.
        """
        if {*frames} != {*self.features}:
            raise InvalidValueError("features", ", ".join(sorted(frames)), ", ".join(sorted(self.features)))
        arrays = {name: np.asarray(frames[name], np.float32) for name in self._numbers}
        count = len(next(iter(arrays.values())))
        for name, array in arrays.items():
            if array.shape != (count, self._numbers[name].size) or not count:
                allowed = f"shape ({count or 'T'}, {self._numbers[name].size}), T frames of each feature"
                raise InvalidValueError(name, f"shape {array.shape}", allowed)
        films = {name: np.asarray(frames[name]) for name in self._films}
        for name, film in films.items():
            shape = (count, *self._films[name].picture, 3)
            if film.shape != shape or film.dtype != np.uint8:
                raise InvalidValueError(
                    name, f"{film.dtype} of shape {film.shape}", f"uint8 of shape {shape}"
                )
        number = self._tasks.setdefault(task, len(self._tasks))
        at = np.arange(count)
        scalars = [
            (at / self.fps).astype(np.float32), at, np.full(count, self.episodes), self.frames + at,
            np.full(count, number),
        ]  # fmt: skip
        # One row per number, so that all are sorted in one call, in vector registers.
        table = np.empty((self._edges[-1] + 1, count), np.float32)
        for name, begin, end in zip(arrays, self._edges[:-1], self._edges[1:], strict=True):
            table[begin:end] = arrays[name].T
        table[-1] = scalars[0]
        parts = [_of_numbers(table)]
        if not np.isfinite(parts[0][:2]).all():
            bad = next(name for name, array in arrays.items() if not np.isfinite(array).all())
            raise InvalidValueError(bad, "NaN or infinity", "finite numbers")
        parts.append(_of_indices(count, self.episodes, self.frames, number))
        parts += [_of_pictures(film) for film in films.values()]
        self._write(arrays, scalars, count)
        for name, film in films.items():
            chunk, file = divmod(self.episodes, _CHUNK)
            with self.store.write(_VIDEO.format(name, chunk, file)) as target:
                _encode(film, self.fps, target)
        self._rows.append((task, count, self.frames, *divmod(self._file, _CHUNK)))
        self._statistics.append(np.concatenate(parts, axis=1))
        self.episodes, self.frames = self.episodes + 1, self.frames + count
        if len(self._rows) >= _TOGETHER:
            self._flush()

    def close(self) -> None:
        """Complete the dataset.

        Raises:
            InvalidValueError: if no episode was added.
            FileFormatError: if a file cannot be written.
        """
        if not self.episodes:
            raise InvalidValueError("episodes", 0, "one at least")
        self._flush()
        self._end_file("data")
        self._end_file("episodes")
        with self.store.write("meta/tasks.parquet") as file:
            pq.write_table(_tasks_table(list(self._tasks)), file)
        self.store.write_text("meta/stats.json", json.dumps(self._whole_statistics(), indent=1))
        self.store.write_text("meta/info.json", json.dumps(self._info(), indent=1))

    def __enter__(self) -> LeRobotWriter:
        """Return itself."""
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        """Close; after an exception leave the folder without `meta/info.json`, so that readers refuse it."""
        if kind is None:
            self.close()
            return
        for context, _ in self._open.values():
            context.__exit__(kind, error, trace)
        self._open = {}

    def _write(self, arrays: dict[str, Any], scalars: list[Any], count: int) -> None:
        """Write the frames of an episode as one group (lerobot reads whole groups)."""
        if "data" in self._open and self._in_file + count > self._most:
            self._end_file("data")
            self._file, self._in_file = self._file + 1, 0
        columns = []
        for array in arrays.values():
            flat = pa.array(np.ascontiguousarray(array).reshape(-1))
            size = array.shape[1]
            columns.append(flat if size == 1 else pa.FixedSizeListArray.from_arrays(flat, size))
        batch = pa.RecordBatch.from_arrays([*columns, *map(pa.array, scalars)], schema=self._schema)
        self._writer("data", _DATA.format(*divmod(self._file, _CHUNK)), self._schema).write_batch(batch)
        self._in_file += count

    def _writer(self, key: str, name: str, schema: pa.Schema) -> pq.ParquetWriter:
        if key not in self._open:
            context = self.store.write(name)
            options = {"compression": "snappy", "use_dictionary": False, "write_statistics": False}
            self._open[key] = context, pq.ParquetWriter(context.__enter__(), schema, **options)
        return self._open[key][1]

    def _end_file(self, key: str) -> None:
        context, writer = self._open.pop(key)
        try:
            writer.close()
        except BaseException as error:
            context.__exit__(type(error), error, error.__traceback__)
            raise
        context.__exit__(None, None, None)

    def _spans(self) -> dict[str, tuple[int, int]]:
        """Return the range of each feature in the arrays of all statistics."""
        sizes = {name: f.size for name, f in self._numbers.items()}
        sizes |= {"timestamp": 1, **dict.fromkeys(_INDICES, 1), **dict.fromkeys(self._films, 3)}
        ends = np.cumsum(list(sizes.values())).tolist()
        return {n: (end - size, end) for (n, size), end in zip(sizes.items(), ends, strict=True)}

    def _flush(self) -> None:
        """Write the metadata and statistics of the last episodes."""
        if not self._rows:
            return
        found, first = np.stack(self._statistics), self.episodes - len(self._rows)
        tasks, counts, begins, chunks, files = zip(*self._rows, strict=True)
        numbers = np.arange(first, self.episodes)
        zeros, counts_of = np.zeros_like(numbers), np.array(counts)
        columns: dict[str, Any] = {
            "episode_index": numbers,
            "tasks": pa.array([[task] for task in tasks], pa.list_(pa.string())),
            "length": counts_of,
            "data/chunk_index": np.array(chunks),
            "data/file_index": np.array(files),
            "dataset_from_index": np.array(begins),
            "dataset_to_index": np.array(begins) + counts_of,
            "meta/episodes/chunk_index": zeros,
            "meta/episodes/file_index": zeros,
        }
        for name in self._films:
            columns[f"videos/{name}/chunk_index"] = numbers // _CHUNK
            columns[f"videos/{name}/file_index"] = numbers % _CHUNK
            columns[f"videos/{name}/from_timestamp"] = np.zeros(len(numbers))
            columns[f"videos/{name}/to_timestamp"] = counts_of / self.fps
        for name, (begin, end) in self._spans().items():
            for k, word in enumerate(_NAMES):
                value = found[:, k, begin:end]
                value = value[:, :1].astype(np.int64) if word == "count" else value
                columns[f"stats/{name}/{word}"] = _lists(value, deep=name in self._films and word != "count")
        table = pa.table(columns)
        self._writer("episodes", _EPISODES, table.schema).write_table(table)
        self._total(found)
        self._rows, self._statistics = [], []

    def _total(self, found: NDArray[np.float64]) -> None:
        """Add statistics, shape (episodes, 10, size), to the totals; quantiles are weighted means."""
        rows = found if self._totals is None else np.concatenate([self._totals[None], found])
        low, high, mean, std, count = (rows[:, k] for k in range(5))
        whole = count.sum(axis=0)
        total = np.empty(rows.shape[1:])
        total[0], total[1], total[4] = low.min(axis=0), high.max(axis=0), whole
        total[2] = (count * mean).sum(axis=0) / whole
        total[3] = np.sqrt((count * (std**2 + (mean - total[2]) ** 2)).sum(axis=0) / whole)
        total[5:] = (count[:, None] * rows[:, 5:]).sum(axis=0) / whole
        self._totals = total

    def _whole_statistics(self) -> dict[str, dict[str, Any]]:
        found: dict[str, dict[str, Any]] = {}
        assert self._totals is not None
        for name, (begin, end) in self._spans().items():
            found[name] = {}
            for k, word in enumerate(_NAMES):
                value = self._totals[k, begin:end]
                if word == "count":
                    found[name][word] = [int(value[0])]
                else:
                    found[name][word] = (value[:, None, None] if name in self._films else value).tolist()
        return found

    def _info(self) -> dict[str, Any]:
        features: dict[str, Any] = {
            name: {"dtype": "float32", "shape": [f.size], "names": list(f.names) or None}
            for name, f in self._numbers.items()
        }
        for name, film in self._films.items():
            about = {
                "video.height": film.picture[0], "video.width": film.picture[1], "video.codec": "h264",
                "video.pix_fmt": "yuv420p", "video.is_depth_map": False, "video.fps": self.fps,
                "video.channels": 3, "has_audio": False,
            }  # fmt: skip
            shape = [*film.picture, 3]
            names = ["height", "width", "channels"]
            features[name] = {"dtype": "video", "shape": shape, "names": names, "info": about}
        features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
        features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in _INDICES}
        video = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
        return {
            "codebase_version": "v3.0",
            "robot_type": self.robot_type,
            "total_episodes": self.episodes,
            "total_frames": self.frames,
            "total_tasks": len(self._tasks),
            "chunks_size": _CHUNK,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 500,
            "fps": self.fps,
            "splits": {"train": f"0:{self.episodes}"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": video if self._films else None,
            "features": features,
        }


def _check_features(features: Mapping[str, Feature]) -> None:
    """Refuse features that LeRobot cannot store, naming the feature."""
    for name, feature in features.items():
        if name in RESERVED:
            raise InvalidValueError("feature", repr(name), f"another name than {', '.join(RESERVED)}")
        if not name or {*"/\\\0"} & {*name} or name in (".", ".."):
            raise InvalidValueError("feature", repr(name), "a name that is not empty and without '/'")
        if name.endswith("_is_pad"):
            words = "a name with another end: what LeRobot adds to a window of a feature has this one"
            raise InvalidValueError("feature", repr(name), words)
        if feature.size < 0 or len(set(feature.names)) < len(feature.names):
            raise InvalidValueError(f"feature {name}", feature, "a size of at least 0, names that differ")
        if feature.names and len(feature.names) != feature.size:
            count = f"{len(feature.names)} names of {feature.size} numbers"
            raise InvalidValueError(f"feature {name}", count, "one name for each number, or none")
        if not feature.size and (min(feature.picture) < 2 or any(side % 2 for side in feature.picture)):
            raise InvalidValueError(f"feature {name}", feature.picture, "numbers, or even height and width")


def _of_numbers(table: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the statistics of numbers, shape (size, T), as rows of `_NAMES`, shape (10, size).

    Quantiles are interpolated linearly between sorted numbers at (T - 1) q, like NumPy's.
    """
    count = table.shape[1]
    table = table.copy()
    mean = table.mean(axis=1, dtype=np.float64)
    # Scaled by a power of two, so that no square overflows or underflows in single precision.
    power = np.frexp(np.maximum(table.max(axis=1), -table.min(axis=1)))[1].clip(-120, 120)
    scale = np.ldexp(np.float32(1.0), -power)[:, None]
    shifted = table * scale - (mean[:, None] * scale).astype(np.float32)
    std = np.sqrt((shifted**2).mean(axis=1, dtype=np.float64)) / scale[:, 0]
    table.sort(axis=1)
    place = (count - 1) * np.array(QUANTILES)
    low = place.astype(int)
    high, share = np.minimum(low + 1, count - 1), place - low
    below = table[:, low].astype(np.float64)
    quantiles = below + share * (table[:, high] - below)
    counts = np.full(len(table), float(count))
    return np.vstack([table[:, 0], table[:, -1], mean, std, counts, quantiles.T])


def _of_indices(count: int, episode: int, first: int, task: int) -> NDArray[np.float64]:
    """Return the statistics of `_INDICES`: of the sequences 0 ... T - 1, and of constants."""
    last = count - 1
    run = [0.0, last, last / 2, np.sqrt((count**2 - 1) / 12), count, *(last * q for q in QUANTILES)]
    shift = np.array([1.0, 1.0, 1.0, 0.0, 0.0, *(1.0 for _ in QUANTILES)])
    level = np.array([0.0, 0.0, 0.0, 0.0, count, *(0.0 for _ in QUANTILES)])
    return np.column_stack([run, level + episode * shift, run + first * shift, level + task * shift])


def _of_pictures(film: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the statistics of the colors of some pictures, 0 to 1, shape (10, 3)."""
    few = film[np.unique(np.linspace(0, len(film) - 1, min(_STILLS, len(film))).round().astype(int))]
    found = _of_numbers(few.reshape(-1, 3).T.astype(np.float32) / np.float32(255.0))
    found[4] = len(few)
    return found


def _lists(values: NDArray[Any], *, deep: bool) -> pa.Array:
    """Return rows (N, k) as lists, or as lists of (k, 1, 1) for statistics of pictures."""
    found = pa.array(np.ascontiguousarray(values).reshape(-1))
    for _ in range(2 if deep else 0):
        found = pa.ListArray.from_arrays(np.arange(len(found) + 1, dtype=np.int32), found)
    edges = np.arange(len(values) + 1, dtype=np.int32) * values.shape[1]
    return pa.ListArray.from_arrays(edges, found)


def _tasks_table(tasks: Sequence[str]) -> pa.Table:
    """Return the tasks with metadata that make pandas use their texts as the index."""

    def column(name: str | None, field: str, kind: str, dtype: str) -> dict[str, Any]:
        return {"name": name, "field_name": field, "pandas_type": kind, "numpy_type": dtype, "metadata": None}

    index = "__index_level_0__"
    about = {
        "index_columns": [index],
        "column_indexes": [
            {**column(None, "None", "unicode", "object"), "metadata": {"encoding": "UTF-8"}}
        ],
        "columns": [
            column("task_index", "task_index", "int64", "int64"), column(None, index, "unicode", "object")
        ],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.2.0",
    }  # fmt: skip
    table = pa.table({"task_index": np.arange(len(tasks)), index: pa.array(tasks, pa.string())})
    return table.replace_schema_metadata({"pandas": json.dumps(about)})


def _av() -> Any:
    return optional("av", extra="video", need="films of cameras")


def _encode(film: NDArray[np.uint8], fps: int, target: BinaryIO) -> None:
    """Encode pictures, shape (T, height, width, 3), as H.264; every second picture is a keyframe."""
    av = _av()
    try:
        with av.open(target, "w", format="mp4") as container:
            stream = container.add_stream("libx264", rate=Fraction(fps))
            stream.height, stream.width, stream.pix_fmt = *film.shape[1:3], "yuv420p"
            stream.options = {"crf": "23", "g": "2", "threads": "1"}
            for picture in film:
                container.mux(
                    stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24"))
                )
            container.mux(stream.encode())
    except av.error.FFmpegError as error:
        raise FileFormatError("film", f"cannot be encoded: {error}") from error
