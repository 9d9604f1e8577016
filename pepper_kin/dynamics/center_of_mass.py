"""Center of mass of the whole robot."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch import over_states, state_data
from pepper_kin.core.fixed_mass import center_of_all
from pepper_kin.dynamics.mass import mass_of_some
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel, once_for_robot

pinocchio = lazy_module("pinocchio")


def center_of_mass(pepper: PepperModel, q: ArrayLike) -> Array:
    """Return the center of mass of all links, c = sum(m_i c_i) / sum(m_i).

    Links fixed to the floor are included (Pinocchio leaves them out: with the base fixed, Pepper's 16 kg
    base).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        c in world coordinates [m], shape (..., 3).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
        ModelError: for a robot without mass.
    """
    data = state_data(pepper, q)
    if data is not None:
        center: Array = pinocchio.centerOfMass(pepper.inner_model, data, q, False)
        _extension(pepper)(center)
        return center
    data = pepper.pinocchio_data

    def one(q: Array) -> Array:
        center: Array = pinocchio.centerOfMass(pepper.inner_model, data, pepper.to_full(q), False)
        _extension(pepper)(center)
        return center

    return over_states(pepper, one, (3,), ("center_of_mass",), q=q)


@once_for_robot
def _extension(pepper: PepperModel) -> Callable[[Array], None]:
    """Return the function that converts the moving links' center to that of all links, in place."""
    share, still = share_of_moving(pepper)
    if share > 0.0:
        return partial(center_of_all.native, share, still)
    return lambda center: np.copyto(center, still)  # no mass moves: Pinocchio's center is NaN


@once_for_robot
def share_of_moving(pepper: PepperModel) -> tuple[float, Array]:
    """Return the mass fraction of the moving links, and the contribution of fixed ones to the center [m].

    Raises:
        ModelError: for a robot without mass.
    """
    still = pepper.inner_model.inertias[0]
    part = still.mass / mass_of_some(pepper)
    return 1.0 - part, part * np.array(still.lever)


@once_for_robot
def _share(pepper: PepperModel) -> Array:
    """Return the mass fraction of the moving links as an array."""
    return np.array(share_of_moving(pepper)[0])  # an array multiplies arrays faster than a float does


def center_of_mass_jacobian(pepper: PepperModel, q: ArrayLike) -> Array:
    """Return J_c(q): the velocity of the center of mass of all links is J_c v.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        J_c in world axes [m/rad], shape (..., 3, n).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    share = _share(pepper)
    data = state_data(pepper, q)
    if data is not None:
        jacobian: Array = pinocchio.jacobianCenterOfMass(pepper.inner_model, data, q, False)
        if not share:  # no mass moves, of which Pinocchio's center is NaN
            return np.zeros((3, pepper.n))
        jacobian *= share
        return jacobian.reshape(3, pepper.n)  # Pinocchio drops the axis of a single joint
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: Array) -> Array:
        if not share:
            return np.zeros((3, pepper.n))
        moving = pinocchio.jacobianCenterOfMass(model, data, pepper.to_full(q), False)
        return np.asarray(pepper.columns_from_full(moving) * share)

    return over_states(pepper, one, (3, pepper.n), ("center_of_mass_jacobian",), q=q)
