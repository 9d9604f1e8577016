"""Joint friction of the description."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors


def joint_friction(pepper: PepperModel, v: ArrayLike) -> NDArray[np.float64]:
    """Return the torque of friction, d v + c sign(v), from the URDF's `<dynamics damping friction>`.

    The motors need it on top of `inverse_dynamics`; subtract it from their torque before `forward_dynamics`.

    Args:
        pepper: The robot.
        v: Joint velocities [rad/s or m/s], shape (..., n).

    Returns:
        Torques or forces [N m or N], shape (..., n); zero where the description gives no friction, as for
        Pepper, whose vendor publishes none.

    Raises:
        InvalidValueError: for a wrong length, NaN or infinity.
    """
    speed = as_joint_vectors(pepper, v, "v")
    joints = {joint.name: joint for joint in pepper.document.joints}
    damping = np.array([joints[name].damping for name in pepper.joint_names])
    coulomb = np.array([joints[name].friction for name in pepper.joint_names])
    return damping * speed + coulomb * np.sign(speed)
