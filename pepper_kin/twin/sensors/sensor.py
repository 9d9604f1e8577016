"""Base class of all sensors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.twin.sensors.noise import SensorNoise
from pepper_kin.twin.sensors.reading import SensedState
from pepper_kin.twin.sensors.specification import SensorSpecification


class Sensor(ABC):
    """A sensor, with the true value for a state.

    Args:
        pepper: The robot.
        specification: Specification of the sensor.
        seed: Seed of the suite.

    Attributes:
        shape: Shape of its readings.
        dtype: Type of the readings' numbers.
        uses_scene: Whether it measures the surroundings of the robot.

    Raises:
        UnknownNameError: for a frame that the robot lacks.
    """

    shape: tuple[int, ...] = ()
    dtype: type = np.float64
    uses_scene: bool = False

    def __init__(self, pepper: PepperModel, specification: SensorSpecification, seed: int) -> None:
        if specification.frame:
            pepper.frame_id(specification.frame)
        self.pepper, self.specification = pepper, specification
        self.noise = SensorNoise(specification, seed)

    @abstractmethod
    def truth(self, state: SensedState) -> NDArray[Any]:
        """Return the reading of an ideal sensor."""

    def reset(self) -> None:  # noqa: B027 - most sensors remember nothing
        """Clear the memory of earlier states."""


class LinearSensor(Sensor):
    """A sensor whose reading is truth + bias + noise, rounded to its resolution and limited to its range.

    Attributes:
        clipped: Minimum and maximum reading, to which readings are clipped.
        in_range: Minimum and maximum distance; -inf stands for less, inf for more (ROS's REP 117).
    """

    clipped: tuple[float, float] = (-np.inf, np.inf)
    in_range: tuple[float, float] = (-np.inf, np.inf)


class ErringSensor(Sensor):
    """A sensor with errors of another kind.

    Attributes:
        exact: Whether the sensor has no errors, so that the reading is the truth.
    """

    exact: bool = False

    @abstractmethod
    def measured(self, truth: NDArray[Any], sample: int) -> NDArray[Any]:
        """Return this sensor's reading of a true value.

        Args:
            truth: True value in the sensor's unit, of the sensor's `shape`.
            sample: Index of the sample.
        """

    def limited(self, value: NDArray[Any]) -> NDArray[Any]:
        """Return a value, of the sensor's `shape`, limited to the sensor's range."""
        return value
