"""Recording of the twin's runs on disk while they happen, in chunks of a second."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.file_access import atomic_file
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.numpy_archive import write_arrays
from pepper_kin.model.joint_vectors import as_finite, check_positive
from pepper_kin.trajectory.trajectory import Trajectory
from pepper_kin.twin.packing import pack, pack_moved, pack_together
from pepper_kin.twin.recording import Recording, chunk_path, load_recording
from pepper_kin.twin.recording_header import HEADER, STATES, described, write_header
from pepper_kin.twin.reference import References, sampled
from pepper_kin.twin.run import SERIES, Run
from pepper_kin.twin.run_status import RunStatus
from pepper_kin.twin.sensors.recording import ReadingSeries
from pepper_kin.twin.twin import Twin


class Recorder:
    """Recorder of a twin's motion.

        recorder = Recorder(pk.Twin(pepper), "monday", seed=3)
        recorder.execute(trajectory)
        recorder.recording.save("monday.mcap")

    A recording is a folder: `recording.json` is its header, and each second of the twin's time is a separate
    file, written completely or not at all.  After a crash, only the current second is missing;
    `Recorder.resume` continues the recording.  Commands, position, velocity and torque of every step are
    recorded, and every sensor reading with its true value and time.

    Args:
        twin: The twin, which is reset to its present position and velocity.
        folder: Folder of the recording; created if missing, and must not contain a recording.
        chunk: Time between files [s].
        seed: Stored in the header; pass it to the sensors and to all else that is random.

    Raises:
        FileFormatError: if the folder contains a recording already, or cannot be written.
    """

    def __init__(self, twin: Twin, folder: PathName, *, chunk: float = 1.0, seed: int = 0) -> None:
        self.twin, self.folder = twin, atomic_file.make_folder(folder)
        self._steps = max(round(check_positive("chunk", chunk, "s") / twin.timestep), 1)
        if (self.folder / HEADER).exists():
            raise FileFormatError(
                self.folder, "holds a recording already: take another folder, or Recorder.resume"
            )
        self._count = 0
        start = twin.reset(twin.state.position, twin.state.velocity)
        header = {
            "robot": twin.pepper.name,
            "joints": list(twin.pepper.joint_names),
            "units": list(twin.pepper.joint_units),
            "timestep": twin.timestep,
            "substeps": twin.substeps,
            "feedforward": twin.feedforward,
            "chunk_steps": self._steps,
            "seed": seed,
            "loads": described(twin.loads),
            "sensors": sorted(getattr(twin.sensors, "names", ())),
            "start": {
                "position": [float(x).hex() for x in start.position],
                "velocity": [float(x).hex() for x in start.velocity],
                "torque": [float(x).hex() for x in start.torque],
            },
        }
        write_header(self.folder, header)

    @classmethod
    def resume(cls, twin: Twin, folder: PathName) -> Recorder:
        """Continue an interrupted recording.

        The twin replays the recording, which restores the states of sensors, world and delays, and is
        compared with it bit by bit.

        Args:
            twin: A twin created like the recorded one.
            folder: Folder of the recording.

        Returns:
            A recorder at the end of the last whole chunk, at the time `recorder.time`.

        Raises:
            FileFormatError: if there is no recording, or it is damaged.
            InvalidValueError: for a twin with other joints, timestep or physics, naming the first step that
                differs.
        """
        found = load_recording(folder)
        found.replay(twin)
        recorder = cls.__new__(cls)
        recorder.twin, recorder.folder = twin, Path(folder)
        recorder._steps, recorder._count = found.chunk_steps, found.chunks
        return recorder

    @property
    def time(self) -> float:
        """End of the recording on the twin's clock [s]."""
        return self.twin.state.time

    @property
    def recording(self) -> Recording:
        """The recording written so far."""
        return load_recording(self.folder)

    def execute(self, trajectory: Trajectory, hold_time: float = 0.0) -> Run:
        """Follow a trajectory from the twin's present state, and record it.

        In a resumed recording, the part that is already recorded is skipped, if the recording began with the
        same trajectory.

        Args:
            trajectory: The trajectory; its joints must be the robot's, its start where the twin began.
            hold_time: Time to hold the end afterwards [s].

        Returns:
            The new part of the run.

        Raises:
            InvalidValueError: for other joints, or a hold time that is not a finite number of at least 0.
            FileFormatError: if a file cannot be written.
        """
        rows = sampled(self.twin.pepper, trajectory, hold_time, self.twin.timestep)
        done = round(self.time / self.twin.timestep)
        kept = done if done and self._is_begin_of(rows.position[1 : done + 1]) else 0
        position, velocity, acceleration = (values[1 + kept :] for values in rows[:3])
        return self.follow(position, velocity, acceleration=acceleration)

    def follow(
        self,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        *,
        acceleration: ArrayLike | None = None,
        effort: ArrayLike | None = None,
        load: ArrayLike | None = None,
    ) -> Run:
        """Follow references with a row for every timestep, and record it; see `Twin.follow`.

        Args:
            position: Reference positions at the end of each step [rad or m], shape (T, n).
            velocity: Reference velocities [rad/s or m/s], shape (T, n); zero if omitted.
            acceleration: Reference accelerations for the feed-forward "inverse_dynamics" [rad/s^2 or m/s^2],
                shape (T, n); zero if omitted.
            effort: Torques of joints in torque mode [N m or N], shape (T, n); zero if omitted.
            load: External torques on the joints [N m or N], shape (T, n); none if omitted.

        Returns:
            The new part of the run; if it stopped, everything before the stop is recorded.

        Raises:
            InvalidValueError: naming the quantity, for a wrong shape, NaN or infinity.
            FileFormatError: where a file cannot be written.
        """
        n = self.twin.pepper.n
        rows = len(as_finite(position, "position", (None, n)))
        if not rows:
            raise InvalidValueError("position", "no rows", "one or more")
        values = dict(zip(References._fields, (position, velocity, acceleration, effort, load), strict=True))
        inputs = {k: as_finite(v, k, (rows, n)) for k, v in values.items() if v is not None}
        if self.twin.feedforward != "inverse_dynamics":
            inputs.pop("acceleration", None)  # without effect
        parts, first = [], 0
        while first < rows:
            done = round(self.time / self.twin.timestep)
            last = min(first + self._steps - done % self._steps, rows)
            part = {name: array[first:last] for name, array in inputs.items()}
            run = self.twin.follow(**part)
            parts.append(run)
            self._write(part, run, self.twin.pushes)
            if run.status is RunStatus.STOPPED:
                break
            first = last
        return _joined(parts, self.twin.timestep)

    def _is_begin_of(self, position: Array) -> bool:
        """Return whether the recorded positions equal given ones [rad or m], shape (T, n), bit by bit."""
        recorded = np.concatenate([chunk["position"] for chunk in self.recording.inputs()])
        return recorded.shape == position.shape and bool(np.array_equal(recorded, position))

    def _write(self, inputs: dict[str, Array], run: Run, pushes: Any) -> None:
        """Write a chunk.

        Args:
            inputs: Name of a command -> its values, shape (T, n) each.
            run: The run of the chunk.
            pushes: Pushes on the twin.
        """
        rows = len(run) - 1
        arrays: dict[str, Any] = {f"in.{name}": pack(array[:rows]) for name, array in inputs.items()}
        arrays |= {f"out.{name}": pack(getattr(run, name)[1:]) for name in STATES[1:]}
        moved = (run.position[1:], run.velocity[1:], run.position[0], self.twin.timestep)
        arrays["out.position"] = pack_moved(*moved)
        if (run.external_wrench[1:] != 0.0).any():
            arrays["out.external_wrench"] = pack(run.external_wrench[1:])
        if pushes:
            recorded = [[p.start, p.duration, *p.force, *p.point] for p in pushes]
            arrays["pushes"], arrays["push_frames"] = np.array(recorded), np.array([p.frame for p in pushes])
        offset = self.time - run.duration
        sensor_series = {
            name: (
                [series.unit, series.frame],
                [pack(series.time + offset), pack(series.value), pack(series.truth)],
            )
            for name, series in _news(run, self._count == 0).items()
        }
        if sensor_series:
            arrays["readings"] = pack_together(sensor_series)
        arrays["message"], arrays["status"] = np.array(run.message), np.array(run.status.value)
        write_arrays(chunk_path(self.folder, self._count), arrays, compressed=False)
        self._count += 1


def _joined(parts: list[Run], timestep: float) -> Run:
    """Join successive runs."""
    if len(parts) == 1:
        return parts[0]
    ends = np.cumsum([0.0, *(part.duration for part in parts)])
    stacked: dict[str, Any] = {
        name: np.concatenate([getattr(p, name)[min(k, 1) :] for k, p in enumerate(parts)]) for name in SERIES
    }
    time = timestep * np.arange(len(stacked["position"]), dtype=float)
    news = [_news(part, k == 0) for k, part in enumerate(parts)]
    readings = {
        name: ReadingSeries(
            np.concatenate([part[name].time + ends[k] for k, part in enumerate(news) if name in part]),
            np.concatenate([part[name].value for part in news if name in part]),
            np.concatenate([part[name].truth for part in news if name in part]),
            parts[0].readings[name].unit,
            parts[0].readings[name].frame,
        )
        for name in parts[0].readings
    }
    last = parts[-1]
    return replace(
        parts[0], time=time, **stacked, status=last.status, message=last.message, readings=readings
    )


def _news(run: Run, first: bool) -> dict[str, ReadingSeries]:
    """Return the readings of a run, without readings at its start, which the previous run contains."""
    if first:
        return dict(run.readings)
    recorded = {}
    for name, series in run.readings.items():
        new = series.time > 1e-9
        if new.any():
            values = (series.time[new], series.value[new], series.truth[new])
            recorded[name] = ReadingSeries(*values, series.unit, series.frame)
    return recorded
