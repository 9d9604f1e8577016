"""Collision and clearance queries as plain functions."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.bodies import GeometryType
from pepper_kin.collision.checked_shapes import PairsTo
from pepper_kin.collision.checker import checker_for
from pepper_kin.collision.contact import ClosestPair, Contact
from pepper_kin.collision.least_clearance import least_clearance_of_movers
from pepper_kin.collision.movers import Movers, checked_times, movers_of
from pepper_kin.collision.scene import Scene
from pepper_kin.collision.solids import not_negative
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors

if TYPE_CHECKING:
    from pepper_kin.collision.fast import FastChecker


def in_collision(
    pepper: PepperModel, q: ArrayLike, scene: Scene | None = None, times: ArrayLike | None = None
) -> NDArray[np.bool_]:
    """Return whether the robot collides with itself or the scene.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        scene: The world around it; None checks the robot against itself only.
        times: Times of the configurations [s], one number or shape (...,): moving obstacles are where they
            are then, enlarged by the growth of their uncertainty.  None: all stand as at time 0.

    Returns:
        Booleans, shape (...,).

    Raises:
        InvalidValueError: for a q of wrong length, or with NaN or infinity, or a negative time.
    """
    groups = () if times is None else movers_of(pepper, scene)
    if not groups or scene is None or times is None:
        return _checkers()(pepper, scene).in_collision(q)
    q_all = as_joint_vectors(pepper, q, "q")
    found = np.array(_checkers()(pepper, scene.standing).in_collision(q_all)).ravel()
    flat, when = q_all.reshape(found.size, pepper.n), checked_times(times, found.size)
    for movers in groups:
        free = np.flatnonzero(~found)
        found[free] = _meets(movers, flat[free], when[free])
    return found.reshape(q_all.shape[:-1])


def _meets(movers: Movers, q: Array, times: Array) -> NDArray[np.bool_]:
    """Return whether a robot at q, shape (T, n), collides with obstacles at times [s], shape (T,)."""
    states = movers.states(q, times)
    found = _checkers()(movers.robot, movers.scene).nearer(states, movers.uncertainty * times)
    if not movers.alike:
        for k in np.flatnonzero(found):
            found[k] = least_clearance_of_movers(movers, states[[k]], times[[k]]).distance <= 0.0
    return found


@functools.cache
def _checkers() -> Callable[[PepperModel, Scene | None], FastChecker]:
    """Return `fast_checker_for`, which is imported at the first check because it loads machine code."""
    from pepper_kin.collision.fast import fast_checker_for

    return fast_checker_for


def without_robot(
    pepper: PepperModel,
    q: ArrayLike,
    points: ArrayLike,
    scene: Scene | None = None,
    *,
    margin: float = 0.02,
) -> NDArray[np.float64]:
    """Return the points that belong neither to the robot itself nor to an attached object.

    It is meant for clouds of a camera that sees the robot's own arms, before `Scene.add_point_cloud`.

    Args:
        pepper: The robot.
        q: Its joint positions when the points were measured [rad or m], shape (n,).
        points: Points in the world [m], shape (k, 3).
        scene: The scene with attached objects; objects of the world are ignored.  None for none.
        margin: Distance from the robot's shapes up to which points belong to the robot [m].

    Returns:
        The other points, shape (m, 3), in their order.  A nonconvex mesh counts as its convex hull.

    Raises:
        InvalidValueError: for a q or points of wrong shape, or with NaN or infinity, a negative margin, or a
            robot whose shapes the compiled check does not support.
    """
    cloud = np.ascontiguousarray(as_finite(points, "points", (None, 3)))
    return cloud[~_checkers()(pepper, scene).near(q, cloud, not_negative("margin", margin))]


def clearance(
    pepper: PepperModel, q: ArrayLike, scene: Scene | None = None, *, to: PairsTo = "all"
) -> NDArray[np.float64]:
    """Return the exact minimum distance of the robot to itself and the scene, or to one of them.

    Adjacent bodies that `in_collision` decides by joint ranges have no distance and do not count here.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        scene: The world around it; None for the robot against itself only.
        to: "self" for the distance of the robot, with attached objects, to itself; "obstacles" for the
            distance to the objects of the scene; "all" for the minimum of both.

    Returns:
        Distances [m], shape (...,); negative where shapes overlap, inf if there is no such pair.

    Raises:
        InvalidValueError: for a q of wrong length, or with NaN or infinity, or another word for `to`.
    """
    return checker_for(pepper, scene).clearance(q, to)


def closest_pair(
    pepper: PepperModel, q: ArrayLike, scene: Scene | None = None, *, to: PairsTo = "all"
) -> ClosestPair | None:
    """Return the nearest pair of bodies at one configuration, with distance and nearest points.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (n,).
        scene: The world around it; None for the robot against itself only.
        to: Which pairs count: "self", "obstacles" or "all", as in `clearance`.

    Returns:
        The pair; None if no pair is checked.

    Raises:
        InvalidValueError: for a q of wrong length, or with NaN or infinity, or another word for `to`.
    """
    return checker_for(pepper, scene).closest_pair(q, to)


def contacts(
    pepper: PepperModel,
    q: ArrayLike,
    scene: Scene | None = None,
    *,
    within: float = 0.0,
    geometry_type: GeometryType = "collision",
) -> tuple[Contact, ...]:
    """Return the contacts at one configuration, the deepest first.

    Each pair of links or objects is listed once, at its nearest points.  Pairs of adjacent links that a table
    of joint ranges decides come last, without points.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (n,).
        scene: The world around it, with attached objects; None for the robot against itself only.
        within: Distance up to which nearby pairs are listed as well [m].
        geometry_type: "collision" for the shapes that contain the bodies; "visual" for the visual surfaces,
            which are the vendor's if the robot was loaded with its meshes.

    Returns:
        The contacts.

    Raises:
        InvalidValueError: for a q of wrong length, or with NaN or infinity; for a negative `within`.
    """
    return checker_for(pepper, scene, geometry_type=geometry_type).contact_points(q, within)
