"""The Coriolis matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states, state_data
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


def coriolis_matrix(pepper: PepperModel, q: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
    """Return C(q, v) of tau = M(q) a + C(q, v) v + g(q), by Christoffel symbols.

    C_ij = sum_k (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) v_k / 2, so that dM/dt - 2 C is skew-symmetric;
    computed by Pinocchio.  With mimic joints C = E^T C_full E, where q_full = E q + e.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).

    Returns:
        C, shape (..., n, n) [N m s/rad; N s/m or N s between other joints].

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    data = state_data(pepper, q, v)
    if data is not None:
        matrix: NDArray[np.float64] = pinocchio.computeCoriolisMatrix(pepper.inner_model, data, q, v)
        return matrix
    model, data, full_map = pepper.inner_model, pepper.pinocchio_data, pepper.full_map

    def one(q: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        full = pinocchio.computeCoriolisMatrix(model, data, pepper.to_full(q), pepper.rate_to_full(v))
        return full_map.T @ full @ full_map if pepper.is_coupled else np.asarray(full)

    return over_states(pepper, one, (pepper.n, pepper.n), ("coriolis_matrix",), q=q, v=v)
