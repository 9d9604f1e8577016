"""Base class of sensors: frequency and subscriptions."""

from __future__ import annotations

import math
from typing import Any

from pepper_kin.qibullet.errors import SimulationError
from pepper_kin.qibullet.robot_module import RobotModule
from pepper_kin.qibullet.simulation import finite


class Sensor(RobotModule):
    """A sensor of a robot, read at a frequency while there is a subscription."""

    def __init__(self, robot_model: int | None, physics_client: int) -> None:
        super().__init__(robot_model, physics_client)
        self.frequency: float | None = None
        self._read_at = -math.inf

    def subscribe(self, *arguments: Any, **options: Any) -> Any:
        """Start reading; implemented by each kind of sensor."""
        raise NotImplementedError

    def unsubscribe(self) -> Any:
        """Stop reading; implemented by each kind of sensor."""
        raise NotImplementedError

    def getFrequency(self) -> float | None:
        """Return the frequency [Hz], or None if none was set."""
        return self.frequency

    def setFrequency(self, frequency: float) -> None:
        """Set the frequency [Hz].

        Raises:
            SimulationError: for anything but a finite number above 0.
        """
        value = finite(frequency, "frequency", "Hz")
        if value <= 0.0:
            raise SimulationError(f"frequency: got {value:g}, expected a number above 0 [Hz]")
        self.frequency = value

    def _is_due(self, now: float) -> bool:
        """Return whether a reading is due at a time [s]; if so, start the next period."""
        if self.frequency is None or now < self._read_at + 1.0 / self.frequency - 1e-9:
            return False
        self._read_at = now
        return True
