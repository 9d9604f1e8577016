"""Frame Jacobians, which map joint velocities to the velocity of a frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states, state_data
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


def frame_jacobian(pepper: PepperModel, q: ArrayLike, frame: str) -> NDArray[np.float64]:
    """Return the Jacobian J(q) of a frame: (velocity of its origin, angular velocity) = J(q) v.

    Both blocks of rows are in world axes at the frame's origin; linear first.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        frame: A name of `pepper.frame_names`.

    Returns:
        J, shape (..., 6, n) [m/rad, rad/rad].

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        InvalidValueError: for a q of wrong length, or with NaN or infinity.
    """
    frame_id = pepper.frame_id(frame)
    axes = pinocchio.LOCAL_WORLD_ALIGNED
    data = state_data(pepper, q)
    if data is not None:
        found: NDArray[np.float64] = pinocchio.computeFrameJacobian(
            pepper.inner_model, data, q, frame_id, axes
        )
        return found if found.ndim == 2 else found.reshape(6, 1)  # Pinocchio drops the axis of a single joint
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        jacobian = pinocchio.computeFrameJacobian(model, data, pepper.to_full(q), frame_id, axes)
        jacobian = jacobian.reshape(6, model.nv)
        return pepper.columns_from_full(jacobian)

    return over_states(pepper, one, (6, pepper.n), ("frame_jacobian", frame), q=q)


def frame_jacobian_rate(pepper: PepperModel, q: ArrayLike, v: ArrayLike, frame: str) -> NDArray[np.float64]:
    """Return dJ/dt of a frame's Jacobian while the robot moves, so that its acceleration is J a + dJ/dt v.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        frame: A name of `pepper.frame_names`.

    Returns:
        dJ/dt, shape (..., 6, n), in the axes of `frame_jacobian` [m/(rad s), 1/s].

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    frame_id, axes = pepper.frame_id(frame), pinocchio.LOCAL_WORLD_ALIGNED
    data = state_data(pepper, q, v)
    if data is not None:
        model = pepper.inner_model
        pinocchio.computeJointJacobiansTimeVariation(model, data, q, v)
        pinocchio.updateFramePlacement(model, data, frame_id)
        found: NDArray[np.float64] = pinocchio.getFrameJacobianTimeVariation(model, data, frame_id, axes)
        return found.reshape(6, model.nv)
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        pinocchio.computeJointJacobiansTimeVariation(model, data, pepper.to_full(q), pepper.rate_to_full(v))
        pinocchio.updateFramePlacement(model, data, frame_id)
        rate = pinocchio.getFrameJacobianTimeVariation(model, data, frame_id, axes)
        return pepper.columns_from_full(rate)

    return over_states(pepper, one, (6, pepper.n), ("frame_jacobian_rate", frame), q=q, v=v)
