"""Total mass, mass matrix and its inverse."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.core import tree_dynamics
from pepper_kin.dynamics.tree_tables import all_states, one_state
from pepper_kin.exceptions import ModelError
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel, kept_for_robot, once_for_robot
from pepper_kin.model.moving_tree import moving_tree

pinocchio = lazy_module("pinocchio")


@kept_for_robot(most=1)
def joint_masses(pepper: PepperModel) -> Array:
    """Return the mass of the links that move with each joint [kg], shape (joints,), the world's first.

    Joints are those of `moving_tree`; links are summed as Pinocchio does, without importing it.
    """
    changed = pepper.dynamics_model.changed()
    if changed is not None:
        return read_only([inertia.mass for inertia in changed.inertias])
    tree = moving_tree(pepper)
    masses = np.zeros(tree.count)
    for link in pepper.document.tree.findall("link"):
        mass = link.find("inertial/mass")
        masses[tree.frame_joints[link.get("name", "")]] += (
            0.0 if mass is None else float(mass.get("value", 0))
        )
    return read_only(masses)


@once_for_robot
def total_mass(pepper: PepperModel) -> float:
    """Return the mass of all links, including those fixed to the floor [kg]."""
    model = pepper.inner_model
    return float(model.inertias[0].mass + pinocchio.computeTotalMass(model))


def mass_of_some(pepper: PepperModel) -> float:
    """Return the mass of all links [kg], after a check that it is positive, so that a center exists.

    Raises:
        ModelError: for a robot without mass.
    """
    mass = total_mass(pepper)
    if not mass > 0.0:
        raise ModelError(f"robot {pepper.name!r}: no link has mass, so it has no center of mass")
    return mass


def mass_matrix(pepper: PepperModel, q: ArrayLike, *, solver: str = "robot") -> Array:
    """Return M(q), symmetric and positive definite, by the composite-rigid-body algorithm.

    Featherstone (2008), table 6.2.  With mimic joints M = E^T M_full E.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        solver: "robot" for the choice in its `solvers`; or "compiled", or "pinocchio" as the reference.

    Returns:
        M, shape (..., n, n) [kg m^2, kg m or kg].

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity, or an unknown solver.
    """
    compute, shape = tree_dynamics.mass_matrix, (pepper.n, pepper.n)
    found = one_state(compute, pepper, solver, shape, q)
    if found is not None:
        return found
    full_map = pepper.full_map

    def reference(q: Array) -> Array:
        full = pinocchio.crba(pepper.inner_model, pepper.pinocchio_data, pepper.to_full(q))
        return np.asarray(full_map.T @ full @ full_map if pepper.is_coupled else full)

    return all_states(compute, pepper, solver, shape, reference, "mass_matrix", q=q)


def inverse_mass_matrix(pepper: PepperModel, q: ArrayLike, *, solver: str = "robot") -> Array:
    """Return M(q)^-1, symmetric: column j is the acceleration caused by a unit torque of joint j.

    It is computed from the factors of M, as in `forward_dynamics`; the reference is Pinocchio's recursion
    (Carpentier, Analytical inverse of the joint space inertia matrix, 2018).  With mimic joints
    M = E^T M_full E.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        solver: "robot" for the choice in its `solvers`; or "compiled", or "pinocchio" as the reference.

    Returns:
        M^-1, shape (..., n, n).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity, or an unknown solver.
        ModelError: naming joints that move no mass: M has no inverse.
    """
    compute, shape = tree_dynamics.inverse_mass_matrix, (pepper.n, pepper.n)
    found = one_state(compute, pepper, solver, shape, q)
    if found is not None:
        return found

    def reference(q: Array) -> Array:
        if not pepper.is_coupled:
            inverse = np.asarray(pinocchio.computeMinverse(pepper.inner_model, pepper.pinocchio_data, q))
            if np.isfinite(inverse).all():
                return inverse
        return _inverse(pepper, mass_matrix(pepper, q, solver=solver))

    return all_states(compute, pepper, solver, shape, reference, "inverse_mass_matrix", q=q)


def _inverse(pepper: PepperModel, mass: Array) -> Array:
    """Return the symmetric inverse of a mass matrix, shape (n, n)."""
    inverse = solved(pepper, mass, np.eye(pepper.n))
    return np.asarray((inverse + inverse.T) / 2)


def solved(pepper: PepperModel, mass: Array, load: Array) -> Array:
    """Return M^-1 times a load, shape (n,) or (n, k); NaN if a value overflows.

    Raises:
        ModelError: if M has no inverse, naming the joints that move no mass, or those that can move together
            without moving any mass.
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
