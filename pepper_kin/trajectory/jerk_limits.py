"""Jerk limits, one for each joint, from numbers or names."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_numbers, shown

JerkLike: TypeAlias = str | float | ArrayLike

NAMED = {"gentle": 5.0, "moderate": 10.0, "brisk": 30.0}
"""Factors on the acceleration limits [1/s]: full acceleration is reached in 0.2, 0.1 and 0.033 s."""


def jerk_limits(pepper: PepperModel, jerk: JerkLike, acceleration: Array | None = None) -> Array:
    """Return the limit of each joint [rad/s^3 or m/s^3], shape (n,).

    Args:
        pepper: The robot.
        jerk: A name of `NAMED`; a factor on the acceleration limits [1/s]; or limits, shape (n,), of which
            infinite ones do not act.
        acceleration: The acceleration limits, shape (n,); None for the robot's.

    Raises:
        UnknownNameError: listing the names.
        InvalidValueError: for what is not above zero, or has another shape.
    """
    if isinstance(jerk, str):
        if jerk not in NAMED:
            raise UnknownNameError("jerk limit", jerk, NAMED)
        jerk = NAMED[jerk]
    try:
        value = as_numbers(jerk, "jerk")
    except InvalidValueError:
        value = np.array(np.nan)
    if value.shape not in ((), (pepper.n,)) or not np.all(value > 0):
        allowed = f"a name, a factor above 0 [1/s], or {pepper.n} limits above 0"
        raise InvalidValueError("jerk", shown(jerk), allowed)
    limits = pepper.acceleration_limits if acceleration is None else acceleration
    return np.array(value if value.ndim else value * limits)
