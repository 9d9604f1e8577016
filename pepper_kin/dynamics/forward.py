"""Forward dynamics: the accelerations that torques cause."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states, state_data
from pepper_kin.core.plain_vectors import is_plain
from pepper_kin.dynamics.external_force import external_torque
from pepper_kin.dynamics.mass import solved
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors

pinocchio = lazy_module("pinocchio")


def forward_dynamics(
    pepper: PepperModel,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    forces: Mapping[str, ArrayLike] | None = None,
) -> NDArray[np.float64]:
    """Return a = M(q)^-1 (tau + sum_k J_k^T f_k - C(q, v) v - g(q)) by the articulated-body algorithm.

    Featherstone (2008), table 7.1; through Pinocchio.  With mimic joints M = E^T M_full E is formed and
    solved instead.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        tau: Joint torques or forces [N m or N], shape (..., n).
        forces: Forces from outside by frame, as `external_torque` takes them.

    Returns:
        Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
        UnknownNameError: for a force at a frame that the robot lacks.
        ModelError: where M has no inverse, naming the joints that move no mass.
    """
    if forces:
        driven = as_joint_vectors(pepper, tau, "tau") + external_torque(pepper, q, forces)
        return forward_dynamics(pepper, q, v, driven)
    data = state_data(pepper, q, v, tau)
    if data is not None:
        a: NDArray[np.float64] = pinocchio.aba(pepper.inner_model, data, q, v, tau)
        if is_plain.native(a.size, a):  # else a mass matrix has no inverse, which is looked at below
            return a
    model, data = pepper.inner_model, pepper.pinocchio_data
    full_map = pepper.full_map

    def one(q: NDArray[np.float64], v: NDArray[np.float64], tau: NDArray[np.float64]) -> NDArray[np.float64]:
        if not pepper.is_coupled:
            a = np.asarray(pinocchio.aba(model, data, q, v, tau))
            if np.isfinite(a).all():
                return a
        q_full, v_full = pepper.to_full(q), pepper.rate_to_full(v)
        upper = np.triu(pinocchio.crba(model, data, q_full))
        mass = full_map.T @ (upper + np.triu(upper, 1).T) @ full_map
        bias = pinocchio.nonLinearEffects(model, data, q_full, v_full) @ full_map
        return solved(pepper, mass, tau - bias)

    return over_states(pepper, one, (pepper.n,), ("forward_dynamics",), q=q, v=v, tau=tau)
