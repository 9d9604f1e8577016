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


class Integrator:
    """Steps a robot whose joints are driven by position servos.

    Scheme, with step h, position q, velocity v, references q_r, v_r for the end of the step, feed-forward f,
    bias b(q, v) = C(q, v) v + g(q), servo gains Kp, Kd:

        v+ = v + h a,   q+ = q + h v+                     (semi-implicit, or symplectic, Euler)
        tau = Kp (q_r - q+) + Kd (v_r - v+) + f           (the servo sees the end of the step: implicit)
        M(q) a + b(q, v) = tau

    Inserted, (M + h^2 Kp + h Kd) a = Kp (q_r - q - h v) + Kd (v_r - v) + f - b: the articulated-body algorithm
    with h^2 Kp + h Kd added to the joints' inertia ("armature"), so that a step costs one pass over the links.
    Where |tau| exceeds the torque limit, tau is the limit and its gains are zero; where q+ lies beyond a
    position limit, a stop pushes back with Ks (limit - q+) - Ds v+, implicit in the same way and never pulling
    in; the step is solved again until both sets are consistent, n times at most.

    Order: one in h, for position and velocity.  Stability: the servo is damped for every h > 0, as in implicit
    Euler, however high its gains; M and b are taken at the start of the step, which bounds h by the speed of
    the links (far above 0.05 s for Pepper's velocities).  Without servo, friction and stops, the
    scheme is symplectic for constant M: the energy of a swing oscillates by O(h) and does not drift.

    Robots with mimic joints use M = E^T M_full E, formed and solved densely.

    Source: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), I.1.2 and VI.3; Featherstone,
    Rigid Body Dynamics Algorithms (2008), table 7.1.

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
        self._lower, self._upper = np.array(pepper.lower_limits), np.array(pepper.upper_limits)
        self._kp, self._kd = np.array(actuators.stiffness), np.array(actuators.damping)
        self._ks, self._ds = np.array(actuators.stop_stiffness), np.array(actuators.stop_damping)
        self._limit = np.array(actuators.torque_limit)
        h = self.timestep
        self._inertia = h * h * self._kp + h * self._kd
        self._stop_inertia = h * h * self._ks + h * self._ds
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
        limited = abs(tau) > self._limit
        beyond = (q_next > self._upper) | (q_next < self._lower)
        if limited.any() or beyond.any():  # False for NaN, which the caller looks for
            return self._constrained(q, v, drive, load, limited, beyond, tau, q_next)
        return q_next, v_next, tau

    def _constrained(
        self,
        q: Array,
        v: Array,
        drive: Array,
        load: Array | None,
        limited: NDArray[np.bool_],
        stopped: NDArray[np.bool_],
        tau: Array,
        q_next: Array,
    ) -> tuple[Array, Array, Array]:
        """Solve the step again with saturated servos and touched stops until both sets are consistent."""
        h = self.timestep
        v_next = v
        sign = np.sign(tau)
        side = np.where(q_next > self._upper, 1.0, -1.0)  # which stop, where one is touched
        for _ in range(self._n + 1):
            inertia = np.where(limited, 0.0, self._inertia) + np.where(stopped, self._stop_inertia, 0.0)
            gap = np.where(side > 0, self._upper, self._lower) - q
            push = np.zeros_like(q)
            push[stopped] = (self._ks * (gap - h * v) - self._ds * v)[stopped]
            force = np.where(limited, sign * self._limit, drive) + push
            a = self._acceleration(q, v, force if load is None else force + load, inertia)
            v_next = v + h * a
            q_next = q + h * v_next
            wanted = drive - self._inertia * a
            tau = np.where(limited, sign * self._limit, wanted)
            pulls = stopped & ((push - self._stop_inertia * a) * side > 0.0)
            over, under = q_next > self._upper, q_next < self._lower
            new_limited, new_sign = abs(wanted) > self._limit, np.sign(wanted)
            new_stopped = (stopped & ~pulls) | over | under
            same_sign = np.array_equal(new_sign[limited], sign[limited])
            if same_sign and np.array_equal(new_limited, limited) and np.array_equal(new_stopped, stopped):
                break
            side = np.where(stopped, side, np.where(over, 1.0, -1.0))
            limited, sign, stopped = new_limited, new_sign, new_stopped
        return q_next, v_next, np.clip(tau, -self._limit, self._limit)

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
