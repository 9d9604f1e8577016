"""The twin: a robot with servos under gravity that executes trajectories."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError, PepperKinError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors, check_choice, check_within_limits
from pepper_kin.model.shapes import read_only
from pepper_kin.trajectory.trajectory import Trajectory
from pepper_kin.twin.actuators import ActuatorParameters, actuator_parameters
from pepper_kin.twin.integrator import Integrator
from pepper_kin.twin.run import COMPLETED, STOPPED, Run

Array = NDArray[np.float64]

FEEDFORWARDS = ("none", "gravity", "inverse_dynamics")
_RUNAWAY = 1e4  # [rad/s or m/s] no joint gets this fast but by a divergence


class DivergedError(PepperKinError):
    """A step of the twin gave a state that is not finite, or absurd.

    Attributes:
        joint: The joint to blame.
        step: Number of the step, from 1.
        time: When [s].
        cause: What was found.
    """

    def __init__(self, joint: str, step: int, time: float, cause: str) -> None:
        self.joint, self.step, self.time, self.cause = joint, step, time, cause
        super().__init__(f"twin stopped at step {step} ({time:.6g} s): {joint}: {cause}")


@dataclass(frozen=True, eq=False)
class TwinState:
    """State of the twin; arrays are read-only.

    Attributes:
        time: Since the last reset [s].
        position: [rad or m], shape (n,).
        velocity: [rad/s or m/s], shape (n,).
        torque: Of the servos during the last step [N m or N], shape (n,).
    """

    time: float
    position: Array
    velocity: Array
    torque: Array

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "torque"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


class Twin:
    """A simulated robot: its links under gravity, each joint driven by a position servo with limited torque.

    See `pepper_kin.twin.Integrator` for the scheme, its order and its stability.

    Args:
        pepper: The robot.
        timestep: Time of one step [s], above 0 and at most 0.05.
        feedforward: What the servos add to their feedback: "none"; "gravity", the torque that holds the
            present posture; or "inverse_dynamics", the torque that the reference motion needs.
        actuators: Servos and stops; `actuator_parameters(pepper)` if omitted.

    Raises:
        InvalidValueError: for a timestep out of range, an unknown feed-forward, or actuators of other joints.
    """

    def __init__(
        self,
        pepper: PepperModel,
        timestep: float = 0.001,
        *,
        feedforward: str = "gravity",
        actuators: ActuatorParameters | None = None,
    ) -> None:
        self.pepper = pepper
        self.feedforward = check_choice("feedforward", feedforward, FEEDFORWARDS)
        self.actuators = actuators if actuators is not None else actuator_parameters(pepper)
        self._integrator = Integrator(pepper, timestep, self.actuators)
        self._step = 0
        self._q, self._v = pepper.neutral(), np.zeros(pepper.n)
        self._torque = np.zeros(pepper.n)
        self.reset()

    @property
    def timestep(self) -> float:
        """Time of one step [s]."""
        return self._integrator.timestep

    @property
    def state(self) -> TwinState:
        """The present state."""
        return TwinState(self._step * self.timestep, self._q, self._v, self._torque)

    def reset(self, q: ArrayLike | None = None, v: ArrayLike | None = None) -> TwinState:
        """Put the twin somewhere and set its clock to zero.

        Args:
            q: Position [rad or m], shape (n,); the neutral posture (Stand) if omitted.
            v: Velocity [rad/s or m/s], shape (n,); rest if omitted.

        Returns:
            The state.

        Raises:
            InvalidValueError: for a wrong length, NaN or infinity.
            LimitError: for a position outside the limits.
        """
        position = self.pepper.neutral() if q is None else _vector(self.pepper, q, "q")
        velocity = np.zeros(self.pepper.n) if v is None else _vector(self.pepper, v, "v")
        check_within_limits(self.pepper, position, "q", 1e-6)
        self._q, self._v, self._step = position.copy(), velocity.copy(), 0
        held = self._integrator.gravity_torque(self._q) if self.feedforward == "gravity" else 0 * self._q
        self._torque = self._integrator.servo_torque(self._q, self._v, self._q, self._v, held)
        return self.state

    def step(
        self,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        *,
        acceleration: ArrayLike | None = None,
        load: ArrayLike | None = None,
    ) -> TwinState:
        """Advance by one timestep towards a reference.

        Args:
            position: Position wanted at the end of the step [rad or m], shape (n,).
            velocity: Velocity wanted then [rad/s or m/s], shape (n,); zero if omitted.
            acceleration: Used by the feed-forward "inverse_dynamics" only, zero if omitted, shape (n,).
            load: Torque on the joints from elsewhere [N m or N], shape (n,); none if omitted.

        Returns:
            The new state.

        Raises:
            InvalidValueError: for a wrong length, NaN or infinity.
            DivergedError: where the new state is not finite, naming joint, step and cause; the state stays.
        """
        zero = np.zeros(self.pepper.n)
        q_ref = _vector(self.pepper, position, "position")
        v_ref = zero if velocity is None else _vector(self.pepper, velocity, "velocity")
        a_ref = zero if acceleration is None else _vector(self.pepper, acceleration, "acceleration")
        push = None if load is None else _vector(self.pepper, load, "load")
        given = self._reference_torque(q_ref, v_ref, a_ref)
        self._advance(q_ref, v_ref, given, push)
        return self.state

    def execute(self, trajectory: Trajectory, settle: float = 0.0, *, from_present: bool = False) -> Run:
        """Follow a trajectory.

        Args:
            trajectory: What to follow; its joints must be the robot's.
            settle: Time to hold the end afterwards [s].
            from_present: Start where the twin is; otherwise it is first put at the trajectory's start, with
                its velocity.

        Returns:
            The run; where the state diverged its status is "stopped", its message names joint, step and
            cause, and it holds everything up to there.

        Raises:
            InvalidValueError: for other joints, or a settle time that is not a finite number of at least 0.
            LimitError: where the trajectory starts outside the position limits.
        """
        if trajectory.joint_names != self.pepper.joint_names:
            raise InvalidValueError(
                "joints of the trajectory",
                ", ".join(trajectory.joint_names),
                ", ".join(self.pepper.joint_names),
            )
        if not (np.isfinite(settle) and settle >= 0):
            raise InvalidValueError("settle", settle, "a finite time of at least 0 s")
        if not from_present:
            start = trajectory(0.0)
            self.reset(start.position, start.velocity)
        steps = int(np.ceil((trajectory.duration + settle) / self.timestep - 1e-9))
        time: Array = self.timestep * np.arange(steps + 1, dtype=float)
        reference = trajectory(np.minimum(time, trajectory.duration))
        after = time > trajectory.duration
        reference.velocity[after], reference.acceleration[after] = 0.0, 0.0
        given = self._reference_torque(*reference)
        return self._follow(time, reference.position, reference.velocity, given)

    def _reference_torque(self, q: Array, v: Array, a: Array) -> Array:
        """Return the feed-forward that depends on the reference alone, shape (..., n)."""
        if self.feedforward != "inverse_dynamics":
            return np.zeros_like(q)
        from pepper_kin import dynamics

        return dynamics.inverse_dynamics(self.pepper, q, v, a)

    def _follow(self, time: Array, q_ref: Array, v_ref: Array, given: Array) -> Run:
        position, velocity, torque = (np.empty_like(q_ref) for _ in range(3))
        position[0], velocity[0], torque[0] = self._q, self._v, self._torque
        count, status, message = len(time), COMPLETED, ""
        for k in range(1, len(time)):
            try:
                self._advance(q_ref[k], v_ref[k], given[k], None)
            except DivergedError as error:
                count, status, message = k, STOPPED, str(error)
                break
            position[k], velocity[k], torque[k] = self._q, self._v, self._torque
        part = slice(count)
        return Run(
            self.pepper.joint_names,
            self.pepper.joint_units,
            time[part],
            position[part],
            velocity[part],
            torque[part],
            q_ref[part],
            v_ref[part],
            self.actuators.torque_limit,
            status,
            message,
        )

    def _advance(self, q_ref: Array, v_ref: Array, given: Array, load: Array | None) -> None:
        forward = self._integrator.gravity_torque(self._q) if self.feedforward == "gravity" else given
        q, v, tau = self._integrator.step(self._q, self._v, q_ref, v_ref, forward, load)
        if not abs(v).max() < _RUNAWAY:  # also True for NaN
            raise self._diverged(q, v, tau)
        self._q, self._v, self._torque = q, v, tau
        self._step += 1

    def _diverged(self, q: Array, v: Array, tau: Array) -> DivergedError:
        bad = ~(np.isfinite(q) & np.isfinite(v) & np.isfinite(tau))
        j = int(np.argmax(bad)) if bad.any() else int(np.argmax(np.abs(v)))
        step = self._step + 1
        cause = (
            f"velocity became {v[j]:.3g} after {self._v[j]:.3g}, position {q[j]:.3g} after {self._q[j]:.3g}"
        )
        advice = "; lower the timestep, or check masses and inertias of the links it moves"
        return DivergedError(self.pepper.joint_names[j], step, step * self.timestep, cause + advice)


def _vector(pepper: PepperModel, value: ArrayLike, quantity: str) -> Array:
    array = as_joint_vectors(pepper, value, quantity)
    if array.ndim != 1:
        raise InvalidValueError(quantity, f"shape {array.shape}", f"shape ({pepper.n},)")
    return array
