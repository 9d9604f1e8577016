"""Commands of actuators, and their latency."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array


class Command(NamedTuple):
    """References of all joints at the end of a step, or of T steps, for one robot or for N.

    Attributes:
        position: Reference positions [rad or m], shape (n,), (T, n) or (N, T, n); N may be 1 for all robots.
        velocity: Reference velocities [rad/s or m/s], of the positions' shape.
        feedforward: Feed-forward of joints in position and velocity mode that depends only on the reference,
            and effort of joints in torque mode [N m or N], of the positions' shape.
    """

    position: Array
    velocity: Array
    feedforward: Array

    def as_rows(self) -> Command:
        """Return one command as T = 1 commands."""
        position, velocity, feedforward = self
        return Command(position[np.newaxis], velocity[np.newaxis], feedforward[np.newaxis])

    def part(self, rows: slice) -> Command:
        """Return a slice of T commands."""
        position, velocity, feedforward = self
        return Command(position[..., rows, :], velocity[..., rows, :], feedforward[..., rows, :])

    def row(self, k: int) -> Command:
        """Return one of T commands."""
        return Command(*(x[..., k, :] for x in self))

    def then(self, other: Command) -> Command:
        """Return the T commands followed by other commands."""
        return Command(*(_joined(first, second) for first, second in zip(self, other, strict=True)))

    def refined(self, count: int, h: float) -> Command:
        """Return `count` commands for each command, whose reference moves to its end with its velocity.

        Args:
            count: Number of sub-steps in a step.
            h: Time of a sub-step [s].
        """
        position, velocity, feedforward = (np.repeat(x, count, axis=-2) for x in self)
        ahead = np.tile(h * np.arange(count - 1, -1, -1.0), self.position.shape[-2])
        return Command(position - ahead[:, np.newaxis] * velocity, velocity, feedforward)


class Delay:
    """Delay line of commands.

    Args:
        ticks: Delay in steps.

    Attributes:
        waiting: Commands in the delay line; None for none.
    """

    def __init__(self, ticks: int) -> None:
        self.ticks = ticks
        self.waiting: Command | None = None

    def fill(self, command: Command, rows: NDArray[np.int64] | None = None, count: int = 0) -> None:
        """Fill the delay line of all or selected robots with one command.

        Args:
            command: Command, shape (n,) or (N, n); shape (k, n) for k robots.
            rows: Indices of k of N robots, shape (k,); all if omitted.
            count: Number N of robots, if rows are given.
        """
        if not self.ticks:
            return
        filled = Command(*(np.repeat(x[..., np.newaxis, :], self.ticks, axis=-2) for x in command))
        if rows is None or rows.size == count:
            order = slice(None) if rows is None else np.argsort(rows)
            self.waiting = Command(*(x[order] for x in filled))
            return
        assert self.waiting is not None
        waiting = []
        for before, new in zip(self.waiting, filled, strict=True):
            line = np.broadcast_to(before, (count, *before.shape[1:])).copy()
            line[rows] = new
            waiting.append(line)
        self.waiting = Command(*waiting)

    def through(self, command: Command) -> Command:
        """Put T commands into the delay line and return the T commands that are due."""
        if not self.ticks or self.waiting is None:
            return command
        line, steps = self.waiting.then(command), command.position.shape[-2]
        self.waiting = line.part(slice(steps, None))
        return line.part(slice(steps))


def _joined(first: Array, second: Array) -> Array:
    """Return two series of commands joined; a series for all robots is repeated for each if necessary.

    Args:
        first: Commands, shape (T, n) or (N, T, n); N may be 1 for all robots.
        second: Commands that follow, shape (T', n) or (N', T', n).
    """
    if first.ndim == 3 and len(first) != len(second):
        robots = max(len(first), len(second))
        first, second = (np.broadcast_to(x, (robots, *x.shape[1:])) for x in (first, second))
    return np.concatenate([first, second], axis=-2)
