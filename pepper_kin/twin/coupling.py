"""Steps of the twin, with pushes and a world that have a say in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.twin.actuators import ActuatorParameters
from pepper_kin.twin.command import Command
from pepper_kin.twin.hooks import WorldHook
from pepper_kin.twin.integrator import Forecast, Integrator, Series, nothing_done
from pepper_kin.twin.push import Push

if TYPE_CHECKING:
    from pepper_kin.twin.fast.engine import Engine

Array = NDArray[np.float64]

LONGEST_MARCH = 500  # steps, after which the interpreter has a say: an interrupt, for one
LONGEST_PATIENCE = 15  # steps taken one by one before machine code is asked again


class Coupling:
    """Steps a robot, alone or coupled with what is around it.

    Args:
        pepper: The robot.
        timestep: Of the twin [s].
        actuators: Of its joints.
        gravity: Whether servos add what holds the present posture.
        substeps: Steps of the integrator in a timestep.
        compiled: Whether to step by machine code, made when it is first needed.

    Raises:
        InvalidValueError: for a timestep out of range, or actuators of other joints.
    """

    def __init__(
        self,
        pepper: PepperModel,
        timestep: float,
        actuators: ActuatorParameters,
        *,
        gravity: bool,
        substeps: int,
        compiled: bool,
    ) -> None:
        self.integrator = Integrator(pepper, timestep / substeps, actuators)
        self._pepper, self._actuators = pepper, actuators
        self._gravity, self._substeps, self._compiled = gravity, substeps, compiled
        self._made: Engine | None = None
        self._patience = self._waits = 0

    def quiet(self, q: Array, v: Array, command: Command, load: Array) -> Series:
        """Advance by some timesteps in which nobody else has a say.

        Args:
            q: Position at the start [rad or m], shape (n,).
            v: Velocity, shape (n,).
            command: For each timestep, shape (T, n) each.
            load: Torque from elsewhere [N m or N], shape (T, n), or (1, n) for all steps.
        """
        k, h = self._substeps, self.integrator.timestep
        fine = command if k == 1 else command.refined(k, h)
        outer = load if k == 1 or len(load) == 1 else np.repeat(load, k, axis=0)
        series = self._steps(q, v, fine, outer)
        if k == 1:
            return series
        whole, failed = divmod(series.good, k)
        ends = np.arange(k - 1, len(fine.position), k)
        if failed or whole < len(ends):
            ends[whole] = series.good  # the state that diverged
        return Series(series.position[ends], series.velocity[ends], series.torque[ends], whole)

    def march(self, q: Array, v: Array, command: Command, load: Array, world: WorldHook) -> Series:
        """Advance with a world by as many of some timesteps as machine code can, which may be none.

        Args:
            q: Position at the start [rad or m], shape (n,).
            v: Velocity, shape (n,).
            command: For each timestep, shape (T, n) each.
            load: Torque from elsewhere [N m or N], shape (T, n), or (1, n) for all steps.
            world: What the robot may touch.
        """
        march = getattr(world, "march", None)
        if march is None or not self._compiled or self._substeps > 1 or self._waits > 0:
            self._waits -= 1
            return nothing_done(len(q))
        part = slice(0, LONGEST_MARCH)
        series: Series = march(self._engine.single, q, v, command.part(part), load[part])
        # Where a step was for Python, so is probably the next: ask again after 1, 2, 4, ... steps.
        self._patience = 0 if len(series.position) else min(2 * self._patience + 1, LONGEST_PATIENCE)
        self._waits = self._patience
        return series

    def step(
        self,
        q: Array,
        v: Array,
        command: Command,
        load: Array,
        *,
        time: float,
        pushes: Sequence[Push] = (),
        world: WorldHook | None = None,
    ) -> Series:
        """Advance by one timestep with pushes and world.

        The world is shown the step without contacts as one linear equation.  Where it adds nothing, that
        step is taken as it is; otherwise it is taken again with the load of the contacts.

        Args:
            q: Position at the start [rad or m], shape (n,).
            v: Velocity, shape (n,).
            command: Of this timestep, shape (1, n) each.
            load: Torque from elsewhere [N m or N], shape (n,).
            time: At the start, on the clock of the pushes [s].
            pushes: Those that may act.
            world: What the robot may touch.

        Raises:
            ContactError: where the world cannot do its step.
        """
        k, h = self._substeps, self.integrator.timestep
        fine = command if k == 1 else command.refined(k, h)
        for i in range(k):
            outer = load + self._pushed(q, time + i * h, pushes) if pushes else load
            if world is None:
                series = self._steps(q, v, fine.part(slice(i, i + 1)), outer[np.newaxis])
            else:
                series = self._in_world(q, v, fine.row(i), outer, world)
            if series.good == 0:
                break
            q, v = series.position[0], series.velocity[0]
        return series

    def _in_world(self, q: Array, v: Array, row: Command, load: Array, world: WorldHook) -> Series:
        """Advance by one step of the integrator."""
        series, mass_hat, force = self._forecast(q, v, row, load)
        if not series.good and not np.isfinite(force).all():
            return series  # the robot is to blame, not what it touches
        contact = world.advance(q, v, mass_hat, force, self.integrator.timestep)
        if not np.any(contact):
            return series
        return self._steps(q, v, row.as_rows(), (load + contact)[np.newaxis])

    def _pushed(self, q: Array, time: float, pushes: Sequence[Push]) -> Array:
        """Return what the pushes of a time are worth at the joints, shape (n,)."""
        total = np.zeros(self._pepper.n)
        for push in pushes:
            if push.acts_at(time + 1e-9):
                total += push.load(self._pepper, q)
        return total

    def _steps(self, q: Array, v: Array, command: Command, load: Array) -> Series:
        """Return what follows from a state in steps of the integrator."""
        if self._compiled:
            return self._engine.follow(q, v, command, load)
        return self.integrator.run(q, v, *command, load, gravity=self._gravity)

    def _forecast(self, q: Array, v: Array, command: Command, load: Array) -> Forecast:
        if self._compiled:
            return self._engine.single.forecast(q, v, command, load)
        return self.integrator.forecast(q, v, *command, load, gravity=self._gravity)

    @property
    def _engine(self) -> Engine:
        if self._made is None:
            from pepper_kin.twin.fast.engine import Engine

            h = self.integrator.timestep
            self._made = Engine.of_one(self._pepper, h, self._actuators, self._gravity)
        return self._made
