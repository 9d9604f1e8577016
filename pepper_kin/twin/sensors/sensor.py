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
    """One sensor: the truth of a state.

    Args:
        pepper: The robot.
        specification: Its numbers.
        seed: Seed of the suite.

    Attributes:
        shape: Of its readings.
        dtype: Of their numbers.
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
        """Return what an ideal sensor would say."""

    def reset(self) -> None:  # noqa: B027 - most sensors remember nothing
        """Forget what earlier states left behind."""


class LinearSensor(Sensor):
    """A sensor that says truth + bias + noise, rounded to its resolution, as far as its range reaches.

    Attributes:
        clipped: Lowest and highest reading; what is beyond is cut off there.
        in_range: Least and greatest distance; -inf stands for less, inf for more (ROS's REP 117).
    """

    clipped: tuple[float, float] = (-np.inf, np.inf)
    in_range: tuple[float, float] = (-np.inf, np.inf)


class ErringSensor(Sensor):
    """A sensor with errors of another kind.

    Attributes:
        exact: Whether it has none, and says the truth.
    """

    exact: bool = False

    @abstractmethod
    def measured(self, truth: NDArray[Any], sample: int) -> NDArray[Any]:
        """Return this sensor's reading of a truth.

        Args:
            truth: In the sensor's unit, of the sensor's `shape`.
            sample: Number of the sample.
        """

    def limited(self, value: NDArray[Any]) -> NDArray[Any]:
        """Return a value, of the sensor's `shape`, as far as the sensor's range reaches."""
        return value
