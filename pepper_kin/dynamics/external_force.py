"""Joint torques of external forces."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch import over_states
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import MOST, as_batch, as_joint_vectors

pinocchio = lazy_module("pinocchio")


def external_torque(pepper: PepperModel, q: ArrayLike, forces: Mapping[str, ArrayLike]) -> Array:
    """Return the joint torques of external forces, sum_k J_k(q)^T f_k.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        forces: Frame -> force [N] and moment [N m] that act on the robot at the frame's origin, in world
            axes, force first, shape (..., 6); leading axes broadcast against those of q.

    Returns:
        Torques or forces [N m or N], shape (..., n).

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        InvalidValueError: for a wrong shape, NaN or infinity, naming the frame.
    """
    states = as_joint_vectors(pepper, q, "q")
    total = np.zeros_like(states)
    for frame, force in forces.items():
        pepper.frame_id(frame)
        wrench = as_batch(force, f"force at {frame}", (6,), MOST)
        jacobian = over_states(
            pepper, _jacobian(pepper, frame), (6, pepper.n), ("frame_jacobian", frame), q=states
        )
        try:
            total = total + np.einsum("...ij,...i->...j", jacobian, wrench)
        except ValueError:
            allowed = f"leading axes that broadcast against {states.shape[:-1]}"
            raise InvalidValueError(f"force at {frame}", f"shape {wrench.shape}", allowed) from None
    return total


def _jacobian(pepper: PepperModel, frame: str) -> Callable[[Array], Array]:
    """Return a function that computes the Jacobian of a frame at one state."""
    model, data, frame_id = pepper.inner_model, pepper.pinocchio_data, pepper.frame_id(frame)
    axes = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def one(q: Array) -> Array:
        """Return the Jacobian, shape (6, n), at positions q [rad or m], shape (n,)."""
        jacobian = pinocchio.computeFrameJacobian(model, data, pepper.to_full(q), frame_id, axes)
        return pepper.columns_from_full(jacobian)

    return one
