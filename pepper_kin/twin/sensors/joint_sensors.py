"""Joint encoders and torques."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.twin.sensors.reading import SensedState
from pepper_kin.twin.sensors.sensor import LinearSensor
from pepper_kin.twin.sensors.specification import SensorSpecification

_BASE = ("BaseX", "BaseY", "BaseYaw")


class JointEncoders(LinearSensor):
    """Positions of the joints, in the order of `joint_names`.

    The pose of a moving base is not measured: its three joints have no encoder.
    """

    def __init__(self, pepper: PepperModel, specification: SensorSpecification, seed: int) -> None:
        super().__init__(pepper, specification, seed)
        self.joint_names = tuple(name for name in pepper.joint_names if name not in _BASE)
        self._rows = np.array([pepper.joint_index(name) for name in self.joint_names], dtype=np.int64)
        self.shape = self._rows.shape

    def truth(self, state: SensedState) -> Array:
        """Return the positions [rad or m], shape (len(joint_names),)."""
        return state.q[self._rows]


class JointTorques(JointEncoders):
    """Torques of the servos, estimated from their currents, in the order of `joint_names`."""

    def truth(self, state: SensedState) -> Array:
        """Return the torques [N m or N], shape (len(joint_names),)."""
        return state.torque[self._rows]
