"""Momentum of the whole robot about its centre of mass."""

from __future__ import annotations

import numpy as np
import pinocchio
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states
from pepper_kin.dynamics.center_of_mass import total_mass
from pepper_kin.model import PepperModel

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
    model, data = pepper.pinocchio_model, pepper.pinocchio_data
    still, mass, rest = model.inertias[0], total_mass(pepper), np.zeros(model.nv)

    def one(q: Array) -> Array:
        # computeCentroidalMap would leave the centre of mass as it was.
        matrix = np.array(pinocchio.ccrba(model, data, pepper.to_full(q), rest))
        center_moving = np.array(data.com[0])
        center_all = ((mass - still.mass) * center_moving + still.mass * still.lever) / mass
        matrix[3:] += np.cross(center_moving - center_all, matrix[:3], axisb=0, axisc=0)
        return matrix @ pepper.full_map if pepper.is_coupled else matrix

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

    def one(q: Array, v: Array) -> Array:
        return np.asarray(centroidal_map(pepper, q) @ v)

    return over_states(pepper, one, (6,), ("centroidal_momentum",), q=q, v=v)
