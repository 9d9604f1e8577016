"""Collision and clearance as plain functions."""

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
    """Whether the robot touches itself or the scene.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        scene: The world around it; None checks the robot against itself only.
        times: When it is there [s], one number or shape (...,): obstacles that move are where they are then,
            and touched at the distance by which their uncertainty has grown.  None: all stand as at time 0.

    Returns:
        Booleans, shape (...,).

    Raises:
        InvalidValueError: for a q of wrong length, or with NaN or infinity, or a time below 0.
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
    """Whether a robot at q, shape (T, n), touches obstacles where they are at times [s], shape (T,)."""
    states = movers.states(q, times)
    found = _checkers()(movers.robot, movers.scene).nearer(states, movers.uncertainty * times)
    if not movers.alike:
        for k in np.flatnonzero(found):
            found[k] = least_clearance_of_movers(movers, states[[k]], times[[k]]).distance <= 0.0
    return found


@functools.cache
def _checkers() -> Callable[[PepperModel, Scene | None], FastChecker]:
    """Return `fast_checker_for`, which loads machine code: not before the first check."""
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
    """Return those of some points that are not of the robot itself, nor of what it holds.

    For clouds of a camera that sees the robot's own arms, before `Scene.add_point_cloud`.

    Args:
        pepper: The robot.
        q: Its joint positions when the points were seen [rad or m], shape (n,).
        points: Points in the world [m], shape (k, 3).
        scene: What the robot holds; objects of the world do not matter.  None for nothing.
        margin: Points nearer to the robot's shapes than this are the robot's [m].

    Returns:
        The others, shape (m, 3), in their order.  A mesh that is not convex counts as its convex hull.

    Raises:
        InvalidValueError: for a q or points of wrong shape, or with NaN or infinity, a margin below 0, or a
            robot whose shapes the compiled check does not know.
    """
    cloud = np.ascontiguousarray(as_finite(points, "points", (None, 3)))
    return cloud[~_checkers()(pepper, scene).near(q, cloud, not_negative("margin", margin))]


def clearance(
    pepper: PepperModel, q: ArrayLike, scene: Scene | None = None, *, to: PairsTo = "all"
) -> NDArray[np.float64]:
    """Return the exact smallest distance of the robot to itself and the scene, or to one of them.

    Neighboring bodies that `in_collision` decides by joint ranges have no distance and do not count here.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        scene: The world around it; None for the robot against itself only.
        to: "self" for the distance of the robot, and of what it holds, to itself; "obstacles" for that to
            the objects of the scene; "all" for the lesser.

    Returns:
        Distances [m], shape (...,); below zero where shapes overlap, inf where there is no such pair.

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
        to: As in `clearance`.

    Returns:
        The pair; None where nothing is checked.

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
    """Return where things touch at one configuration, the deepest first.

    Each pair of links or objects is listed once, where it is nearest.  A pair of neighboring links that a
    table of joint ranges decides comes last, without points.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (n,).
        scene: The world around it, with what the robot holds; None for the robot against itself only.
        within: Pairs nearer than this are listed as well [m].
        geometry_type: "collision" for the shapes that contain the bodies; "visual" for the surfaces that are
            drawn, which are the vendor's where the robot was loaded with its meshes.

    Returns:
        The contacts.

    Raises:
        InvalidValueError: for a q of wrong length, or with NaN or infinity; for `within` below 0.
    """
    return checker_for(pepper, scene, geometry_type=geometry_type).contact_points(q, within)
