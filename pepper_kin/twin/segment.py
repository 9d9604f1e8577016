"""Timesteps of a twin between two changes of external forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.simulation.rollout import DONE
from pepper_kin.model import PepperModel
from pepper_kin.twin.command import Command
from pepper_kin.twin.hooks import WorldCoupling, WorldHook, coupling_of, unknown_where
from pepper_kin.twin.integrator import Integrator, Series
from pepper_kin.twin.push import Push, loads_of


class SegmentRunner:
    """Runner of a robot's timesteps under loads, pushes and contacts, with their wrench.

    Args:
        pepper: The robot.
        integrator: Integrator of its steps.
        substeps: Number of the integrator's steps in a timestep.
    """

    def __init__(self, pepper: PepperModel, integrator: Integrator, substeps: int) -> None:
        self._pepper, self._integrator, self._substeps = pepper, integrator, substeps
        self._met: tuple[WorldHook | None, WorldCoupling | None] = (None, None)

    def run(
        self,
        state: tuple[Array, Array],
        command: Command,
        load: Array,
        world: WorldHook | None,
        pushes: tuple[Sequence[Push], float] | None,
    ) -> tuple[Series, BaseException | None]:
        """Return the states after some timesteps, and the error if the world stopped.

        Args:
            state: Position [rad or m] and velocity [rad/s or m/s] at the start, shape (n,) each.
            command: Commands of the timesteps, shape (T, n) each.
            load: External torques on the joints [N m or N], shape (T, n) or (1, n).
            world: World around the robot; None for none.
            pushes: All pushes and the time at the start [s]; None if none acts.
        """
        k, h = self._substeps, self._integrator.timestep
        fine = command if k == 1 else command.refined(k, h)
        outer = load if k == 1 or len(load) == 1 else np.repeat(load, k, axis=0)
        if pushes is None:
            series, error = self._steps(*state, fine, outer, k, world)
            return series._replace(wrench=_with_loads(series, load)), error
        (acting, time), (q, v) = pushes, state
        wrench = np.zeros((1, 6))
        for i in range(k):
            pushed, its_wrench = loads_of(acting, self._pepper, q, time + i * h)
            now = slice(min(i, len(outer) - 1), min(i, len(outer) - 1) + 1)
            series, error = self._steps(q, v, fine.part(slice(i, i + 1)), outer[now] + pushed, 1, world)
            if error is not None or series.good == 0:
                break
            wrench += its_wrench / k
            if series.wrench is not None:
                wrench += series.wrench / k
            q, v = series.position[0], series.velocity[0]
        return series._replace(wrench=_with_loads(series._replace(wrench=wrench), load)), error

    def _steps(
        self, q: Array, v: Array, command: Command, load: Array, every: int, world: WorldHook | None
    ) -> tuple[Series, BaseException | None]:
        """Return the states after some steps of the integrator, and the error if the world stopped.

        Args:
            q: Position at the start [rad or m], shape (n,).
            v: Velocity at the start [rad/s or m/s], shape (n,).
            command: Commands of the steps, shape (T, n) each.
            load: External torques on the joints [N m or N], shape (T, n) or (1, n).
            every: Number of steps between states of the result, a divisor of T.
            world: World around the robot; None for none.
        """
        if world is None:
            return self._integrator.run(q, v, command, load, every=every), None
        coupling = self._coupling(world)
        tables = coupling.begin(self._integrator.timestep, len(command.position))
        series = self._integrator.run(q, v, command, load, every=every, world=tables)
        taken = series.good + (series.outcome == DONE and series.good < len(series.position))
        error = coupling.end(taken * every, series.outcome)
        if series.outcome != DONE:
            position, velocity, torque = (rows[: series.good] for rows in series[:3])
            series = Series(position, velocity, torque, series.good, series.outcome)
        rows = len(series.position)
        wrench, found = np.zeros((rows * every, 6)), coupling.wrench[: rows * every]
        wrench[: len(found)] = found
        return series._replace(wrench=wrench.reshape(rows, every, 6).mean(axis=1)), error

    def _coupling(self, world: WorldHook) -> WorldCoupling:
        met, coupling = self._met
        if coupling is None or met is not world:
            coupling = coupling_of(world, self._pepper.n)
            self._met = (world, coupling)
        return coupling


def _with_loads(series: Series, load: Array) -> Array | None:
    """Return the wrench of a series, NaN where loads act, of which only the torques are known.

    Args:
        series: States and wrench [N, N m].
        load: External torques on the joints [N m or N], shape (T, n) or (1, n).

    Returns:
        Force [N] and moment [N m], shape (T, 6); None if the series has none and no load acts.
    """
    if not load.any():
        return series.wrench
    rows, loaded = len(series.position), np.asarray(load.any(axis=1))
    loaded = np.broadcast_to(loaded, (rows,)) if len(load) == 1 else loaded[:rows]
    unknown = unknown_where(loaded)
    return unknown if series.wrench is None else series.wrench + unknown
