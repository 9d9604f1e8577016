"""Worlds of a batch of twins, identical except for states, masses and friction of their bodies."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.simulation.contact_step import SOLVED, WorldTables
from pepper_kin.core.simulation.shaped_steps import (
    BODY,
    FRICTION,
    INERTIA,
    MASS,
    MOTION,
    ROTATION,
    RobotWorlds,
)
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.model.poses import rotation_from_rpy
from pepper_kin.twin.batch_parameters import broadcast
from pepper_kin.twin.world.body_limits import ROUGHEST
from pepper_kin.twin.world.world import CAUSES, World


class BatchBodies(NamedTuple):
    """State of one free body, or moving obstacle, in N worlds.

    Attributes:
        position: Position of the body's center [m], shape (N, 3).
        rotation: Rotation from the body's frame to the world, shape (N, 3, 3).
        velocity: Velocity of the center [m/s] and angular velocity [rad/s], in world axes, shape (N, 6).
    """

    position: Array
    rotation: Array
    velocity: Array


class BatchWorld:
    """N worlds that begin as copies of one.

    Args:
        world: Initial world of all robots; it is not changed.
        count: Number N of worlds.
        vary: Body -> "mass" [kg] or "friction" -> one number or shape (N,), in place of the body's own.

    Attributes:
        bodies: Bodies of all worlds for compiled code.

    Raises:
        UnknownNameError: for an unknown body or quantity.
        InvalidValueError: for a wrong shape, or a number out of range.
    """

    def __init__(
        self, world: World, count: int, vary: Mapping[str, Mapping[str, ArrayLike]] | None = None
    ) -> None:
        self._world, self._count = world.copy(), count
        self._names = (*world.bodies, *(item.name for item in world.scene.movers))
        self._free: deque[World] = deque()
        held = world.present()
        row = [
            np.concatenate(
                [
                    body.position, body.pose[:3, :3].ravel(), body.velocity,
                    [body.mass], body.inertia, [body.friction],
                ]
            )
            for body in held
        ]  # fmt: skip
        self._begin = np.tile(np.reshape(row, (1, len(row), BODY)), (count, 1, 1))
        for name, quantities in (vary or {}).items():
            self._vary(name, quantities)
        self.bodies = RobotWorlds(
            self._begin.copy(),
            np.zeros((count, 6)),
            np.zeros(count, np.int64),
            np.zeros(count),
            self._world.levers(),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free bodies and moving obstacles."""
        return self._names

    @property
    def failures(self) -> dict[int, str]:
        """Robot -> reason why its world could not be solved in the last step."""
        rows = np.flatnonzero(self.bodies.outcome != SOLVED)
        return {int(row): CAUSES[int(self.bodies.outcome[row])] for row in rows}

    def state_of(self, name: str) -> BatchBodies:
        """Return the state of a body in all worlds."""
        rows = self.bodies.rows[:, self._place_of(name)]
        turns = rows[:, ROTATION:MOTION].reshape(-1, 3, 3)
        return BatchBodies(rows[:, :ROTATION].copy(), turns.copy(), rows[:, MOTION:MASS].copy())

    def reset(self, rows: NDArray[np.int64]) -> None:
        """Reset all bodies of the worlds with indices `rows`, shape (k,), to their initial states."""
        self.bodies.rows[rows], self.bodies.wrench[rows] = self._begin[rows], 0.0
        self.bodies.outcome[rows], self.bodies.apart[rows] = SOLVED, 0.0

    def place(
        self,
        name: str,
        rows: NDArray[np.int64],
        position: ArrayLike | None,
        rpy: ArrayLike | None,
        velocity: ArrayLike | None,
    ) -> None:
        """Set the state of a body in selected worlds; None keeps the current value.

        Args:
            name: Name of the body.
            rows: Indices of the worlds, shape (k,).
            position: Position of the body's center [m], shape (3,) or (k, 3).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,) or (k, 3).
            velocity: Velocity of the center [m/s] and angular velocity [rad/s], shape (6,) or (k, 6).
        """
        table, body = self.bodies.rows, self._place_of(name)
        self.bodies.apart[rows] = 0.0
        if position is not None:
            table[rows, body, :ROTATION] = _numbers(f"position of {name!r}", position, (rows.size, 3))
        if rpy is not None:
            angles = _numbers(f"rpy of {name!r}", rpy, (rows.size, 3))
            table[rows, body, ROTATION:MOTION] = rotation_from_rpy(angles).reshape(-1, 9)
        if velocity is not None:
            table[rows, body, MOTION:MASS] = _numbers(f"velocity of {name!r}", velocity, (rows.size, 6))

    @contextmanager
    def tables(self, h: float) -> Iterator[WorldTables]:
        """Provide a world's tables for steps of length h [s] to one thread, until the context ends.

        An interrupt, such as Ctrl-C in a callback, is raised afterwards; the error of a failed step is not.
        """
        try:
            world = self._free.popleft()
        except IndexError:
            world = self._world.copy()
        try:
            yield world.begin(h)
        finally:
            self._free.append(world)
        error = world.raised()
        if error is not None and not isinstance(error, Exception):
            raise error

    def _vary(self, name: str, quantities: Mapping[str, ArrayLike]) -> None:
        body = self._begin[:, self._place_of(name)]
        for quantity, value in quantities.items():
            if quantity not in ("mass", "friction"):
                raise UnknownNameError("quantity of a body", quantity, ("mass", "friction"))
            numbers = _numbers(f"{quantity} of {name!r}", value, (self._count,))
            if quantity == "friction":
                wrong, allowed = (numbers < 0) | (numbers > ROUGHEST), f"numbers from 0 to {ROUGHEST:g}"
            else:
                wrong, allowed = ~((numbers > 0) & (numbers < 1e6)), "numbers above 0 and below 1e6 kg"
            if wrong.any():
                raise InvalidValueError(f"{quantity} of {name!r}", numbers[wrong][0], allowed)
            if quantity == "mass":
                body[:, INERTIA:FRICTION] *= (numbers / body[:, MASS])[:, np.newaxis]
            body[:, MASS if quantity == "mass" else FRICTION] = numbers

    def _place_of(self, name: str) -> int:
        if name not in self._names:
            raise UnknownNameError("body", name, self._names)
        return self._names.index(name)


def _numbers(quantity: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    return as_finite(broadcast(value, quantity, shape), quantity, shape)
