"""Tip-over margin: distance of the zero-moment point from the edges of the support polygon."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch import over_states
from pepper_kin.dynamics.support_polygon import (
    checked_polygon,
    distances_inside,
    inward_normals,
    wheel_contacts,
)
from pepper_kin.dynamics.zero_moment_point import zero_moment_point
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

pinocchio = lazy_module("pinocchio")


def tip_over_margin(
    pepper: PepperModel,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    contacts: ArrayLike | None = None,
    base_frame: str = "base_footprint",
) -> Array:
    """Return the distance of the zero-moment point from the edges of the wheels' polygon.

    It is the minimum distance to a line through two adjacent contacts, negative outside: if it is negative,
    the robot starts to tip over that line.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        contacts: x and y of three or more contacts in the base's frame [m], shape (k, 2), the corners of a
            convex polygon in counter-clockwise order; the robot's wheels if omitted.
        base_frame: Frame to which the contacts are fixed.

    Returns:
        Margin [m], shape (...).

    Raises:
        UnknownNameError: for a base_frame that the robot lacks.
        InvalidValueError: for contacts that are not such a polygon, omitted contacts of a robot without known
            wheels, a wrong length, NaN, infinity, or batch axes that do not broadcast.
        InfeasibleError: if the floor would have to pull.
    """
    corners = wheel_contacts(pepper) if contacts is None else checked_polygon(contacts)
    point = zero_moment_point(pepper, q, v, a)
    pose = over_states(pepper, _pose_of(pepper, base_frame), (4, 4), ("frame_pose", base_frame), q=q)
    place = np.einsum("...ji,...j->...i", pose[..., :2, :2], point - pose[..., :2, 3])
    return distances_inside(corners, inward_normals(corners), place).min(axis=-1)


def _pose_of(pepper: PepperModel, frame: str) -> Callable[[Array], Array]:
    """Return a function that computes the pose of a frame at one state."""
    model, data, frame_id = pepper.inner_model, pepper.pinocchio_data, pepper.frame_id(frame)

    def one(q: Array) -> Array:
        pinocchio.forwardKinematics(model, data, pepper.to_full(q))
        return np.asarray(pinocchio.updateFramePlacement(model, data, frame_id).homogeneous)

    return one
