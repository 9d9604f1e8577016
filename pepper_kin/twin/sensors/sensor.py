"""What all sensors have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.twin.sensors.noise import SensorNoise
from pepper_kin.twin.sensors.reading import SensedState
from pepper_kin.twin.sensors.specification import SensorSpecification

Array = NDArray[np.float64]


class Sensor(ABC):
    """One sensor: the truth of a state, and that truth disturbed.

    Args:
        pepper: The robot.
        specification: Its numbers.
        seed: Seed of the suite.

    Raises:
        UnknownNameError: for a frame that the robot lacks.
    """

    def __init__(self, pepper: PepperModel, specification: SensorSpecification, seed: int) -> None:
        if specification.frame:
            pepper.frame_id(specification.frame)
        self.pepper, self.specification = pepper, specification
        self.noise = SensorNoise(specification, seed)

    @abstractmethod
    def truth(self, state: SensedState) -> NDArray[Any]:
        """Return what an ideal sensor would say."""

    def measured(self, truth: NDArray[Any], sample: int) -> NDArray[Any]:
        """Return what this sensor says instead, for a sample of a given number."""
        return self.noise.disturbed(truth, sample)

    def limited(self, value: NDArray[Any]) -> NDArray[Any]:
        """Return a value as far as the sensor's range reaches."""
        return value

    def reset(self) -> None:  # noqa: B027 - most sensors remember nothing
        """Forget what earlier states left behind."""
