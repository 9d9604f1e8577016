"""Joints of a robot, with the limits of commands."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Joint:
    """A joint that accepts commands.

    Attributes:
        index: Number of the joint, and of the link that it moves.
        name: Name of the joint.
        lower_limit: Lower limit [rad, for hands a fraction].
        upper_limit: Upper limit [rad, for hands a fraction].
        max_effort: Maximum torque of later commands [N m].
        max_velocity: Maximum speed of later commands [rad/s].
    """

    index: int
    name: str
    lower_limit: float
    upper_limit: float
    max_effort: float
    max_velocity: float

    def getIndex(self) -> int:
        """Return the number of the joint."""
        return self.index

    def getName(self) -> str:
        """Return the name of the joint."""
        return self.name

    def getLowerLimit(self) -> float:
        """Return the lower limit [rad, for hands a fraction]."""
        return self.lower_limit

    def getUpperLimit(self) -> float:
        """Return the upper limit [rad, for hands a fraction]."""
        return self.upper_limit

    def getMaxEffort(self) -> float:
        """Return the maximum torque of commands [N m]."""
        return self.max_effort

    def setMaxEffort(self, effort: float) -> None:
        """Set the maximum torque of later commands [N m]; the motor's own maximum holds, too."""
        self.max_effort = effort

    def getMaxVelocity(self) -> float:
        """Return the maximum speed of commands [rad/s]."""
        return self.max_velocity

    def setMaxVelocity(self, velocity: float) -> None:
        """Set the maximum speed of later commands [rad/s]; the joint's own maximum holds, too."""
        self.max_velocity = velocity
