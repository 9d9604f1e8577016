"""States, torques and references of the twin over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, kept_read_only
from pepper_kin.collision.loads import checked_loads
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.files.table_file import TIME, load_table, save_table
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.trajectory.motion_plots import plot_motions
from pepper_kin.twin.run_status import RunEnd, RunStatus, status_of

if TYPE_CHECKING:
    from pepper_kin.model import PepperModel
    from pepper_kin.twin.sensors.recording import ReadingSeries


_QUANTITIES = {
    "position": "position",
    "velocity": "velocity",
    "torque": "torque",
    "reference": "reference_position",
    "reference_velocity": "reference_velocity",
}


SERIES = (*_QUANTITIES.values(), "external_wrench")
"""Attributes of a run with a row for each time."""

_FORCE = tuple(f"robot.external_{what}_{axis}" for what in ("force", "moment") for axis in "xyz")
_KNOWN = "robot.external_known"


@dataclass(frozen=True, eq=False)
class Run(FrozenArrays):
    """A motion of the twin; arrays are read-only.

    The base of a twin is held: it neither tips nor slides under any load.  `BalanceMonitor.assess_run` tells
    whether the robot would have kept standing, with its loads and all external forces of the run.

    Attributes:
        joint_names: Order of the columns.
        joint_units: "rad" or "m" for each joint.
        time: Times [s], shape (T,), from 0 in steps of the twin.
        position: Joint positions [rad or m], shape (T, n).
        velocity: Joint velocities [rad/s or m/s], shape (T, n).
        torque: Torques of the servos during the step that ends at each time [N m or N], shape (T, n); the
            first row is the torque at the start.
        reference_position: Reference positions of the servos [rad or m], shape (T, n).
        reference_velocity: Reference velocities of the servos [rad/s or m/s], shape (T, n).
        torque_limit: Torque limits of the servos [N m or N], shape (n,), inf for none.
        status: Status of the run.
        message: Reason why it did not complete: joint, distance from its reference and contact, or step and
            cause of a stop; empty if it completed.
        readings: Readings of the twin's sensors by name, with times from 0.
        external_wrench: Force [N] of pushes and contacts on the robot and moment about the world's origin
            [N m], in world axes, the mean of the step that ends at each time, shape (T, 6); zero in the first
            row and if omitted.  NaN if only joint torques are known: in steps with a `load`, or with contacts
            of an object other than a `World`.
        loads: Carried loads.
    """

    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array
    torque: Array
    reference_position: Array
    reference_velocity: Array
    torque_limit: Array
    status: RunStatus = RunStatus.COMPLETED
    message: str = ""
    readings: Mapping[str, ReadingSeries] = field(default_factory=dict)
    external_wrench: Array = None  # type: ignore[assignment]
    loads: Loads = ()

    def __post_init__(self) -> None:
        if self.external_wrench is None:
            object.__setattr__(self, "external_wrench", np.zeros((len(self.time), 6)))
        for name in ("time", *SERIES, "torque_limit"):
            object.__setattr__(self, name, kept_read_only(getattr(self, name)))
        if self.external_wrench.shape != (self.time.size, 6):
            got = f"shape {self.external_wrench.shape}"
            raise InvalidValueError("external_wrench", got, f"shape {(self.time.size, 6)}")
        shape = (self.time.size, len(self.joint_names))
        for name in _QUANTITIES.values():
            if getattr(self, name).shape != shape:
                raise InvalidValueError(name, f"shape {getattr(self, name).shape}", f"shape {shape}")

    def __len__(self) -> int:
        return int(self.time.size)

    @property
    def success(self) -> bool:
        """Whether the run completed without contact with its scene, and the robot is on its reference."""
        return self.status is RunStatus.COMPLETED

    @property
    def duration(self) -> float:
        """Time of the last state [s]."""
        return float(self.time[-1])

    @property
    def tracking_error(self) -> Array:
        """Position minus reference [rad or m], shape (T, n)."""
        return self.position - self.reference_position

    @property
    def rms_error(self) -> Array:
        """Root mean square of the tracking error of each joint [rad or m], shape (n,)."""
        return np.sqrt(np.mean(self.tracking_error**2, axis=0))

    @property
    def max_error(self) -> Array:
        """Maximum tracking error of each joint [rad or m], shape (n,)."""
        return np.abs(self.tracking_error).max(axis=0)

    @property
    def peak_torque(self) -> Array:
        """Maximum torque of each joint [N m or N], shape (n,)."""
        return np.abs(self.torque).max(axis=0)

    @property
    def torque_use(self) -> Array:
        """Fraction of its torque limit that each joint reached, shape (n,)."""
        return self.peak_torque / self.torque_limit

    def position_at(self, t: ArrayLike) -> Array:
        """Return positions at times, linear between steps [rad or m], shape (..., n).

        Args:
            t: Times within the run [s], shape (...).

        Raises:
            InvalidValueError: for a time that is NaN or outside the run by more than 1e-9 s.
        """
        t = np.asarray(t, dtype=float)
        if not np.all((t >= self.time[0] - 1e-9) & (t <= self.time[-1] + 1e-9)):
            raise InvalidValueError("t", t, f"times within [{self.time[0]:g}, {self.time[-1]:.9g}] s")
        columns = [np.interp(t, self.time, self.position[:, j]) for j in range(len(self.joint_names))]
        return np.stack(columns, axis=-1)

    def _words_on_outside(self) -> list[str]:
        """Return in words that the base was held, and the external forces on the robot."""
        lines = ["  base held: no tipping or sliding; BalanceMonitor.assess_run checks for it"]
        unknown = np.isnan(self.external_wrench).any(axis=1)
        force = np.linalg.norm(self.external_wrench[:, :3], axis=1)
        if np.nanmax(force, initial=0.0) > 0.0:
            at = int(np.nanargmax(force))
            lines.append(f"  outside force: at most {force[at]:.4g} N, at {self.time[at]:.3f} s")
        if unknown.any():
            times = f"from {self.time[int(np.argmax(unknown))]:.3f} s"
            lines.append(
                f"  loads on joints by unknown outside forces in {int(unknown.sum())} steps, {times}"
            )
        return lines

    def report(self) -> str:
        """Return tracking errors and torques of all joints as a text table."""
        worst, hardest = int(np.argmax(self.max_error)), int(np.argmax(self.torque_use))
        names = self.joint_names
        head = [
            f"Run of {self.duration:.3f} s in {len(self) - 1} steps: {self.status.value}"
            + (f" ({self.message})" if self.message else ""),
            f"  worst tracking: {names[worst]}, at most {self.max_error[worst]:.3g} "
            f"{self.joint_units[worst]}; hardest work: {names[hardest]}, "
            f"{self.torque_use[hardest]:.0%} of its torque",
            *self._words_on_outside(),
            f"  {'joint':<16}{'rms error':>12}{'max error':>12}{'peak torque':>14}{'of limit':>10}",
        ]
        rows = [
            f"  {name:<16}{self.rms_error[j]:>12.2e}{self.max_error[j]:>12.2e}{self.peak_torque[j]:>14.3f}"
            f"{self.torque_use[j]:>10.1%}"
            for j, name in enumerate(names)
        ]
        return "\n".join(head + rows + ([] if self.success else [self.status.advice]))

    def as_dict(self) -> dict[str, Any]:
        """Return status and numbers per joint for JSON (the series themselves go to CSV)."""
        joints = {
            name: {
                "rms_error": float(self.rms_error[j]),
                "max_error": float(self.max_error[j]),
                "peak_torque": float(self.peak_torque[j]),
                "torque_use": float(self.torque_use[j]),
                "unit": self.joint_units[j],
            }
            for j, name in enumerate(self.joint_names)
        }
        force = float(np.linalg.norm(self.external_wrench[:, :3], axis=1).max())
        return {
            "status": self.status.value,
            "message": self.message,
            "duration": self.duration,
            "steps": len(self) - 1,
            "base_held": True,
            "external_force": None if np.isnan(force) else force,  # JSON has no NaN
            "joints": joints,
        }

    def plot(self, pepper: PepperModel, path: PathName | None = None, **options: Any) -> Any:
        """Draw the run in its units and with the limits; see `pepper_kin.trajectory.plot_motions`."""
        return plot_motions(pepper, self, path, **options)

    def save(self, path: PathName) -> Path:
        """Write the run as CSV, with `columns.json` beside it, or as Parquet; see `files.save_table`.

        Columns: `time`, then for all joints `.position`, `.velocity`, `.torque`, `.reference` and
        `.reference_velocity`, then of the robot `.external_force_x` to `.external_moment_z`, and
        `.external_known`, which is 0 if these are not known.  Carried loads are not in the file.

        Args:
            path: Path of the file; its folder must exist.

        Returns:
            The path.

        Raises:
            FileFormatError: if the file cannot be written.
        """
        columns = {TIME: self.time}
        for quantity, attribute in _QUANTITIES.items():
            values = getattr(self, attribute)
            columns.update({f"{name}.{quantity}": values[:, j] for j, name in enumerate(self.joint_names)})
        known = np.asarray(~np.isnan(self.external_wrench).any(axis=1))
        wrench = np.where(known[:, np.newaxis], self.external_wrench, 0.0)
        columns.update({name: wrench[:, k] for k, name in enumerate(_FORCE)})
        columns[_KNOWN] = known.astype(float)
        return save_table(
            columns, path, joint_units=dict(zip(self.joint_names, self.joint_units, strict=True))
        )


def load_run(pepper: Any, path: PathName, loads: Loads = ()) -> Run:
    """Read a run that `Run.save` wrote.

    Args:
        pepper: The robot with the run's joints, which gives units and torque limits.
        path: Path of the file.
        loads: Carried loads, which are not in the file; see `pepper_kin.collision.loads_of`.

    Returns:
        The run; its status depends only on its end, since the file has no contacts.

    Raises:
        FileFormatError: for an invalid file, naming path, line and fault.
        InvalidValueError: for invalid loads.
        UnknownNameError: for a load at a frame that the robot lacks.
    """
    held = checked_loads(pepper, loads)
    names: tuple[str, ...] = pepper.joint_names
    header = [TIME, *(f"{name}.{quantity}" for quantity in _QUANTITIES for name in names), *_FORCE, _KNOWN]
    table: Mapping[str, Array] = load_table(path, header)
    values = {
        attribute: np.column_stack([table[f"{name}.{quantity}"] for name in names])
        for quantity, attribute in _QUANTITIES.items()
    }
    time = as_finite(table[TIME], TIME, (None,))
    wrench = np.column_stack([table[name] for name in _FORCE])
    wrench[table[_KNOWN] == 0.0] = np.nan
    if time[0] != 0.0:
        raise FileFormatError(path, f"time begins at {float(time[0])!r}, expected 0", 2)
    end = RunEnd(time, values["position"], values["velocity"][-1], values["reference_position"][-1])
    status, message = status_of(pepper, end)
    return Run(
        names,
        pepper.joint_units,
        time,
        values["position"],
        values["velocity"],
        values["torque"],
        values["reference_position"],
        values["reference_velocity"],
        pepper.effort_limits,
        status,
        message,
        external_wrench=wrench,
        loads=held,
    )
