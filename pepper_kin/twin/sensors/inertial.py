"""Accelerometers, gyroscopes and the orientation estimated from them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.kinematics import frame_acceleration, frame_velocity
from pepper_kin.model import PepperModel
from pepper_kin.twin.sensors.reading import SensedState
from pepper_kin.twin.sensors.sensor import ErringSensor, LinearSensor
from pepper_kin.twin.sensors.specification import SensorSpecification


class _InertialSensor(LinearSensor):
    """Sensor of three components along the axes of a frame, clipped to the sensor's range."""

    shape = (3,)

    def __init__(self, pepper: PepperModel, specification: SensorSpecification, seed: int) -> None:
        super().__init__(pepper, specification, seed)
        self.clipped = (-specification.maximum, specification.maximum)


class Accelerometer(_InertialSensor):
    """The specific force at a frame, R^T (a - g): 9.81 m/s^2 upward at rest, zero without support."""

    def __init__(self, pepper: PepperModel, specification: SensorSpecification, seed: int) -> None:
        super().__init__(pepper, specification, seed)
        self._gravity = np.array(pepper.inner_model.gravity.linear)

    def truth(self, state: SensedState) -> Array:
        """Return the specific force in the frame's axes [m/s^2], shape (3,)."""
        frame = self.specification.frame
        acceleration = frame_acceleration(self.pepper, state.q, state.v, state.a, frame)[:3]
        return np.asarray(state.pose(frame)[:3, :3].T @ (acceleration - self._gravity))


class Gyroscope(_InertialSensor):
    """The angular velocity of a frame."""

    def truth(self, state: SensedState) -> Array:
        """Return the angular velocity in the frame's axes [rad/s], shape (3,)."""
        frame = self.specification.frame
        rotation = state.pose(frame)[:3, :3]
        return np.asarray(rotation.T @ frame_velocity(self.pepper, state.q, state.v, frame)[3:])


class Orientation(ErringSensor):
    """The orientation of a frame in the world, as a unit quaternion x, y, z, w with w >= 0.

    Bias and noise rotate it by a small rotation vector in the frame's own axes [rad].
    """

    shape = (4,)

    def truth(self, state: SensedState) -> Array:
        """Return the quaternion x, y, z, w, shape (4,)."""
        from pinocchio import Quaternion

        rotation = state.pose(self.specification.frame)[:3, :3]
        return _upper(Quaternion(np.array(rotation)).coeffs())

    def measured(self, truth: NDArray[Any], sample: int) -> Array:
        """Return truth * exp(bias + noise), quaternions x, y, z, w, shape (4,)."""
        from pinocchio import Quaternion

        turn = self.noise.disturbed(np.zeros(3), sample)
        angle = math.sqrt(turn.dot(turn))
        # sin(x/2)/x, by its limit near 0
        share = 0.5 if angle < 1e-12 else np.sin(angle / 2) / angle
        extra = Quaternion(*np.array([np.cos(angle / 2), *(share * turn)]))
        return _upper((Quaternion(np.array(truth)) * extra).coeffs())


def _upper(coefficients: Any) -> Array:
    """Return the unit quaternion q or -q whose w is not negative."""
    xyzw = np.array(coefficients, dtype=float)
    xyzw /= math.sqrt(xyzw.dot(xyzw))
    return -xyzw if xyzw[3] < 0 else xyzw
