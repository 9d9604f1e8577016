"""What actuators are told, and how it comes late."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Command(NamedTuple):
    """References of all joints at the end of a step, or of each of T steps.

    Attributes:
        position: [rad or m], shape (n,) or (T, n).
        velocity: [rad/s or m/s], the same shape.
        given: Feed-forward of joints in position and velocity mode that depends on the reference alone, and
            the effort of those in torque mode [N m or N], the same shape.
    """

    position: Array
    velocity: Array
    given: Array

    def as_rows(self) -> Command:
        """Return one command as T = 1 commands."""
        return Command(*(x[np.newaxis] for x in self))

    def part(self, rows: slice) -> Command:
        """Return some of T commands."""
        return Command(*(x[rows] for x in self))

    def row(self, k: int) -> Command:
        """Return one of T commands."""
        return Command(*(x[k] for x in self))

    def then(self, other: Command) -> Command:
        """Return these T commands followed by others."""
        return Command(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def refined(self, count: int, h: float) -> Command:
        """Return `count` commands for each: on the way to its end, the reference moves with its velocity.

        Args:
            count: Sub-steps in a step.
            h: Time of a sub-step [s].
        """
        position, velocity, given = (np.repeat(x, count, axis=0) for x in self)
        ahead = h * np.arange(count - 1, -1, -1.0)
        position -= np.tile(ahead, len(self.position))[:, np.newaxis] * velocity
        return Command(position, velocity, given)


class Delay:
    """A line that commands pass through.

    Args:
        ticks: How many steps later they come out.
    """

    def __init__(self, ticks: int) -> None:
        self.ticks = ticks
        self._waiting: Command | None = None

    def fill(self, command: Command) -> None:
        """Let one command stand for all that came before."""
        self._waiting = Command(*(np.repeat(x[np.newaxis], self.ticks, axis=0) for x in command))

    def through(self, command: Command) -> Command:
        """Put T commands in and take the T out that are due."""
        if not self.ticks or self._waiting is None:
            return command
        line = self._waiting.then(command)
        self._waiting = line.part(slice(len(command.position), None))
        return line.part(slice(len(command.position)))
