"""Base wrench: force and moment of the floor on the robot."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch import over_states, state_data
from pepper_kin.core.fixed_mass import wrench_about_origin
from pepper_kin.dynamics.center_of_mass import share_of_moving
from pepper_kin.dynamics.mass import mass_of_some
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel, once_for_robot

pinocchio = lazy_module("pinocchio")


def base_wrench(pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
    """Return the wrench of the floor on the robot, about the world's origin.

    With p the linear momentum, L the angular momentum about the center c of the moving mass, m the mass of
    all links with center c_all, and g the gravity vector,

        f = dp/dt - m g,   n = dL/dt + c x dp/dt - c_all x m g.

    The wrench is linear in the accelerations.

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
    data = state_data(pepper, q, v, a)
    if data is not None:
        return _wrench(pepper, data, cast("Array", q), cast("Array", v), cast("Array", a))

    def one(q: Array, v: Array, a: Array) -> Array:
        rates = pepper.rate_to_full(v), pepper.rate_to_full(a)
        return _wrench(pepper, pepper.pinocchio_data, pepper.to_full(q), *rates)

    return over_states(pepper, one, (6,), ("base_wrench",), q=q, v=v, a=a)


def _wrench(pepper: PepperModel, data: Any, q: Array, v: Array, a: Array) -> Array:
    """Return force [N] and moment about the origin [N m], shape (6,), of one state; arrays of shape (n,)."""
    rate = pinocchio.computeCentroidalMomentumTimeVariation(pepper.inner_model, data, q, v, a)
    wrench: Array = rate.vector
    _balance(pepper)(pepper.moving_center, wrench)
    return wrench


@once_for_robot
def _balance(pepper: PepperModel) -> Callable[[Array, Array], None]:
    """Return the function that converts the rate of momentum to the floor's wrench, in place."""
    weight = mass_of_some(pepper) * np.array(pepper.inner_model.gravity.linear)
    share, still = share_of_moving(pepper)
    if share > 0.0:
        return partial(wrench_about_origin.native, share, still, weight)
    resting = np.concatenate([-weight, -np.cross(still, weight)])
    return lambda _, wrench: np.copyto(wrench, resting)  # no mass moves: Pinocchio's center is NaN
