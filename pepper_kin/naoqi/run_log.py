"""A log of the simulated body, as a run of the twin."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision import loads_of
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.naoqi.body import Body
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.twin import Run, actuator_parameters


class RunLog:
    """Log of the states and commands of every cycle, from its creation on.

    Args:
        body: The simulated body.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self._rows: list[tuple[np.ndarray, ...]] = []
        body.listeners.append(self._note)

    def __len__(self) -> int:
        return len(self._rows)

    def stop(self) -> None:
        """Stop logging."""
        if self._note in self.body.listeners:
            self.body.listeners.remove(self._note)

    def _note(self) -> None:
        state = self.body.state
        command = self.body.configuration(False)
        self._rows.append((state.position, state.velocity, state.torque, command))

    def run(self) -> Run:
        """Return the log as a run, one row a cycle.

        Raises:
            InvalidValueError: if fewer than two cycles were logged.
        """
        if len(self._rows) < 2:
            raise InvalidValueError("cycles", len(self._rows), "2 or more before a run can be made")
        position, velocity, torque, command = (np.array(rows) for rows in zip(*self._rows, strict=True))
        pepper = self.body.pepper
        return Run(
            joint_names=pepper.joint_names,
            joint_units=pepper.joint_units,
            time=CYCLE * np.arange(len(position), dtype=np.float64),
            position=position,
            velocity=velocity,
            torque=torque,
            reference_position=command,
            reference_velocity=np.gradient(command, CYCLE, axis=0),
            torque_limit=np.asarray(actuator_parameters(pepper, "motor").torque_limit),
            loads=loads_of(pepper, self.body.scene),
        )
