"""Base class of a robot's modules."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.qibullet.simulation import body_of

if TYPE_CHECKING:
    from pepper_kin.naoqi.body import Body


class RobotModule:
    """A module of a robot: a sensor, or the controller of the base.

    Args:
        robot_model: Number of the robot's model.
        physics_client: Number of the simulation.
    """

    def __init__(self, robot_model: int | None, physics_client: int) -> None:
        self.robot_model, self.physics_client = robot_model, physics_client
        self._active = False

    @property
    def body(self) -> Body:
        """The simulated body.

        Raises:
            SimulationError: for a module without a robot.
        """
        return body_of(self.physics_client, -1 if self.robot_model is None else self.robot_model)

    def getRobotModel(self) -> int | None:
        """Return the number of the robot's model."""
        return self.robot_model

    def getPhysicsClientId(self) -> int:
        """Return the number of the simulation."""
        return self.physics_client

    def isAlive(self) -> bool:
        """Return whether the module runs."""
        return self._active

    def _terminateModule(self) -> None:
        """End the module."""
        self._active = False
