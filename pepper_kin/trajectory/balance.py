"""Balance margin: the zero-moment point against the triangle of the wheels."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.loads import load_wrench
from pepper_kin.dynamics import base_wrench, tip_over_margin
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.support_polygon import WHEELS, inward_normals
from pepper_kin.dynamics.support_polygon import support_polygon as support_polygon
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_real, shown
from pepper_kin.model.wheels import BASE_JOINTS

BALANCE_ALLOWED = "a finite distance of 0 or more [m], or None"


def checked_balance(pepper: PepperModel, balance: float | None) -> float | None:
    """Return the distance that is kept from the edges of the support polygon [m]; None leaves balance out.

    Raises:
        InvalidValueError: for what is no finite distance of 0 or more, or a robot without a support polygon.
    """
    if balance is None:
        return None
    if not 0.0 <= as_real(balance) < np.inf:
        raise InvalidValueError("balance", shown(balance), BALANCE_ALLOWED)
    if support_polygon(pepper) is None:
        raise InvalidValueError("balance", balance, f"None for a robot without {', '.join(WHEELS)}")
    return float(balance)


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
    vertices, inward = _to_world(pepper, q, polygon, inward_normals(polygon))
    wrench = base_wrench(pepper, q, v, a)
    if loads:
        wrench = wrench + load_wrench(pepper, loads, q, v, a)
    tilt = np.stack([-wrench[..., 4], wrench[..., 3]], axis=-1)
    reach = np.sum(inward * vertices, axis=-1) + margin
    return np.einsum("...ki,...i->...k", inward, tilt) - reach * wrench[..., 2:3]


def moment_matrix(polygon: Array, margin: float) -> Array:
    """Return G such that the edge moments of a robot with a fixed base are wrench @ G, shape (6, k)."""
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
    if loads:
        wrench = base_wrench(pepper, q, v, a) + load_wrench(pepper, loads, q, v, a)
        moments = edge_moments(pepper, polygon, q, v, a, 0.0, loads).min(axis=1)
        carried = wrench[:, 2] > 0
        return np.where(carried, moments / np.where(carried, wrench[:, 2], 1.0), -np.inf)
    lifted = base_wrench(pepper, q, v, a)[:, 2] <= 0
    margin = np.full(len(q), -np.inf)
    stands = ~lifted
    if stands.any():
        margin[stands] = tip_over_margin(pepper, q[stands], v[stands], a[stands], polygon, _base(pepper))
    return margin


def _base(pepper: PepperModel) -> str:
    """Return the frame that the support polygon moves with."""
    return "base_footprint" if "base_footprint" in pepper.frame_names else pepper.document.root


def _to_world(pepper: PepperModel, q: Array, points: Array, directions: Array) -> tuple[Array, Array]:
    """Return points and directions of the base, shape (k, 2), in the world, shape (..., k, 2)."""
    if not moves_base(pepper):
        shape = (*q.shape[:-1], *points.shape)
        return np.broadcast_to(points, shape), np.broadcast_to(directions, shape)
    x, y, yaw = (q[..., pepper.joint_index(joint)] for joint in BASE_JOINTS)
    turn = np.stack([np.stack([np.cos(yaw), -np.sin(yaw)], -1), np.stack([np.sin(yaw), np.cos(yaw)], -1)], -2)
    turned = [np.einsum("...ij,kj->...ki", turn, vectors) for vectors in (points, directions)]
    return turned[0] + np.stack([x, y], axis=-1)[..., None, :], turned[1]
