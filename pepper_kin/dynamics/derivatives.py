"""Derivatives of inverse and forward dynamics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch import all_over_states
from pepper_kin.core import tree_dynamics
from pepper_kin.dynamics.forward import forward_dynamics
from pepper_kin.dynamics.mass import inverse_mass_matrix
from pepper_kin.dynamics.tree_tables import by_kernel, one_state
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


class InverseDynamicsDerivatives(NamedTuple):
    """Derivatives of tau(q, v, a), each of shape (..., n, n): rows are torques.

    Attributes:
        dtau_dq: Derivatives by positions [N m/rad].
        dtau_dv: Derivatives by velocities [N m s/rad].
        dtau_da: Derivatives by accelerations, M(q) [kg m^2].
    """

    dtau_dq: Array
    dtau_dv: Array
    dtau_da: Array


class ForwardDynamicsDerivatives(NamedTuple):
    """Derivatives of a(q, v, tau), each of shape (..., n, n): rows are accelerations.

    Attributes:
        da_dq: Derivatives by positions [1/s^2].
        da_dv: Derivatives by velocities [1/s].
        da_dtau: Derivatives by torques, M(q)^-1 [1/(kg m^2)].
    """

    da_dq: Array
    da_dv: Array
    da_dtau: Array


def inverse_dynamics_derivatives(
    pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, solver: str = "robot"
) -> InverseDynamicsDerivatives:
    """Return the derivatives of tau = M(q) a + C(q, v) v + g(q).

    Carpentier and Mansard, Analytical derivatives of rigid body dynamics algorithms (2018).  With mimic
    joints each matrix is E^T A_full E.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        solver: "robot" for the choice in its `solvers`; or "compiled", or "pinocchio" as the reference.

    Returns:
        dtau_dq, dtau_dv and dtau_da, each of shape (..., n, n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, batch axes that do not broadcast, or an unknown
            solver.
    """
    compute, n = tree_dynamics.inverse_dynamics_derivatives, pepper.n
    at_once = one_state(compute, pepper, solver, (3, n, n), q, v, a)
    if at_once is not None:
        return InverseDynamicsDerivatives(at_once[0], at_once[1], at_once[2])

    def one(q: Array, v: Array, a: Array) -> tuple[Array, ...]:
        found = one_state(compute, pepper, solver, (3, n, n), *map(np.ascontiguousarray, (q, v, a)))
        if found is not None:
            return tuple(found)
        state = pepper.to_full(q), pepper.rate_to_full(v), pepper.rate_to_full(a)
        full_map, data = pepper.full_map, pepper.pinocchio_data
        full = pinocchio.computeRNEADerivatives(pepper.inner_model, data, *state)
        return tuple(full_map.T @ by @ full_map if pepper.is_coupled else by.copy() for by in full)

    quantity = by_kernel(pepper, solver, "inverse_dynamics_derivatives")
    return InverseDynamicsDerivatives(*all_over_states(pepper, one, ((n, n),) * 3, quantity, q=q, v=v, a=a))


def forward_dynamics_derivatives(
    pepper: PepperModel, q: ArrayLike, v: ArrayLike, tau: ArrayLike, *, solver: str = "robot"
) -> ForwardDynamicsDerivatives:
    """Return the derivatives of a = M(q)^-1 (tau - C(q, v) v - g(q)).

    da/dq = -M^-1 dtau/dq and da/dv = -M^-1 dtau/dv, where the derivatives of inverse dynamics are evaluated
    at the acceleration a; da/dtau = M^-1 (Carpentier and Mansard, 2018).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        tau: Joint torques or forces [N m or N], shape (..., n).
        solver: "robot" for the choice in its `solvers`; or "compiled", or "pinocchio" as the reference.

    Returns:
        da_dq, da_dv and da_dtau, each of shape (..., n, n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, batch axes that do not broadcast, or an unknown
            solver.
        ModelError: naming joints that move no mass.
    """
    compute, n = tree_dynamics.forward_dynamics_derivatives, pepper.n
    at_once = one_state(compute, pepper, solver, (3, n, n), q, v, tau)
    if at_once is not None:
        return ForwardDynamicsDerivatives(at_once[0], at_once[1], at_once[2])

    def one(q: Array, v: Array, tau: Array) -> tuple[Array, ...]:
        found = one_state(compute, pepper, solver, (3, n, n), *map(np.ascontiguousarray, (q, v, tau)))
        if found is not None:
            return tuple(found)
        if not pepper.is_coupled:
            model, data = pepper.inner_model, pepper.pinocchio_data
            by = tuple(by.copy() for by in pinocchio.computeABADerivatives(model, data, q, v, tau))
            if np.isfinite(by[0]).all():  # otherwise a mass matrix has no inverse, which is handled below
                return by
        inverse = inverse_mass_matrix(pepper, q, solver=solver)
        a = forward_dynamics(pepper, q, v, tau, solver=solver)
        torque = inverse_dynamics_derivatives(pepper, q, v, a, solver=solver)
        return -inverse @ torque.dtau_dq, -inverse @ torque.dtau_dv, inverse

    quantity = by_kernel(pepper, solver, "forward_dynamics_derivatives")
    return ForwardDynamicsDerivatives(
        *all_over_states(pepper, one, ((n, n),) * 3, quantity, q=q, v=v, tau=tau)
    )
