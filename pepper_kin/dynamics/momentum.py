"""Momentum of the whole robot about its center of mass."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch import over_states, state_data
from pepper_kin.core.fixed_mass import momentum_about_center_of_all
from pepper_kin.dynamics.mass import mass_of_some
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel, once_for_robot

pinocchio = lazy_module("pinocchio")


def centroidal_map(pepper: PepperModel, q: ArrayLike) -> Array:
    """Return A(q), which maps joint velocities to the momentum about the center of mass of all links.

    Orin and Goswami, Centroidal momentum matrix of a humanoid robot (2008); computed by Pinocchio, whose
    center includes only the moving links: the angular part is moved to `center_of_mass`.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        A, shape (..., 6, n): linear momentum, then angular, in world axes [kg m/rad, kg m^2/rad].

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    data = state_data(pepper, q)
    if data is not None:
        return _map(pepper, data, cast("Array", q))

    def one(q: Array) -> Array:
        return pepper.columns_from_full(_map(pepper, pepper.pinocchio_data, pepper.to_full(q)))

    return over_states(pepper, one, (6, pepper.n), ("centroidal_map",), q=q)


def _map(pepper: PepperModel, data: Any, q: Array) -> Array:
    """Return the centroidal map, shape (6, n), at positions of shape (n,)."""
    # computeCentroidalMap would not update the center of mass; any velocity will do.
    matrix: Array = pinocchio.ccrba(pepper.inner_model, data, q, q)
    matrix = matrix.reshape(6, pepper.inner_model.nv)  # Pinocchio drops the axis of a single joint
    _shift(pepper)(pepper.moving_center, matrix.ravel())
    return matrix


def centroidal_inertia(pepper: PepperModel, q: ArrayLike) -> Array:
    """Return the inertia of all links about their center of mass, with locked joints.

    Links fixed to the floor are included, as in `center_of_mass`.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        Inertia in world axes [kg m^2], shape (..., 3, 3).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
        ModelError: for a robot without mass.
    """
    model, data, still = pepper.inner_model, pepper.pinocchio_data, pepper.inner_model.inertias[0]
    moves = mass_of_some(pepper) > still.mass

    def one(q: Array) -> Array:
        if not moves:
            return np.array(still.inertia)
        pinocchio.ccrba(model, data, pepper.to_full(q), np.zeros(model.nv))
        lever = data.com[0] + data.Ig.lever
        moving = pinocchio.Inertia(data.Ig.mass, lever, np.array(data.Ig.inertia))
        return np.array((moving + still if still.mass > 0 else moving).inertia)

    return over_states(pepper, one, (3, 3), ("centroidal_inertia",), q=q)


def centroidal_momentum(pepper: PepperModel, q: ArrayLike, v: ArrayLike) -> Array:
    """Return the momentum of the robot about the center of mass of all its links, A(q) v.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).

    Returns:
        Linear momentum [kg m/s], then angular momentum [kg m^2/s], in world axes, shape (..., 6).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    data = state_data(pepper, q, v)
    if data is not None:
        return _momentum(pepper, data, cast("Array", q), cast("Array", v))

    def one(q: Array, v: Array) -> Array:
        return _momentum(pepper, pepper.pinocchio_data, pepper.to_full(q), pepper.rate_to_full(v))

    return over_states(pepper, one, (6,), ("centroidal_momentum",), q=q, v=v)


def _momentum(pepper: PepperModel, data: Any, q: Array, v: Array) -> Array:
    """Return the centroidal momentum, shape (6,), of one state; q and v have shape (n,)."""
    momentum: Array = pinocchio.computeCentroidalMomentum(pepper.inner_model, data, q, v).vector
    _shift(pepper)(pepper.moving_center, momentum)
    return momentum


@once_for_robot
def _shift(pepper: PepperModel) -> Callable[[Array, Array], None]:
    """Return the function that moves momenta to the center of all links, in place."""
    still = pepper.inner_model.inertias[0]
    part, center = still.mass / mass_of_some(pepper), np.array(still.lever)
    if part >= 1.0:  # no mass moves: Pinocchio's center is NaN
        return lambda _, momentum: momentum.fill(0.0)
    return partial(momentum_about_center_of_all.native, part, center)
