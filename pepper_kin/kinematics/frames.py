"""Poses of link and sensor frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch import over_states, state_data
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


def frame_pose(pepper: PepperModel, q: ArrayLike, frame: str) -> NDArray[np.float64]:
    """Return the pose of a link or sensor frame.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        frame: A name of `pepper.frame_names`.

    Returns:
        transform_frame_to_world, shape (..., 4, 4): maps homogeneous coordinates of the frame to the world's
        (`base_footprint` of the fixed base: on the floor, x forward, y left, z up) [m].

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        InvalidValueError: for a q of wrong length, or with NaN or infinity.
    """
    frame_id = pepper.frame_id(frame)
    data = state_data(pepper, q)
    if data is not None:
        pinocchio.forwardKinematics(pepper.inner_model, data, q)
        pose = pinocchio.updateFramePlacement(pepper.inner_model, data, frame_id)
        transform: NDArray[np.float64] = pose.homogeneous
        return transform
    model, data = pepper.inner_model, pepper.pinocchio_data

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        pinocchio.forwardKinematics(model, data, pepper.to_full(q))
        return np.asarray(pinocchio.updateFramePlacement(model, data, frame_id).homogeneous)

    return over_states(pepper, one, (4, 4), ("frame_pose", frame), q=q)


def frame_poses(pepper: PepperModel, q: ArrayLike, frames: Sequence[str]) -> NDArray[np.float64]:
    """Return the poses of several frames.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        frames: k names of `pepper.frame_names`.

    Returns:
        transform_frame_to_world for each, shape (..., k, 4, 4).

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        InvalidValueError: for a q of wrong length, or with NaN or infinity.
    """
    model, data = pepper.inner_model, pepper.pinocchio_data
    ids = [pepper.frame_id(name) for name in frames]

    def one(q: NDArray[np.float64]) -> NDArray[np.float64]:
        result = np.empty((len(ids), 4, 4))
        pinocchio.forwardKinematics(model, data, pepper.to_full(q))
        for place, frame_id in enumerate(ids):
            result[place] = pinocchio.updateFramePlacement(model, data, frame_id).homogeneous
        return result

    return over_states(pepper, one, (len(ids), 4, 4), ("frame_poses", tuple(frames)), q=q)


def link_poses(pepper: PepperModel, q: ArrayLike) -> NDArray[np.float64]:
    """Return the poses of all links, shape (..., len(pepper.link_names), 4, 4), in that order [m]."""
    return frame_poses(pepper, q, pepper.link_names)
