"""Momentum of the whole robot about its centre of mass."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import is_plain_state, over_states
from pepper_kin.dynamics.mass import total_mass
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel, kept_while_private

pinocchio = lazy_module("pinocchio")

Array = NDArray[np.float64]


def centroidal_map(pepper: PepperModel, q: ArrayLike) -> Array:
    """Return A(q), which maps joint velocities to the momentum about the centre of mass of all links.

    Orin and Goswami, Centroidal momentum matrix of a humanoid robot (2008); through Pinocchio, whose centre
    is that of the moving links only: the angular part is moved to that of `center_of_mass`.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        A, shape (..., 6, n): linear momentum, then angular, in world axes [kg m/rad, kg m^2/rad].

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    model, data = pepper.inner_model, pepper.pinocchio_data
    (part, lever), rest = _share_of_still(pepper), np.zeros(model.nv)

    def one(q: Array) -> Array:
        # computeCentroidalMap would leave the centre of mass as it was.
        matrix: Array = pinocchio.ccrba(model, data, pepper.to_full(q), rest)
        matrix[3:] += pinocchio.skew(part * (data.com[0] - lever)).dot(matrix[:3])
        return matrix @ pepper.full_map if pepper.is_coupled else matrix

    if is_plain_state(pepper, q):
        return one(cast("Array", q))
    return over_states(pepper, one, (6, pepper.n), ("centroidal_map",), q=q)


def centroidal_momentum(pepper: PepperModel, q: ArrayLike, v: ArrayLike) -> Array:
    """Return the momentum of the robot about the centre of mass of all its links, A(q) v.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).

    Returns:
        Linear momentum [kg m/s], then angular momentum [kg m^2/s], in world axes, shape (..., 6).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    model, data = pepper.inner_model, pepper.pinocchio_data
    part, lever = _share_of_still(pepper)

    def one(q: Array, v: Array) -> Array:
        found = pinocchio.computeCentroidalMomentum(model, data, pepper.to_full(q), pepper.rate_to_full(v))
        momentum: Array = found.vector
        momentum[3:] += pinocchio.skew(part * (data.com[0] - lever)).dot(momentum[:3])
        return momentum

    if is_plain_state(pepper, q, v):
        return one(cast("Array", q), cast("Array", v))

    return over_states(pepper, one, (6,), ("centroidal_momentum",), q=q, v=v)


@kept_while_private
def _share_of_still(pepper: PepperModel) -> tuple[float, Array]:
    """Return the share s of the mass that is fixed to the floor, and its centre c_0 [m].

    With c the centre of the moving mass, c minus the centre of all is s (c - c_0).
    """
    still = pepper.inner_model.inertias[0]
    return still.mass / total_mass(pepper), np.array(still.lever)
