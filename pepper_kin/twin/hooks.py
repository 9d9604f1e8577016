"""Protocols of the world around a twin and of the sensors on it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.core.simulation.contact_solver import ADDRESSES
from pepper_kin.core.simulation.contact_step import CALLBACK, WorldTables, no_world
from pepper_kin.kernels.callback import Callback
from pepper_kin.kernels.intrinsics import floats_at, words_at
from pepper_kin.twin.state import TwinState

if TYPE_CHECKING:
    from pepper_kin.twin.integrator import Series
    from pepper_kin.twin.sensors.recording import ReadingSeries


class WorldHook(Protocol):
    """A world that exerts forces on the robot."""

    def advance(self, q: Array, v: Array, mass_hat: Array, force: Array, h: float) -> Array:
        """Advance the world by one step and return its contact forces as torques at the robot's joints.

        Args:
            q: Positions of the robot at the start of the step [rad or m], shape (n,).
            v: Velocities of the robot [rad/s or m/s], shape (n,).
            mass_hat: Effective mass matrix of the step, including all implicit terms, shape (n, n).
            force: Generalized force such that the acceleration without contact is mass_hat^-1 force, shape
                (n,).
            h: Time of the step [s].

        Returns:
            Generalized contact load [N m or N], shape (n,).

        Raises:
            ContactError: if the contacts cannot be solved; `Twin.step` raises it too, a run stops there.
        """


class WorldCoupling(Protocol):
    """A world in the form of the compiled time loop."""

    @property
    def wrench(self) -> Array:
        """Force and moment about the world's origin on the robot, NaN if unknown, in the steps since `begin`.

        Shape (s, 6) [N, N m].
        """

    def begin(self, h: float, steps: int) -> WorldTables:
        """Return the tables for a number of steps of length h [s]."""

    def end(self, steps: int, outcome: int) -> BaseException | None:
        """Record the steps that were taken; return why the next one failed, if its outcome is a failure."""


class HookCoupling:
    """Coupling of a world by a callback in every step.

    Args:
        world: The world.
        n: Number of joints.
    """

    def __init__(self, world: WorldHook, n: int) -> None:
        self._world, self._callback, self._h = world, Callback(self._advance), 0.0
        nothing = no_world(n)
        self._tables = nothing._replace(
            kind=CALLBACK,
            callback=self._callback.address,
            state=nothing.state._replace(mail=self._callback.mail),
        )
        self._pushed: list[bool] = []

    @property
    def wrench(self) -> Array:
        """NaN in steps with a load, whose force is unknown, else zero, shape (s, 6) [N, N m]."""
        return unknown_where(np.array(self._pushed, dtype=bool))

    def begin(self, h: float, steps: int) -> WorldTables:
        """Return the tables for steps of length h [s]."""
        self._h, self._pushed = h, []
        return self._tables

    def end(self, steps: int, outcome: int) -> BaseException | None:
        """Return the error that the world has raised, or None."""
        return self._callback.raised()

    def _advance(self, what: int, address: int, *_: int) -> int:
        n, q, v, mass_hat, force, load = words_at(address, ADDRESSES)[:6].tolist()
        matrix = floats_at(mass_hat, n * n).reshape(n, n)
        arrays = (floats_at(q, n), floats_at(v, n), matrix, floats_at(force, n))
        moving = [array.copy() for array in arrays]
        found = floats_at(load, n)
        found[:] = self._world.advance(moving[0], moving[1], moving[2], moving[3], self._h)
        self._pushed.append(bool(found.any()))
        return 0


def unknown_where(loaded: NDArray[np.bool_]) -> Array:
    """Return the wrench of loads of which only joint torques are known: NaN, or zero without a load.

    Args:
        loaded: Whether a load acts in each step, shape (s,).

    Returns:
        Shape (s, 6).
    """
    return np.where(loaded[:, np.newaxis], math.nan, np.zeros((len(loaded), 6)))


def coupling_of(world: WorldHook, n: int) -> WorldCoupling:
    """Return a world's own `coupling`, or a coupling that calls the world back in every step."""
    own = getattr(world, "coupling", None)
    found: WorldCoupling | None = None if own is None else own()
    return HookCoupling(world, n) if found is None else found


class SensorsHook(Protocol):
    """Sensors of a twin.

    If the object has a number `due`, states before that time [s] may be skipped.
    """

    def observe(self, state: TwinState) -> None:
        """Observe a state: the first one after a reset, then the state at the end of every timestep."""


def due_time(sensors: SensorsHook | None, otherwise: float) -> float:
    """Return the time of the sensors' next sample [s]; `otherwise` if they have no clock."""
    return math.inf if sensors is None else float(getattr(sensors, "due", otherwise))


def readings_since(sensors: SensorsHook | None, start: float) -> dict[str, ReadingSeries]:
    """Return the readings recorded since a time [s], by sensor name; empty for sensors without recording."""
    recorded = getattr(sensors, "recorded", None)
    return {} if recorded is None else dict(recorded(start))


def show_first(
    sensors: SensorsHook, series: Series, count: int, velocity: Array, clock: tuple[int, float]
) -> None:
    """Pass the first states of a series to sensors.

    Args:
        sensors: The sensors.
        series: The states.
        count: Number of states to pass.
        velocity: Velocity before the first state [rad/s or m/s], shape (n,).
        clock: Index of the step before the first state, and the timestep [s].
    """
    (step, h), due = clock, due_time(sensors, -math.inf)
    for k in range(count):
        time = (step + k + 1) * h
        if time < due:
            continue
        before = series.velocity[k - 1] if k else velocity
        acceleration = (series.velocity[k] - before) / h
        sensors.observe(
            TwinState(time, series.position[k], series.velocity[k], series.torque[k], acceleration)
        )
        due = due_time(sensors, -math.inf)


def scene_of(world: WorldHook | None) -> Scene | None:
    """Return the scene of a world, or None if it has none."""
    scene = getattr(world, "scene", None)
    return scene if isinstance(scene, Scene) else None
