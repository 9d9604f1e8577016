"""One step of time: semi-implicit Euler on the articulated body, with stiff servos and stops implicit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.twin.actuators import ActuatorParameters

Array = NDArray[np.float64]

GREATEST_TIMESTEP = 0.05  # [s]
_FAR = 1e12  # [rad or m] stands for infinity in a joint's range, so that 0 times it is 0
_BLOCK_ROUNDS = 4  # in which all joints' guesses are corrected at once


class Integrator:
    """Steps a robot whose joints are driven by position servos.

    Scheme, with step h, position q, velocity v, references q_r, v_r for the end of the step, feed-forward f,
    bias b(q, v) = C(q, v) v + g(q), servo gains Kp, Kd:

        v+ = v + h a,   q+ = q + h v+                     (semi-implicit, or symplectic, Euler)
        tau = Kp (q_r - q+) + Kd (v_r - v+) + f           (the servo sees the end of the step: implicit)
        M(q) a + b(q, v) = tau

    Inserted, (M + h^2 Kp + h Kd) a = Kp (q_r - q - h v) + Kd (v_r - v) + f - b: the articulated-body
    algorithm with h^2 Kp + h Kd added to the joints' inertia ("armature"), so that a step costs one pass over
    the links.

    A servo's torque is clipped at its limit.  At a position limit stands a stop, a stiff spring that only
    pushes, max(0, Ks (q+ - limit) + Ds v+), implicit in the same way; its damper Ds acts once the
    joint is beyond the limit.  Both make a joint's force a decreasing, piecewise linear function of its own
    acceleration, so that the step has exactly one solution.  Where the unclipped step exceeds a limit, that
    solution is found by block principal pivoting: guess which servos are clipped and which stops push, solve,
    correct the guess; from the fifth round on for one joint at a time, which cannot cycle.

    Order: one in h, for position and velocity.  Stability: the servo is damped for every h > 0, as in
    implicit Euler, however high its gains; M and b are taken at the start of the step, which bounds h by the
    speed of the links.  Without servo and stops, the scheme is symplectic for constant M: the energy of a
    swing oscillates by O(h) and does not drift.

    Robots with mimic joints use M = E^T M_full E, formed and solved densely.

    Source: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), I.1.2 and VI.3; Featherstone,
    Rigid Body Dynamics Algorithms (2008), table 7.1; Judice and Pires, A block principal pivoting algorithm
    for large-scale strictly monotone linear complementarity problems, Computers & Operations Research 21
    (1994).

    Args:
        pepper: The robot; its Pinocchio model is copied, not changed.
        timestep: h [s], above 0 and at most 0.05.
        actuators: The servos and stops.

    Raises:
        InvalidValueError: for a timestep out of range, or actuators of other joints.
    """

    def __init__(self, pepper: PepperModel, timestep: float, actuators: ActuatorParameters) -> None:
        import pinocchio

        self.timestep = check_positive("timestep", timestep, "s")
        if self.timestep > GREATEST_TIMESTEP:
            raise InvalidValueError("timestep", f"{timestep} s", f"a number in (0, {GREATEST_TIMESTEP}] s")
        if actuators.joint_names != pepper.joint_names:
            raise InvalidValueError(
                "joints of the actuators", ", ".join(actuators.joint_names), ", ".join(pepper.joint_names)
            )
        self._pinocchio = pinocchio
        self._model: Any = pinocchio.Model(pepper.pinocchio_model)
        self._data = self._model.createData()
        self._own_armature = np.array(self._model.armature)
        self._map = pepper.full_map if pepper.is_coupled else None
        self._offset = pepper.full_offset
        self._lower = np.maximum(pepper.lower_limits, -_FAR)
        self._upper = np.minimum(pepper.upper_limits, _FAR)
        self._kp, self._kd = np.array(actuators.stiffness), np.array(actuators.damping)
        self._ks, self._ds = np.array(actuators.stop_stiffness), np.array(actuators.stop_damping)
        self._limit = np.array(actuators.torque_limit)
        self._finite_limit = np.where(np.isfinite(self._limit), self._limit, 0.0)
        h = self.timestep
        self._inertia = h * h * self._kp + h * self._kd
        self._n = pepper.n

    def gravity_torque(self, q: Array) -> Array:
        """Return g(q) [N m or N], shape (n,)."""
        if self._map is None:
            return np.array(self._pinocchio.computeGeneralizedGravity(self._model, self._data, q))
        full = self._map @ q + self._offset
        tau = self._pinocchio.computeGeneralizedGravity(self._model, self._data, full)
        return np.asarray(tau @ self._map)

    def servo_torque(self, q: Array, v: Array, q_ref: Array, v_ref: Array, feedforward: Array) -> Array:
        """Return clip(Kp (q_ref - q) + Kd (v_ref - v) + f) [N m or N], shape (n,)."""
        tau = self._kp * (q_ref - q) + self._kd * (v_ref - v) + feedforward
        return np.clip(tau, -self._limit, self._limit)

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
            feedforward: Torque added by the servo [N m or N], shape (n,).
            load: Torque from elsewhere, not limited [N m or N], shape (n,).

        Returns:
            Position and velocity at the end of the step, and the servo's torque during it [N m or N].
        """
        h = self.timestep
        drive = self._kp * (q_ref - q - h * v) + self._kd * (v_ref - v) + feedforward
        external = drive if load is None else drive + load
        a = self._acceleration(q, v, external, self._inertia)
        tau = drive - self._inertia * a
        v_next = v + h * a
        q_next = q + h * v_next
        beyond = (q_next > self._upper) | (q_next < self._lower) | (q > self._upper) | (q < self._lower)
        if beyond.any() or (abs(tau) > self._limit).any():  # False for NaN, which the caller looks for
            return self._constrained(q, v, drive, load, a)
        return q_next, v_next, tau

    def _constrained(
        self, q: Array, v: Array, drive: Array, load: Array | None, a: Array
    ) -> tuple[Array, Array, Array]:
        """Solve the step with clipped servos and touched stops, from the acceleration without either."""
        h = self.timestep
        reach = [self._ks * (q + h * v - limit) for limit in (self._upper, self._lower)]
        inside = [q <= self._upper, q >= self._lower]
        # Push of either stop is -(base + inertia a), where that points away from the limit.
        damping = [np.where(free, 0.0, self._ds) for free in inside]
        base = [r + d * v for r, d in zip(reach, damping, strict=True)]
        inertia = [h * h * self._ks + h * d for d in damping]
        clipped, upper, lower = self._sets(drive, a, base, inertia)
        for round_ in range(_BLOCK_ROUNDS + 10 * self._n):
            extra = np.where(upper, inertia[0], 0.0) + np.where(lower, inertia[1], 0.0)
            push = -np.where(upper, base[0], 0.0) - np.where(lower, base[1], 0.0)
            force = np.where(clipped == 0, drive, clipped * self._finite_limit) + push
            extra += np.where(clipped == 0, self._inertia, 0.0)
            a = self._acceleration(q, v, force if load is None else force + load, extra)
            found = self._sets(drive, a, base, inertia)
            found[0][found[0] * clipped < 0] = 0  # from one limit to the other by way of neither
            wrong = (found[0] != clipped) | (found[1] != upper) | (found[2] != lower)
            if not wrong.any():
                break
            if round_ >= _BLOCK_ROUNDS:
                wrong[int(np.argmax(wrong)) + 1 :] = False
            for now, better in zip((clipped, upper, lower), found, strict=True):
                now[wrong] = better[wrong]
        v_next = v + h * a
        return q + h * v_next, v_next, np.clip(drive - self._inertia * a, -self._limit, self._limit)

    def _sets(
        self, drive: Array, a: Array, base: list[Array], inertia: list[Array]
    ) -> tuple[NDArray[np.int_], NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which servos are clipped (-1, 0, 1) and which upper and lower stops push, for a given a."""
        wanted = drive - self._inertia * a
        clipped = (wanted > self._limit).astype(int) - (wanted < -self._limit).astype(int)
        return clipped, base[0] + inertia[0] * a > 0.0, base[1] + inertia[1] * a < 0.0

    def _acceleration(self, q: Array, v: Array, force: Array, inertia: Array) -> Array:
        """Return a of (M + diag(inertia)) a + b = force."""
        if self._map is None:
            self._model.armature = self._own_armature + inertia
            return np.array(self._pinocchio.aba(self._model, self._data, q, v, force))
        full_q, full_v = self._map @ q + self._offset, self._map @ v
        upper = np.triu(self._pinocchio.crba(self._model, self._data, full_q))
        mass = self._map.T @ (upper + np.triu(upper, 1).T) @ self._map
        bias = self._pinocchio.nonLinearEffects(self._model, self._data, full_q, full_v) @ self._map
        mass[np.diag_indices(self._n)] += inertia
        return np.asarray(np.linalg.solve(mass, force - bias))
