"""Derivatives of inverse and forward dynamics."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch import all_over_states, state_data
from pepper_kin.core.plain_vectors import is_finite
from pepper_kin.dynamics.forward import forward_dynamics
from pepper_kin.dynamics.mass import inverse_mass_matrix
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


class InverseDynamicsDerivatives(NamedTuple):
    """Derivatives of tau(q, v, a), each of shape (..., n, n): rows are torques.

    Attributes:
        dtau_dq: By positions [N m/rad].
        dtau_dv: By velocities [N m s/rad].
        dtau_da: By accelerations, M(q) [kg m^2].
    """

    dtau_dq: Array
    dtau_dv: Array
    dtau_da: Array


class ForwardDynamicsDerivatives(NamedTuple):
    """Derivatives of a(q, v, tau), each of shape (..., n, n): rows are accelerations.

    Attributes:
        da_dq: By positions [1/s^2].
        da_dv: By velocities [1/s].
        da_dtau: By torques, M(q)^-1 [1/(kg m^2)].
    """

    da_dq: Array
    da_dv: Array
    da_dtau: Array


def inverse_dynamics_derivatives(
    pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike
) -> InverseDynamicsDerivatives:
    """Return the derivatives of tau = M(q) a + C(q, v) v + g(q).

    Carpentier and Mansard, Analytical derivatives of rigid body dynamics algorithms (2018); through
    Pinocchio.  With mimic joints each is E^T A_full E.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        dtau_dq, dtau_dv and dtau_da, each of shape (..., n, n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    data = state_data(pepper, q, v, a)
    if data is not None:
        return _of_torques(pepper, data, cast("Array", q), cast("Array", v), cast("Array", a))
    full_map, n = pepper.full_map, pepper.n

    def one(q: Array, v: Array, a: Array) -> tuple[Array, ...]:
        rates = pepper.rate_to_full(v), pepper.rate_to_full(a)
        full = _of_torques(pepper, pepper.pinocchio_data, pepper.to_full(q), *rates)
        return tuple(full_map.T @ block @ full_map for block in full) if pepper.is_coupled else full

    found = all_over_states(pepper, one, ((n, n),) * 3, ("inverse_dynamics_derivatives",), q=q, v=v, a=a)
    return InverseDynamicsDerivatives(*found)


def _of_torques(pepper: PepperModel, data: Any, q: Array, v: Array, a: Array) -> InverseDynamicsDerivatives:
    """Return the derivatives, shape (n, n) each, at one state; q, v and a have shape (n,)."""
    by_q, by_v, by_a = pinocchio.computeRNEADerivatives(pepper.inner_model, data, q, v, a)
    return InverseDynamicsDerivatives(by_q.copy(), by_v.copy(), by_a.copy())


def forward_dynamics_derivatives(
    pepper: PepperModel, q: ArrayLike, v: ArrayLike, tau: ArrayLike
) -> ForwardDynamicsDerivatives:
    """Return the derivatives of a = M(q)^-1 (tau - C(q, v) v - g(q)).

    da/dq = -M^-1 dtau/dq and da/dv = -M^-1 dtau/dv, where the derivatives of inverse dynamics are taken at
    the acceleration a; da/dtau = M^-1 (Carpentier and Mansard, 2018).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        tau: Joint torques or forces [N m or N], shape (..., n).

    Returns:
        da_dq, da_dv and da_dtau, each of shape (..., n, n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
        ModelError: naming joints that move no mass.
    """
    data = state_data(pepper, q, v, tau)
    if data is not None:
        found = _of_accelerations(pepper, data, cast("Array", q), cast("Array", v), cast("Array", tau))
        if is_finite.native(found.da_dq):  # else a mass matrix has no inverse, which is looked at below
            return found
    n = pepper.n

    def one(q: Array, v: Array, tau: Array) -> ForwardDynamicsDerivatives:
        if not pepper.is_coupled:
            found = _of_accelerations(pepper, pepper.pinocchio_data, q, v, tau)
            if np.isfinite(found.da_dq).all():
                return found
        inverse = inverse_mass_matrix(pepper, q)
        by = inverse_dynamics_derivatives(pepper, q, v, forward_dynamics(pepper, q, v, tau))
        return ForwardDynamicsDerivatives(-inverse @ by.dtau_dq, -inverse @ by.dtau_dv, inverse)

    return ForwardDynamicsDerivatives(
        *all_over_states(pepper, one, ((n, n),) * 3, ("forward_dynamics_derivatives",), q=q, v=v, tau=tau)
    )


def _of_accelerations(
    pepper: PepperModel, data: Any, q: Array, v: Array, tau: Array
) -> ForwardDynamicsDerivatives:
    """Return the derivatives, shape (n, n) each, at one state; q, v and tau have shape (n,)."""
    by_q, by_v, by_tau = pinocchio.computeABADerivatives(pepper.inner_model, data, q, v, tau)
    return ForwardDynamicsDerivatives(by_q.copy(), by_v.copy(), by_tau.copy())
