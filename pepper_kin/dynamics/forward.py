"""Forward dynamics: the accelerations caused by torques."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.core import tree_dynamics
from pepper_kin.dynamics.external_force import external_torque
from pepper_kin.dynamics.mass import solved
from pepper_kin.dynamics.tree_tables import all_states, one_state
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
    *,
    solver: str = "robot",
) -> Array:
    """Return a = M(q)^-1 (tau + sum_k J_k^T f_k - C(q, v) v - g(q)).

    M and bias are computed by composite bodies and recursive Newton-Euler, then M = L^T D L with the zeros of
    the tree (Featherstone, 2008, section 6.5); Pinocchio uses the articulated-body algorithm.  With mimic
    joints M is E^T M_full E.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        tau: Joint torques or forces [N m or N], shape (..., n).
        forces: External forces by frame, as for `external_torque`.
        solver: "robot" for the choice in its `solvers`; or "compiled", or "pinocchio" as the reference.

    Returns:
        Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, batch axes that do not broadcast, or an unknown
            solver.
        UnknownNameError: for a force at a frame that the robot lacks.
        ModelError: if M has no inverse, naming the joints that move no mass.
    """
    if forces:
        driven = as_joint_vectors(pepper, tau, "tau") + external_torque(pepper, q, forces)
        return forward_dynamics(pepper, q, v, driven, solver=solver)
    compute, shape = tree_dynamics.forward_dynamics, (pepper.n,)
    found = one_state(compute, pepper, solver, shape, q, v, tau)
    if found is not None:
        return found

    def reference(q: Array, v: Array, tau: Array) -> Array:
        model, data, full_map = pepper.inner_model, pepper.pinocchio_data, pepper.full_map
        if not pepper.is_coupled:
            a = np.asarray(pinocchio.aba(model, data, q, v, tau))
            if np.isfinite(a).all():  # otherwise a mass matrix has no inverse, which is handled below
                return a
        q_full, v_full = pepper.to_full(q), pepper.rate_to_full(v)
        upper = np.triu(pinocchio.crba(model, data, q_full))
        mass = full_map.T @ (upper + np.triu(upper, 1).T) @ full_map
        bias = pinocchio.nonLinearEffects(model, data, q_full, v_full) @ full_map
        return solved(pepper, mass, tau - bias)

    return all_states(compute, pepper, solver, shape, reference, "forward_dynamics", q=q, v=v, tau=tau)
