"""Recorded states, torques and references of a batch of twins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.model.joint_vectors import check_whole


@dataclass(frozen=True, eq=False)
class BatchRun(FrozenArrays):
    """Motions of N twins; arrays are read-only.

    Rows are recorded at `time`; a robot whose state diverged has NaN from there on.

    Attributes:
        joint_names: Order of the columns.
        time: Times of the rows [s], shape (rows,), from 0.
        position: Joint positions [rad or m], shape (N, rows, n).
        velocity: Joint velocities [rad/s or m/s], shape (N, rows, n).
        torque: Actuator torques during the step that ends at each time [N m or N], shape (N, rows, n); the
            first row is the torque at the start.
        reference_position: Reference positions of the servos [rad or m], shape (N or 1, rows, n).
        final_position: Final position, or the last good one of a robot that stopped [rad or m], shape (N, n).
        final_velocity: Final velocity, or the last good one [rad/s or m/s], shape (N, n).
        good_steps: Number of good steps of each robot, shape (N,).
        messages: Robot -> reason why it stopped, naming joint, step and cause.
    """

    joint_names: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array
    torque: Array
    reference_position: Array
    final_position: Array
    final_velocity: Array
    good_steps: NDArray[np.int64]
    messages: dict[int, str]

    def __post_init__(self) -> None:
        for name in ("time", "reference_position", "final_position", "final_velocity", "good_steps"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in ("position", "velocity", "torque"):  # too large to copy, and not referenced elsewhere
            getattr(self, name).flags.writeable = False

    def __len__(self) -> int:
        return len(self.position)

    @property
    def success(self) -> NDArray[np.bool_]:
        """Whether each robot completed the run, shape (N,)."""
        result = np.ones(len(self), dtype=bool)
        result[list(self.messages)] = False
        return result

    @property
    def tracking_error(self) -> Array:
        """Position minus reference [rad or m], shape (N, rows, n)."""
        return self.position - self.reference_position

    @property
    def rms_error(self) -> Array:
        """Root mean square of the tracking error over the rows [rad or m], shape (N, n)."""
        return np.sqrt(np.mean(self.tracking_error**2, axis=1))

    def report(self) -> str:
        """Return how many robots completed the run, and why the first other robot stopped."""
        stopped = len(self.messages)
        text = f"{len(self)} twins, {self.time[-1]:.3f} s: {len(self) - stopped} completed, {stopped} stopped"
        if not stopped:
            return text
        first = min(self.messages)
        return f"{text}; robot {first}: {self.messages[first]}"


def recorded_steps(steps: int, every: int | None) -> int:
    """Return the number of steps between rows.

    Raises:
        InvalidValueError: for a number that is not an integer of at least 1.
    """
    if every is None:
        return max(steps, 1)
    return check_whole("every", every)
