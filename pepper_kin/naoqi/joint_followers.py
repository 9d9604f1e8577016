"""The simulated joints' response to ALMotion's commands: latency, lag, backlash and droop by gravity."""

from __future__ import annotations

import numpy as np

from pepper_kin import dynamics
from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.twin import JointResponse


class JointFollowers:
    """The references of the twin's joints, cycle by cycle; see `JointResponse` for the law.

    Args:
        pepper: Model of the robot, with its gravity.
        response: Response of the joints to commands.
        command: Initial positions [rad, m or fraction], shape (n,).
        early: Latency of the twin's actuators, which counts towards the response's latency [s].

    Attributes:
        position: References at the end of the last cycle [rad, m or fraction], shape (n,).
    """

    def __init__(self, pepper: PepperModel, response: JointResponse, command: Array, early: float) -> None:
        self._pepper, self._response = pepper, response
        with np.errstate(divide="ignore"):
            self._share = np.where(response.lag > 0, 1.0 - np.exp(-CYCLE / response.lag), 1.0)
        late = np.where(response.latency > 0, response.latency - early, 0.0)
        cycles = np.maximum(late / CYCLE, 0.0)
        self._delay = np.floor(cycles).astype(int)
        self._between = cycles - self._delay  # fraction of a cycle, to interpolate between two commands
        self._columns = np.arange(pepper.n)
        self.place(command)

    def place(self, command: Array) -> None:
        """Set all joints at rest at a command, shape (n,)."""
        self._commands = np.tile(command, (int(self._delay.max()) + 2, 1))
        self._servo, self._link, self.position = (np.array(command, dtype=float) for _ in range(3))

    def put(self, joints: list[int], position: Array) -> None:
        """Set joints at rest at positions, shape (k,)."""
        self._commands[:, joints] = position
        for reference in (self._servo, self._link, self.position):
            reference[joints] = position

    def step(self, command: Array) -> Array:
        """Return the references at the end of the next cycle, shape (n,).

        Args:
            command: Command of the cycle [rad, m or fraction], shape (n,).
        """
        self._commands = np.concatenate([command[None], self._commands[:-1]])
        due, older = (self._commands[self._delay + k, self._columns] for k in (0, 1))
        due = np.where(self._between > 0, due + self._between * (older - due), due)
        self._servo = np.where(self._share < 1.0, self._servo + self._share * (due - self._servo), due)
        backlash, compliance = self._response.backlash, self._response.compliance
        self._link = np.clip(self._link, self._servo - backlash, self._servo + backlash)
        self.position = self._link.copy()
        if compliance.any():
            self.position -= compliance * dynamics.gravity_torque(self._pepper, self._link)
        return self.position
