"""The zero-moment point."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.dynamics.base_wrench import base_wrench
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.model import PepperModel


def zero_moment_point(pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[np.float64]:
    """Return the zero-moment point: the point of the floor where the floor's wrench has no horizontal moment.

    With (f, n) the wrench of the floor about the world's origin, zmp = (-n_y, n_x) / f_z.
    Vukobratovic and Borovac, Zero-moment point (2004).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        x and y on the floor [m], shape (..., 2).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
        InfeasibleError: if the floor would have to pull (f_z <= 0): there is no such point.
    """
    wrench = base_wrench(pepper, q, v, a)
    vertical = wrench[..., 2]
    if np.any(vertical <= 0):
        pull = f"the floor would have to pull with {-vertical.min():.4g} N"
        raise InfeasibleError("zero-moment point", pull, "slow the motion down")
    return np.stack([-wrench[..., 4], wrench[..., 3]], axis=-1) / vertical[..., None]
