"""The twin: a robot with actuators under gravity that executes trajectories."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision import Scene, loads_of
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_finite,
    as_joint_vector,
    check_choice,
    check_whole,
    check_within_limits,
)
from pepper_kin.trajectory.trajectory import Trajectory
from pepper_kin.twin.actuator_data import actuator_parameters
from pepper_kin.twin.actuator_table import check_joints
from pepper_kin.twin.actuators import TORQUE, ActuatorParameters
from pepper_kin.twin.command import Command, Delay
from pepper_kin.twin.contact_error import ContactError
from pepper_kin.twin.hooks import SensorsHook, WorldHook, due_time, readings_since, scene_of, show_first
from pepper_kin.twin.integrator import Integrator, Series, check_timestep, joined
from pepper_kin.twin.push import Push
from pepper_kin.twin.real_time import Commander, Timing, run_real_time
from pepper_kin.twin.reference import References, sampled
from pepper_kin.twin.run import Run
from pepper_kin.twin.run_status import RunEnd, RunStatus, status_of
from pepper_kin.twin.segment import SegmentRunner
from pepper_kin.twin.state import TwinState, diverged
from pepper_kin.twin.world.ground import standing_on_ground
from pepper_kin.twin.world.world import World

LONGEST_ALONE = 30_000  # number of steps after which the interpreter runs, to handle interrupts
LONGEST_RUN = 500  # number of steps after which the interpreter runs with a world
FEEDFORWARDS = ("none", "gravity", "inverse_dynamics")


class Twin:
    """A simulated robot: its links under gravity, each joint driven by an actuator with limited torque.

    See `pepper_kin.twin.Integrator` for the scheme, its order and its stability.

    Args:
        pepper: The robot.
        timestep: Time of one step [s], above 0 and at most 0.05.
        feedforward: Torque that servos add to their feedback: "none"; "gravity", the torque that holds the
            present posture; or "inverse_dynamics", the torque that the reference motion needs.
        actuators: Actuators and stops; `actuator_parameters(pepper)` if omitted.
        world: World that the robot may touch, which computes the load of each step.  A `World` of the scene
            if omitted.
        sensors: Sensors, which observe every state; readings of a `SensorSuite` are in `run.readings`.
        substeps: Number of integrator steps in a timestep; in between, the reference moves with its velocity.
        payload: Point masses at "left", "right" or a frame by name [kg], in addition to attached objects.
        scene: Static and moving obstacles, which the robot cannot penetrate, and attached objects, whose
            masses count; the scene of a `World` if omitted.  With a `world`, only attached objects count.

    Attributes:
        world: World that the robot may touch; None for none.
        loads: Carried loads.  Feed-forward ignores them: it uses the nominal masses, as a robot's controller
            does.

    Raises:
        InvalidValueError: for a timestep out of range, an unknown feed-forward, actuators of other joints, or
            a number of substeps below 1.
    """

    def __init__(
        self,
        pepper: PepperModel,
        timestep: float = 0.001,
        *,
        feedforward: str = "gravity",
        actuators: ActuatorParameters | None = None,
        world: WorldHook | None = None,
        sensors: SensorsHook | None = None,
        substeps: int = 1,
        payload: Mapping[str, float] | None = None,
        scene: Scene | None = None,
    ) -> None:
        self.pepper = pepper
        self.feedforward = check_choice("feedforward", feedforward, FEEDFORWARDS)
        self.actuators = actuators if actuators is not None else actuator_parameters(pepper)
        self.world, self.sensors, self._own_world = world, sensors, None
        if scene is not None and scene.objects and world is None:
            self.world = self._own_world = World(pepper, standing_on_ground(pepper, scene))
        self.substeps = check_whole("substeps", substeps)
        self._timestep = check_timestep(timestep)
        check_joints(pepper, self.actuators)
        self.loads = loads_of(pepper, scene_of(world) if scene is None else scene, payload)
        self._integrator = Integrator(
            pepper,
            self._timestep / self.substeps,
            self.actuators,
            gravity=feedforward == "gravity",
            loads=self.loads,
        )
        self._runner = SegmentRunner(pepper, self._integrator, self.substeps)
        self._torque_mode = self.actuators.in_mode(TORQUE)
        self._effort_mode = self._torque_mode if self._torque_mode.any() else None
        self._rest = read_only(np.zeros(pepper.n))
        self._pushes: tuple[Push, ...] = ()
        self._step = 0
        self._q, self._v = pepper.neutral(), np.zeros(pepper.n)
        self._torque, self._a = np.zeros(pepper.n), np.zeros(pepper.n)
        self._delay = Delay(round(self.actuators.latency / self._timestep))
        self.reset()

    @property
    def timestep(self) -> float:
        """Time of one step [s]."""
        return self._timestep

    @property
    def state(self) -> TwinState:
        """The present state."""
        return TwinState.of_read_only(self._step * self._timestep, self._q, self._v, self._torque, self._a)

    @property
    def temperature(self) -> Array:
        """Temperatures of the motors, from 0 (cold) to 1, the maximum under the derated limit, shape (n,)."""
        return self._integrator.temperature

    @property
    def pushes(self) -> tuple[Push, ...]:
        """Past and future pushes."""
        return self._pushes

    def reset(self, q: ArrayLike | None = None, v: ArrayLike | None = None) -> TwinState:
        """Set the state of the twin, with cold motors, and its clock to zero; pushes are kept.

        Bodies of a given world keep their states, because `execute` resets too: see `twin.world.reset()`.
        Moving obstacles of the twin's scene return to their poses at time 0.

        Args:
            q: Position [rad or m], shape (n,); the neutral posture (Stand) if omitted.
            v: Velocity [rad/s or m/s], shape (n,); rest if omitted.

        Returns:
            The state.

        Raises:
            InvalidValueError: for a wrong length, NaN or infinity.
            LimitError: for a position outside the limits.
        """
        position = self.pepper.neutral() if q is None else as_joint_vector(self.pepper, q, "q")
        velocity = np.zeros(self.pepper.n) if v is None else as_joint_vector(self.pepper, v, "v")
        check_within_limits(self.pepper, position, "q", 1e-6)
        self._q, self._v, self._step = position.copy(), velocity.copy(), 0
        self._a = np.zeros(self.pepper.n)
        rest = np.zeros(self.pepper.n)
        self._delay.fill(self._command(References(position, rest, rest)))
        self._integrator.reset()
        if self._own_world is not None and self._own_world.scene.movers:
            self._own_world.reset()
        held = self._integrator.gravity_torque(self._q) if self.feedforward == "gravity" else 0 * self._q
        held = np.where(self._torque_mode, 0.0, held)
        self._torque = self._integrator.present_torque(self._q, self._v, self._q, self._v, held)
        self._protect()
        if self.sensors is not None:
            self.sensors.observe(self.state)
        return self.state

    def push(
        self,
        frame: str,
        force: ArrayLike,
        point: ArrayLike | None = None,
        *,
        start: float | None = None,
        duration: float = 0.1,
    ) -> Push:
        """Apply a force to the robot for some time.

        Args:
            frame: Name of the frame that it acts on.
            force: Force in world axes [N], shape (3,).
            point: Point of action in the frame's axes [m], shape (3,); the frame's origin if omitted.
            start: Start time on the twin's clock [s], which `reset` sets to zero, and `execute` too unless it
                starts from the present state; now if omitted.
            duration: Duration [s]; may be infinite.

        Returns:
            The push, also in `pushes`.

        Raises:
            UnknownNameError: for a frame that the robot lacks.
            InvalidValueError: for a wrong value, naming its quantity.
        """
        begin = self._step * self.timestep if start is None else start
        added = Push.checked(self.pepper, frame, force, point, begin, duration)
        self._pushes = (*self._pushes, added)
        return added

    def clear_pushes(self) -> None:
        """Remove all pushes."""
        self._pushes = ()

    def step(
        self,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        *,
        acceleration: ArrayLike | None = None,
        effort: ArrayLike | None = None,
        load: ArrayLike | None = None,
    ) -> TwinState:
        """Advance by one timestep towards a reference.

        Args:
            position: Reference position at the end of the step [rad or m], shape (n,).
            velocity: Reference velocity at the end of the step [rad/s or m/s], shape (n,); zero if omitted.
            acceleration: Reference acceleration for the feed-forward "inverse_dynamics" [rad/s^2 or m/s^2],
                shape (n,); zero if omitted.
            effort: Torques of joints in torque mode [N m or N], shape (n,); zero if omitted.
            load: External torques on the joints [N m or N], shape (n,); none if omitted.

        Returns:
            The new state.

        Raises:
            InvalidValueError: for a wrong length, NaN or infinity.
            DivergedError: if the new state is not finite, naming joint, step and cause; the state is
                unchanged.
            ContactError: if the world's step cannot be solved; the state is unchanged.
        """
        references = References.checked(
            partial(as_joint_vector, self.pepper), self._rest, position, velocity, acceleration, effort, load
        )
        command = self._command(references)
        before, due = (self._q, self._v), self._delay.through(command.as_rows())
        series, failed = self._segment(due, references.load[np.newaxis], self._steps_alone(1) > 0)
        if failed is not None:
            raise failed
        if series.good < 1:
            after = (series.position[0], series.velocity[0], series.torque[0])
            step = self._step + 1
            wanted = self._integrator.wanted_torque(self._q, *command)
            raise diverged(self.pepper.joint_names, step, step * self.timestep, before, after, wanted)
        self._take(series, 1)
        return self.state

    def execute(
        self,
        trajectory: Trajectory,
        hold_time: float = 0.0,
        *,
        from_present: bool = False,
        progress: Callable[[int, int], object] = lambda done, total: None,
    ) -> Run:
        """Follow a trajectory.

        Args:
            trajectory: The trajectory; its joints must be the robot's.
            hold_time: Time to hold the end afterwards [s].
            from_present: Whether the twin starts in its present state; otherwise it is first reset to the
                trajectory's start, with its velocity.
            progress: Function called with the numbers of finished and of all timesteps, at least every half
                second; an error that it raises ends the run.

        Returns:
            The run.  Its status is COMPLETED if the robot ends on its reference (see `RunStatus`) without
            contact with the twin's scene; else its message names the joint, its distance from the reference
            and the contact.  If the state diverged, or the world's step could not be solved, its status is
            STOPPED, its message names step, joint or contact, and cause, and it holds everything before the
            stop.

        Raises:
            InvalidValueError: for other joints, or a hold time that is not a finite number of at least 0.
            LimitError: if the trajectory starts outside the position limits.
        """
        references = sampled(self.pepper, trajectory, hold_time, self.timestep)
        if not from_present:
            self.reset(references.position[0], references.velocity[0])
        return self._follow(self._command(references), progress=progress)

    def follow(
        self,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        *,
        acceleration: ArrayLike | None = None,
        effort: ArrayLike | None = None,
        load: ArrayLike | None = None,
    ) -> Run:
        """Follow references with a row for every timestep, from the present state of the twin.

        Args:
            position: Reference positions at the end of each step [rad or m], shape (T, n).
            velocity: Reference velocities [rad/s or m/s], shape (T, n); zero if omitted.
            acceleration: Reference accelerations for the feed-forward "inverse_dynamics" [rad/s^2 or m/s^2],
                shape (T, n); zero if omitted.
            effort: Torques of joints in torque mode [N m or N], shape (T, n); zero if omitted.
            load: External torques on the joints [N m or N], shape (T, n); none if omitted.

        Returns:
            The run, with T + 1 rows: the first is the present state.

        Raises:
            InvalidValueError: naming the quantity, for a wrong shape, NaN or infinity.
        """
        shape = (len(as_finite(position, "position", (None, self.pepper.n))), self.pepper.n)
        references = References.checked(
            partial(as_finite, shape=shape), np.zeros(shape), position, velocity, acceleration, effort, load
        )
        first = Command(self._q, self._v, np.zeros(self.pepper.n)).as_rows()
        return self._follow(first.then(self._command(references)), references.load)

    def run_real_time(self, commander: Commander, **options: Any) -> Timing:
        """Step in time with the wall clock, with a function of target positions; see `run_real_time`."""
        return run_real_time(self, commander, **options)

    def _command(self, references: References) -> Command:
        """Return the actuators' commands for references."""
        return references.command(self.pepper, self.feedforward, self._effort_mode)

    def _follow(
        self,
        command: Command,
        load: Array | None = None,
        progress: Callable[[int, int], object] = lambda done, total: None,
    ) -> Run:
        """Follow commands, the first of which is the present state.

        Args:
            command: First command and commands of T timesteps, shape (T + 1, n) each.
            load: External torques on the joints [N m or N], shape (T, n) or (1, n); none if omitted.
            progress: Function called with the number of finished timesteps and T.
        """
        first = self._step
        time = self.timestep * np.arange(len(command.position), dtype=float)
        start = (self._q, self._v, self._torque)
        outer = np.zeros((1, self.pepper.n)) if load is None else load
        series, failed = self._advance(command.part(slice(1, None)), outer, progress)
        if series.rows is None:
            pairs = zip(start, series[:3], strict=True)
            logged = [np.concatenate([row[np.newaxis], rows]) for row, rows in pairs]
        else:
            logged = list(series.rows)
            logged[2][0] = start[2]
        if series.wrench is not None:
            logged.append(np.concatenate([np.zeros((1, 6)), series.wrench]))
        for rows in (time, *logged):
            rows.setflags(write=False)
        count, status, message = series.good + 1, RunStatus.COMPLETED, ""
        if count < len(time):
            step = first + count
            status, at = RunStatus.STOPPED, step * self.timestep
            if failed is not None:
                message = f"twin stopped at step {step} ({at:.6g} s): {failed}"
            else:
                before = (logged[0][count - 1], logged[1][count - 1])
                after = (logged[0][count], logged[1][count], logged[2][count])
                wanted = self._integrator.wanted_torque(self._q, *command.row(count))
                message = str(diverged(self.pepper.joint_names, step, at, before, after, wanted))
            time, *logged = (rows[:count] for rows in (time, *logged))
        else:
            position, velocity, _, *wrench = logged
            reference = np.where(self._torque_mode, np.nan, command.position[-1])
            end = RunEnd(time, position, velocity[-1], reference, wrench[0] if wrench else None)
            status, message = status_of(
                self.pepper, end, self.world, self.world is self._own_world, first * self.timestep
            )
        part = slice(count)
        return Run(
            self.pepper.joint_names,
            self.pepper.joint_units,
            time,
            logged[0],
            logged[1],
            logged[2],
            command.position[part],
            command.velocity[part],
            self.actuators.torque_limit,
            status,
            message,
            readings_since(self.sensors, first * self.timestep),
            logged[3] if len(logged) > 3 else np.zeros((len(time), 6)),
            self.loads,
        )

    def _advance(
        self,
        command: Command,
        load: Array,
        progress: Callable[[int, int], object] = lambda done, total: None,
    ) -> tuple[Series, ContactError | None]:
        """Advance by one timestep for each command, in segments between changes of pushes and samples.

        Args:
            command: Commands of the timesteps, shape (T, n) each.
            load: External torques on the joints [N m or N], shape (T, n) or (1, n).
            progress: Function called with the number of finished timesteps and T.

        Returns:
            The states, and the error if the world stopped.
        """
        due = self._delay.through(command)
        total, done = len(due.position), 0
        nothing = np.empty((0, self.pepper.n))
        parts = [Series(nothing, nothing, nothing, 0)] if total == 0 else []
        while done < total:
            alone = self._steps_alone(total - done)
            now, outer = due, load
            if total > 1:
                part = slice(done, done + max(alone, 1))
                now, outer = due.part(part), load if len(load) == 1 else load[part]
            series, error = self._segment(now, outer, alone > 0)
            parts.append(series)
            self._take(series, series.good)
            done += series.good
            progress(done, total)
            if error is not None and not isinstance(error, ContactError):
                try:
                    raise error
                finally:
                    del error  # it refers to this frame: states would wait for garbage collection
            if error is not None or series.good < len(series.position):
                return joined(parts, done), error
        return joined(parts, done), None

    def _segment(self, command: Command, load: Array, alone: bool) -> tuple[Series, BaseException | None]:
        """Return the states after some timesteps, and the error if the world stopped.

        Args:
            command: Commands of the timesteps, shape (T, n) each.
            load: External torques on the joints [N m or N], shape (T, n) or (1, n).
            alone: Whether no push acts.
        """
        pushes = None if alone else (self._pushes, self._step * self._timestep)
        return self._runner.run((self._q, self._v), command, load, self.world, pushes)

    def _steps_alone(self, most: int) -> int:
        """Return the number of steps before the next push or sensor sample of the world; 0 if a push acts."""
        most = min(most, LONGEST_ALONE if self.world is None else LONGEST_RUN)
        now, h = self._step * self._timestep, self._timestep
        if self._pushes and any(push.acts_within(now, now + h) for push in self._pushes):
            return 0
        if most == 1:
            return 1
        ahead = [push.start - now for push in self._pushes if push.start > now]
        count = min([most, *(max(int(time / h), 1) for time in ahead)])
        if self.world is None or self.sensors is None:
            return count
        due = max(due_time(self.sensors, now), now)
        k = max(int(min((due - now) / h, count)) - 1, 1)
        while k < count and (self._step + k) * h < due:
            k += 1
        return min(k, count)

    def _take(self, series: Series, good: int) -> None:
        """Make the last good state the present one, and pass all good states to the sensors."""
        if not good:
            return
        before = self._v if good == 1 else series.velocity[good - 2]
        if self.sensors is not None and good > 1:
            show_first(self.sensors, series, good - 1, self._v, (self._step, self._timestep))
        last = [rows[good - 1] for rows in series[:3]]
        if len(series.position) > 1:  # copies, so that the other rows can be freed
            last = [row.copy() for row in last]
        self._q, self._v, self._torque = last
        self._a = (self._v - before) / self._timestep
        self._protect()
        self._step += good
        if self.sensors is not None and self._step * self._timestep >= due_time(self.sensors, -math.inf):
            self.sensors.observe(self.state)

    def _protect(self) -> None:
        """Make the arrays of the present state read-only, since they are returned to callers."""
        for values in (self._q, self._v, self._torque, self._a):
            values.flags.writeable = False
