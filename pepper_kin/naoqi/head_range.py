"""The pitch of the head stops where the yaw lets it, as a robot's does."""

from __future__ import annotations

from pepper_kin.arrays import Array
from pepper_kin.collision.dependent_ranges import STOP_SPARE, dependent_ranges
from pepper_kin.model import PepperModel

YAW, PITCH = "HeadYaw", "HeadPitch"


class HeadRange:
    """The range of HeadPitch for each position of HeadYaw; see `pepper_kin.collision.dependent_ranges`.

    A robot that is sent beyond it answers that the posture was commanded, and its pitch stops at the end.

    Args:
        pepper: The model.

    Attributes:
        pitch: Place of HeadPitch in the model.
        stopped: Whether the pitch was kept from where it was sent in the last cycle.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self._yaw, self.pitch = pepper.joint_index(YAW), pepper.joint_index(PITCH)
        places = self._yaw, self.pitch
        self._table = next(t for t in dependent_ranges(pepper) if (t.first, t.second) == places)
        self._always_free = float(self._table.upper.min()) - STOP_SPARE
        self.stopped = False

    def keep(self, command: Array) -> None:
        """Change the pitch of a command that is beyond where the head stops.

        Args:
            command: Positions of all joints [rad or m], shape (n,); changed.
        """
        self.stopped = False
        if command[self.pitch] <= self._always_free:
            return
        upper = float(self._table.interval(command[self._yaw])[1]) - STOP_SPARE
        if command[self.pitch] > upper:
            command[self.pitch], self.stopped = upper, True
