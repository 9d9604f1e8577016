"""Batches of twins, each with its own parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import dynamics
from pepper_kin.arrays import Array
from pepper_kin.core.simulation.actuator_model import ActuatorTable, present_torques
from pepper_kin.core.simulation.rollout import Inputs
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_finite,
    as_joint_vectors,
    check_choice,
    check_rows,
    check_whole,
    check_within_limits,
)
from pepper_kin.model.requirements import checked_share
from pepper_kin.trajectory.trajectory import Trajectory
from pepper_kin.twin.actuator_data import actuator_parameters
from pepper_kin.twin.actuator_table import actuator_table, check_joints
from pepper_kin.twin.actuators import TORQUE, ActuatorParameters
from pepper_kin.twin.batch_parameters import PerRobot, actuators_of_all, broadcast, loads_of_all, mass_factors
from pepper_kin.twin.batch_run import BatchRun, recorded_steps
from pepper_kin.twin.batch_world import BatchBodies, BatchWorld
from pepper_kin.twin.command import Command, Delay
from pepper_kin.twin.hooks import scene_of
from pepper_kin.twin.integrator import check_timestep
from pepper_kin.twin.reference import References, sampled
from pepper_kin.twin.simulator import Rollout, Sending, Simulator
from pepper_kin.twin.state import diverged
from pepper_kin.twin.twin import FEEDFORWARDS
from pepper_kin.twin.world.world import World

if TYPE_CHECKING:
    from pepper_kin.collision import Scene


MOST_ROBOTS = 1_000_000
COMMANDS = ("held", "linear", "shaped")  # kinds of commands, in the order of their ids in `shaped_steps`
GREATEST_LATENCY = 1.0  # maximum latency of commands of `step`, which are stored that long [s]
FASTEST = 1e6  # velocity [rad/s or m/s] and acceleration [rad/s^2 or m/s^2] of commands without a limit


class TwinBatch:
    """N independent robots of one kind, stepped together by vector machine code.

    Each robot agrees with a `Twin` of the same parameters to 1e-9.  With a world, each robot has its own
    copy, and only `step` can be used, which steps robot by robot.

    Args:
        pepper: The robot.
        count: Number N of robots.
        timestep: Time of one step [s], above 0 and at most 0.05.
        feedforward: "none", "gravity" or "inverse_dynamics", as for `Twin`; computed with the nominal masses,
            as a robot's controller does.
        actuators: Common actuators of the robots; `actuator_parameters(pepper)` if omitted.
        vary: Quantity of `ActuatorParameters`, such as "stiffness" -> individual values of the robots, shape
            (n,), (N, 1) or (N, n), or joint -> shape (N,); or "latency" -> times [s], one number or shape
            (N,).
        mass_scale: Joint, or group of joints -> factor of the mass and inertia of the links that move with
            the joint, up to the next joint, one number or shape (N,).
        payload: "left", "right" or frame -> point mass at its origin [kg], one number or shape (N,), in
            addition to attached objects.
        scene: The scene whose attached objects count with their mass, for all robots; the rest of the scene
            is ignored.
        substeps: Number of integrator steps in a timestep, as for `Twin`.
        world: World that each robot may touch; none if omitted.
        vary_bodies: Body of the world -> "mass" [kg] or "friction" -> one number or shape (N,).

    Raises:
        InvalidValueError: for a value that is not allowed, naming robot, joint and quantity.
        UnknownNameError: for an unknown quantity, joint, group, frame or body.
    """

    def __init__(
        self,
        pepper: PepperModel,
        count: int,
        timestep: float = 0.001,
        *,
        feedforward: str = "gravity",
        actuators: ActuatorParameters | None = None,
        vary: Mapping[str, PerRobot] | None = None,
        mass_scale: Mapping[str, ArrayLike] | None = None,
        payload: Mapping[str, ArrayLike] | None = None,
        scene: Scene | None = None,
        substeps: int = 1,
        world: World | None = None,
        vary_bodies: Mapping[str, Mapping[str, ArrayLike]] | None = None,
    ) -> None:
        self.pepper, self.count = pepper, check_whole("count", count, 1, MOST_ROBOTS)
        self.timestep = check_timestep(timestep)
        self.feedforward = check_choice("feedforward", feedforward, FEEDFORWARDS)
        self.actuators = actuators if actuators is not None else actuator_parameters(pepper)
        check_joints(pepper, self.actuators)
        self.substeps = check_whole("substeps", substeps)
        varied = dict(vary or {})
        late = varied.pop("latency", None)
        everyone = actuators_of_all(self.count, self.actuators, varied)
        self._world = None
        if world is not None:
            self._world = BatchWorld(self._checked_world(world), self.count, vary_bodies)
        if world is None and vary_bodies:
            raise InvalidValueError("vary_bodies", ", ".join(vary_bodies), "none, where there is no world")
        table = actuator_table(pepper, everyone)
        self._actuators = ActuatorTable(*(x.reshape(self.count, pepper.n) for x in table))
        self._simulator = Simulator(
            pepper,
            self.timestep / self.substeps,
            self._actuators,
            gravity=feedforward == "gravity",
            scale=mass_factors(pepper, self.count, mass_scale),
            loads=loads_of_all(pepper, self.count, payload, scene_of(world) if scene is None else scene),
        )
        self._torque_mode = self.actuators.in_mode(TORQUE)
        self._effort_mode = self._torque_mode if self._torque_mode.any() else None
        self._delay = Delay(round(self.actuators.latency / self.timestep))
        self._late = self._ticks(self.actuators.latency if late is None else late)
        if 0 < self._late.max() * self.timestep <= GREATEST_LATENCY:  # else only `follow` works
            self._simulator.delay(self._late * self.substeps)
        self._q = self._v = self._torque = np.zeros((self.count, pepper.n))
        self._shaped = True  # whether commands continue from the last `step`
        self.reset()

    @property
    def position(self) -> Array:
        """Present positions [rad or m], shape (N, n)."""
        return self._q.copy()

    @property
    def velocity(self) -> Array:
        """Present velocities [rad/s or m/s], shape (N, n)."""
        return self._v.copy()

    @property
    def temperature(self) -> Array:
        """Temperatures of the motors, from 0 (cold) to 1 (hottest), shape (N, n)."""
        return self._simulator.temperature

    @property
    def torque(self) -> Array:
        """Torques of the actuators in the last timestep [N m or N], shape (N, n)."""
        return self._torque.copy()

    @property
    def contact_wrench(self) -> Array:
        """Mean force of contacts [N] on each robot, and moment about the world's origin [N m].

        Of the last `step`, in world axes, shape (N, 6); zero without a world.
        """
        return np.zeros((self.count, 6)) if self._world is None else self._world.bodies.wrench.copy()

    @property
    def failures(self) -> dict[int, str]:
        """Robot -> reason why its world could not be solved in the last step; see `step`."""
        return {} if self._world is None else self._world.failures

    def body(self, name: str) -> BatchBodies:
        """Return the state of a free body, or a moving obstacle, in the worlds of all robots.

        Raises:
            UnknownNameError: for an unknown body; the message lists the bodies.
        """
        return self._bodies(name).state_of(name)

    def place(
        self,
        name: str,
        position: ArrayLike | None = None,
        rpy: ArrayLike | None = None,
        *,
        velocity: ArrayLike | None = None,
        rows: ArrayLike | None = None,
    ) -> None:
        """Set the state of a free body, or a moving obstacle, in the worlds of all or selected robots.

        Args:
            name: Name of the body.
            position: Position of its center [m], shape (3,) or (k, 3); unchanged if omitted.
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,) or (k, 3); unchanged if omitted.
            velocity: Velocity of its center [m/s] and angular velocity [rad/s], in world axes, shape (6,) or
                (k, 6); unchanged if omitted.
            rows: Indices of robots, shape (k,), or a mask, shape (N,); all if omitted.

        Raises:
            UnknownNameError: for an unknown body; the message lists the bodies.
            InvalidValueError: for NaN, a wrong shape, or rows that do not exist.
        """
        places = np.arange(self.count) if rows is None else check_rows(rows, self.count)
        self._bodies(name).place(name, places, position, rpy, velocity)

    def reset(
        self, q: ArrayLike | None = None, v: ArrayLike | None = None, *, rows: ArrayLike | None = None
    ) -> None:
        """Set the states of all or selected robots, with cold motors; the other robots are unchanged.

        The bodies of their worlds return to their initial states.

        Args:
            q: Positions [rad or m], shape (n,), or one for each of k robots, shape (k, n); the neutral
                posture (Stand) if omitted.
            v: Velocities [rad/s or m/s], shape (n,) or (k, n); rest if omitted.
            rows: Indices of robots from 0, shape (k,), each once, or a mask, shape (N,), such as
                `run.good_steps < steps`; all robots, k = N, if omitted.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity, or rows that do not exist.
            LimitError: for a position outside the limits.
        """
        rest = np.zeros(self.pepper.n)
        places = np.arange(self.count) if rows is None else check_rows(rows, self.count)
        position = self._states(self.pepper.neutral() if q is None else q, "q", places.size)
        velocity = self._states(rest if v is None else v, "v", places.size)
        check_within_limits(self.pepper, position, "q", 1e-6)
        # The present arrays may belong to a run that was returned.
        self._q, self._v, torque = self._q.copy(), self._v.copy(), self._torque.copy()
        self._q[places], self._v[places] = position, velocity
        torque[places] = self._torque_at_rest()[places]
        self._torque = torque
        still = np.zeros_like(position)
        self._delay.fill(self._command(References(position, still, still)), places, self.count)
        self._simulator.reset(places)
        self._simulator.fill(self._q, places)
        if self._world is not None:
            self._world.reset(places)

    def checkpoint(self) -> dict[str, Array]:
        """Return the complete state as arrays by name; `restore` continues from it, bit by bit."""
        found = {"position": self._q, "velocity": self._v, "torque": self._torque}
        found |= self._simulator.checkpoint() | {"shaped": np.array(self._shaped)}
        found |= {f"waiting {k}": part for k, part in enumerate(self._delay.waiting or ())}
        if self._world is not None:
            found |= {f"world {name}": part for name, part in self._world.bodies._asdict().items()}
        return {name: part.copy() for name, part in found.items()}

    def restore(self, checkpoint: Mapping[str, ArrayLike]) -> None:
        """Restore a state that `checkpoint` returned, of a batch with the same arguments.

        Raises:
            InvalidValueError: for an array that is missing or has another shape; then nothing is changed.
        """
        present, found = self.checkpoint(), {}
        for name, part in present.items():
            array = np.array(checkpoint.get(name, np.nan), dtype=part.dtype)
            if array.shape != part.shape:
                raise InvalidValueError(f"checkpoint's {name}", f"shape {array.shape}", f"shape {part.shape}")
            found[name] = array
        self._q, self._v, self._torque = found["position"], found["velocity"], found["torque"]
        self._shaped = bool(found["shaped"])
        self._simulator.restore(found)
        if self._delay.waiting is not None:
            self._delay.waiting = Command(*(found[f"waiting {k}"] for k in range(3)))
        if self._world is not None:
            for name, part in self._world.bodies._asdict().items():
                part[:] = found[f"world {name}"]

    def execute(
        self,
        trajectory: Trajectory,
        hold_time: float = 0.0,
        *,
        from_present: bool = False,
        every: int | None = None,
        threads: int = 1,
        progress: Callable[[int, int], object] = lambda done, total: None,
    ) -> BatchRun:
        """Let all robots follow a trajectory.

        Args:
            trajectory: The trajectory; its joints must be the robot's.
            hold_time: Time to hold the end afterwards [s].
            from_present: Whether robots start in their present states; otherwise all are first reset to the
                trajectory's start, with its velocity.
            every: Timesteps between recorded states; only start and end if omitted.
            threads: Number of threads; the result does not depend on it.
            progress: Function called with the approximate number of finished robots and N, since robots are
                simulated to the end one after the other; an error that it raises ends the call.

        Returns:
            The run; robots whose state diverged are named in it.

        Raises:
            InvalidValueError: for other joints, or a time or number that is not allowed.
            LimitError: if the trajectory starts outside the position limits.
        """
        reference = sampled(self.pepper, trajectory, hold_time, self.timestep)
        if not from_present:
            self.reset(reference.position[0], reference.velocity[0])
        command = self._command(References(*(x[np.newaxis, 1:] for x in reference[:3])))
        return self._follow(command, np.zeros((1, 1, self.pepper.n)), every, threads, progress)

    def follow(
        self,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        *,
        acceleration: ArrayLike | None = None,
        effort: ArrayLike | None = None,
        load: ArrayLike | None = None,
        every: int | None = None,
        threads: int = 1,
    ) -> BatchRun:
        """Follow references with a row for every timestep, from the present states of the robots.

        Args:
            position: Reference positions at the end of each step [rad or m], shape (T, n) for all robots, or
                (N, T, n).
            velocity: Reference velocities [rad/s or m/s], shape (T, n) or (N, T, n); zero if omitted.
            acceleration: Reference accelerations for the feed-forward "inverse_dynamics" [rad/s^2 or m/s^2],
                shape (T, n) or (N, T, n); zero if omitted.
            effort: Torques of joints in torque mode [N m or N], shape (T, n) or (N, T, n); zero if omitted.
            load: External torques on the joints [N m or N], shape (T, n) or (N, T, n); none if omitted.
            every: Timesteps between recorded states; only start and end if omitted.
            threads: Number of threads; the result does not depend on it.

        Returns:
            The run.

        Raises:
            InvalidValueError: naming the quantity, for a wrong shape, NaN or infinity.
        """
        steps = self._series(position, "position", None).shape[1]
        zero = np.zeros((1, steps, self.pepper.n))
        references = References.checked(
            partial(self._series, steps=steps), zero, position, velocity, acceleration, effort, load
        )
        robots = max(map(len, references[:4]))
        shape = robots, steps, self.pepper.n
        command = self._command(References(*(np.broadcast_to(x, shape) for x in references[:4])))
        return self._follow(command, references.load if load is not None else zero[:, :1], every, threads)

    def step(
        self,
        targets: ArrayLike,
        steps: int = 20,
        *,
        speed: float = 1.0,
        commands: str = "shaped",
        load: ArrayLike | None = None,
        threads: int = 1,
    ) -> NDArray[np.bool_]:
        """Move the joints toward targets, as `setAngles` does, for some timesteps.

        The command of each joint moves to its target along a cubic in time, from its present position and
        velocity, see `pepper_kin.core.simulation.target_following`; the joints follow the command.  `reset`,
        `execute` and `follow` set the commands to the joints' positions, at rest.

        Args:
            targets: Target positions [rad or m], shape (n,), or for each robot, shape (N, n); they are
                clipped to the position limits.
            steps: Number of timesteps.
            speed: Fraction of the velocity limits that commands may use, in (0, 1].
            commands: "shaped", as above; "linear": commands move evenly and arrive in the last step; or
                "held": commands are at the targets immediately.
            load: External torques on the joints, such as J^T f of a push, during all steps [N m or N], shape
                (n,) or (N, n); none if omitted.
            threads: Number of threads; the result does not depend on it.

        Returns:
            Whether each robot's state is valid and its world was solved, shape (N,); other robots keep their
            last good state.  `failures` tells what was not solved.

        Raises:
            InvalidValueError: naming the quantity, for a wrong shape, NaN or infinity; or for robots with
                torque mode or inverse-dynamics feed-forward, which need `follow`.
        """
        n = self.pepper.n
        if self._torque_mode.any() or self.feedforward == "inverse_dynamics":
            allowed = "no torque mode, feed-forward 'gravity' or 'none'; or `follow`"
            raise InvalidValueError("robots", "of another kind", allowed)
        latest = self._late.max() * self.timestep
        if latest > GREATEST_LATENCY:
            raise InvalidValueError("latency", latest, f"{GREATEST_LATENCY:g} s at most, or `follow`")
        check_whole("steps", steps, 1)
        check_whole("threads", threads, 1)
        kind = COMMANDS.index(check_choice("commands", commands, COMMANDS))
        goal = np.broadcast_to(self._states(targets, "targets", self.count), (self.count, n))
        goal = np.clip(goal, self.pepper.lower_limits, self.pepper.upper_limits)
        outer = None if load is None else self._states(load, "load", self.count)
        share = checked_share("speed", speed)
        if not self._shaped:
            self._simulator.fill(self._q)
            self._shaped = True
        limits = np.stack([share * self.pepper.velocity_limits, self.pepper.acceleration_limits])
        limits = np.where(np.isfinite(limits) & (limits > 0), limits, FASTEST)
        state, count = (self._q, self._v, goal, outer), steps * self.substeps
        self._q, self._v, self._torque, good = self._simulator.go_to(
            state, Sending(kind, limits), count, threads, self._world
        )
        return np.asarray(good == count)

    def _follow(
        self,
        command: Command,
        load: Array,
        every: int | None,
        threads: int,
        progress: Callable[[int, int], object] = lambda done, total: None,
    ) -> BatchRun:
        """Follow commands from the present states of the robots, and return the run.

        Args:
            command: Commands of each timestep, shape (N, T, n), or (1, T, n) for all robots.
            load: External torques on the joints [N m or N], shape (N, T, n), (1, T, n) or (1, 1, n).
            every: Timesteps between recorded states; only start and end if None.
            threads: Number of threads.
            progress: Function called with the approximate number of finished robots and N.
        """
        steps, k = command.position.shape[1], self.substeps
        between = recorded_steps(steps, every)
        check_whole("threads", threads)
        if self._world is not None or (self._late != self._delay.ticks).any():
            raise InvalidValueError("robots", "with a world, or latencies of their own", "`step` for these")
        self._shaped = False
        due = self._delay.through(command)
        if not due.feedforward.any():
            due = due._replace(feedforward=np.zeros((1, 1, self.pepper.n)))
        if k > 1:
            no_feedforward = due.feedforward.shape[1] == 1
            full = due._replace(feedforward=np.zeros_like(due.position)) if no_feedforward else due
            fine = full.refined(k, self.timestep / k)
            due = fine._replace(feedforward=due.feedforward) if no_feedforward else fine
            load = load if load.shape[1] == 1 else np.repeat(load, k, axis=1)
        start = (self._q, self._v)
        inputs = Inputs(due.position, due.velocity, due.feedforward, load)
        rollout = self._simulator.run(
            *start, inputs, steps * k, every=between * k, threads=threads, progress=progress
        )
        rollout.torque[:, 0] = self._torque
        self._q, self._v, self._torque = rollout.last_position, rollout.last_velocity, rollout.last_torque
        return self._run(command, rollout, start, steps, between)

    def _run(
        self, command: Command, rollout: Rollout, start: tuple[Array, Array], steps: int, between: int
    ) -> BatchRun:
        """Return the recorded run, with the robots that stopped.

        Args:
            command: Commands of each timestep, shape (N, T, n) or (1, T, n).
            rollout: States and torques of the simulation.
            start: Positions [rad or m] and velocities [rad/s or m/s] at the start, shape (N, n) each.
            steps: Number of timesteps T.
            between: Timesteps between recorded states.
        """
        rows = steps // between + 1
        good = rollout.good // self.substeps
        messages = {}
        for robot in np.flatnonzero(good < steps):
            row = int(rollout.good[robot]) // (between * self.substeps) + 1
            before = (rollout.last_position[robot], rollout.last_velocity[robot])
            after = (rollout.position[robot, row], rollout.velocity[robot, row], rollout.torque[robot, row])
            step = int(good[robot]) + 1
            error = diverged(self.pepper.joint_names, step, step * self.timestep, before, after)
            messages[int(robot)] = str(error)
            for values in rollout[:3]:
                values[robot, row:] = np.nan
        places = between * np.arange(1, rows) - 1
        reference = command.position[:, places]
        begin = start[0] if len(reference) > 1 else np.broadcast_to(start[0][:1], (1, self.pepper.n))
        return BatchRun(
            joint_names=self.pepper.joint_names,
            time=self.timestep * between * np.arange(rows, dtype=float),
            position=rollout.position[:, :rows],
            velocity=rollout.velocity[:, :rows],
            torque=rollout.torque[:, :rows],
            reference_position=np.concatenate([begin[:, np.newaxis], reference], axis=1),
            final_position=rollout.last_position,
            final_velocity=rollout.last_velocity,
            good_steps=good,
            messages=messages,
        )

    def _torque_at_rest(self) -> Array:
        """Return the actuators' torques at the present states, with references equal to these states."""
        n = self._q.size
        held, torque = np.zeros((self.count, self.pepper.n)), np.empty(n)
        if self.feedforward == "gravity":
            held = self._actuators.feedforward * dynamics.gravity_torque(self.pepper, self._q)
        table = np.stack([values.ravel() for values in self._actuators])
        state = np.stack([x.ravel() for x in (self._q, self._v, self._q, self._v)])
        present_torques(table, state, held.ravel(), torque)
        return torque.reshape(self.count, self.pepper.n)

    def _command(self, references: References) -> Command:
        """Return the actuators' commands for references."""
        return references.command(self.pepper, self.feedforward, self._effort_mode)

    def _bodies(self, name: str) -> BatchWorld:
        if self._world is None:
            raise UnknownNameError("body", name, ())
        return self._world

    def _checked_world(self, world: World) -> World:
        if not isinstance(world, World) or world.pepper is not self.pepper:
            raise InvalidValueError("world", type(world).__name__, "a World of the same robot")
        return world

    def _ticks(self, latency: Any) -> NDArray[np.int64]:
        """Return the latency of each robot's commands in timesteps, shape (N,)."""
        times = as_finite(broadcast(latency, "latency", (self.count,)), "latency", (self.count,))
        if (times < 0).any():
            raise InvalidValueError("latency", times.min(), "times of at least 0 s")
        return np.round(times / self.timestep).astype(np.int64)

    def _states(self, value: ArrayLike, quantity: str, count: int) -> Array:
        """Return joint vectors of k robots, shape (k, n)."""
        array = as_joint_vectors(self.pepper, value, quantity)
        shape = (count, self.pepper.n)
        if array.shape not in (shape[1:], shape):
            raise InvalidValueError(quantity, f"shape {array.shape}", f"shape {shape[1:]} or {shape}")
        return np.broadcast_to(array, shape).copy()

    def _series(self, value: ArrayLike, quantity: str, steps: int | None) -> Array:
        """Return joint vectors for every step, shape (1, T, n) or (N, T, n)."""
        array = as_joint_vectors(self.pepper, value, quantity)
        if array.ndim == 2:
            array = array[np.newaxis]
        good = (
            array.ndim == 3 and len(array) in (1, self.count) and array.shape[1] == (steps or array.shape[1])
        )
        if not good or not array.shape[1]:
            t = "T" if steps is None else steps
            allowed = f"shape ({t}, {self.pepper.n}) or ({self.count}, {t}, {self.pepper.n})"
            raise InvalidValueError(quantity, f"shape {np.shape(value)}", allowed)
        return array
