"""Robots stepped by machine code."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.kernels import Kernel
from pepper_kin.kernels.threads import run_in_pieces
from pepper_kin.model import PepperModel
from pepper_kin.twin.actuators import ActuatorParameters
from pepper_kin.twin.command import Command
from pepper_kin.twin.fast.expression import mass_places, solve_kernel, step_kernel
from pepper_kin.twin.fast.law import derived
from pepper_kin.twin.fast.loop import Inputs, Log, roll
from pepper_kin.twin.fast.settle import Room
from pepper_kin.twin.integrator import Series
from pepper_kin.twin.joint_law import LawTable, law_table

Array = NDArray[np.float64]

_logger = logging.getLogger(__name__)
_SLOW = 2.0  # [s]; loading from Numba's cache takes a tenth of that
_WEIGHT = 512  # rows that a robot counts as when work is shared among threads


class Rolled(NamedTuple):
    """What robots did.

    Attributes:
        position: Every so many steps [rad or m], shape (N, rows, n).
        velocity: The same [rad/s or m/s].
        torque: The same [N m or N].
        good: Number of good steps of each robot, shape (N,).
        last_position: Of the last good state [rad or m], shape (N, n).
        last_velocity: The same [rad/s or m/s], shape (N, n).
    """

    position: Array
    velocity: Array
    torque: Array
    good: NDArray[np.int64]
    last_position: Array
    last_velocity: Array


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
        self._step: Kernel = step_kernel(pepper, scale is not None, tuple(loads))
        self._solve: Kernel = solve_kernel(pepper)
        self._lanes = 1 if self.robots == 1 else self._step.lanes
        single = self._lanes == 1
        kernels = (self._step, self._solve)
        self._addresses = np.array([k.single_address if single else k.block_address for k in kernels])
        self._places = np.array(mass_places(pepper), dtype=np.int64).T.copy()
        self._law = LawTable(*(self._blocks(values) for values in law))
        self._fixed = derived(self._law, timestep)
        constant = [law.feedforward if gravity else np.zeros_like(law.kp)]
        if scale is not None:
            constant.append(scale)
        if loads:
            constant.append(np.stack(list(loads.values()), axis=-1))
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
        inputs = Inputs(*(x[np.newaxis] for x in command), load=load[np.newaxis])
        rolled = self.run(q[np.newaxis], v[np.newaxis], inputs, steps)
        return Series(rolled.position[0], rolled.velocity[0], rolled.torque[0], int(rolled.good[0]))

    def run(
        self, q: Array, v: Array, inputs: Inputs, steps: int, *, every: int = 1, threads: int = 1
    ) -> Rolled:
        """Advance all robots.

        Args:
            q: Positions at the start [rad or m], shape (N, n).
            v: Velocities, shape (N, n).
            inputs: What the robots are told.
            steps: Number of steps T.
            every: Steps between rows of the result.
            threads: Number of threads; the result does not depend on it.

        Returns:
            The states after every so many steps; rows after a robot has stopped are NaN, but for the one
            that shows why.
        """
        shape = (self.robots, steps // every, self._n)
        position, velocity, torque = (np.full(shape, np.nan) for _ in range(3))
        log = Log(position, velocity, torque, every, np.full(self.robots, steps, dtype=np.int64))
        state = np.stack([self._blocks(q), self._blocks(v), self._blocks(np.zeros_like(q))])
        told = Inputs(*(np.ascontiguousarray(x, dtype=float) for x in inputs))
        blocks = state.shape[1]

        def work(start: int, stop: int) -> None:
            first, last = start // (self._lanes * _WEIGHT), -(-stop // (self._lanes * _WEIGHT))
            roll(steps, self._h, self._addresses, self._lanes, first, last, self._law, self._fixed,
                 self._room(), told, state, log)  # fmt: skip

        begin = time.perf_counter()
        compiled = len(roll.signatures)
        run_in_pieces(blocks * self._lanes * _WEIGHT, threads, self._lanes * _WEIGHT, work)
        if len(roll.signatures) > compiled and time.perf_counter() - begin > _SLOW + 1e-5 * steps:
            _logger.warning("compiled the loop of the twin in %.1f s", time.perf_counter() - begin)
        q_end, v_end = self._robots(state[0]), self._robots(state[1])
        return Rolled(position, velocity, torque, log.good, q_end, v_end)

    def _room(self) -> Room:
        """Return the arrays of one thread."""
        m, entries = self._n * self._lanes, self._places.shape[1]
        work = np.empty(max(self._step.work_size, self._solve.work_size) + 8)
        aligned = work[(-(work.ctypes.data // 8)) % 8 :]
        return Room(
            given=_aligned(4 * m + self._constant.shape[1]),
            constant=self._constant,
            result=_aligned(3 * m + entries * self._lanes),
            work=aligned,
            told=np.empty((4, m)),
            servo=np.empty(m),
            next=np.empty(3 * m),
            ask=_aligned(2 * m + entries * self._lanes),
            answer=_aligned(m),
            piece=np.empty((2, m)),
            before=np.empty(m),
            way=np.empty((2, m)),
            settled=np.zeros(self._lanes, dtype=np.bool_),
            alive=np.ones(self._lanes, dtype=np.bool_),
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


def _aligned(size: int) -> Array:
    """Return an array at a multiple of 64 bytes."""
    room = np.empty(size + 8)
    start = (-(room.ctypes.data // 8)) % 8
    return room[start : start + size]
