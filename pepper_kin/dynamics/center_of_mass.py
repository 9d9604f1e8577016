"""Centre of mass of the whole robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import is_plain_state, over_states
from pepper_kin.dynamics.mass import total_mass
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel, kept_while_private

pinocchio = lazy_module("pinocchio")


def center_of_mass(pepper: PepperModel, q: ArrayLike) -> NDArray[np.float64]:
    """Return the centre of mass of all links, c = sum(m_i c_i) / sum(m_i).

    Links fixed to the floor count (Pinocchio leaves them out: with the base fixed, Pepper's 16 kg base).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        c in world coordinates [m], shape (..., 3).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    model, data = pepper.inner_model, pepper.pinocchio_data
    share, still = share_of_moving(pepper)
    if is_plain_state(pepper, q):
        center: NDArray[np.float64] = pinocchio.centerOfMass(model, data, q, False)
        center *= share
        center += still
        return center

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        moving: NDArray[np.float64] = pinocchio.centerOfMass(model, data, pepper.to_full(q), False)
        return moving * share + still

    return over_states(pepper, one, (3,), ("center_of_mass",), q=q)


@kept_while_private
def share_of_moving(pepper: PepperModel) -> tuple[float, NDArray[np.float64]]:
    """Return the moving links' share of the mass, and what those fixed to the floor add to the centre [m]."""
    still = pepper.inner_model.inertias[0]
    part = still.mass / total_mass(pepper)
    return 1.0 - part, part * np.array(still.lever)


def center_of_mass_jacobian(pepper: PepperModel, q: ArrayLike) -> NDArray[np.float64]:
    """Return J_c(q): the velocity of the centre of mass of all links is J_c v.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        J_c in world axes [m/rad], shape (..., 3, n).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    model, data = pepper.inner_model, pepper.pinocchio_data
    share, _ = share_of_moving(pepper)
    if is_plain_state(pepper, q):
        jacobian: NDArray[np.float64] = pinocchio.jacobianCenterOfMass(model, data, q, False)
        jacobian *= share
        return jacobian

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        moving = pinocchio.jacobianCenterOfMass(model, data, pepper.to_full(q), False) @ pepper.full_map
        return np.asarray(moving * share)

    return over_states(pepper, one, (3, pepper.n), ("center_of_mass_jacobian",), q=q)
