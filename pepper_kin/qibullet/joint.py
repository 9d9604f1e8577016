"""Joints of a robot, with the limits that commands obey."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Joint:
    """A joint that can be commanded.

    Attributes:
        index: Number of the joint, and of the link that it moves.
        name: Its name.
        lower_limit: [rad, for hands a share].
        upper_limit: [rad, for hands a share].
        max_effort: Torque that commands from now on may use [N m].
        max_velocity: Speed that commands from now on may use at most [rad/s].
    """

    index: int
    name: str
    lower_limit: float
    upper_limit: float
    max_effort: float
    max_velocity: float

    def getIndex(self) -> int:
        """Return the number."""
        return self.index

    def getName(self) -> str:
        """Return the name."""
        return self.name

    def getLowerLimit(self) -> float:
        """Return the lower limit [rad, for hands a share]."""
        return self.lower_limit

    def getUpperLimit(self) -> float:
        """Return the upper limit [rad, for hands a share]."""
        return self.upper_limit

    def getMaxEffort(self) -> float:
        """Return the torque that commands may use [N m]."""
        return self.max_effort

    def setMaxEffort(self, effort: float) -> None:
        """Set the torque that commands from now on may use [N m]; above the motor's own it is that."""
        self.max_effort = effort

    def getMaxVelocity(self) -> float:
        """Return the speed that commands may use [rad/s]."""
        return self.max_velocity

    def setMaxVelocity(self, velocity: float) -> None:
        """Set the speed that commands from now on may use [rad/s]; above the joint's own it is that."""
        self.max_velocity = velocity
