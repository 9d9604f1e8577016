"""Range of the head's pitch, which depends on the yaw."""

from __future__ import annotations

from pepper_kin.arrays import Array
from pepper_kin.collision.dependent_ranges import STOP_SPARE, dependent_ranges
from pepper_kin.model import PepperModel

YAW, PITCH = "HeadYaw", "HeadPitch"


class HeadRange:
    """The range of HeadPitch for each position of HeadYaw; see `pepper_kin.collision.dependent_ranges`.

    Beyond the range, a robot reports the command as accepted, and its pitch stops at the end of the range.

    Args:
        pepper: Model of the robot.

    Attributes:
        pitch: Index of HeadPitch in the model.
        stopped: Whether the pitch was limited in the last cycle.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self._yaw, self.pitch = pepper.joint_index(YAW), pepper.joint_index(PITCH)
        places = self._yaw, self.pitch
        self._table = next(t for t in dependent_ranges(pepper) if (t.first, t.second) == places)
        self._always_free = float(self._table.upper.min()) - STOP_SPARE
        self.stopped = False

    def keep(self, command: Array) -> None:
        """Limit the pitch of a command to the range at its yaw, in place.

        Args:
            command: Positions of all joints [rad or m], shape (n,); changed.
        """
        self.stopped = False
        if command[self.pitch] <= self._always_free:
            return
        upper = float(self._table.interval(command[self._yaw])[1]) - STOP_SPARE
        if command[self.pitch] > upper:
            command[self.pitch], self.stopped = upper, True
