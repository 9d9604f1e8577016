"""The twin: a robot with actuators under gravity that executes trajectories."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors, check_choice, check_within_limits
from pepper_kin.trajectory.trajectory import Trajectory
from pepper_kin.twin.actuator_data import actuator_parameters
from pepper_kin.twin.actuators import TORQUE, ActuatorParameters
from pepper_kin.twin.command import Command, Delay
from pepper_kin.twin.contact_error import ContactError
from pepper_kin.twin.coupling import Coupling
from pepper_kin.twin.hooks import SensorsHook, WorldHook, due_time, readings_since
from pepper_kin.twin.integrator import Integrator, Series, nothing_done
from pepper_kin.twin.push import Push
from pepper_kin.twin.real_time import Commander, Timing, serve
from pepper_kin.twin.reference import sampled
from pepper_kin.twin.run import COMPLETED, STOPPED, Run
from pepper_kin.twin.state import TwinState, diverged

Array = NDArray[np.float64]

FEEDFORWARDS = ("none", "gravity", "inverse_dynamics")


class Twin:
    """A simulated robot: its links under gravity, each joint driven by an actuator with limited torque.

    See `pepper_kin.twin.Integrator` for the scheme, its order and its stability.

    Args:
        pepper: The robot.
        timestep: Time of one step [s], above 0 and at most 0.05.
        feedforward: What the servos add to their feedback: "none"; "gravity", the torque that holds the
            present posture; or "inverse_dynamics", the torque that the reference motion needs.
        actuators: Actuators and stops; `actuator_parameters(pepper)` if omitted.
        world: What the robot may touch; asked for its load in every step.
        sensors: Shown every state; what a `SensorSuite` reads is in `run.readings`.
        substeps: Number of integrator steps in a timestep; in between, the reference is taken to move with
            its velocity.
        compiled: Step by machine code, which is made once on a machine (some seconds) and then read from
            disk; otherwise by Pinocchio from Python, some hundred times slower and ready at once.  The states
            agree to 1e-9.

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
        compiled: bool = True,
    ) -> None:
        self.pepper = pepper
        self.feedforward = check_choice("feedforward", feedforward, FEEDFORWARDS)
        self.actuators = actuators if actuators is not None else actuator_parameters(pepper)
        self.world, self.sensors = world, sensors
        self.substeps = whole_number("substeps", substeps)
        Integrator(pepper, timestep, self.actuators)  # refuses what is wrong by the names given here
        self._timestep = float(timestep)
        self.compiled = bool(compiled)
        self._coupling = Coupling(
            pepper,
            self._timestep,
            self.actuators,
            gravity=feedforward == "gravity",
            substeps=self.substeps,
            compiled=self.compiled,
        )
        self._integrator = self._coupling.integrator
        self._torque_mode = self.actuators.in_mode(TORQUE)
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
        return TwinState(self._step * self.timestep, self._q, self._v, self._torque, self._a)

    @property
    def pushes(self) -> tuple[Push, ...]:
        """Pushes, past and to come."""
        return self._pushes

    def reset(self, q: ArrayLike | None = None, v: ArrayLike | None = None) -> TwinState:
        """Put the twin somewhere and set its clock to zero; pushes stay.

        What lies in a world stays where it lies, for `execute` resets too: see `twin.world.reset()`.

        Args:
            q: Position [rad or m], shape (n,); the neutral posture (Stand) if omitted.
            v: Velocity [rad/s or m/s], shape (n,); rest if omitted.

        Returns:
            The state.

        Raises:
            InvalidValueError: for a wrong length, NaN or infinity.
            LimitError: for a position outside the limits.
        """
        position = self.pepper.neutral() if q is None else self._vector(q, "q")
        velocity = np.zeros(self.pepper.n) if v is None else self._vector(v, "v")
        check_within_limits(self.pepper, position, "q", 1e-6)
        self._q, self._v, self._step = position.copy(), velocity.copy(), 0
        self._a = np.zeros(self.pepper.n)
        rest = np.zeros(self.pepper.n)
        given = self._given(position, rest, rest, rest)
        self._delay.fill(Command(position, rest, given))
        held = self._integrator.gravity_torque(self._q) if self.feedforward == "gravity" else 0 * self._q
        held = np.where(self._torque_mode, 0.0, held)
        self._torque = self._integrator.servo_torque(self._q, self._v, self._q, self._v, held)
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
        """Let a force act on the robot for some time.

        Args:
            frame: Frame that it acts on.
            force: In world axes [N], shape (3,).
            point: Where, in the frame's axes [m], shape (3,); its origin if omitted.
            start: When it begins on the twin's clock [s], which `reset` sets to zero, and `execute` too
                unless it goes on from the present; now if omitted.
            duration: How long it lasts [s]; infinity for ever.

        Returns:
            The push, also in `pushes`.

        Raises:
            UnknownNameError: for a frame that the robot lacks.
            InvalidValueError: naming the quantity that is wrong.
        """
        begin = self._step * self.timestep if start is None else start
        added = Push.checked(self.pepper, frame, force, point, begin, duration)
        self._pushes = (*self._pushes, added)
        return added

    def clear_pushes(self) -> None:
        """Forget all pushes."""
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
            position: Position wanted at the end of the step [rad or m], shape (n,).
            velocity: Velocity wanted then [rad/s or m/s], shape (n,); zero if omitted.
            acceleration: Used by the feed-forward "inverse_dynamics" only, zero if omitted, shape (n,).
            effort: Torque of the joints in torque mode [N m or N], shape (n,); zero if omitted.
            load: Torque on the joints from elsewhere [N m or N], shape (n,); none if omitted.

        Returns:
            The new state.

        Raises:
            InvalidValueError: for a wrong length, NaN or infinity.
            DivergedError: where the new state is not finite, naming joint, step and cause; the state stays.
            ContactError: where the world cannot do its step; the state stays.
        """
        q_ref = self._vector(position, "position")
        v_ref, a_ref, torque, outer = (
            np.zeros(self.pepper.n) if value is None else self._vector(value, name)
            for value, name in (
                (velocity, "velocity"),
                (acceleration, "acceleration"),
                (effort, "effort"),
                (load, "load"),
            )
        )
        command = Command(q_ref, v_ref, self._given(q_ref, v_ref, a_ref, torque))
        before = (self._q, self._v)
        series, failed = self._advance(command.as_rows(), outer[np.newaxis])
        if failed is not None:
            raise failed
        if series.good < 1:
            after = (series.position[0], series.velocity[0], series.torque[0])
            step = self._step + 1
            wanted = self._integrator.wanted_torque(self._q, *command)
            raise diverged(self.pepper.joint_names, step, step * self.timestep, before, after, wanted)
        return self.state

    def execute(self, trajectory: Trajectory, settle: float = 0.0, *, from_present: bool = False) -> Run:
        """Follow a trajectory.

        Args:
            trajectory: What to follow; its joints must be the robot's.
            settle: Time to hold the end afterwards [s].
            from_present: Start where the twin is; otherwise it is first put at the trajectory's start, with
                its velocity.

        Returns:
            The run; where the state diverged, or the world could not do its step, its status is "stopped",
            its message names step, joint or contact, and cause, and it holds everything up to there.

        Raises:
            InvalidValueError: for other joints, or a settle time that is not a finite number of at least 0.
            LimitError: where the trajectory starts outside the position limits.
        """
        position, velocity, acceleration = sampled(
            self.pepper, trajectory, settle, self.timestep, compiled=self.compiled
        )
        if not from_present:
            self.reset(position[0], velocity[0])
        given = self._given(position, velocity, acceleration, np.zeros(self.pepper.n))
        return self._follow(Command(position, velocity, given))

    def follow(
        self,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        *,
        acceleration: ArrayLike | None = None,
        effort: ArrayLike | None = None,
        load: ArrayLike | None = None,
    ) -> Run:
        """Follow references given for every timestep, from where the twin is.

        Args:
            position: Position wanted at the end of each step [rad or m], shape (T, n).
            velocity: Velocity wanted then [rad/s or m/s], shape (T, n); zero if omitted.
            acceleration: Used by the feed-forward "inverse_dynamics" only, shape (T, n); zero if omitted.
            effort: Torque of the joints in torque mode [N m or N], shape (T, n); zero if omitted.
            load: Torque on the joints from elsewhere [N m or N], shape (T, n); none if omitted.

        Returns:
            The run, with T + 1 rows: the first is the present state.

        Raises:
            InvalidValueError: naming the quantity, for a wrong shape, NaN or infinity.
        """
        rows = len(as_finite(position, "position", (None, self.pepper.n)))
        given_by_name = {
            "position": position,
            "velocity": velocity,
            "acceleration": acceleration,
            "effort": effort,
            "load": load,
        }
        q_ref, v_ref, a_ref, torque, outer = (
            np.zeros((rows, self.pepper.n)) if x is None else as_finite(x, name, (rows, self.pepper.n))
            for name, x in given_by_name.items()
        )
        command = Command(q_ref, v_ref, self._given(q_ref, v_ref, a_ref, torque))
        first = Command(self._q, self._v, np.zeros(self.pepper.n)).as_rows()
        return self._follow(first.then(command), outer)

    def serve(self, commander: Commander, **options: Any) -> Timing:
        """Step against the wall clock, with a function that says where to go; see `real_time.serve`."""
        return serve(self, commander, **options)

    def _given(self, q: Array, v: Array, a: Array, effort: Array) -> Array:
        """Return what the actuators are told besides positions and velocities, shape (..., n)."""
        forward = np.zeros(q.shape)
        if self.feedforward == "inverse_dynamics":
            from pepper_kin import dynamics

            forward = dynamics.inverse_dynamics(self.pepper, q, v, a)
        return np.where(self._torque_mode, effort, forward) if self._torque_mode.any() else forward

    def _follow(self, command: Command, load: Array | None = None) -> Run:
        """Follow commands, of which the first stands for the present state."""
        first = self._step
        time = self.timestep * np.arange(len(command.position), dtype=float)
        start = (self._q, self._v, self._torque)
        outer = np.zeros((1, self.pepper.n)) if load is None else load
        series, failed = self._advance(command.part(slice(1, None)), outer)
        logged = [
            np.concatenate([row[np.newaxis], rows]) for row, rows in zip(start, series[:3], strict=True)
        ]
        for rows in (time, *logged):
            rows.setflags(write=False)
        count, status, message = series.good + 1, COMPLETED, ""
        if count < len(time):
            step = first + count
            status, at = STOPPED, step * self.timestep
            if failed is not None:
                message = f"twin stopped at step {step} ({at:.6g} s): {failed}"
            else:
                before = (logged[0][count - 1], logged[1][count - 1])
                after = (logged[0][count], logged[1][count], logged[2][count])
                wanted = self._integrator.wanted_torque(self._q, *command.row(count))
                message = str(diverged(self.pepper.joint_names, step, at, before, after, wanted))
            time, *logged = (rows[:count] for rows in (time, *logged))
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
        )

    def _advance(self, command: Command, load: Array) -> tuple[Series, ContactError | None]:
        """Advance by one timestep for each command, in pieces where someone else has a say in each.

        Returns:
            What came of it, and why the world stopped, if it did.
        """
        due = self._delay.through(command)
        total, done = len(due.position), 0
        parts: list[Series] = []
        while done < total:
            part = slice(done, done + max(self._steps_alone(total - done), 1))
            outer = load if len(load) == 1 else load[part]
            try:
                series = self._piece(due.part(part), outer)
            except ContactError as error:
                return self._joined(parts, done), error
            good = series.good
            parts.append(series)
            self._take(series, good)
            done += good
            if good < len(series.position):
                break
        return self._joined(parts, done), None

    def _joined(self, parts: list[Series], good: int) -> Series:
        """Return series that follow one another as one."""
        if len(parts) == 1:
            return parts[0]
        parts = [nothing_done(self.pepper.n), *parts]
        return Series(
            np.concatenate([part.position for part in parts]),
            np.concatenate([part.velocity for part in parts]),
            np.concatenate([part.torque for part in parts]),
            good,
        )

    def _piece(self, command: Command, load: Array) -> Series:
        """Return what follows from the present state, at least one step and as many as can be had at once."""
        alone = self._steps_alone(len(command.position))
        if self.world is None and alone:
            return self._coupling.quiet(self._q, self._v, command, load)
        if self.world is not None and alone:
            series = self._coupling.march(self._q, self._v, command, load, self.world)
            if len(series.position):
                return series
        time, now = self._step * self.timestep, command.part(slice(0, 1))
        return self._coupling.step(
            self._q, self._v, now, load[0], time=time, pushes=self._pushes, world=self.world
        )

    def _steps_alone(self, most: int) -> int:
        """Return how many steps no push has a say in, nor sensors that look at a world; 0 for none."""
        now, h = self._step * self.timestep, self.timestep
        if any(push.acts_within(now, now + h) for push in self._pushes):
            return 0
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
        """Make the last good state the present one, and show all of them to the sensors."""
        if not good:
            return
        before = self._v if good == 1 else series.velocity[good - 2]
        if self.sensors is not None:
            self._show(series, good - 1)
        self._q, self._v = series.position[good - 1].copy(), series.velocity[good - 1].copy()
        self._torque = series.torque[good - 1].copy()
        self._a = (self._v - before) / self.timestep
        self._step += good
        if self.sensors is not None and self._step * self.timestep >= due_time(self.sensors, -math.inf):
            self.sensors.observe(self.state)

    def _show(self, series: Series, count: int) -> None:
        """Show the sensors the first states of a series."""
        due = due_time(self.sensors, -math.inf)
        for k in range(count):
            time = (self._step + k + 1) * self.timestep
            if time < due:
                continue
            before = series.velocity[k - 1] if k else self._v
            velocity = series.velocity[k]
            acceleration = (velocity - before) / self.timestep
            state = TwinState(time, series.position[k], velocity, series.torque[k], acceleration)
            self.sensors.observe(state)  # type: ignore[union-attr]
            due = due_time(self.sensors, -math.inf)

    def _vector(self, value: ArrayLike, quantity: str) -> Array:
        array = as_joint_vectors(self.pepper, value, quantity)
        if array.ndim != 1:
            raise InvalidValueError(quantity, f"shape {array.shape}", f"shape ({self.pepper.n},)")
        return array


def whole_number(quantity: str, value: int) -> int:
    """Return a number if it is an integer of at least 1.

    Raises:
        InvalidValueError: otherwise.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise InvalidValueError(quantity, repr(value), "an integer of at least 1")
    return int(value)
