"""Tip-over margin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch import over_states
from pepper_kin.dynamics.zero_moment_point import zero_moment_point
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite

pinocchio = lazy_module("pinocchio")


WHEEL_CONTACTS = ((0.09, 0.155), (-0.17, 0.0), (0.09, -0.155))
"""Where Pepper's three wheels touch the floor, x and y in `base_footprint` [m], counter-clockwise."""


def tip_over_margin(
    pepper: PepperModel,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    contacts: ArrayLike = WHEEL_CONTACTS,
    base_frame: str = "base_footprint",
) -> Array:
    """Return how far the zero-moment point lies inside the polygon of the wheels.

    The smallest distance to a line through two neighboring contacts, counted negative outside: below zero
    the robot begins to tip over that line.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        contacts: x and y of three or more contacts in the base's frame [m], shape (k, 2), the corners of a
            convex polygon in counter-clockwise order; Pepper's wheels by default.
        base_frame: Frame that the contacts move with.

    Returns:
        Margin [m], shape (...).

    Raises:
        UnknownNameError: for a base_frame that the robot lacks.
        InvalidValueError: for contacts that are no such polygon, a wrong length, NaN, infinity, or batch axes
            that do not broadcast.
        InfeasibleError: where the floor would have to pull.
    """
    corners = as_finite(contacts, "contacts", (None, 2))
    sides = np.roll(corners, -1, axis=0) - corners
    turns = _cross(sides, np.roll(sides, -1, axis=0))
    # Two turns of a star are also to the left at each corner; all corners on one side of each line are not.
    reach = _cross(sides[:, None], corners[None] - corners[:, None])
    if len(corners) < 3 or np.any(turns <= 0) or np.any(reach < -1e-12):
        raise InvalidValueError(
            "contacts", corners.tolist(), "corners of a convex polygon, counter-clockwise, shape (k >= 3, 2)"
        )
    point = zero_moment_point(pepper, q, v, a)
    pose = over_states(pepper, _pose_of(pepper, base_frame), (4, 4), ("frame_pose", base_frame), q=q)
    place = np.einsum("...ji,...j->...i", pose[..., :2, :2], point - pose[..., :2, 3])
    distances = _cross(sides, place[..., None, :] - corners) / np.linalg.norm(sides, axis=-1)
    return np.asarray(distances.min(axis=-1))


def _pose_of(pepper: PepperModel, frame: str) -> Callable[[Array], Array]:
    model, data, frame_id = pepper.inner_model, pepper.pinocchio_data, pepper.frame_id(frame)

    def one(q: Array) -> Array:
        pinocchio.forwardKinematics(model, data, pepper.to_full(q))
        return np.asarray(pinocchio.updateFramePlacement(model, data, frame_id).homogeneous)

    return one


def _cross(u: Array, w: Array) -> Array:
    """Return the z component of the cross product of plane vectors, shape (..., 2)."""
    return np.asarray(u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0])
