"""One step of time: semi-implicit Euler on the articulated body, with all joint forces implicit."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.twin.actuators import ActuatorParameters
from pepper_kin.twin.joint_law import Piece, first_piece, holds_unclipped, law_table, piece_at, seen

Array = NDArray[np.float64]

GREATEST_TIMESTEP = 0.05  # [s]
RUNAWAY = 1e4  # [rad/s or m/s] no joint gets this fast but by a divergence
NEWTON_ROUNDS = 4  # after which the way to the next guess is searched for the least energy
MOST_ROUNDS = 60
HALVINGS = 50  # of the interval that is searched
SAME_FORCE = 1e-9  # [N m or N] and part of the force: agreement of law and equation of motion


class Series(NamedTuple):
    """What an engine did in some steps; where the state diverged, `good` is less than their number.

    Attributes:
        position: At the end of each step [rad or m], shape (T, n).
        velocity: [rad/s or m/s], shape (T, n).
        torque: Of the actuators during each step [N m or N], shape (T, n).
        good: Number of good steps; the row after them, if any, is the state that diverged.
    """

    position: Array
    velocity: Array
    torque: Array
    good: int


def nothing_done(n: int) -> Series:
    """Return a series of no steps."""
    return Series(np.empty((0, n)), np.empty((0, n)), np.empty((0, n)), 0)


class Forecast(NamedTuple):
    """A step, and the linear equation mass_hat a = force that it solves; see `Integrator.linearised`.

    Attributes:
        series: The step.
        mass_hat: Shape (n, n) [kg m^2, kg m or kg].
        force: Shape (n,) [N m or N].
    """

    series: Series
    mass_hat: Array
    force: Array


class Integrator:
    """Steps a robot whose joints are driven by actuators.

    Scheme, with step h, position q, velocity v, bias b(q, v) = C(q, v) v + g(q) and the force F_j(v_j+) of
    actuator, friction and stop on each joint at the end of the step (see `pepper_kin.twin.joint_law`):

        v+ = v + h a,   q+ = q + h v+                     (semi-implicit, or symplectic, Euler)
        (M(q) + J) a + b(q, v) = F(v+) + load             (J: rotors; servo, friction and stops implicit)

    On a straight piece of the law, F = c - k v+, this is (M + J + h k) a = c - k v - b + load: the
    articulated-body algorithm with J + h k added to the joints' inertia ("armature").  For a servo alone,
    h k = h^2 Kp + h Kd.

    As no F_j rises, the step minimises the strictly convex, piecewise quadratic function (w - v)^T (M + J)
    (w - v) / 2h + (b - load)^T w - sum of integrals of F_j, and so has exactly one solution.  It is found by
    Newton's method: solve on guessed pieces, look up the pieces at the solution, and again until they agree;
    mostly at once.  From the fifth round on the way to the new guess is searched exactly for the least value,
    after which the method ends in finitely many rounds.

    Order: one in h, for position and velocity.  Stability: the actuator is damped for every h > 0, as in
    implicit Euler, however high its gains; M and b are taken at the start of the step, which bounds h by the
    speed of the links.  Without servo and stops, the scheme is symplectic for constant M: the energy of a
    swing oscillates by O(h) and does not drift.

    Robots with mimic joints use M = E^T M_full E, formed and solved densely.

    Source: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), I.1.2 and VI.3; Featherstone,
    Rigid Body Dynamics Algorithms (2008), table 7.1; Sun, On piecewise quadratic Newton and trust region
    problems, Mathematical Programming 76 (1997), for the end of the rounds.

    Args:
        pepper: The robot; its Pinocchio model is copied, not changed.
        timestep: h [s], above 0 and at most 0.05.
        actuators: The actuators and stops.

    Raises:
        InvalidValueError: for a timestep out of range, or actuators of other joints.
    """

    def __init__(self, pepper: PepperModel, timestep: float, actuators: ActuatorParameters) -> None:
        import pinocchio

        self.timestep = check_timestep(timestep)
        check_joints(pepper, actuators)
        self._pinocchio = pinocchio
        self._model: Any = pinocchio.Model(pepper.pinocchio_model)
        self._data = self._model.createData()
        self._own_armature = np.array(self._model.armature)
        self._map = pepper.full_map if pepper.is_coupled else None
        self._offset = pepper.full_offset
        self._law = law_table(pepper, actuators)
        self._plain = not (self._law.coulomb.any() or self._law.line.any())
        self._n = pepper.n

    def gravity_torque(self, q: Array) -> Array:
        """Return g(q) [N m or N], shape (n,)."""
        if self._map is None:
            return np.array(self._pinocchio.computeGeneralizedGravity(self._model, self._data, q))
        full = self._map @ q + self._offset
        tau = self._pinocchio.computeGeneralizedGravity(self._model, self._data, full)
        return np.asarray(tau @ self._map)

    def servo_torque(self, q: Array, v: Array, q_ref: Array, v_ref: Array, feedforward: Array) -> Array:
        """Return the torque of the actuators at a state, instead of at the end of a step [N m or N]."""
        servo = self._servo(q, q_ref, v_ref, feedforward)
        return piece_at(self._law, 0.0, q, v, servo).torque

    def wanted_torque(self, q: Array, q_ref: Array, v_ref: Array, feedforward: Array) -> Array:
        """Return what the actuators want at the end of a step if the joints then stand still, unclipped."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self._servo(q, q_ref, v_ref, feedforward)

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

        Nothing is checked here: this is the hot path.

        Args:
            q: Position [rad or m], shape (n,).
            v: Velocity [rad/s or m/s], shape (n,).
            q_ref: Position wanted at the end of the step, shape (n,).
            v_ref: Velocity wanted at the end of the step, shape (n,).
            feedforward: Torque added by the servo; of joints in torque mode the effort [N m or N], shape
                (n,).
            load: Torque from elsewhere, not limited [N m or N], shape (n,).

        Returns:
            Position and velocity at the end of the step, and the actuators' torque during it [N m or N].
        """
        servo = self._servo(q, q_ref, v_ref, feedforward)
        w, torque, _ = self._solve(q, v, servo, load)
        return q + self.timestep * w, w, torque

    def linearised(
        self,
        q: Array,
        v: Array,
        q_ref: Array,
        v_ref: Array,
        feedforward: Array,
        load: Array | None = None,
    ) -> tuple[Array, Array]:
        """Return the step as one linear equation, mass_hat a = force.

        mass_hat = M + J + h diag(k) and force = c - k v - b + load on the pieces where the step without
        further load ends, so that its solution a is exactly that of `step`; a further load adds to the force.

        Args:
            q: Position [rad or m], shape (n,).
            v: Velocity, shape (n,).
            q_ref: Position wanted at the end of the step, shape (n,).
            v_ref: Velocity wanted at the end of the step, shape (n,).
            feedforward: As for `step`, shape (n,).
            load: Torque from elsewhere [N m or N], shape (n,).

        Returns:
            mass_hat (n, n) [kg m^2, kg m or kg], symmetric and positive definite, and force (n,) [N m or N].
        """
        _, mass_hat, force = self.forecast(q, v, q_ref, v_ref, feedforward, load)
        return mass_hat, force

    def forecast(
        self,
        q: Array,
        v: Array,
        q_ref: Array,
        v_ref: Array,
        feedforward: Array,
        load: Array | None = None,
        *,
        gravity: bool = False,
    ) -> Forecast:
        """Return a step together with its linear equation; see `step`, `linearised` and `run`."""
        if gravity:
            feedforward = feedforward + self._shares * self.gravity_torque(q)
        w, torque, piece = self._solve(q, v, self._servo(q, q_ref, v_ref, feedforward), load)
        mass, bias = self._mass(q), self._bias(q, v)
        force = piece.intercept - piece.slope * v - bias
        mass[np.diag_indices(self._n)] += self._law.rotor + self.timestep * piece.slope
        following = (q + self.timestep * w)[np.newaxis]
        series = Series(following, w[np.newaxis], torque[np.newaxis], int(_sound(w, torque)))
        return Forecast(series, mass, force if load is None else force + load)

    def run(
        self,
        q: Array,
        v: Array,
        q_ref: Array,
        v_ref: Array,
        feedforward: Array,
        load: Array,
        *,
        gravity: bool = False,
    ) -> Series:
        """Advance by one step for each row of the references.

        Args:
            q: Position [rad or m], shape (n,).
            v: Velocity, shape (n,).
            q_ref: Position wanted at the end of each step, shape (T, n).
            v_ref: Velocity wanted at the end of each step, shape (T, n).
            feedforward: As for `step`, shape (T, n).
            load: As for `step`, shape (T, n), or (1, n) for all steps.
            gravity: Whether servos add what holds the present posture.

        Returns:
            The states after each step.
        """
        position, velocity, torque = (np.empty_like(q_ref) for _ in range(3))
        for k in range(len(q_ref)):
            forward = feedforward[k]
            if gravity:
                forward = forward + self._shares * self.gravity_torque(q)
            q, v, tau = self.step(q, v, q_ref[k], v_ref[k], forward, load[min(k, len(load) - 1)])
            position[k], velocity[k], torque[k] = q, v, tau
            if not _sound(v, tau):
                return Series(position, velocity, torque, k)
        return Series(position, velocity, torque, len(q_ref))

    @property
    def _shares(self) -> Array:
        """1 where feed-forward is applied, 0 in torque mode (the strength comes later)."""
        return (self._law.feedforward > 0).astype(float)

    def _servo(self, q: Array, q_ref: Array, v_ref: Array, feedforward: Array) -> Array:
        """Return what the actuators want at the end of the step if the joints then stand still."""
        law = self._law
        return law.kp * (q_ref - seen(law, q)) + law.kd * v_ref + law.strength * feedforward

    def _solve(self, q: Array, v: Array, servo: Array, load: Array | None) -> tuple[Array, Array, Piece]:
        """Return velocity and torque at the end of the step, and the piece of the law that they lie on."""
        law, h = self._law, self.timestep
        piece = first_piece(law, h, v, servo)
        w = v
        for round_ in range(MOST_ROUNDS):
            force = piece.intercept - piece.slope * v
            a = self._acceleration(q, v, force if load is None else force + load, law.rotor + h * piece.slope)
            before, w = w, v + h * a
            if round_ == 0 and self._plain and holds_unclipped(law, h, q, w, piece.torque):
                return w, piece.torque - (h * law.kp + law.kd) * w, piece
            found = piece_at(law, h, q, w, servo)
            given, due = found.intercept - found.slope * w, piece.intercept - piece.slope * w
            if not (
                abs(given - due) > SAME_FORCE * (1.0 + abs(due))
            ).any():  # False for NaN: the caller looks
                break
            if round_ >= NEWTON_ROUNDS:
                w = before + self._least(q, v, before, w - before, servo, load) * (w - before)
                found = piece_at(law, h, q, w, servo)
            elif round_ > 0:
                found = piece_at(law, h, q, w, servo, before)
            piece = found
        return w, found.torque, found

    def _least(self, q: Array, v: Array, start: Array, way: Array, servo: Array, load: Array | None) -> float:
        """Return where on start + t way, t in [0, 1], the step's convex function is least."""
        h = self.timestep
        inertia = self._mass(q) + np.diag(self._law.rotor)
        slope = way @ (inertia @ (start - v) / h + self._bias(q, v) - (0.0 if load is None else load))
        curvature = way @ inertia @ way / h
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            t = (low + high) / 2
            w = start + t * way
            piece = piece_at(self._law, h, q, w, servo)
            falls = slope + t * curvature - way @ (piece.intercept - piece.slope * w) < 0
            low, high = (t, high) if falls else (low, t)
        return high

    def _acceleration(self, q: Array, v: Array, force: Array, inertia: Array) -> Array:
        """Return a of (M + diag(inertia)) a + b = force."""
        if self._map is None:
            self._model.armature = self._own_armature + inertia
            return np.array(self._pinocchio.aba(self._model, self._data, q, v, force))
        mass = self._mass(q)
        mass[np.diag_indices(self._n)] += inertia
        return np.asarray(np.linalg.solve(mass, force - self._bias(q, v)))

    def _mass(self, q: Array) -> Array:
        """Return M, with the rotors of the model but without those of the actuators."""
        self._model.armature = self._own_armature
        full = q if self._map is None else self._map @ q + self._offset
        upper = np.triu(self._pinocchio.crba(self._model, self._data, full))
        mass = upper + np.triu(upper, 1).T
        return mass if self._map is None else self._map.T @ mass @ self._map

    def _bias(self, q: Array, v: Array) -> Array:
        if self._map is None:
            return np.array(self._pinocchio.nonLinearEffects(self._model, self._data, q, v))
        full_q, full_v = self._map @ q + self._offset, self._map @ v
        return np.asarray(
            self._pinocchio.nonLinearEffects(self._model, self._data, full_q, full_v) @ self._map
        )


def _sound(v: Array, torque: Array) -> bool:
    """Return whether a state is neither absurd nor NaN."""
    return bool(abs(v).max() < RUNAWAY and np.isfinite(torque).all())


def check_timestep(timestep: float) -> float:
    """Return a timestep [s] if it is above 0 and at most 0.05.

    Raises:
        InvalidValueError: otherwise.
    """
    checked = check_positive("timestep", timestep, "s")
    if checked > GREATEST_TIMESTEP:
        raise InvalidValueError("timestep", f"{timestep} s", f"a number in (0, {GREATEST_TIMESTEP}] s")
    return checked


def check_joints(pepper: PepperModel, actuators: ActuatorParameters) -> None:
    """Refuse actuators of other joints.

    Raises:
        InvalidValueError: naming both.
    """
    if actuators.joint_names != pepper.joint_names:
        raise InvalidValueError(
            "joints of the actuators", ", ".join(actuators.joint_names), ", ".join(pepper.joint_names)
        )
