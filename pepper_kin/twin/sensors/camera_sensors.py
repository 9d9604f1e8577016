"""Cameras as sensors of a suite: images with noise."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.twin.sensors.camera import Camera
from pepper_kin.twin.sensors.noise import within_range
from pepper_kin.twin.sensors.reading import SensedState
from pepper_kin.twin.sensors.robot_rays import RobotRays
from pepper_kin.twin.sensors.sensor import ErringSensor
from pepper_kin.twin.sensors.specification import SensorSpecification


class _CameraSensor(ErringSensor):
    """Base class of cameras on the robot."""

    uses_scene = True

    def __init__(
        self, pepper: PepperModel, specification: SensorSpecification, seed: int, rays: RobotRays
    ) -> None:
        super().__init__(pepper, specification, seed)
        self.camera = Camera(pepper, specification.name, rays=rays, depth_range=(0.0, np.inf))


class ColorCamera(_CameraSensor):
    """A color image of 320 x 240 pixels."""

    shape = (240, 320, 3)
    dtype = np.uint8

    def truth(self, state: SensedState) -> NDArray[np.uint8]:
        """Return red, green and blue, shape (240, 320, 3)."""
        return self.camera.color(state.q, state.scene)

    def measured(self, truth: NDArray[Any], sample: int) -> NDArray[np.uint8]:
        """Return the image, shape (240, 320, 3), with noise in each channel."""
        noisy = self.noise.disturbed(truth.astype(float), sample)
        return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


class DepthCamera(_CameraSensor):
    """Depths of 320 x 240 pixels along the optical axis; -inf stands for too near, inf for too far."""

    shape = (240, 320)

    def truth(self, state: SensedState) -> NDArray[np.float64]:
        """Return the depths [m], inf without a surface, shape (240, 320)."""
        return self.camera.depth(state.q, state.scene)

    def measured(self, truth: NDArray[Any], sample: int) -> NDArray[np.float64]:
        """Return depths whose noise grows with the square of the distance beyond the minimum.

        Args:
            truth: Depths [m], shape (240, 320).
            sample: Index of the sample.
        """
        beyond = np.where(np.isfinite(truth), truth, 0.0) - self.specification.minimum
        deviation = self.specification.noise + self.specification.noise_growth * beyond**2
        return self.noise.disturbed(truth, sample, deviation)

    def limited(self, value: NDArray[Any]) -> NDArray[np.float64]:
        """Return depths [m], shape (240, 320), with -inf below the range and inf above it."""
        return within_range(self.specification.minimum, self.specification.maximum, value)
