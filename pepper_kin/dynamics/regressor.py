"""Torques as a linear function of the inertial parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states, state_data
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


def regressor(pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[np.float64]:
    """Return Y with tau = Y(q, v, a) pi, linear in the inertial parameters pi of `inertial_parameters`.

    Atkeson, An and Hollerbach, Estimation of inertial parameters of manipulator loads and links (1986);
    computed by Pinocchio.  With mimic joints Y = E^T Y_full.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        Y, shape (..., n, 10 k) for k moving bodies.

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    data = state_data(pepper, q, v, a)
    if data is not None:
        matrix: NDArray[np.float64] = pinocchio.computeJointTorqueRegressor(pepper.inner_model, data, q, v, a)
        return matrix.reshape(pepper.n, -1)  # Pinocchio drops the axis of a single joint
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64], v: NDArray[np.float64], a: NDArray[np.float64]) -> NDArray[np.float64]:
        full = pinocchio.computeJointTorqueRegressor(
            model, data, pepper.to_full(q), pepper.rate_to_full(v), pepper.rate_to_full(a)
        )
        full = full.reshape(model.nv, -1)
        return pepper.full_map.T @ full if pepper.is_coupled else np.asarray(full)

    return over_states(pepper, one, (pepper.n, 10 * (model.njoints - 1)), ("regressor",), q=q, v=v, a=a)


def inertial_parameters(pepper: PepperModel) -> NDArray[np.float64]:
    """Return the inertial parameters pi of all moving bodies, shape (10 k,).

    For each body (a joint's child with all links fixed to it, in the order of `pepper.inner_model`):
    m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz, about the origin of its joint frame and in its
    axes [kg, kg m, kg m^2].

    Args:
        pepper: The robot.
    """
    return np.concatenate([i.toDynamicParameters() for i in list(pepper.inner_model.inertias)[1:]])
