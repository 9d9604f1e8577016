"""What the twin asks of a world around it and of sensors on it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from pepper_kin.twin.state import TwinState

if TYPE_CHECKING:
    from pepper_kin.twin.command import Command
    from pepper_kin.twin.fast.single import SingleRobot
    from pepper_kin.twin.integrator import Series
    from pepper_kin.twin.sensors.recording import ReadingSeries

Array = NDArray[np.float64]


class WorldHook(Protocol):
    """Something that pushes back."""

    def advance(self, q: Array, v: Array, mass_hat: Array, force: Array, h: float) -> Array:
        """Advance the world by one step and return what its contacts are worth at the robot's joints.

        Args:
            q: Positions of the robot at the start of the step [rad or m], shape (n,).
            v: Velocities, shape (n,).
            mass_hat: Effective mass matrix of the step, all that is implicit in it included, shape (n, n).
            force: Without contact the robot accelerates with a = mass_hat^-1 force, shape (n,).
            h: Time of the step [s].

        Returns:
            Generalised contact load [N m or N], shape (n,).

        Raises:
            ContactError: where it cannot; `Twin.step` lets it pass, a run stops there.
        """


class MarchingWorld(WorldHook, Protocol):
    """A world that, besides, can take many steps with a robot in machine code."""

    def march(self, robot: SingleRobot, q: Array, v: Array, command: Command, load: Array) -> Series:
        """Advance together with a robot by a step for each command, as far as machine code alone goes.

        Returns:
            The states after the steps taken: fewer rows than commands, or none, where the next step needs
            `advance`.
        """


class SensorsHook(Protocol):
    """Something that looks.

    Where it has a number `due`, states before that time [s] may be kept from it.
    """

    def observe(self, state: TwinState) -> None:
        """Take note of a state: the first after a reset, then the one at the end of every timestep."""


def due_time(sensors: SensorsHook | None, otherwise: float) -> float:
    """Return when sensors want to see a state next [s]; `otherwise` where they do not say."""
    return math.inf if sensors is None else float(getattr(sensors, "due", otherwise))


def readings_since(sensors: SensorsHook | None, start: float) -> dict[str, ReadingSeries]:
    """Return what sensors have recorded since a time [s], by name; nothing for those that record nothing."""
    recorded = getattr(sensors, "recorded", None)
    return {} if recorded is None else dict(recorded(start))
