"""Balance margin: the zero-moment point against the triangle of the wheels."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.loads import carrying, load_wrench
from pepper_kin.dynamics import base_wrench
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.support_polygon import inward_normals
from pepper_kin.dynamics.support_polygon import support_polygon as support_polygon
from pepper_kin.model import PepperModel
from pepper_kin.model.wheels import BASE_JOINTS


def edge_moments(
    pepper: PepperModel,
    polygon: Array,
    q: Array,
    v: Array,
    a: Array,
    margin: float = 0.0,
    loads: Loads = (),
) -> Array:
    """Return how firmly the robot stands on each edge of its support polygon.

    With (f, n) the wrench of the floor, p a vertex of the edge and i the unit vector that points inward,
        h = i . (-n_y, n_x) - (i . p + margin) f_z = (distance of the zero-moment point - margin) f_z:
    zero where the zero-moment point is `margin` inside the edge, and linear in the accelerations.

    Args:
        pepper: The robot.
        polygon: Vertices in base coordinates, counter-clockwise [m], shape (k, 2).
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        margin: Distance from the edge that is wanted [m].
        loads: What is carried.

    Returns:
        h of every edge [N m], positive where it stands, shape (..., k).
    """
    return _moments(pepper, polygon, q, floor_wrench(pepper, q, v, a, loads), margin)


def moment_matrix(polygon: Array, margin: float) -> Array:
    """Return G such that edge moments are wrench @ G, shape (6, k), with the wrench as the base sees it."""
    inward = inward_normals(polygon)
    gain = np.zeros((6, len(polygon)))
    gain[4], gain[3] = -inward[:, 0], inward[:, 1]
    gain[2] = -(np.sum(inward * polygon, axis=1) + margin)
    return gain


def moves_base(pepper: PepperModel) -> bool:
    """Return whether the support polygon moves with the base's joints."""
    return set(BASE_JOINTS) <= set(pepper.joint_names)


def balance_margin(
    pepper: PepperModel, polygon: Array, q: Array, v: Array, a: Array, loads: Loads = ()
) -> Array:
    """Return the distance of the zero-moment point from the nearest edge of the support polygon.

    Args:
        pepper: The robot.
        polygon: Vertices in base coordinates, counter-clockwise [m], shape (k, 2).
        q: Joint positions [rad or m], shape (T, n).
        v: Joint velocities [rad/s or m/s], shape (T, n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (T, n).
        loads: What is carried.

    Returns:
        Signed distance [m], positive inside, -inf where the floor would have to pull, shape (T,).
    """
    return margin_of_wrench(pepper, polygon, q, floor_wrench(pepper, q, v, a, loads))


def margin_of_wrench(pepper: PepperModel, polygon: Array, q: Array, wrench: Array) -> Array:
    """Return what `balance_margin` does, of the wrench of the floor, shape (T, 6)."""
    moments, lift = _moments(pepper, polygon, q, wrench, 0.0).min(axis=1), wrench[:, 2]
    return np.where(lift > 0, moments / np.where(lift > 0, lift, 1.0), -np.inf)


def floor_wrench(pepper: PepperModel, q: Array, v: Array, a: Array, loads: Loads = ()) -> Array:
    """Return the wrench of the floor on a robot and its loads, about the world's origin.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        loads: What is carried.

    Returns:
        Force [N], then moment [N m], shape (..., 6).
    """
    if pepper.solvers != "fast":
        return base_wrench(carrying(pepper, loads), q, v, a)
    wrench = base_wrench(pepper, q, v, a)
    return wrench + load_wrench(pepper, loads, q, v, a) if loads else wrench


def _moments(pepper: PepperModel, polygon: Array, q: Array, wrench: Array, margin: float) -> Array:
    """Return what `edge_moments` does, of the wrench of the floor, shape (..., 6)."""
    if moves_base(pepper):  # the wrench about the base's origin, in the base's axes
        x, y, yaw = (q[..., pepper.joint_index(joint)] for joint in BASE_JOINTS)
        lift, cosine, sine = wrench[..., 2], np.cos(yaw), np.sin(yaw)
        n_x, n_y = wrench[..., 3] - y * lift, wrench[..., 4] + x * lift
        wrench = wrench.copy()
        wrench[..., 3], wrench[..., 4] = cosine * n_x + sine * n_y, cosine * n_y - sine * n_x
    return np.einsum("...i,ik->...k", wrench, moment_matrix(polygon, margin))
