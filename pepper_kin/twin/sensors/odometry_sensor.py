"""Wheel odometry: pose of the base from the rotation of its wheels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.kinematics import frame_velocity
from pepper_kin.model import PepperModel
from pepper_kin.twin.base import OmniBase, arc_between, arc_moved
from pepper_kin.twin.sensors.reading import SensedState
from pepper_kin.twin.sensors.sensor import ErringSensor
from pepper_kin.twin.sensors.specification import SensorSpecification


class WheelOdometry(ErringSensor):
    """Pose and velocity of the base from the rotation of its wheels.

    Between two samples the base is assumed to move along an arc; the wheels rotate accordingly, each with its
    own error, and the arc that fits their rotation is added to the pose.  Errors therefore grow with the
    distance and not while the base rests.  The first sample takes the true pose as its start.

    Bias: relative error of each wheel's radius.  Noise: slip of each wheel, rad for the square root of the
        rotation angle.
    """

    shape = (6,)

    def __init__(self, pepper: PepperModel, specification: SensorSpecification, seed: int) -> None:
        super().__init__(pepper, specification, seed)
        self._base = OmniBase(pepper)
        self.reset()

    def reset(self) -> None:
        """Reset the pose and the wheels' rotation."""
        self._before: Array | None = None
        self._yaw: float | None = None
        self._pose, self._turned, self._counted = np.zeros(3), np.zeros(3), np.zeros(3)

    def truth(self, state: SensedState) -> Array:
        """Return x, y [m], yaw [rad] of the base in the world, and its twist in its own axes, shape (6,)."""
        frame = self.specification.frame
        pose = state.pose(frame)
        velocity = frame_velocity(self.pepper, state.q, state.v, frame)
        yaw = np.arctan2(pose[1, 0], pose[0, 0])
        if self._yaw is not None:  # the turn nearest to the last one
            yaw += 2 * np.pi * np.round((self._yaw - yaw) / (2 * np.pi))
        self._yaw = float(yaw)
        twist = np.array([*(pose[:2, :2].T @ velocity[:2]), velocity[5]])
        return np.array([*pose[:2, 3], yaw, *twist])

    def measured(self, truth: NDArray[Any], sample: int) -> Array:
        """Return pose and velocity from the disturbed rotation of the wheels, shape (6,).

        Args:
            truth: True x, y [m], yaw [rad] and twist [m/s, m/s, rad/s] of the base, shape (6,).
            sample: Index of the sample.
        """
        place = np.asarray(truth[:3], dtype=float)
        if self._before is None:
            self._before, self._pose = place.copy(), place.copy()
            return np.array(truth, dtype=float)
        wheels = self._base.wheel_map
        turn = wheels @ arc_between(self._before, place)
        random = self.noise.generator(sample)
        wheel_slip = self.specification.noise * np.sqrt(np.abs(turn)) * random.standard_normal(len(turn))
        scale = 1.0 + self.noise.bias(turn.shape)
        self._turned = self._turned + scale * turn + wheel_slip
        counted, step = self._turned, self.specification.resolution
        if step:
            counted = np.round(counted / step) * step
        self._pose = arc_moved(self._pose, self._base.body_twist(counted - self._counted))
        self._before, self._counted = place.copy(), counted
        velocity = self._base.body_twist(scale * (wheels @ truth[3:]))
        return np.concatenate([self._pose, velocity])
