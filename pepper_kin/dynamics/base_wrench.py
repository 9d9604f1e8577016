"""The force and moment with which the floor carries the robot."""

from __future__ import annotations

import numpy as np
import pinocchio
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states
from pepper_kin.dynamics.center_of_mass import share_of_moving
from pepper_kin.dynamics.mass import total_mass
from pepper_kin.model import PepperModel


def base_wrench(pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[np.float64]:
    """Return the wrench of the floor on the robot, about the world's origin.

    With p the linear momentum, L the angular momentum about the centre c of the moving mass, m the mass of
    all links with centre c_all, and g the gravity vector,
        f = dp/dt - m g,   n = dL/dt + c x dp/dt - c_all x m g.
    Linear in the accelerations.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        Force [N], then moment [N m], in world axes, shape (..., 6).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    model, data = pepper.pinocchio_model, pepper.pinocchio_data
    share, still = share_of_moving(pepper)
    weight = total_mass(pepper) * np.asarray(model.gravity.linear)

    def one(q: NDArray[np.float64], v: NDArray[np.float64], a: NDArray[np.float64]) -> NDArray[np.float64]:
        rate = pinocchio.computeCentroidalMomentumTimeVariation(
            model, data, pepper.to_full(q), pepper.rate_to_full(v), pepper.rate_to_full(a)
        )
        center, push = np.array(data.com[0]), rate.linear
        wrench = np.empty(6)
        wrench[:3] = push - weight
        # skew(x) y is x cross y; numpy's own takes ten times as long for single vectors
        on_all = pinocchio.skew(center * share + still) @ weight
        wrench[3:] = rate.angular + pinocchio.skew(center) @ push - on_all
        return wrench

    return over_states(pepper, one, (6,), ("base_wrench",), q=q, v=v, a=a)
