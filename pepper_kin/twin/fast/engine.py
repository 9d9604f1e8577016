"""Robots stepped by machine code."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.kernels import Kernel
from pepper_kin.kernels.compilation import PATIENCE, Compilation
from pepper_kin.kernels.threads import run_in_pieces
from pepper_kin.model import PepperModel
from pepper_kin.twin.actuators import ActuatorParameters
from pepper_kin.twin.command import Command
from pepper_kin.twin.fast.expression import Variant, mass_places, parameters, solve_kernel, step_kernel
from pepper_kin.twin.fast.loop import Inputs, Log, roll
from pepper_kin.twin.fast.settle import Room
from pepper_kin.twin.fast.single import SingleRobot
from pepper_kin.twin.integrator import Series
from pepper_kin.twin.joint_law import LawTable, law_table

Array = NDArray[np.float64]

_WEIGHT = 512  # rows that a robot counts as when work is shared among threads


class Rolled(NamedTuple):
    """What robots did.

    Attributes:
        position: At the start and every so many steps [rad or m], shape (N, rows, n).  Where a robot has
            stopped, the next row is the state that diverged, and the rest is of no use; there is one such row
            too many where the steps do not divide evenly.
        velocity: The same [rad/s or m/s].
        torque: The same [N m or N]; the first row is of no use.
        good: Number of good steps of each robot, shape (N,).
        last_position: Of the last good state [rad or m], shape (N, n).
        last_velocity: The same [rad/s or m/s], shape (N, n).
        last_torque: In the last step [N m or N], shape (N, n); of no use where a robot has stopped.
    """

    position: Array
    velocity: Array
    torque: Array
    good: NDArray[np.int64]
    last_position: Array
    last_velocity: Array
    last_torque: Array


class Engine:
    """N robots of one kind, each with its own parameters, stepped without the interpreter.

    Args:
        pepper: The robot.
        timestep: h [s].
        law: Parameters of the joints, each of shape (N, n).
        gravity: Whether servos add what holds the present posture of the robot as it is described.
        scale: Factors of the mass that moves with each joint, shape (N, n); none if omitted.
        payload: Frame -> point mass at its origin [kg], shape (N,) each.
    """

    def __init__(
        self,
        pepper: PepperModel,
        timestep: float,
        law: LawTable,
        *,
        gravity: bool,
        scale: Array | None = None,
        payload: Mapping[str, Array] | None = None,
    ) -> None:
        self.robots, self._n = law.kp.shape
        self._h = timestep
        loads = dict(payload or {})
        variant = Variant(has_motor(law), scale is not None, tuple(loads))
        self._step: Kernel = step_kernel(pepper, variant)
        self._solve: Kernel = solve_kernel(pepper)
        self._lanes = 1 if self.robots == 1 else self._step.lanes
        single = self._lanes == 1
        kernels = (self._step, self._solve)
        self._addresses = np.array([k.single_address if single else k.block_address for k in kernels])
        self._places = np.array(mass_places(pepper), dtype=np.int64).T.copy()
        self._law = np.ascontiguousarray(np.stack([self._blocks(values) for values in law], axis=1))
        if not gravity:
            law = law._replace(feedforward=np.zeros_like(law.kp))
        constant = [getattr(law, name) for name in parameters(variant)]
        constant.append(np.full((self.robots, 1), timestep))
        constant += [scale] if scale is not None else []
        constant += [np.stack(list(loads.values()), axis=-1)] if loads else []
        self._constant = self._blocks(np.concatenate(constant, axis=1))

    @classmethod
    def of_one(
        cls, pepper: PepperModel, timestep: float, actuators: ActuatorParameters, gravity: bool
    ) -> Engine:
        """Return one robot with the given actuators."""
        law = LawTable(*(values[np.newaxis] for values in law_table(pepper, actuators)))
        return cls(pepper, timestep, law, gravity=gravity)

    def follow(self, q: Array, v: Array, command: Command, load: Array) -> Series:
        """Advance the only robot by one step for each command; see `Integrator.run`."""
        steps = len(command.position)
        if steps == 1:
            return self.single.step(q, v, command.row(0), load[0])
        told = (*command, load)
        inputs = Inputs(*(values[np.newaxis] for values in told))
        rolled = self.run(q[np.newaxis], v[np.newaxis], inputs, steps)
        position, velocity, torque = (x[0, 1:] for x in (rolled.position, rolled.velocity, rolled.torque))
        return Series(position, velocity, torque, int(rolled.good[0]))

    @cached_property
    def single(self) -> SingleRobot:
        """The only robot, step by step."""
        kernels = (self._step, self._solve)
        return SingleRobot(self._h, kernels, self._law[0], self._constant[0], self._room())

    def run(
        self, q: Array, v: Array, inputs: Inputs, steps: int, *, every: int = 1, threads: int = 1
    ) -> Rolled:
        """Advance all robots.

        Args:
            q: Positions at the start [rad or m], shape (N, n).
            v: Velocities, shape (N, n).
            inputs: What the robots are told, shape (N, T, n) each, or (1, T, n) for all robots.
            steps: Number of steps T.
            every: Steps between rows of the result.
            threads: Number of threads; the result does not depend on it.

        Returns:
            The states.
        """
        shape = (self.robots, 1 - (-steps // every), self._n)
        position, velocity, torque = (np.empty(shape) for _ in range(3))
        position[:, 0], velocity[:, 0] = q, v
        log = Log(position, velocity, torque, np.full(self.robots, steps, dtype=np.int64))
        state = np.stack([self._blocks(x) for x in (q, v, np.full_like(q, np.nan))])
        told = Inputs(*(self._spread(x) for x in inputs))
        weight = self._lanes * _WEIGHT

        def work(start: int, stop: int) -> None:
            span = (steps, every, self._lanes, start // weight, -(-stop // weight))
            roll(span, self._h, self._addresses, self._law, self._constant, self._room(), told, state, log)

        first = None if roll.signatures else Compilation("the twin", PATIENCE + 1e-5 * steps * self.robots)
        run_in_pieces(state.shape[1] * weight, threads, weight, work)
        if first is not None:
            first.end(compiled=bool(roll.stats.cache_misses))
        return Rolled(position, velocity, torque, log.good, *(self._robots(x) for x in state))

    def _spread(self, values: Array) -> Array:
        """Return values for all robots in the order of elements; others as they are."""
        shared = values.shape[0] == 1
        return np.ascontiguousarray(np.repeat(values, self._lanes, axis=2) if shared else values, dtype=float)

    def _room(self) -> Room:
        """Return the arrays of one thread."""
        m, entries = self._n * self._lanes, self._places.shape[1] * self._lanes
        return Room(
            given=_aligned(6 * m + self._constant.shape[1]),
            result=_aligned(5 * m + entries + self._lanes),
            work=_aligned(max(self._step.work_size, self._solve.work_size)),
            ask=_aligned(2 * m + entries),
            answer=_aligned(m),
            rows=np.empty((5, m)),
            flags=np.zeros((2, self._lanes), dtype=np.bool_),
            places=self._places,
        )

    def _blocks(self, values: Any) -> Array:
        """Return values of robots, (N, k), in blocks of lanes, (blocks, k W); the last robot fills up."""
        lanes, k = self._lanes, values.shape[1]
        blocks = -(-self.robots // lanes)
        rows = np.minimum(np.arange(blocks * lanes), self.robots - 1)
        return np.ascontiguousarray(
            values[rows].reshape(blocks, lanes, k).transpose(0, 2, 1).reshape(blocks, k * lanes), dtype=float
        )

    def _robots(self, blocks: Array) -> Array:
        """Return values of robots from blocks."""
        count, k = blocks.shape[0], blocks.shape[1] // self._lanes
        return blocks.reshape(count, k, self._lanes).transpose(0, 2, 1).reshape(-1, k)[: self.robots].copy()


def has_motor(law: LawTable) -> bool:
    """Return whether any joint has more than a servo with a torque limit and stops."""
    more = (law.viscous, law.coulomb, law.rotor, law.resolution, law.line)
    return any(values.any() for values in more) or bool((law.stall < law.limit).any())


def _aligned(size: int) -> Array:
    """Return an array at a multiple of 64 bytes."""
    room = np.empty(size + 8)
    start = (-(room.ctypes.data // 8)) % 8
    return room[start : start + size]
