"""Total mass, mass matrix and its inverse."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states, state_data
from pepper_kin.core.plain_vectors import is_finite
from pepper_kin.exceptions import ModelError
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel, kept_while_private

pinocchio = lazy_module("pinocchio")


@kept_while_private
def total_mass(pepper: PepperModel) -> float:
    """Return the mass of all links, those fixed to the floor included [kg]."""
    model = pepper.inner_model
    return float(model.inertias[0].mass + pinocchio.computeTotalMass(model))


def mass_of_some(pepper: PepperModel) -> float:
    """Return the mass of all links [kg], which has a center.

    Raises:
        ModelError: for a robot without mass.
    """
    mass = total_mass(pepper)
    if not mass > 0.0:
        raise ModelError(f"robot {pepper.name!r}: no link has mass, so it has no center of mass")
    return mass


def mass_matrix(pepper: PepperModel, q: ArrayLike) -> NDArray[np.float64]:
    """Return M(q), symmetric and positive definite, by the composite-rigid-body algorithm.

    Featherstone (2008), table 6.2; through Pinocchio.  With mimic joints M = E^T M_full E.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        M, shape (..., n, n) [kg m^2, kg m or kg].

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    data = state_data(pepper, q)
    if data is not None:
        mass: NDArray[np.float64] = pinocchio.crba(pepper.inner_model, data, q)
        return mass
    model, data = pepper.inner_model, pepper.pinocchio_data
    full_map = pepper.full_map

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        full = pinocchio.crba(model, data, pepper.to_full(q))
        return full_map.T @ full @ full_map if pepper.is_coupled else full

    return over_states(pepper, one, (pepper.n, pepper.n), ("mass_matrix",), q=q)


def inverse_mass_matrix(pepper: PepperModel, q: ArrayLike) -> NDArray[np.float64]:
    """Return M(q)^-1, symmetric: column j is the motion that a unit torque of joint j causes.

    Through Pinocchio's recursion (Carpentier, Analytical inverse of the joint space inertia matrix, 2018).
    With mimic joints M = E^T M_full E is formed and inverted instead.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        M^-1, shape (..., n, n).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
        ModelError: naming joints that move no mass: M has no inverse.
    """
    data = state_data(pepper, q)
    if data is not None:
        found: NDArray[np.float64] = pinocchio.computeMinverse(pepper.inner_model, data, q)
        if is_finite.native(found):
            return found
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        if pepper.is_coupled:
            return _inverse(pepper, mass_matrix(pepper, q))
        inverse = pinocchio.computeMinverse(model, data, q)
        if not np.isfinite(inverse).all():
            return _inverse(pepper, mass_matrix(pepper, q))
        return np.asarray(inverse)

    return over_states(pepper, one, (pepper.n, pepper.n), ("inverse_mass_matrix",), q=q)


def _inverse(pepper: PepperModel, mass: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the symmetric inverse of a mass matrix, shape (n, n)."""
    inverse = solved(pepper, mass, np.eye(pepper.n))
    return np.asarray((inverse + inverse.T) / 2)


def solved(pepper: PepperModel, mass: NDArray[np.float64], load: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return M^-1 times a load, shape (n,) or (n, k); NaN where a value overflows.

    Raises:
        ModelError: where M has no inverse, naming the joints that move no mass, or those that can move
            against each other without moving any.
    """
    if not (np.isfinite(mass).all() and np.isfinite(load).all()):
        return np.full_like(load, np.nan)
    idle = [name for name, m in zip(pepper.joint_names, np.diag(mass), strict=True) if m <= 0]
    if idle:
        raise ModelError(f"the mass matrix has no inverse: no mass is moved by {', '.join(idle)}")
    try:
        found = np.linalg.solve(mass, load)
    except np.linalg.LinAlgError:
        found = np.full_like(load, np.nan)
    if not np.isfinite(found).all():
        still = np.abs(np.linalg.eigh(mass)[1][:, 0])
        names = [name for name, share in zip(pepper.joint_names, still, strict=True) if share > 1e-3]
        raise ModelError(
            f"the mass matrix has no inverse: no mass is moved when these move together: {', '.join(names)}"
        )
    return np.asarray(found)
