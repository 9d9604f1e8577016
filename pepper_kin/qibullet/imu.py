"""The inertial unit: angular velocity and acceleration."""

from __future__ import annotations

import numpy as np

from pepper_kin.kinematics import frame_velocity
from pepper_kin.qibullet.link import Link
from pepper_kin.qibullet.sensor import Sensor


class Imu(Sensor):
    """An inertial unit with values in world axes and without gravity, as in qiBullet.

    It reads at its frequency, but at most once in a cycle of the body (20 ms).  The acceleration is the
    change of the link's velocity between two readings, divided by the time between them.

    Args:
        robot_model: Number of the robot's model.
        imu_link: Link of the inertial unit.
        frequency: Frequency of the readings [Hz], above 0.
        physicsClientId: Number of the simulation.

    Raises:
        SimulationError: for a frequency that is not above 0.
    """

    def __init__(
        self, robot_model: int, imu_link: Link | None, frequency: float, physicsClientId: int = 0
    ) -> None:
        super().__init__(robot_model, physicsClientId)
        self.setFrequency(frequency)
        self.imu_link = imu_link
        self.angular_velocity = [0.0, 0.0, 0.0]
        self.linear_acceleration = [0.0, 0.0, 0.0]
        self._before: tuple[float, np.ndarray] | None = None

    def subscribe(self) -> None:
        """Start reading."""
        if not self._active:
            self._active, self._before = True, None
            body = self.body
            with body.time.lock:
                body.listeners.append(self._read)

    def unsubscribe(self) -> None:
        """Stop reading."""
        self._terminateModule()

    def getGyroscopeValues(self) -> list[float]:
        """Return the angular velocity [rad/s] in world axes, three numbers."""
        return list(self.angular_velocity)

    def getAccelerometerValues(self) -> list[float]:
        """Return the acceleration [m/s^2] in world axes, without gravity, three numbers."""
        return list(self.linear_acceleration)

    def getValues(self) -> tuple[list[float], list[float]]:
        """Return angular velocity [rad/s] and acceleration [m/s^2] in world axes, three numbers each."""
        return self.getGyroscopeValues(), self.getAccelerometerValues()

    def _read(self) -> None:
        """Read the unit if a reading is due; the lock of the body is held."""
        body = self.body
        now = body.time.now
        if self.imu_link is None or not self._is_due(now):
            return
        state = body.state
        twist = frame_velocity(body.pepper, state.position, state.velocity, self.imu_link.name)
        if self._before is not None and now > self._before[0]:
            change = (twist[:3] - self._before[1]) / (now - self._before[0])
            self.linear_acceleration = [float(x) for x in change]
        self.angular_velocity = [float(x) for x in twist[3:]]
        self._before = (now, twist[:3].copy())

    def _terminateModule(self) -> None:
        """Stop reading."""
        if self._active:
            super()._terminateModule()
            body = self.body
            with body.time.lock:
                body.listeners.remove(self._read)
