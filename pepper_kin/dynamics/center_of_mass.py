"""Centre of mass of the whole robot, and the point where the floor pushes back."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InfeasibleError
from pepper_kin.model import PepperModel
from pepper_kin.model.batch import over_states


def total_mass(pepper: PepperModel) -> float:
    """Return the mass of all links, those fixed to the floor included [kg]."""
    return float(sum(inertia.mass for inertia in pepper.pinocchio_model.inertias))


def center_of_mass(pepper: PepperModel, q: ArrayLike) -> NDArray[np.float64]:
    """Return the centre of mass of all links, c = sum(m_i c_i) / sum(m_i).

    Links fixed to the floor count (Pinocchio leaves them out: with the base fixed, Pepper's 16 kg base).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        c in world coordinates [m], shape (..., 3).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    import pinocchio

    model, data = pepper.pinocchio_model, pepper.pinocchio_data
    still = model.inertias[0]
    mass = total_mass(pepper)

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        moving = pinocchio.centerOfMass(model, data, pepper.to_full(q), False)
        return (data.mass[0] * moving + still.mass * still.lever) / mass

    return over_states(pepper, one, (3,), q=q)


def center_of_mass_jacobian(pepper: PepperModel, q: ArrayLike) -> NDArray[np.float64]:
    """Return J_c(q): the velocity of the centre of mass of all links is J_c v.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).

    Returns:
        J_c in world axes [m/rad], shape (..., 3, n).

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    import pinocchio

    model, data = pepper.pinocchio_model, pepper.pinocchio_data
    share = 1.0 - model.inertias[0].mass / total_mass(pepper)

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        moving = pinocchio.jacobianCenterOfMass(model, data, pepper.to_full(q), False) @ pepper.full_map
        return np.asarray(moving * share)

    return over_states(pepper, one, (3, pepper.n), q=q)


def zero_moment_point(pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[np.float64]:
    """Return the zero-moment point: where the floor's force acts so that it needs no tipping moment.

    With p the linear momentum, L the angular momentum about the moving centre of mass c, m the total mass at
    c_all and g the gravity vector,
        f = dp/dt - m g,   n = dL/dt + c x dp/dt - c_all x m g,   zmp = (-n_y, n_x) / f_z.
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
        InfeasibleError: where the floor would have to pull (f_z <= 0): there is no such point.
    """
    import pinocchio

    model, data = pepper.pinocchio_model, pepper.pinocchio_data
    still, mass = model.inertias[0], total_mass(pepper)
    gravity = np.asarray(model.gravity.linear)

    def one(q: NDArray[np.float64], v: NDArray[np.float64], a: NDArray[np.float64]) -> NDArray[np.float64]:
        rate = pinocchio.computeCentroidalMomentumTimeVariation(
            model, data, pepper.to_full(q), pepper.rate_to_full(v), pepper.rate_to_full(a)
        )
        center_moving = np.array(data.com[0])
        center_all = (data.mass[0] * center_moving + still.mass * still.lever) / mass
        force = rate.linear - mass * gravity
        if force[2] <= 0:
            raise InfeasibleError(
                "zero-moment point",
                f"the floor would have to pull with {-force[2]:.4g} N",
                "slow the motion down",
            )
        moment = rate.angular + np.cross(center_moving, rate.linear) - np.cross(center_all, mass * gravity)
        return np.array([-moment[1], moment[0]]) / force[2]

    return over_states(pepper, one, (2,), q=q, v=v, a=a)
