"""Export of finished datasets to LeRobot and MCAP."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.datasets.columns import Column
from pepper_kin.datasets.dataset import MANIFEST, Dataset
from pepper_kin.datasets.kinds import SOLVED
from pepper_kin.datasets.lerobot import Feature, LeRobotWriter
from pepper_kin.datasets.recipe import PLACE
from pepper_kin.datasets.shard import kind_of
from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import FileFormatError, FileFormatWarning, InvalidValueError, UnknownNameError
from pepper_kin.file_access.atomic_file import make_folder
from pepper_kin.files.motion_points import NANOSECONDS, MotionPoints
from pepper_kin.plugins import plugins
from pepper_kin.twin import Run
from pepper_kin.twin.sensors import ReadingSeries

_STATES = {
    "trajectories": ("position", "position"),
    "runs": ("position", "reference_position"),
    "demonstrations": ("observation", "action"),
    "replays": ("measured", "command"),
}
"""Kind -> columns that become LeRobot's observation.state and action."""


def export(dataset: Dataset, store: Store, format: str) -> None:
    """Write the solved motions of a dataset in another format, to the store's folder named after it.

    "lerobot": one LeRobotDataset v3.0 of all motions; sensors are resampled to the frames, which hold the
    newest reading.  For motions without a twin the action of a frame is the next frame's position.  If
    objects are shifted, `observation.environment_state` has their positions [m].  Joints that a log lacks are
    omitted.  "mcap": one file per row, with ROS 2 messages, on a disk only.  Digests of the files are written
    next to the folder, to "lerobot.json" or "mcap.json", against which `check` compares them.

    Raises:
        InvalidValueError: for another format or a kind without motions, if no row was solved or an object
            is in some scenes only, or for MCAP on an address of fsspec.
        MissingDependencyError: for films without PyAV, for MCAP without `mcap`.

    Warns:
        FileFormatWarning: naming joints that are omitted, and the deviation of times from even steps.
    """
    if dataset.job.kind not in _STATES:
        raise InvalidValueError("kind of dataset", dataset.job.kind, f"one of {', '.join(_STATES)}")
    if format == "lerobot":
        written = _to_lerobot(dataset, store)
    elif format == "mcap":
        written = _to_mcap(dataset, store)
    else:
        raise InvalidValueError("format", format, "lerobot or mcap")
    kept = _kept_digests(store, format) if store.exists(f"{format}.json") else {}
    digests = {name: store.sha256(name)[0] for name in (written if kept else store.files(format))}
    if digests:
        store.write_text(f"{format}.json", json.dumps(kept | digests, indent=1))


def export_faults(store: Store, format: str) -> list[str]:
    """Return the faults of the files of `export`, missing or changed, one sentence each."""
    if not store.exists(f"{format}.json"):
        missing = f"{store.path(f'{format}.json')}: is missing, the digests of the files in {format}"
        return [f"{missing}: remove {MANIFEST}, then resume"]
    again = f"remove {format}, {format}.json and {MANIFEST}, then resume"
    try:
        kept, there = _kept_digests(store, format), {*store.files(format)}
    except FileFormatError as error:
        return [f"{error}: {again}"]
    faults = [f"{store.path(name)}: is missing: {again}" for name in kept if name not in there]
    faults += [f"{store.path(name)}: is no file of this dataset" for name in sorted(there - kept.keys())]
    for name in sorted(there & kept.keys()):
        if (found := store.sha256(name)[0]) != kept[name]:
            words = f"is damaged: its SHA-256 is {found}, that of {format}.json {kept[name]}"
            faults.append(f"{store.path(name)}: {words}: {again}")
    return faults


def _kept_digests(store: Store, format: str) -> dict[str, str]:
    """Return the digests of the files that `export` wrote, by their names in the store.

    Raises:
        FileFormatError: for a file without digests.
    """
    name = f"{format}.json"
    try:
        kept = json.loads(store.read_text(name))
    except ValueError as error:
        raise FileFormatError(store.path(name), f"is damaged: {error}") from error
    if not isinstance(kept, dict):
        raise FileFormatError(store.path(name), "holds no digests by the names of files")
    return kept


def _to_lerobot(dataset: Dataset, store: Store) -> list[str]:
    """Write the LeRobotDataset unless it is complete; return the names of the written files."""
    place = Store(store.path("lerobot"))
    if place.exists("meta/info.json"):
        return []  # it was finished: info.json comes last
    place.remove()
    state, action = (next(c for c in dataset.columns if c.name == name) for name in _STATES[dataset.job.kind])
    sensed = {c.name for c in dataset.columns if f"{c.name}.time" in {o.name for o in dataset.columns}}
    known = _known_joints(dataset, state, action)
    names = tuple(name for name, good in zip(state.names, known, strict=False) if good)
    features = {
        name: Feature(int(known.sum()), names) if not known.all() else _feature(column)
        for name, column in (("observation.state", state), ("action", action))
    }
    others = [c for c in dataset.columns if c.name in sensed and _exported(c)]
    features |= {f"observation.{_folder(c)}.{c.name}": _feature(c) for c in others}
    places = [c for c in dataset.columns if c.name.startswith(PLACE)]
    if places:
        words = tuple(f"{c.name.removeprefix(PLACE)}.{axis}" for c in places for axis in c.names)
        features["observation.environment_state"] = Feature(len(words), words)
    task, fps = dataset.job.targets.get("task", dataset.job.name), _fps(dataset)
    uneven = 0.0
    with LeRobotWriter(place, fps, features) as writer:
        for row in dataset:
            if row["status"] != SOLVED or not len(row[state.name]):
                continue
            frames = _frames(row, state, action, others)
            for name in ("observation.state", "action"):
                frames[name] = frames[name] if known.all() else frames[name][:, known]
            if places:
                where = np.concatenate([row[c.name] for c in places])
                frames["observation.environment_state"] = np.tile(where, (len(row[state.name]), 1))
            writer.add(task, **frames)
            even = row["time"][0] + np.arange(len(row["time"])) / fps
            uneven = max(uneven, float(np.abs(row["time"] - even).max()))
    if uneven > 0.5 / fps:
        text = f"lerobot: frames are stated every {1.0 / fps:g} s; their times differ by up to {uneven:.3g} s"
        warnings.warn(text, FileFormatWarning, stacklevel=4)
    return store.files("lerobot")


def _known_joints(dataset: Dataset, state: Column, action: Column) -> Array:
    """Return a mask of the numbers of state and action in every row, shape (size,); logs may lack joints.

    Warns:
        FileFormatWarning: naming the joints that are omitted.
    """
    known = np.ones(state.size, bool)
    if dataset.job.kind != "replays":
        return known
    for row in dataset:
        if row["status"] == SOLVED:
            known &= np.isfinite(row[state.name]).all(axis=0) & np.isfinite(row[action.name]).all(axis=0)
    if not known.any():
        raise InvalidValueError("replays", "no joint that all logs have", "logs with one at least")
    if not known.all():
        lacking = ", ".join(name for name, good in zip(state.names, known, strict=True) if not good)
        words = f"lerobot: joints that not every log has at all times are left out: {lacking}"
        warnings.warn(words, FileFormatWarning, stacklevel=5)
    return known


def _fps(dataset: Dataset) -> float:
    """Return the rate of the frames [1/s]."""
    if dataset.job.kind in ("trajectories", "runs"):
        return dataset.job.fps
    times = next(row["time"] for row in dataset if len(row["time"]) > 1)
    return float(round(1.0 / float(np.median(np.diff(times)))))


def _frames(row: dict[str, Any], state: Column, action: Column, others: list[Column]) -> dict[str, Any]:
    """Return the frames of a row by LeRobot's feature names; sensors have their newest reading."""
    values, wanted = row[state.name], row[action.name]
    if state == action:
        wanted = np.concatenate([wanted[1:], wanted[-1:]])
    found = {"observation.state": values, "action": wanted}
    for column in others:
        newest = np.searchsorted(row[f"{column.name}.time"], row["time"] + 1e-9, side="right") - 1
        items = row[column.name][np.maximum(newest, 0)]
        items = items if _is_picture(column) else np.reshape(items, (len(items), max(1, column.size)))
        found[f"observation.{_folder(column)}.{column.name}"] = items
    return found


def _is_picture(column: Column) -> bool:
    return column.dtype == "uint8" and len(column.shape) == 3


def _exported(column: Column) -> bool:
    return _is_picture(column) or column.counted


def _folder(column: Column) -> str:
    return "images" if _is_picture(column) else "sensors"


def _feature(column: Column) -> Feature:
    if _is_picture(column):
        return Feature(picture=(column.shape[0], column.shape[1]))
    return Feature(max(1, column.size), column.names)


def _to_mcap(dataset: Dataset, store: Store) -> list[str]:
    """Write the missing MCAP files; return their names in the store."""
    if store.local is None:
        raise InvalidValueError("format", "mcap", f"another one for {store.place}: it needs a disk")
    if "mcap" not in plugins("formats"):
        raise UnknownNameError("format", "mcap", plugins("formats"))
    writer, folder = plugins("formats")["mcap"].load(), make_folder(store.local / "mcap")
    pepper, written = kind_of(dataset.job).recipe.pepper, []
    for row in dataset:
        path = folder / f"row-{row['row']:06d}.mcap"
        if row["status"] != SOLVED or not len(row["time"]) or path.exists():
            continue
        if dataset.job.kind == "runs":
            writer.write_recording(path, _run(dataset, row, pepper))
        else:
            writer.write_trajectory(path, _points(dataset, row, path))
        written.append(f"mcap/{path.name}")
    return written


def _run(dataset: Dataset, row: dict[str, Any], pepper: Any) -> Run:
    """Return a row as a `Run` of the twin."""
    columns = {c.name: c for c in dataset.columns}
    readings = {}
    for name in columns:
        if f"{name}.time" in columns:
            items = row[name]
            readings[name] = ReadingSeries(row[f"{name}.time"], items, items, columns[name].unit, "")
    reference: Array = row["reference_position"]
    return Run(
        pepper.joint_names, pepper.joint_units, row["time"], row["position"], row["velocity"], row["torque"],
        reference, np.zeros_like(reference), np.full(pepper.n, np.inf), readings=readings,
    )  # fmt: skip


def _points(dataset: Dataset, row: dict[str, Any], path: Path) -> MotionPoints:
    """Return a row as a motion through its frames."""
    name = {"replays": "measured"}.get(dataset.job.kind, "position")
    column = next(c for c in dataset.columns if c.name == name)
    position = row[name]
    good = np.isfinite(position).all(axis=0)
    if not good.any():
        raise FileFormatError(path, "has no joint that was measured")
    time = row["time"] - row["time"][0]
    velocity = row["velocity"] if "velocity" in row else np.gradient(position, time, axis=0)
    pepper = kind_of(dataset.job).recipe.pepper
    names = tuple(name for name, known in zip(column.names, good, strict=True) if known)
    units = tuple(pepper.joint_units[pepper.joint_index(name)] for name in names)
    stamps = np.round(time * NANOSECONDS).astype(np.int64)
    return MotionPoints(names, units, stamps, position[:, good], velocity[:, good], None)
