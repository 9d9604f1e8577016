"""Support polygon of the wheels' contact points, and distances of points from its edges."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.model.kinematic_tree import placed_joints
from pepper_kin.model.requirements import ROBOT, WHEELS, Balance, checked_distance


@kept_for_robot(most=32)
def support_polygon(pepper: PepperModel) -> Array | None:
    """Return the contact points of the wheels in base coordinates [m], counter-clockwise, shape (3, 2).

    For Pepper (0.09, 0.155), (-0.17, 0), (0.09, -0.155); None for a robot without `WHEELS`.
    """
    if not set(WHEELS) <= set(pepper.frame_names):
        return None
    placed, centers = placed_joints(pepper.document), []
    for wheel in WHEELS:
        link, center = wheel, np.array([0.0, 0.0, 0.0, 1.0])
        while link in placed:  # no joint between the base and a wheel moves the wheel's center
            center, link = placed[link].transform_child_to_parent @ center, placed[link].joint.parent
        centers.append(center[:2])
    return read_only(centers)


def checked_balance(pepper: PepperModel, balance: Balance, *, if_wheeled: bool = False) -> float | None:
    """Return the distance kept from the edges of the support polygon [m]; None if balance is not required.

    Args:
        pepper: The robot.
        balance: The distance [m]; "robot" for the one of its requirements.
        if_wheeled: Whether to return None for a robot without a support polygon, instead of refusing it.

    Raises:
        InvalidValueError: for an invalid distance, or a robot without a support polygon.
    """
    if balance is None:
        return None
    if isinstance(balance, str) and balance == ROBOT:
        balance = pepper.requirements.balance
        return checked_balance(pepper, balance, if_wheeled=if_wheeled)
    distance = checked_distance(balance)
    if support_polygon(pepper) is None:
        if if_wheeled:
            return None
        raise InvalidValueError("balance", balance, f"None for a robot without {', '.join(WHEELS)}")
    return distance


def wheel_contacts(pepper: PepperModel, quantity: str = "contacts") -> Array:
    """Return the `support_polygon` of a robot that has one, shape (3, 2) [m].

    Raises:
        InvalidValueError: for a robot without `WHEELS`, whose contacts have to be given as the quantity.
    """
    polygon = support_polygon(pepper)
    if polygon is None:
        allowed = f"those of robot {pepper.name!r}, which has no links {', '.join(WHEELS)}"
        raise InvalidValueError(quantity, None, allowed)
    return polygon


def checked_polygon(contacts: object, quantity: str = "contacts") -> Array:
    """Return the corners of a convex polygon [m], shape (k, 2).

    Raises:
        InvalidValueError: naming the quantity, unless they are the corners of a convex polygon in
            counter-clockwise order.
    """
    corners = as_finite(contacts, quantity, (None, 2))  # type: ignore[arg-type]
    sides = np.roll(corners, -1, axis=0) - corners
    turns = cross(sides, np.roll(sides, -1, axis=0))
    # A star turns left at each corner, too, but its corners are not on one side of each line.
    reach = cross(sides[:, None], corners[None] - corners[:, None])
    if len(corners) < 3 or np.any(turns <= 0) or np.any(reach < -1e-12):
        wanted = "corners of a convex polygon, counter-clockwise, shape (k >= 3, 2)"
        raise InvalidValueError(quantity, corners.tolist(), wanted)
    return corners


def inward_normals(corners: Array) -> Array:
    """Return the inward unit normals of the edges, edge i starting at corner i, shape (k, 2)."""
    edge = np.roll(corners, -1, axis=0) - corners
    return np.stack([-edge[:, 1], edge[:, 0]], axis=1) / np.linalg.norm(edge, axis=1)[:, None]


def distances_inside(corners: Array, inward: Array, points: Array) -> Array:
    """Return signed distances of points from the edges' lines [m], negative outside, shape (..., k).

    Args:
        corners: Corners of the polygon [m], shape (k, 2).
        inward: Inward normals of the edges, see `inward_normals`, shape (k, 2).
        points: Points in the same coordinates [m], shape (..., 2).
    """
    return np.asarray(np.einsum("...ki,ki->...k", points[..., None, :] - corners, inward))


def inner_radius(corners: Array) -> float:
    """Return 2 area / perimeter of a polygon, shape (k, 2) [m].

    For a triangle, it is the radius of the inscribed circle; in no polygon is a point farther from all edges.
    """
    beside = np.roll(corners, -1, axis=0)
    girth = np.linalg.norm(beside - corners, axis=1).sum()
    return float(cross(corners, beside).sum() / girth)


def cross(u: Array, w: Array) -> Array:
    """Return the z component of the cross product of plane vectors, shape (..., 2)."""
    return np.asarray(u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0])
