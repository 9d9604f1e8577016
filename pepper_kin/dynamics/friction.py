"""Joint friction from the robot description."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors


def joint_friction(pepper: PepperModel, v: ArrayLike) -> NDArray[np.float64]:
    """Return the torque of friction, d v + c sign(v), from the URDF's `<dynamics damping friction>`.

    The motors need it in addition to `inverse_dynamics`; subtract it from their torque before
    `forward_dynamics`.

    Args:
        pepper: The robot.
        v: Joint velocities [rad/s or m/s], shape (..., n).

    Returns:
        Torques or forces [N m or N], shape (..., n); zero if the description has no friction, as for Pepper,
        whose vendor publishes none.

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    speed = as_joint_vectors(pepper, v, "v")
    damping, coulomb = friction_coefficients(pepper)
    return damping * speed + coulomb * np.sign(speed)


def friction_coefficients(pepper: PepperModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return viscous and Coulomb friction of the coordinates, from the robot description.

    Mimic joints of a coordinate add to its friction: with v_full = E v, d is the diagonal of
    E' diag(d_full) E, and c the sum of |E| c_full.

    Args:
        pepper: The robot.

    Returns:
        d [N m s/rad or N s/m] and c [N m or N], shape (n,) each.
    """
    joints = {joint.name: joint for joint in pepper.document.joints}
    every = [joints[name] for name in list(pepper.inner_model.names)[1:]]
    gains = np.abs(pepper.full_map)
    damping = np.array([joint.damping for joint in every]) @ gains**2
    return damping, np.array([joint.friction for joint in every]) @ gains
