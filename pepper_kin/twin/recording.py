"""Recordings of the twin: reading, replay and export."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import FileFormatError, InvalidValueError, shortened
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.numpy_archive import read_arrays
from pepper_kin.twin.packing import pack_together, unpack, unpack_moved, unpack_together
from pepper_kin.twin.push import Push
from pepper_kin.twin.recording_files import save_recording
from pepper_kin.twin.recording_header import STATES, described, loads_in, read_header
from pepper_kin.twin.reference import References
from pepper_kin.twin.run import Run
from pepper_kin.twin.run_status import RunStatus
from pepper_kin.twin.sensors.recording import ReadingSeries
from pepper_kin.twin.twin import Twin

_PARTS = ("time", "value", "truth")
_NONE = pack_together({})


def chunk_path(folder: Path, index: int) -> Path:
    """Return the file of a chunk."""
    return folder / f"{index:06d}.npz"


@dataclass(frozen=True, eq=False)
class Recording:
    """Recording written by a `Recorder`; read from disk at each access.

    Attributes:
        folder: Folder of the recording.
        header: Content of `recording.json`.
        chunks: Number of successive complete chunks from the first.
    """

    folder: Path
    header: dict[str, Any]
    chunks: int

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Order of the columns."""
        return tuple(self.header["joints"])

    @property
    def timestep(self) -> float:
        """Timestep of the twin [s]."""
        return float(self.header["timestep"])

    @property
    def chunk_steps(self) -> int:
        """Number of timesteps in a chunk, except the last one before a pause."""
        return int(self.header["chunk_steps"])

    @property
    def size(self) -> int:
        """Total size of all files [byte]."""
        return sum(path.stat().st_size for path in self.folder.iterdir() if path.is_file())

    def inputs(self) -> Iterator[dict[str, Array]]:
        """Yield the commands of each chunk, by the arguments of `Twin.follow`."""
        for index, chunk in enumerate(self._read()):
            with self._named(index):
                inputs = {
                    name: unpack(chunk[f"in.{name}"]) for name in References._fields if f"in.{name}" in chunk
                }
                _check_shapes(inputs, len(self.joint_names))
            yield inputs

    def run(self, torque_limit: Array | None = None) -> Run:
        """Return the whole recording as one run of the twin, including sensor readings.

        Args:
            torque_limit: Torque limits of the actuators [N m or N], shape (n,), for the run's report; none if
                omitted.

        Raises:
            FileFormatError: for a damaged file, naming it.
        """
        n, start = len(self.joint_names), self.header["start"]
        first = {name: np.array([float.fromhex(x) for x in start[name]])[None] for name in STATES}
        rows: dict[str, list[Array]] = {name: [first[name]] for name in STATES}
        recorded: dict[str, list[Array]] = {"position": [first["position"]], "velocity": [np.zeros((1, n))]}
        message, status, wrench = "", RunStatus.COMPLETED, [np.zeros((1, 6))]
        before = first["position"][-1]
        for index, chunk in enumerate(self._read()):
            with self._named(index):
                states = self._states(chunk, before)
                count = len(states["position"])
                for name, values in states.items():
                    rows[name].append(values)
                for name, store in recorded.items():
                    key = f"in.{name}"
                    store.append(unpack(chunk[key]) if key in chunk else np.zeros((count, n)))
                    _check_shapes({key: store[-1]}, n, count)
                key = "out.external_wrench"
                wrench.append(unpack(chunk[key]) if key in chunk else np.zeros((count, 6)))
                _check_shapes({key: wrench[-1]}, 6, count)
                message = str(chunk["message"])
                # Older recordings have no status.
                word = "stopped" if message else "completed"
                word = str(chunk["status"]) if "status" in chunk else word
                status = RunStatus(word)  # type: ignore[call-arg]
                before = np.concatenate([before[None], states["position"]])[-1]
        whole = {name: np.concatenate(parts) for name, parts in rows.items()}
        time: Array = self.timestep * np.arange(len(whole["position"]), dtype=float)
        return Run(
            self.joint_names,
            tuple(self.header["units"]),
            time,
            whole["position"],
            whole["velocity"],
            whole["torque"],
            np.concatenate(recorded["position"]),
            np.concatenate(recorded["velocity"]),
            np.full(n, math.inf) if torque_limit is None else torque_limit,
            status,
            message,
            self.readings(),
            np.concatenate(wrench),
            loads_in(self.header),
        )

    def readings(self) -> dict[str, ReadingSeries]:
        """Return the sensor readings by name, with times on the twin's clock."""
        parts: dict[str, list[tuple[Array, Any, Any]]] = {}
        about: dict[str, tuple[str, str]] = {}
        for index, chunk in enumerate(self._read()):
            with self._named(index):
                for key in chunk:
                    kind, _, name = key.partition(".")
                    if kind == "about":
                        unit, frame = chunk[key]
                        about[name] = (str(unit), str(frame))
                        time, value, truth = (unpack(chunk[f"{what}.{name}"]) for what in _PARTS)
                        known = parts.setdefault(name, [(time, value, truth)])[0]
                        if time.ndim != 1 or {len(time)} != {len(value), len(truth)}:
                            raise ValueError(f"readings of {name} have different lengths")
                        if (value.shape[1:], truth.shape[1:]) != (known[1].shape[1:], known[2].shape[1:]):
                            raise ValueError(f"readings of {name} have another shape than before")
                        if known[0] is not time:
                            parts[name].append((time, value, truth))
        joined = {
            name: [np.concatenate([row[i] for row in rows]) for i in range(3)] for name, rows in parts.items()
        }
        return {
            name: ReadingSeries(t, value, truth, *about[name]) for name, (t, value, truth) in joined.items()
        }

    def replay(self, twin: Twin) -> None:
        """Replay the recording with a twin, whose final state is the end of the recording.

        Args:
            twin: A twin created like the recorded one: same robot, timestep, actuators, world, sensors.

        Raises:
            InvalidValueError: for another twin, or a state that differs in a single bit, naming the step.
            FileFormatError: for a damaged file, naming it.
        """
        mine = {
            "joints": list(twin.pepper.joint_names),
            "timestep": twin.timestep,
            "substeps": twin.substeps,
            "feedforward": twin.feedforward,
            "sensors": sorted(getattr(twin.sensors, "names", ())),
            "loads": described(twin.loads),
        }
        for what, value in mine.items():
            if self.header.get(what) != value:
                raise InvalidValueError(f"{what} of the twin", value, f"{self.header.get(what)} as recorded")
        start = self.header["start"]
        twin.clear_pushes()
        twin.reset(*(np.array([float.fromhex(x) for x in start[name]]) for name in STATES[:2]))
        step, before = 0, np.array(twin.state.position)
        for index, (chunk, inputs) in enumerate(zip(self._read(), self.inputs(), strict=True)):
            _push(twin, chunk)
            run = twin.follow(**inputs)
            with self._named(index):
                recorded = self._states(chunk, before)
            for name, values in recorded.items():
                _compare(name, getattr(run, name)[1:], values, step, self.timestep, self.joint_names)
            # A run that stops at the first step of a chunk leaves a chunk without rows.
            step, before = step + len(run) - 1, np.concatenate([[before], recorded["position"]])[-1]

    def save(self, path: PathName) -> Path:
        """Export the recording: .npz (all arrays), .csv (states) or .mcap (states and sensors).

        Returns:
            The path.

        Raises:
            FileFormatError: for another suffix, or if the file cannot be written.
            MissingDependencyError: for .mcap if the package `mcap` is not installed.
        """
        return save_recording(self, path)

    def _states(self, chunk: dict[str, Any], before: Array) -> dict[str, Array]:
        """Return the states of a chunk's steps, shape (T, n) each.

        Args:
            chunk: Arrays of the chunk.
            before: Position before the steps [rad or m], shape (n,).
        """
        velocity, torque = unpack(chunk["out.velocity"]), unpack(chunk["out.torque"])
        _check_shapes({"velocity": velocity, "torque": torque}, len(self.joint_names), len(velocity))
        position = unpack_moved(chunk["out.position"], velocity, before, self.timestep)
        if not np.isfinite(position).all():
            raise ValueError("positions are not finite")
        return {"position": position, "velocity": velocity, "torque": torque}

    @contextlib.contextmanager
    def _named(self, index: int) -> Iterator[None]:
        """Convert errors about a chunk's content to errors that name its file."""
        try:
            yield
        except FileFormatError:
            raise
        except (ValueError, KeyError, TypeError, IndexError, MemoryError) as error:
            path, reason = chunk_path(self.folder, index), shortened(error)
            raise FileFormatError(path, f"is not a chunk of a recording: {reason}") from error

    def _read(self) -> Iterator[dict[str, Any]]:
        for index in range(self.chunks):
            with self._named(index):
                chunk: dict[str, Any] = dict(read_arrays(chunk_path(self.folder, index)))
                for name, (about, parts) in unpack_together(chunk.pop("readings", _NONE)).items():
                    chunk[f"about.{name}"] = about
                    chunk |= {f"{what}.{name}": part for what, part in zip(_PARTS, parts, strict=True)}
            yield chunk


def _check_shapes(arrays: dict[str, Array], n: int, count: int | None = None) -> None:
    """Refuse arrays that are not finite floats of shape (count, n).

    Raises:
        ValueError: for such an array, naming it.
    """
    for name, array in arrays.items():
        if array.dtype != np.float64 or array.ndim != 2 or array.shape[1] != n:
            raise ValueError(f"{name} is {array.dtype} of shape {array.shape}, expected (..., {n})")
        if count is not None and len(array) != count:
            raise ValueError(f"{name} has {len(array)} rows, expected {count}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} is not finite")


def load_recording(folder: PathName) -> Recording:
    """Read the recording in a folder.

    Args:
        folder: Folder of a `Recorder`.

    Returns:
        The recording; chunks after a missing one are ignored.

    Raises:
        FileFormatError: if there is no recording, or its header is damaged.
    """
    place = Path(folder)
    header = read_header(place)
    chunks = 0
    while chunk_path(place, chunks).is_file():
        chunks += 1
    return Recording(place, header, chunks)


def _push(twin: Twin, chunk: dict[str, Any]) -> None:
    known = {(p.frame, p.start, p.duration, *p.force, *p.point) for p in twin.pushes}
    for row, frame in zip(chunk.get("pushes", ()), chunk.get("push_frames", ()), strict=True):
        start, duration, *rest = (float(x) for x in row)
        if (str(frame), start, duration, *rest) not in known:
            added: Push = twin.push(str(frame), rest[:3], rest[3:], start=start, duration=duration)
            known.add((added.frame, added.start, added.duration, *added.force, *added.point))


def _compare(
    name: str, again: Array, recorded: Array, step: int, timestep: float, joints: tuple[str, ...]
) -> None:
    """Refuse a replay that differs from the recording.

    Args:
        name: Name of the quantity.
        again: Values of the replay, shape (T, n).
        recorded: Recorded values, shape (T', n), where T' differs if the replay stopped elsewhere.
        step: Index of the step before the first row.
        timestep: Timestep of the twin [s].
        joints: Names of the columns.

    Raises:
        InvalidValueError: for a difference, naming quantity, joint, step and time of the first one.
    """
    count = min(len(again), len(recorded))
    same = again[:count].view(np.uint64) == recorded[:count].view(np.uint64)
    if len(again) == len(recorded) and same.all():
        return
    row, joint = (int(x) for x in np.argwhere(~same)[0]) if not same.all() else (count, 0)
    raise InvalidValueError(
        f"{name} of {joints[joint]} at step {step + row + 1} ({(step + row + 1) * timestep:.6g} s)",
        repr(float(again[row, joint])) if row < count else "no value",
        (repr(float(recorded[row, joint])) if row < count else "a value") + " as recorded, to the last bit",
    )
