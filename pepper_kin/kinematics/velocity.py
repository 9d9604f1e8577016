"""Velocities and accelerations of frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states, state_data
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


def frame_velocity(pepper: PepperModel, q: ArrayLike, v: ArrayLike, frame: str) -> NDArray[np.float64]:
    """Return the velocity of a frame, J(q) v.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        frame: A name of `pepper.frame_names`.

    Returns:
        Velocity of the frame's origin [m/s], then angular velocity [rad/s], in world axes, shape (..., 6).

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    frame_id, axes = pepper.frame_id(frame), pinocchio.LOCAL_WORLD_ALIGNED
    data = state_data(pepper, q, v)
    if data is not None:
        model = pepper.inner_model
        pinocchio.forwardKinematics(model, data, q, v)
        velocity: NDArray[np.float64] = pinocchio.getFrameVelocity(model, data, frame_id, axes).vector
        return velocity
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        pinocchio.forwardKinematics(model, data, pepper.to_full(q), pepper.rate_to_full(v))
        return np.asarray(pinocchio.getFrameVelocity(model, data, frame_id, axes).vector)

    return over_states(pepper, one, (6,), ("frame_velocity", frame), q=q, v=v)


def frame_acceleration(
    pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike, frame: str
) -> NDArray[np.float64]:
    """Return the acceleration of a frame, J(q) a + dJ/dt v.

    The linear part is the second derivative of the position of the frame's origin (the classical, not the
    spatial acceleration).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        frame: A name of `pepper.frame_names`.

    Returns:
        Acceleration of the frame's origin [m/s^2], then angular acceleration [rad/s^2], in world axes,
        shape (..., 6).

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    frame_id, axes = pepper.frame_id(frame), pinocchio.LOCAL_WORLD_ALIGNED
    data = state_data(pepper, q, v, a)
    if data is not None:
        model = pepper.inner_model
        pinocchio.forwardKinematics(model, data, q, v, a)
        found = pinocchio.getFrameClassicalAcceleration(model, data, frame_id, axes)
        acceleration: NDArray[np.float64] = found.vector
        return acceleration
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64], v: NDArray[np.float64], a: NDArray[np.float64]) -> NDArray[np.float64]:
        v_full, a_full = pepper.rate_to_full(v), pepper.rate_to_full(a)
        pinocchio.forwardKinematics(model, data, pepper.to_full(q), v_full, a_full)
        return np.asarray(pinocchio.getFrameClassicalAcceleration(model, data, frame_id, axes).vector)

    return over_states(pepper, one, (6,), ("frame_acceleration", frame), q=q, v=v, a=a)
