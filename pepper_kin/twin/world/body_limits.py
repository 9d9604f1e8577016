"""Limits of free bodies, beyond which rounding could let a body fall through a floor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite, check_positive

SIZES = (1e-6, 1e3)  # [m]
MASSES = (1e-15, 1e6)  # [kg]
LARGEST_RATIO = 1e5  # maximum ratio of two masses: a heavier body presses a light one into the floor
FARTHEST = 1e5  # [m]
FASTEST = 1e5  # [m/s and rad/s]
ROUGHEST = 100.0  # coefficient of friction


def check_size(quantity: str, value: float, share: float = 1.0) -> float:
    """Return a length [m] if it is a number from 1e-6 to 1e3; for a radius, `share` is one half.

    Raises:
        InvalidValueError: otherwise, as all functions here.
    """
    return _between(quantity, value, (share * SIZES[0], share * SIZES[1]), "m")


def check_mass(quantity: str, value: float) -> float:
    """Return a mass [kg] if it is a number from 1e-15 to 1e6."""
    return _between(quantity, value, MASSES, "kg")


def check_ratio(name: str, mass: float, others: Mapping[str, float]) -> None:
    """Refuse a body whose mass and that of another thing are too different.

    Args:
        name: Name of the body.
        mass: Mass of the body [kg].
        others: Name -> mass of each other moving body [kg].
    """
    for other, weight in others.items():
        if max(mass, weight) > LARGEST_RATIO * min(mass, weight):
            allowed = f"at most {LARGEST_RATIO:g} times heavier or lighter than {other} ({weight:g} kg)"
            raise InvalidValueError(f"mass of {name!r}", f"{mass:g} kg", allowed)


def check_friction(quantity: str, value: float) -> float:
    """Return a coefficient of friction if it is a number from 0 to 100."""
    number = float(as_finite(value, quantity, ()))
    if not 0.0 <= number <= ROUGHEST:
        raise InvalidValueError(quantity, value, f"a number from 0 to {ROUGHEST:g}")
    return number


def check_position(quantity: str, value: ArrayLike) -> Array:
    """Return a position [m], shape (3,), if its numbers are at most 1e5."""
    return _within(quantity, value, (3,), FARTHEST, "m")


def check_velocity(quantity: str, value: ArrayLike) -> Array:
    """Return a velocity [m/s] and angular velocity [rad/s], shape (6,), if their numbers are at most 1e5."""
    return _within(quantity, value, (6,), FASTEST, "m/s or rad/s")


def _between(quantity: str, value: float, limits: tuple[float, float], unit: str) -> float:
    number = check_positive(quantity, value, unit)
    if not limits[0] <= number <= limits[1]:
        allowed = f"a number from {limits[0]:g} to {limits[1]:g} {unit}"
        raise InvalidValueError(quantity, f"{number:g} {unit}", allowed)
    return number


def _within(quantity: str, value: ArrayLike, shape: tuple[int, ...], most: float, unit: str) -> Array:
    """Return an array of a given shape if none of its numbers, in a unit, is greater than `most`."""
    array = as_finite(value, quantity, shape)
    if np.abs(array).max() > most:
        raise InvalidValueError(quantity, array.tolist(), f"numbers of at most {most:g} {unit}")
    return array
