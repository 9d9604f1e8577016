"""Inverse dynamics: the torques of a motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.core import tree_dynamics
from pepper_kin.dynamics.external_force import external_torque
from pepper_kin.dynamics.tree_tables import all_states, one_state
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


def inverse_dynamics(
    pepper: PepperModel,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    forces: Mapping[str, ArrayLike] | None = None,
    *,
    solver: str = "robot",
) -> Array:
    """Return tau = M(q) a + C(q, v) v + g(q) - sum_k J_k^T f_k by the recursive Newton-Euler algorithm.

    Featherstone, Rigid Body Dynamics Algorithms (2008), table 5.1.  With mimic joints tau = E^T tau_full,
    where q_full = E q + e.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        forces: External forces by frame, as for `external_torque`.
        solver: "robot" for the choice in its `solvers`; or "compiled", or "pinocchio" as the reference.

    Returns:
        Joint torques or forces [N m or N], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, batch axes that do not broadcast, or an unknown
            solver.
        UnknownNameError: for a force at a frame that the robot lacks.
    """
    if forces:
        return inverse_dynamics(pepper, q, v, a, solver=solver) - external_torque(pepper, q, forces)
    compute, shape = tree_dynamics.inverse_dynamics, (pepper.n,)
    found = one_state(compute, pepper, solver, shape, q, v, a)
    if found is not None:
        return found

    def reference(q: Array, v: Array, a: Array) -> Array:
        rates = pepper.rate_to_full(v), pepper.rate_to_full(a)
        tau = pinocchio.rnea(pepper.inner_model, pepper.pinocchio_data, pepper.to_full(q), *rates)
        return np.asarray(tau @ pepper.full_map if pepper.is_coupled else tau)

    return all_states(compute, pepper, solver, shape, reference, "inverse_dynamics", q=q, v=v, a=a)


def gravity_torque(pepper: PepperModel, q: ArrayLike, *, solver: str = "robot") -> Array:
    """Return g(q), the torques that hold the robot still [N m or N], shape (..., n).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        solver: "robot" for the choice in its `solvers`; or "compiled", or "pinocchio" as the reference.

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity, or an unknown solver.
    """
    compute, shape = tree_dynamics.gravity_torque, (pepper.n,)
    found = one_state(compute, pepper, solver, shape, q)
    if found is not None:
        return found

    def reference(q: Array) -> Array:
        model, data = pepper.inner_model, pepper.pinocchio_data
        tau = pinocchio.computeGeneralizedGravity(model, data, pepper.to_full(q))
        return np.asarray(tau @ pepper.full_map if pepper.is_coupled else tau)

    return all_states(compute, pepper, solver, shape, reference, "gravity_torque", q=q)
