"""What the floor does to the robot, and how far it is from tipping over."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.dynamics.center_of_mass import total_mass, zero_moment_point
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.batch import over_states
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors

Array = NDArray[np.float64]

WHEEL_CONTACTS = ((0.09, 0.155), (-0.17, 0.0), (0.09, -0.155))
"""Where Pepper's three wheels touch the floor, x and y in `base_footprint` [m], counter-clockwise."""


def base_wrench(pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
    """Return the wrench that the floor exerts on the robot during a motion.

    With p the linear momentum, L the angular momentum about the moving centre of mass c, m the total mass at
    c_all and g the gravity vector: f = dp/dt - m g, n = dL/dt + c x dp/dt - c_all x m g.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        Force [N], then moment about the world's origin [N m], in world axes, shape (..., 6).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    import pinocchio

    model, data = pepper.pinocchio_model, pepper.pinocchio_data
    still, mass = model.inertias[0], total_mass(pepper)
    gravity = np.asarray(model.gravity.linear)

    def one(q: Array, v: Array, a: Array) -> Array:
        rate = pinocchio.computeCentroidalMomentumTimeVariation(
            model, data, pepper.to_full(q), pepper.rate_to_full(v), pepper.rate_to_full(a)
        )
        center = np.array(data.com[0])
        first_moment = (mass - still.mass) * center + still.mass * still.lever
        moment = rate.angular + np.cross(center, rate.linear) - np.cross(first_moment, gravity)
        return np.concatenate([rate.linear - mass * gravity, moment])

    return over_states(pepper, one, (6,), q=q, v=v, a=a)


def tip_over_margin(
    pepper: PepperModel,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    contacts: ArrayLike = WHEEL_CONTACTS,
    base_frame: str = "base_footprint",
) -> Array:
    """Return how far the zero-moment point lies inside the polygon of the wheels.

    The smallest distance to a line through two neighbouring contacts, counted negative outside: below zero
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
    local = over_states(
        pepper, lambda q: _base_axes(pepper, q, base_frame), (2, 3), q=as_joint_vectors(pepper, q, "q")
    )
    place = np.einsum("...ji,...j->...i", local[..., :2], point - local[..., 2])
    distances = _cross(sides, place[..., None, :] - corners) / np.linalg.norm(sides, axis=-1)
    return np.asarray(distances.min(axis=-1))


def _base_axes(pepper: PepperModel, q: Array, base_frame: str) -> Array:
    """Return the base's x and y axes and its origin on the floor as columns, shape (2, 3)."""
    import pinocchio

    model, data = pepper.pinocchio_model, pepper.pinocchio_data
    frame_id = pepper.frame_id(base_frame)
    pinocchio.forwardKinematics(model, data, pepper.to_full(q))
    pose = pinocchio.updateFramePlacement(model, data, frame_id).homogeneous
    return np.column_stack([pose[:2, :2], pose[:2, 3]])


def _cross(u: Array, w: Array) -> Array:
    return np.asarray(u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0])
