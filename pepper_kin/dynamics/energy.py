"""Mechanical energy."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch import over_states, state_data
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel, once_for_robot

pinocchio = lazy_module("pinocchio")


def kinetic_energy(pepper: PepperModel, q: ArrayLike, v: ArrayLike) -> Array:
    """Return v^T M(q) v / 2 [J], shape (...).

    The composite-rigid-body algorithm computes M: Pinocchio's `computeKineticEnergy` takes three times as
    long.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    data = state_data(pepper, q, v)
    if data is not None:
        return _kinetic(pepper, data, cast("Array", q), cast("Array", v))

    def one(q: Array, v: Array) -> Array:
        return _kinetic(pepper, pepper.pinocchio_data, pepper.to_full(q), pepper.rate_to_full(v))

    return over_states(pepper, one, (), ("kinetic_energy",), q=q, v=v)


def potential_energy(pepper: PepperModel, q: ArrayLike) -> Array:
    """Return -sum(m_i g . c_i) over the moving links [J], shape (...); zero if their center is at z = 0.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    data = state_data(pepper, q)
    if data is not None:
        return _potential(pepper, data, cast("Array", q))

    def one(q: Array) -> Array:
        return _potential(pepper, pepper.pinocchio_data, pepper.to_full(q))

    return over_states(pepper, one, (), ("potential_energy",), q=q)


def _kinetic(pepper: PepperModel, data: Any, q: Array, v: Array) -> Array:
    """Return v^T M(q) v / 2 [J], shape (), of one state; q and v have shape (n,)."""
    return np.array(v.dot(pinocchio.crba(pepper.inner_model, data, q).dot(v)) / 2)


def _potential(pepper: PepperModel, data: Any, q: Array) -> Array:
    """Return the potential energy [J], shape (), at positions of shape (n,)."""
    # The sum over all links at once, since Pinocchio's `computePotentialEnergy` takes four times as long.
    center = pinocchio.centerOfMass(pepper.inner_model, data, q, False)
    weight = _weight(pepper)
    return np.array(0.0 if weight is None else center.dot(weight))


@once_for_robot
def _weight(pepper: PepperModel) -> Array | None:
    """Return -m g of the moving links [N], shape (3,); None if they have no mass, and so no center."""
    model = pepper.inner_model
    mass = pinocchio.computeTotalMass(model)
    return np.array(model.gravity.linear) * -mass if mass > 0.0 else None
