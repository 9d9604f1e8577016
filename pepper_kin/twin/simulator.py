"""Robots of one kind in the form of the compiled time loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.simulation.actuator_model import LIMIT, ActuatorTable
from pepper_kin.core.simulation.contact_step import no_world
from pepper_kin.core.simulation.drive_state import COLD_LIMIT, HELD, TEMPERATURE, remembers
from pepper_kin.core.simulation.implicit_step import CONSTANT, CONSTANT_LIMIT, RobotTables, StepWorkspace
from pepper_kin.core.simulation.rollout import Inputs, Log, Span, rollout
from pepper_kin.core.simulation.shaped_steps import (
    COMMAND,
    COMMAND_SPEED,
    EFFORT,
    FROM_OUTSIDE,
    NO_BODIES,
    POSITION,
    STATE_ROWS,
    TARGET,
    VELOCITY,
    Sent,
    Steps,
    shaped_steps,
)
from pepper_kin.kernels.threads import run_in_pieces
from pepper_kin.model import PepperModel
from pepper_kin.twin.pinocchio_step import PythonKernel
from pepper_kin.twin.step_kernel import Variant, mass_places, parameters, step_kernels

if TYPE_CHECKING:
    from pepper_kin.twin.batch_world import BatchWorld

_ALL = slice(None)
_LONGEST_RUN = 300_000  # number of robots' steps after which the interpreter runs, to handle interrupts
_WEIGHT = 512  # number of rows that a robot counts as when work is divided among threads


class Rollout(NamedTuple):
    """States and torques of simulated robots.

    Attributes:
        position: Positions at the start and at recorded steps [rad or m], shape (N, rows, n).  If a robot has
            stopped, the next row is the diverged state, and later rows are undefined; there is one additional
            row if the steps do not divide evenly.
        velocity: Velocities at the rows [rad/s or m/s], shape (N, rows, n).
        torque: Torques at the rows [N m or N], shape (N, rows, n); the first row is undefined.
        good: Number of good steps of each robot, shape (N,).
        last_position: Positions of the last good state [rad or m], shape (N, n).
        last_velocity: Velocities of the last good state [rad/s or m/s], shape (N, n).
        last_torque: Torques in the last step [N m or N], shape (N, n); undefined for a robot that has
            stopped.
    """

    position: Array
    velocity: Array
    torque: Array
    good: NDArray[np.int64]
    last_position: Array
    last_velocity: Array
    last_torque: Array


class Sending(NamedTuple):
    """Settings of the commands of joints.

    Attributes:
        kind: HELD_COMMANDS, LINEAR or SHAPED, see `shaped_steps`.
        limits: Maximum velocity [rad/s or m/s] and acceleration [rad/s^2 or m/s^2] of shaped commands, shape
            (2, n).
    """

    kind: int
    limits: Array


class Simulator:
    """N robots of one kind, each with its own parameters.

    Args:
        pepper: The robot.
        timestep: Timestep h [s].
        actuators: Parameters of the joints' actuators, shape (N, n) each.
        gravity: Whether servos add the gravity torque of the present posture, with nominal masses.
        scale: Factors of the mass that moves with each joint, shape (N, n); none if omitted.
        loads: Frame -> inertial parameters of the frame's load, shape (N, PARAMETERS); see
            `pepper_kin.collision.loads`.

    Attributes:
        robots: Number N of robots.
        tables: Tables of the robots for compiled code.
    """

    def __init__(
        self,
        pepper: PepperModel,
        timestep: float,
        actuators: ActuatorTable,
        *,
        gravity: bool,
        scale: Array | None = None,
        loads: Mapping[str, Array] | None = None,
    ) -> None:
        self.robots, self._n = actuators.kp.shape
        carried = dict(loads or {})
        variant = Variant(has_motor(actuators), scale is not None, tuple(carried))
        # The kernels are kept, since machine code lives only as long as its kernel.
        self._kernels = step_kernels(pepper, variant, self.robots)
        self._lanes = 1 if self.robots == 1 else self._kernels[0].lanes
        if not gravity:
            actuators = actuators._replace(feedforward=np.zeros_like(actuators.kp))
        constant = [getattr(actuators, name) for name in parameters(variant)]
        constant.append(np.full((self.robots, 1), timestep))
        constant += [scale] if scale is not None else []
        constant += list(carried.values())
        law = list(actuators)
        if actuators.play.any() or np.isfinite(actuators.continuous_torque).any():
            decay = np.exp(-timestep / actuators.thermal_time)
            law += [np.full_like(decay, np.nan), np.zeros_like(decay), decay, actuators.limit]
        step, solve = self._addresses(
            6 * self._n + sum(values.shape[1] for values in constant), len(mass_places(pepper))
        )
        self.tables = RobotTables(
            float(timestep),
            self._lanes,
            step,
            solve,
            np.ascontiguousarray(np.stack([self._blocks(values) for values in law], axis=1)),
            self._blocks(np.concatenate(constant, axis=1)),
            np.array(mass_places(pepper), dtype=np.int64).T.copy(),
        )
        self._nothing, self._clock = no_world(self._n), 0
        blocks, m = self.tables.law.shape[0], self._n * self._lanes
        self._delay, self._waiting = np.zeros((blocks, m), np.int64), np.zeros((0, 2 * blocks, m))
        self._sent = np.zeros((STATE_ROWS, blocks, m))

    @property
    def temperature(self) -> Array:
        """Temperatures of the motors, from 0 (cold) to 1 (hottest), shape (N, n)."""
        law = self.tables.law
        return self._robots(law[:, TEMPERATURE]) if remembers(law) else np.zeros((self.robots, self._n))

    def reset(self, robots: NDArray[np.int64] | slice = _ALL) -> None:
        """Reset motor temperatures and backlash of robots with given indices, shape (k,), or of all."""
        law, constant = self.tables.law, self.tables.constant
        if not remembers(law):
            return
        chosen = np.zeros((self.robots, self._n))
        chosen[robots] = 1.0
        where, m = self._blocks(chosen) > 0, law.shape[2]
        limits = constant[:, (CONSTANT_LIMIT - CONSTANT) * m : (CONSTANT_LIMIT - CONSTANT + 1) * m]
        law[:, HELD][where], law[:, TEMPERATURE][where] = np.nan, 0.0
        for values in (law[:, LIMIT], limits):
            values[where] = law[:, COLD_LIMIT][where]

    def run(
        self,
        q: Array,
        v: Array,
        inputs: Inputs,
        steps: int,
        *,
        every: int = 1,
        threads: int = 1,
        progress: Callable[[int, int], object] = lambda done, total: None,
    ) -> Rollout:
        """Advance all robots.

        Args:
            q: Positions at the start [rad or m], shape (N, n).
            v: Velocities at the start [rad/s or m/s], shape (N, n).
            inputs: Inputs of the robots, shape (N, T, n) each, or (1, T, n) for all robots.
            steps: Number of steps T.
            every: Number of steps between rows of the result.
            threads: Number of threads; the result does not depend on it.
            progress: Function called with the approximate number of finished robots and N.

        Returns:
            The states.
        """
        shape = (self.robots, 1 - (-steps // every), self._n)
        position, velocity, torque = (np.empty(shape) for _ in range(3))
        position[:, 0], velocity[:, 0] = q, v
        log = Log(position, velocity, torque, np.full(self.robots, steps, dtype=np.int64))
        state = np.stack([self._blocks(x) for x in (q, v, np.full_like(q, np.nan))])
        spread = Inputs(*(self._spread(x) for x in inputs))
        weight, world = self._lanes * _WEIGHT, self._nothing

        def work(start: int, stop: int) -> None:
            span = Span(steps, every, start // weight, -(-stop // weight))
            rollout(span, self.tables, self.workspace(), spread, state, log, world)

        def tell(rows: int) -> None:
            progress(min(rows // _WEIGHT, self.robots), self.robots)

        run_in_pieces(state.shape[1] * weight, threads, weight, work, _most(steps), tell)
        self.reraise()
        return Rollout(position, velocity, torque, log.good, *(self._robots(x) for x in state))

    def delay(self, ticks: NDArray[np.int64]) -> None:
        """Set the delay of commands of `go_to` in steps, shape (N,)."""
        self._delay = self._blocks(np.repeat(ticks[:, np.newaxis], self._n, axis=1)).astype(np.int64)
        self._waiting = np.zeros((int(ticks.max()) + 1, 2 * self._delay.shape[0], self._delay.shape[1]))

    def fill(self, q: Array, rows: NDArray[np.int64] | slice = _ALL) -> None:
        """Set all past commands of selected robots, (k,), to rest at q [rad or m], shape (N, n)."""
        chosen = np.zeros(q.shape)
        chosen[rows] = 1.0
        where, at = self._blocks(chosen) > 0, self._blocks(q)
        self._sent[COMMAND][where], self._sent[COMMAND_SPEED][where] = at[where], 0.0
        self._waiting[:, 0::2][:, where], self._waiting[:, 1::2][:, where] = at[where], 0.0

    def go_to(
        self,
        state: tuple[Array, Array, Array, Array | None],
        sending: Sending,
        steps: int,
        threads: int,
        worlds: BatchWorld | None,
    ) -> tuple[Array, Array, Array, NDArray[np.int64]]:
        """Move all robots toward targets; see `shaped_steps`.

        Args:
            state: Position, velocity, target, and external load, shape (N, n) each; None for no load.
            sending: Settings of the commands.
            steps: Number of steps.
            threads: Number of threads; the result does not depend on it.
            worlds: Worlds around the robots; None for none.

        Returns:
            Position, velocity and torque, shape (N, n) each, and the number of good steps of each robot,
            shape (N,).
        """
        q, v, target, load = state
        blocks = self._sent
        blocks[POSITION], blocks[VELOCITY], blocks[TARGET] = (self._blocks(x) for x in (q, v, target))
        blocks[FROM_OUTSIDE] = 0.0 if load is None else self._blocks(load)
        limits, good = np.repeat(sending.limits, self._lanes, axis=1), np.empty(self.robots, np.int64)
        weight = self._lanes * _WEIGHT

        def work(start: int, stop: int) -> None:
            span = Steps(start // weight, -(-stop // weight), steps, sending.kind, self._clock)
            sent = Sent(limits, np.empty((4, limits.shape[1])), self._delay, self._waiting)
            space = self.workspace()
            if worlds is None:
                shaped_steps(span, self.tables, space, blocks, sent, NO_BODIES, self._nothing, good)
                return
            with worlds.tables(self.tables.timestep) as world:
                shaped_steps(span, self.tables, space, blocks, sent, worlds.bodies, world, good)

        run_in_pieces(blocks.shape[1] * weight, threads, weight, work, _most(steps))
        self.reraise()
        self._clock += steps
        q, v, torque = (self._robots(blocks[part]) for part in (POSITION, VELOCITY, EFFORT))
        return q, v, torque, good

    def checkpoint(self) -> dict[str, Array]:
        """Return the arrays of the internal state, by name."""
        return {
            "sent": self._sent, "late": self._waiting, "clock": np.array(self._clock),
            "law": self.tables.law, "constant": self.tables.constant,
        }  # fmt: skip

    def restore(self, found: Mapping[str, Array]) -> None:
        """Restore the internal state that `checkpoint` returned."""
        for name, part in self.checkpoint().items():
            part[...] = found[name]
        self._clock = int(found["clock"])

    def reraise(self) -> None:
        """Raise the error of a step by Pinocchio, such as KeyboardInterrupt; its state is invalid."""
        for kernel in self._kernels:
            if isinstance(kernel, PythonKernel):
                kernel.reraise()

    def workspace(self) -> StepWorkspace:
        """Return working arrays for one thread."""
        m, entries = self._n * self._lanes, self.tables.places.shape[1] * self._lanes
        return StepWorkspace(
            step_input=_aligned(6 * m + self.tables.constant.shape[1]),
            step_output=_aligned(5 * m + entries + self._lanes),
            work=_aligned(max(kernel.work_size for kernel in self._kernels)),
            solve_input=_aligned(2 * m + entries),
            solve_output=_aligned(m),
            rows=np.zeros((7, m)),  # unused lanes must hold numbers, too
            flags=np.zeros((2, self._lanes), dtype=np.bool_),
        )

    def _addresses(self, inputs: int, places: int) -> list[int]:
        """Return the addresses of the step and solve kernels, for buffers as `workspace` returns them."""
        function, work = "single" if self._lanes == 1 else "block", max(k.work_size for k in self._kernels)
        sizes = (inputs, 5 * self._n + places + 1), (places + 2 * self._n, self._n)
        return [
            kernel.address_of(function, inputs=read, outputs=written, work=work)
            for kernel, (read, written) in zip(self._kernels, sizes, strict=True)
        ]

    def _spread(self, values: Array) -> Array:
        """Return values shared by all robots repeated for each lane, and individual values unchanged.

        Args:
            values: Values, shape (1, T, n) for all robots, else (N, T, n).

        Returns:
            Values, shape (1, T, n W) with W lanes, or (N, T, n).
        """
        shared = values.shape[0] == 1
        return np.ascontiguousarray(np.repeat(values, self._lanes, axis=2) if shared else values, dtype=float)

    def _blocks(self, values: Any) -> Array:
        """Return values of robots, (N, k), in blocks of lanes, (blocks, k W), padded with the last robot."""
        lanes, k = self._lanes, values.shape[1]
        blocks = -(-self.robots // lanes)
        if blocks * lanes != self.robots:
            values = values[np.minimum(np.arange(blocks * lanes), self.robots - 1)]
        return np.ascontiguousarray(
            values.reshape(blocks, lanes, k).transpose(0, 2, 1).reshape(blocks, k * lanes), dtype=float
        )

    def _robots(self, blocks: Array) -> Array:
        """Return values of robots, (N, k), from blocks of W lanes, shape (blocks, k W)."""
        count, k = blocks.shape[0], blocks.shape[1] // self._lanes
        return blocks.reshape(count, k, self._lanes).transpose(0, 2, 1).reshape(-1, k)[: self.robots].copy()


def has_motor(actuators: ActuatorTable) -> bool:
    """Return whether any joint has more than a servo with a torque limit and stops."""
    more = {*parameters(Variant(motor=True))} - {*parameters(Variant()), "stall"}
    limited = (actuators.stall < actuators.limit).any()
    return bool(limited) or any(getattr(actuators, name).any() for name in more)


def _aligned(size: int) -> Array:
    """Return an array that is aligned to 64 bytes."""
    floats = np.empty(size + 8)
    start = (-(floats.ctypes.data // 8)) % 8
    return floats[start : start + size]


def _most(steps: int) -> int:
    """Return the number of rows that a thread processes before the interpreter runs; see `_WEIGHT`."""
    return _LONGEST_RUN // max(steps, 1) * _WEIGHT
