"""Log of a robot: commands and encoder readings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite

LOST = 0.05
"""Distance from both neighbors above which a reading of exactly 0 counts as lost in transmission [rad]."""


@dataclass(frozen=True, eq=False)
class RobotLog(FrozenArrays):
    """Commands of `setAngles` and the angles read at the same time.

    Attributes:
        name: Name of the log, for messages and tables.
        joint_names: Names of the n joints.
        command_time: Times of the commands, rising [s], shape (C,).
        command: Targets [rad], shape (C, n).
        time: Times of the readings, rising [s], shape (T,).
        measured: Angles read by encoders [rad], shape (T, n).
        share: Ratio of the maximum speed given with the commands, above 0 and at most 1.
        reading_order: Number of round trips to the robot between `time` and the reading of each joint,
            shape (n,); 0 if encoders were read at `time`.
        person: Person of the session: sessions of one person are not independent.
    """

    name: str
    joint_names: tuple[str, ...]
    command_time: Array
    command: Array
    time: Array
    measured: Array
    share: float = 1.0
    reading_order: Array = None  # type: ignore[assignment]
    person: str = ""

    def __post_init__(self) -> None:
        """Copy and check the fields.

        Raises:
            InvalidValueError: naming the field, for a wrong shape, NaN, times that do not rise, or a share
                that is not allowed.
        """
        n = len(self.joint_names)
        if not n or len(set(self.joint_names)) < n:
            raise InvalidValueError("joint_names", ", ".join(self.joint_names), "names that differ")
        order = np.zeros(n) if self.reading_order is None else self.reading_order
        fields = {
            "command_time": as_finite(self.command_time, "command_time", (None,)),
            "time": as_finite(self.time, "time", (None,)),
            "reading_order": as_finite(order, "reading_order", (n,)),
        }
        fields["command"] = as_finite(self.command, "command", (fields["command_time"].size, n))
        fields["measured"] = as_finite(self.measured, "measured", (fields["time"].size, n))
        for quantity in ("command_time", "time"):
            if not fields[quantity].size or np.any(np.diff(fields[quantity]) <= 0):
                raise InvalidValueError(quantity, "times that do not rise", "at least one, rising [s]")
        if not 0 < self.share <= 1:
            raise InvalidValueError("share", self.share, "a number above 0 and at most 1")
        for quantity, array in fields.items():
            object.__setattr__(self, quantity, read_only(array))
        object.__setattr__(self, "person", self.person or self.name)

    @property
    def begin(self) -> float:
        """Time of the first command or reading [s]."""
        return float(min(self.time[0], self.command_time[0]))

    @property
    def duration(self) -> float:
        """Time from the first to the last reading [s]."""
        return float(self.time[-1] - self.time[0])

    def index(self, joint: str) -> int:
        """Return the column of a joint."""
        return self.joint_names.index(joint)

    def commands_at(self, times: Array) -> Array:
        """Return the newest command at times [rad], shape (T, n); before the first command, the first one."""
        newest = np.searchsorted(self.command_time, times, side="right") - 1
        return np.asarray(self.command[np.maximum(newest, 0)])

    def arrived(self) -> NDArray[np.bool_]:
        """Return which readings were not lost in transmission, shape (T, n)."""
        lost = [_lost(self.measured[:, j]) for j in range(len(self.joint_names))]
        return ~np.column_stack(lost)

    def renamed(self, *, name: str | None = None, person: str | None = None) -> RobotLog:
        """Return the log under another name, or of another person."""
        return replace(self, name=name or self.name, person=person or self.person)


def _lost(q: Array) -> NDArray[np.bool_]:
    """Return which readings of one joint are zeros between readings far from 0, shape (T,)."""
    lost = np.zeros(q.size, dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], q == 0.0, [False]]).astype(int)))
    for first, beyond in edges.reshape(-1, 2):
        beside = [abs(q[k]) for k in (first - 1, beyond) if 0 <= k < q.size]
        lost[first:beyond] = bool(beside) and min(beside) > LOST
    return lost
