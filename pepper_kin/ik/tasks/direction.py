"""Angle between two directions as a residual with a single minimum."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite

# Sine below which two directions count as parallel: the exact formulas would divide by zero.
PARALLEL = 1e-7

# Minimum distance of a point with a defined direction [m].
NEAREST = 1e-6


def unit_vector(vector: ArrayLike, quantity: str) -> Array:
    """Return a vector, shape (3,), normalized and read-only.

    Raises:
        InvalidValueError: for a wrong shape, NaN, infinity or a vector shorter than 1e-9.
    """
    array = as_finite(vector, quantity, (3,))
    length = float(np.linalg.norm(array))
    if length < 1e-9:
        raise InvalidValueError(quantity, array, "a vector that is not zero")
    return read_only(array / length)


def unit_and_length(line: Array) -> tuple[Array, float]:
    """Return the unit vector of a line, shape (3,) [m], and its length [m]; x and NEAREST if shorter."""
    length = float(np.linalg.norm(line))
    return (line / length, length) if length >= NEAREST else (np.array([1.0, 0.0, 0.0]), NEAREST)


def sideways_basis(axis: Array) -> Array:
    """Return B, shape (2, 3), read-only: two unit rows normal to a unit axis and to each other.

    For the x axis they are y and z.
    """
    return _sideways_basis(*axis.tolist())


@lru_cache(maxsize=256)
def _sideways_basis(x: float, y: float, z: float) -> Array:
    """Return the rows of `sideways_basis` for an axis given by its components."""
    axis = np.array([x, y, z])
    first = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    first = first - (first @ axis) * axis
    first /= np.linalg.norm(first)
    return read_only([first, np.cross(axis, first)])


def cross_matrix(vector: Array) -> Array:
    """Return [a]x, shape (3, 3), of a, shape (3,): [a]x b = a x b."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def turn_between(first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Return r, dr/da and dr/dd of the rotation from a unit direction a to a unit direction d, both variable.

    r = f a x d with f = theta / sin theta, see `direction_residual`; with c = a . d,

        dr/da = -f [d]x + f'(c) (a x d) d^T,    dr/dd = f [a]x + f'(c) (a x d) a^T.

    Args:
        first: a, shape (3,).
        second: d, shape (3,).

    Returns:
        r, shape (3,) [rad], dr/da and dr/dd, shape (3, 3) each.
    """
    across, cosine = cross_matrix(first) @ second, float(first @ second)
    sine = float(np.linalg.norm(across))
    if sine < PARALLEL and cosine < 0:
        # Opposite directions: every rotation axis across a is equivalent, so take the first.
        across, sine = PARALLEL * sideways_basis(first)[0], PARALLEL
    factor, slope = _angle_over_sine(sine, cosine)
    by_first = -factor * cross_matrix(second) + slope * np.outer(across, second)
    return factor * across, by_first, factor * cross_matrix(first) + slope * np.outer(across, first)


def direction_residual(axis: Array, basis: Array, direction: Array) -> tuple[Array, Array]:
    """Return r and dr/dd of the rotation from a unit axis a to a unit direction d.

    r = (theta / sin theta) B d, where B d are the two components of d across the axis and theta is the angle
    between a and d.  Hence |r| = theta: it grows up to pi, where d is opposite to a, whereas B d alone would
    vanish there and trap a solver.  With c = a . d = cos theta and f = theta / sin theta,

        dr/dd = f B + f'(c) (B d) a^T,    f'(c) = (c f - 1) / (1 - c^2).

    Args:
        axis: a, shape (3,).
        basis: B, shape (2, 3), see `sideways_basis`.
        direction: d, shape (3,).

    Returns:
        r, shape (2,) [rad], and dr/dd, shape (2, 3).
    """
    across, cosine = basis @ direction, float(axis @ direction)
    sine = math.hypot(across[0], across[1])
    if sine < PARALLEL and cosine < 0:
        # Opposite directions: every rotation axis across a is equivalent, so take the first.
        across, sine = np.array([PARALLEL, 0.0]), PARALLEL
    factor, slope = _angle_over_sine(sine, cosine)
    return factor * across, factor * basis + slope * np.outer(across, axis)


def _angle_over_sine(sine: float, cosine: float) -> tuple[float, float]:
    """Return f = theta / sin theta and its derivative by cos theta."""
    theta = math.atan2(sine, cosine)
    if theta < 1e-3:
        return 1 + theta**2 / 6, -1 / 3 - 2 * theta**2 / 15
    factor = theta / sine
    return factor, (cosine * factor - 1) / sine**2
