"""Forward dynamics: the motion that torques cause."""

from __future__ import annotations

import numpy as np
import pinocchio
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states
from pepper_kin.model import PepperModel


def forward_dynamics(pepper: PepperModel, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> NDArray[np.float64]:
    """Return a = M(q)^-1 (tau - C(q, v) v - g(q)) by the articulated-body algorithm.

    Featherstone (2008), table 7.1; through Pinocchio.  With mimic joints M = E^T M_full E is formed and
    solved instead.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        tau: Joint torques or forces [N m or N], shape (..., n).

    Returns:
        Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    model, data = pepper.pinocchio_model, pepper.pinocchio_data
    full_map = pepper.full_map

    def one(q: NDArray[np.float64], v: NDArray[np.float64], tau: NDArray[np.float64]) -> NDArray[np.float64]:
        if not pepper.is_coupled:
            return np.asarray(pinocchio.aba(model, data, q, v, tau))
        q_full, v_full = pepper.to_full(q), pepper.rate_to_full(v)
        upper = np.triu(pinocchio.crba(model, data, q_full))
        mass = full_map.T @ (upper + np.triu(upper, 1).T) @ full_map
        bias = pinocchio.nonLinearEffects(model, data, q_full, v_full) @ full_map
        return np.asarray(np.linalg.solve(mass, tau - bias))

    return over_states(pepper, one, (pepper.n,), ("forward_dynamics",), q=q, v=v, tau=tau)
