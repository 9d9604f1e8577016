"""The three lasers at the base."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.qibullet.sensor import Sensor
from pepper_kin.twin.sensors.specification import sensor_specifications
from pepper_kin.twin.sensors.suite import SensorSuite

NUM_RAY = 15
"""Number of beams of a laser."""

RAY_LENGTH = 3.0
"""Reading of a beam without an echo [m]."""

NEAREST = 0.1
"""Reading of a beam that meets a nearer obstacle [m]."""

DEFAULT_FREQUENCY = 6.25
"""Default number of scans a second [Hz]."""

SENSORS = ("laser_front", "laser_right", "laser_left")


class Laser(Sensor):
    """The twin's three lasers of 15 beams each, without noise; a scan is made on request, when it is due.

    Args:
        robot_model: Number of the robot's model.
        laser_id: Number of the lasers' link.
        frequency: Scans a second.
        display: Whether the browser page marks the ends of beams.
        physicsClientId: Number of the simulation.
    """

    def __init__(
        self,
        robot_model: int,
        laser_id: int,
        frequency: float = DEFAULT_FREQUENCY,
        display: bool = False,
        physicsClientId: int = 0,
    ) -> None:
        super().__init__(robot_model, physicsClientId)
        self.laser_id, self.display = laser_id, display
        self.laser_value = [0.0] * NUM_RAY * len(SENSORS)
        self._suite: SensorSuite | None = None
        self.setFrequency(frequency)

    def subscribe(self) -> None:
        """Start scanning."""
        self._active = True

    def unsubscribe(self) -> None:
        """Stop scanning; the last values are kept."""
        self._active = False

    def showLaser(self, display: bool) -> None:
        """Set whether the browser page marks the ends of beams."""
        self.display = bool(display)

    def getFrontLaserValue(self) -> list[float]:
        """Return the distances of the front laser [m], clockwise."""
        return self._values(0)

    def getRightLaserValue(self) -> list[float]:
        """Return the distances of the right laser [m], clockwise."""
        return self._values(1)

    def getLeftLaserValue(self) -> list[float]:
        """Return the distances of the left laser [m], clockwise."""
        return self._values(2)

    def ends(self) -> NDArray[np.float64]:
        """Return the points in the world that beams hit [m], shape (k, 3); none unless `display`."""
        if not (self._active and self.display):
            return np.empty((0, 3))
        self._scan()
        found = []
        for k, name in enumerate(SENSORS):
            specification = sensor_specifications()[name]
            pose = self.body.frame_pose(specification.frame, True)
            half = specification.field_of_view / 2.0
            for value, angle in zip(self._values(k), np.linspace(half, -half, NUM_RAY), strict=True):
                if value < RAY_LENGTH:
                    place = [value * np.cos(angle), value * np.sin(angle), specification.height]
                    found.append(pose[:3, :3] @ place + pose[:3, 3])
        return np.reshape(found, (-1, 3))

    def _values(self, which: int) -> list[float]:
        if self._active:
            self._scan()
        return self.laser_value[which * NUM_RAY : (which + 1) * NUM_RAY]

    def _scan(self) -> None:
        """Make a scan if one is due."""
        body = self.body
        with body.time.lock:
            if not self._is_due(body.time.now):
                return
            state, now, scene = body.state, body.time.now, body.scene
        if self._suite is None:
            self._suite = SensorSuite(body.pepper, sensors=SENSORS, noise=False)
        self._suite.reset()
        readings = self._suite.read(
            now, state.position, state.velocity, state.acceleration, state.torque, scene=scene
        )
        clockwise = np.concatenate([np.asarray(readings[name].value, dtype=float)[::-1] for name in SENSORS])
        finite = np.where(clockwise > 0.0, np.minimum(clockwise, RAY_LENGTH), NEAREST)
        self.laser_value = [float(value) for value in finite]
