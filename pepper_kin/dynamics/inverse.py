"""Inverse dynamics: the torques of a motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states, state_data
from pepper_kin.dynamics.external_force import external_torque
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


def inverse_dynamics(
    pepper: PepperModel,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    forces: Mapping[str, ArrayLike] | None = None,
) -> NDArray[np.float64]:
    """Return tau = M(q) a + C(q, v) v + g(q) - sum_k J_k^T f_k by the recursive Newton-Euler algorithm.

    Featherstone, Rigid Body Dynamics Algorithms (2008), table 5.1; through Pinocchio.  With mimic joints
    tau = E^T tau_full, where q_full = E q + e.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        forces: Forces from outside by frame, as `external_torque` takes them.

    Returns:
        Joint torques or forces [N m or N], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
        UnknownNameError: for a force at a frame that the robot lacks.
    """
    if forces:
        return inverse_dynamics(pepper, q, v, a) - external_torque(pepper, q, forces)
    data = state_data(pepper, q, v, a)
    if data is not None:
        torque: NDArray[np.float64] = pinocchio.rnea(pepper.inner_model, data, q, v, a)
        return torque
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64], v: NDArray[np.float64], a: NDArray[np.float64]) -> NDArray[np.float64]:
        tau = pinocchio.rnea(model, data, pepper.to_full(q), pepper.rate_to_full(v), pepper.rate_to_full(a))
        return tau @ pepper.full_map if pepper.is_coupled else tau

    return over_states(pepper, one, (pepper.n,), ("inverse_dynamics",), q=q, v=v, a=a)


def gravity_torque(pepper: PepperModel, q: ArrayLike) -> NDArray[np.float64]:
    """Return g(q), the torques that hold the robot still [N m or N], shape (..., n).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    data = state_data(pepper, q)
    if data is not None:
        torque: NDArray[np.float64] = pinocchio.computeGeneralizedGravity(pepper.inner_model, data, q)
        return torque
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        tau = pinocchio.computeGeneralizedGravity(model, data, pepper.to_full(q))
        return tau @ pepper.full_map if pepper.is_coupled else tau

    return over_states(pepper, one, (pepper.n,), ("gravity_torque",), q=q)
