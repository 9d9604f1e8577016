"""Time stepping of one robot: semi-implicit Euler on the articulated body, with implicit joint forces."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np

from pepper_kin import dynamics
from pepper_kin.arrays import Array
from pepper_kin.collision.loads import load_parameters
from pepper_kin.core.simulation.actuator_model import ActuatorTable, present_torques
from pepper_kin.core.simulation.contact_step import WorldTables, no_world
from pepper_kin.core.simulation.rollout import DONE, Inputs, Log, Span, linearized_step, rollout
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, check_positive
from pepper_kin.twin.actuator_table import actuator_table, check_joints
from pepper_kin.twin.actuators import ActuatorParameters
from pepper_kin.twin.command import Command
from pepper_kin.twin.simulator import Simulator

GREATEST_TIMESTEP = 0.05  # maximum timestep [s]
_ONE = Span(1, 1, 0, 1)


def _shapes(arrays: tuple[Array, ...], every: int) -> str:
    """Return the shapes of state, commands and load, of any shape, in words."""
    shapes = ", ".join(str(getattr(part, "shape", type(part).__name__)) for part in arrays)
    return f"shapes {shapes}, and states every {every} steps"


def _shapes_wanted(n: int) -> str:
    rows = f"commands of shape (T, {n}), a load of shape (T, {n}) or (1, {n})"
    return f"a state of shape ({n},), {rows}, and a divisor of T"


class Series(NamedTuple):
    """States after a series of steps; if a state diverged, `good` is less than their number.

    Attributes:
        position: Positions at the end of each step [rad or m], shape (T, n).
        velocity: Velocities at the end of each step [rad/s or m/s], shape (T, n).
        torque: Torques of the actuators during each step [N m or N], shape (T, n).
        good: Number of good steps; the row after them, if any, is the diverged state.
        outcome: DONE, or the outcome of the world's step that failed; then there is no diverged row.
        rows: Arrays of position, velocity and torque that begin with the initial state, shape (1 + T, n)
            each, or None; the first row of the torque is not written.
        wrench: Mean force [N] and moment about the world's origin [N m] on the robot from outside during each
            step, shape (T, 6); None without one.
    """

    position: Array
    velocity: Array
    torque: Array
    good: int
    outcome: int = DONE
    rows: tuple[Array, Array, Array] | None = None
    wrench: Array | None = None


def joined(parts: list[Series], good: int) -> Series:
    """Join successive series into one."""
    if len(parts) == 1:
        return parts[0]
    rows = zip(*(part[:3] for part in parts), strict=True)
    position, velocity, torque = (np.concatenate(values) for values in rows)
    if all(part.wrench is None for part in parts):
        return Series(position, velocity, torque, good)
    wrenches = [np.zeros((len(p.position), 6)) if p.wrench is None else p.wrench for p in parts]
    return Series(position, velocity, torque, good, wrench=np.concatenate(wrenches))


class _SingleStep(NamedTuple):
    """Arrays of a single step.

    Attributes:
        inputs: Inputs of the time loop.
        state: State of the time loop.
        log: Log of the time loop.
        rows: Rows for position, velocity, references of both, feed-forward and load, shape (1, n) each.
        step_output: Position, velocity and torque after the step, shape (3, 1, n).
    """

    inputs: Inputs
    state: Array
    log: Log
    rows: tuple[Array, ...]
    step_output: Array

    @classmethod
    def of(cls, n: int) -> _SingleStep:
        """Return arrays for n joints."""
        inputs, state, logged = Inputs(*np.empty((4, 1, 1, n))), np.empty((3, 1, n)), np.empty((3, 1, 2, n))
        rows = (state[0], state[1], *(part[0] for part in inputs))
        return cls(
            inputs, state, Log(logged[0], logged[1], logged[2], np.ones(1, np.int64)), rows, logged[:, 0, 1:]
        )


class Integrator:
    """Integrator of a robot whose joints are driven by actuators.

    Scheme, with step h, position q, velocity v, bias b(q, v) = C(q, v) v + g(q) and the force F_j(v_j+) of
    actuator, friction and stop on each joint at the end of the step (see `core.simulation.actuator_model`):

        v+ = v + h a,   q+ = q + h v+                     (semi-implicit, or symplectic, Euler)
        (M(q) + J) a + b(q, v) = F(v+) + load             (J: rotors; servo, friction and stops implicit)

    On a straight segment of the model, F = c - k v+, this is (M + J + h k) a = c - k v - b + load: for a
    servo alone, h k = h^2 Kp + h Kd.  The segments are found by Newton's method
    (`core.simulation.implicit_step`).

    Order: one in h, for position and velocity.  Stability: the actuator is damped for every h > 0, as in
    implicit Euler, however high its gains; M and b are taken at the start of the step, which bounds h by the
    speed of the links.  Without servo and stops, the scheme is symplectic for constant M: the energy of a
    swing oscillates by O(h) and does not drift.

    Source: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), I.1.2 and VI.3; Featherstone,
    Rigid Body Dynamics Algorithms (2008), table 7.1.

    Threads that share an integrator take turns; their steps then depend on each other.

    Args:
        pepper: The robot.
        timestep: h [s], above 0 and at most 0.05.
        actuators: The actuators and stops.
        gravity: Whether servos add the gravity torque of the present posture, with nominal masses.
        loads: Carried loads.

    Raises:
        InvalidValueError: for a timestep out of range, or actuators of other joints.
    """

    def __init__(
        self,
        pepper: PepperModel,
        timestep: float,
        actuators: ActuatorParameters,
        *,
        gravity: bool = False,
        loads: Loads = (),
    ) -> None:
        self.timestep = check_timestep(timestep)
        check_joints(pepper, actuators)
        self._pepper, self._gravity = pepper, bool(gravity)
        frames, values = load_parameters(pepper, loads)
        self._loads = {frame: row[np.newaxis] for frame, row in zip(frames, values, strict=True)}
        self._actuators = actuator_table(pepper, actuators)
        self._table = np.ascontiguousarray(np.stack(self._actuators))
        self._nothing = np.zeros((1, pepper.n))
        self._alone = no_world(pepper.n)
        self._made: Simulator | None = None
        # Machine code releases the interpreter's lock, but there is only one working memory.
        self._turn = threading.RLock()

    @property
    def temperature(self) -> Array:
        """Temperatures of the motors after the last step, from 0 (cold) to 1 (hottest), shape (n,)."""
        return np.zeros(self._pepper.n) if self._made is None else self._made.temperature[0]

    def reset(self) -> None:
        """Reset the internal state: motors are cold, and joints with backlash are held where they are."""
        with self._turn:
            if self._made is not None:
                self._made.reset()

    def gravity_torque(self, q: Array) -> Array:
        """Return g(q) [N m or N], shape (n,)."""
        return np.asarray(dynamics.gravity_torque(self._pepper, q))

    def present_torque(self, q: Array, v: Array, q_ref: Array, v_ref: Array, feedforward: Array) -> Array:
        """Return the torque of the actuators at a state, instead of at the end of a step.

        Args:
            q: Position [rad or m], shape (n,).
            v: Velocity [rad/s or m/s], shape (n,).
            q_ref: Reference position [rad or m], shape (n,).
            v_ref: Reference velocity [rad/s or m/s], shape (n,).
            feedforward: Feed-forward [N m or N], shape (n,).

        Returns:
            Torques [N m or N], shape (n,).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        *state, effort = self._vectors(q=q, v=v, q_ref=q_ref, v_ref=v_ref, feedforward=feedforward)
        torque = np.empty(self._pepper.n)
        present_torques(self._table, np.stack(state), self._actuators.strength * effort, torque)
        return torque

    def _vectors(self, **values: Array) -> list[Array]:
        """Return joint vectors, shape (n,) each, given by their names in messages.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        return [as_joint_vector(self._pepper, value, name) for name, value in values.items()]

    def wanted_torque(self, q: Array, q_ref: Array, v_ref: Array, feedforward: Array) -> Array:
        """Return the torques that the actuators demand at the end of a step with zero velocity, unclipped.

        Args:
            q: Position [rad or m], shape (n,).
            q_ref: Reference position [rad or m], shape (n,).
            v_ref: Reference velocity [rad/s or m/s], shape (n,).
            feedforward: Feed-forward [N m or N], shape (n,).

        Returns:
            Torques [N m or N], shape (n,); infinite or NaN for a diverged state.

        Raises:
            InvalidValueError: for a wrong shape.
        """
        servo, shape = self._actuators, (self._pepper.n,)
        for name, value in (("q", q), ("q_ref", q_ref), ("v_ref", v_ref), ("feedforward", feedforward)):
            if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype != np.float64:
                raise InvalidValueError(name, np.shape(value), f"an array of float64 of shape {shape}")
        with np.errstate(over="ignore", invalid="ignore"):
            return servo.kp * (q_ref - q) + servo.kd * v_ref + servo.strength * feedforward

    def step(
        self,
        q: Array,
        v: Array,
        q_ref: Array,
        v_ref: Array,
        feedforward: Array,
        load: Array | None = None,
    ) -> tuple[Array, Array, Array]:
        """Advance by one timestep.

        Args:
            q: Position [rad or m], shape (n,).
            v: Velocity [rad/s or m/s], shape (n,).
            q_ref: Reference position at the end of the step [rad or m], shape (n,).
            v_ref: Reference velocity at the end of the step [rad/s or m/s], shape (n,).
            feedforward: Torque added by the servo, or effort of joints in torque mode [N m or N], shape (n,).
            load: External torque, not limited [N m or N], shape (n,).

        Returns:
            Position and velocity at the end of the step, and the actuators' torque during the step [N m or
            N]; NaN if they diverge.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        q, v, *wanted = self._vectors(q=q, v=v, q_ref=q_ref, v_ref=v_ref, feedforward=feedforward)
        outer = self._nothing if load is None else self._vectors(load=load)[0][np.newaxis]
        series = self.run(q, v, Command(*wanted).as_rows(), outer)
        return series.position[0], series.velocity[0], series.torque[0]

    def linearized(
        self,
        q: Array,
        v: Array,
        q_ref: Array,
        v_ref: Array,
        feedforward: Array,
        load: Array | None = None,
    ) -> tuple[Array, Array]:
        """Return the step as one linear equation, mass_hat a = force.

        mass_hat = M + J + h diag(k) and force = c - k v - b + load on the segments where the step without
        further load ends, so that its solution a is exactly that of `step`; a further load adds to the force.

        Args:
            q: Position [rad or m], shape (n,).
            v: Velocity [rad/s or m/s], shape (n,).
            q_ref: Reference position at the end of the step [rad or m], shape (n,).
            v_ref: Reference velocity at the end of the step [rad/s or m/s], shape (n,).
            feedforward: Torque added by the servo, or effort of joints in torque mode [N m or N], shape (n,).
            load: External torque [N m or N], shape (n,).

        Returns:
            Matrix mass_hat, shape (n, n) [kg m^2, kg m or kg], symmetric and positive definite, and force,
            shape (n,) [N m or N].

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        n = self._pepper.n
        *inputs, effort = self._vectors(q=q, v=v, q_ref=q_ref, v_ref=v_ref, feedforward=feedforward)
        inputs += [self._actuators.strength * effort, self._nothing[0]]
        if load is not None:
            inputs[-1] = self._vectors(load=load)[0]
        mass_hat, force = np.empty((n, n)), np.empty(n)
        with self._turn:
            tables, space = self._simulator.tables, self._space
            for row, values in enumerate(inputs):
                space.step_input[row * n : (row + 1) * n] = values
            space.step_input[6 * n :] = tables.constant[0]
            linearized_step(tables, space, mass_hat, force)
        return mass_hat, force

    def run(
        self,
        q: Array,
        v: Array,
        command: Command,
        load: Array,
        *,
        every: int = 1,
        world: WorldTables | None = None,
    ) -> Series:
        """Advance by one step for each command.

        Only shapes are checked, which machine code relies on, because this is the hot path.

        Args:
            q: Position [rad or m], shape (n,).
            v: Velocity [rad/s or m/s], shape (n,).
            command: Commands for the end of each step, shape (T, n) each.
            load: External torque [N m or N], shape (T, n), or (1, n) for all steps.
            every: Number of steps between states of the result, a divisor of T.
            world: World around the robot; none if omitted.

        Returns:
            The states.

        Raises:
            InvalidValueError: for a wrong shape, or an `every` that is no divisor of T.
        """
        world = self._alone if world is None else world
        shape = steps, n = command.position.shape
        if steps == 1 and every == 1:
            with self._turn:
                return self._one_step(q, v, command, load, world)
        if not (
            n == self._pepper.n
            and getattr(q, "shape", None) == getattr(v, "shape", None) == (n,)
            and shape == command.velocity.shape == command.feedforward.shape
            and load.shape in ((1, n), shape)
            and every > 0
            and steps % every == 0
        ):
            got = _shapes((q, v, *command, load), every)
            raise InvalidValueError("state, command and load", got, _shapes_wanted(self._pepper.n))
        inputs = Inputs(*(np.ascontiguousarray(x, np.float64).reshape(1, -1, n) for x in (*command, load)))
        shape = (1 + steps // every, n)
        position, velocity, torque = np.empty(shape), np.empty(shape), np.empty(shape)
        state, good = np.empty((3, 1, n)), np.array([steps])
        state[0, 0], state[1, 0] = position[0], velocity[0] = q, v
        log = Log(position[np.newaxis], velocity[np.newaxis], torque[np.newaxis], good)
        with self._turn:
            tables = self._simulator.tables
            outcome = rollout(Span(steps, every, 0, 1), tables, self._space, inputs, state, log, world)
            if good[0] < steps:
                self._simulator.reraise()
        kept = (position, velocity, torque)
        return Series(position[1:], velocity[1:], torque[1:], int(good[0]) // every, int(outcome), kept)

    def _one_step(self, q: Array, v: Array, command: Command, load: Array, world: WorldTables) -> Series:
        """Take one step in reused arrays; the result is a copy.

        Args:
            q: Position [rad or m], shape (n,).
            v: Velocity [rad/s or m/s], shape (n,).
            command: Command for the end of the step, shape (1, n) each.
            load: External torque [N m or N], shape (1, n).
            world: World around the robot.
        """
        tables, single = self._simulator.tables, self._single
        try:
            for row, values in zip(single.rows, (q, v, *command, load), strict=True):
                row[:] = values
        except (TypeError, ValueError, OverflowError):  # NumPy compares the shapes
            got = _shapes((q, v, *command, load), 1)
            wanted = _shapes_wanted(self._pepper.n)
            raise InvalidValueError("state, command and load", got, wanted) from None
        single.log.good[0] = 1
        outcome = rollout(_ONE, tables, self._space, single.inputs, single.state, single.log, world)
        if not single.log.good[0]:
            self._simulator.reraise()
        position, velocity, torque = single.step_output.copy()
        return Series(position, velocity, torque, int(single.log.good[0]), outcome)

    @property
    def _simulator(self) -> Simulator:
        if self._made is None:
            one = ActuatorTable(*(values[np.newaxis] for values in self._actuators))
            made = Simulator(self._pepper, self.timestep, one, gravity=self._gravity, loads=self._loads)
            self._space = made.workspace()
            self._single = _SingleStep.of(self._pepper.n)
            self._made = made
        return self._made


def check_timestep(timestep: float) -> float:
    """Return a timestep [s], after checks.

    Raises:
        InvalidValueError: for a timestep that is not above 0 and at most 0.05 s.
    """
    checked = check_positive("timestep", timestep, "s")
    if checked > GREATEST_TIMESTEP:
        raise InvalidValueError("timestep", f"{timestep} s", f"a number in (0, {GREATEST_TIMESTEP}] s")
    return checked
