"""Mechanical energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states, state_data
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


def kinetic_energy(pepper: PepperModel, q: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
    """Return v^T M(q) v / 2 [J], shape (...).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    data = state_data(pepper, q, v)
    if data is not None:
        return np.array(pinocchio.computeKineticEnergy(pepper.inner_model, data, q, v))
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        energy = pinocchio.computeKineticEnergy(model, data, pepper.to_full(q), pepper.rate_to_full(v))
        return np.array(energy)

    return over_states(pepper, one, (), ("kinetic_energy",), q=q, v=v)


def potential_energy(pepper: PepperModel, q: ArrayLike) -> NDArray[np.float64]:
    """Return -sum(m_i g . c_i) over the moving links [J], shape (...); zero where their centre is at z = 0.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    data = state_data(pepper, q)
    if data is not None:
        return np.array(pinocchio.computePotentialEnergy(pepper.inner_model, data, q))
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array(pinocchio.computePotentialEnergy(model, data, pepper.to_full(q)))

    return over_states(pepper, one, (), ("potential_energy",), q=q)
