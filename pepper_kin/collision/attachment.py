"""Attaching an obstacle to a frame of the robot, and releasing it into the world."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision.scene_object import AttachedObject, SceneObject, as_rigid
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors


def attached(
    item: SceneObject,
    frame: str,
    transform_object_to_frame: ArrayLike | None,
    pepper: PepperModel | None,
    q: ArrayLike | None,
    touch_links: Iterable[str],
    mass: float,
    center_of_mass: ArrayLike | None,
) -> AttachedObject:
    """Return an obstacle as an object that is attached to a frame; see `Scene.attach`.

    Args:
        item: The obstacle.
        frame: Frame of the robot to which it is attached.
        transform_object_to_frame: Pose of the object in the frame, translation in [m], shape (4, 4); or None.
        pepper: Without a pose, the robot that grasps the object at its current pose in the world.
        q: Joint positions of that robot [rad or m], shape (n,).
        touch_links: Links that the object may touch.
        mass: Mass [kg]; 0 if it does not count.
        center_of_mass: Center of mass in the object's frame [m], shape (3,); None: its centroid.

    Raises:
        UnknownNameError: for a frame or link that a given robot lacks.
        InvalidValueError: for neither or both of transform and robot, or an invalid one; for an invalid mass
            or center of mass.
    """
    links = (touch_links,) if isinstance(touch_links, str) else tuple(touch_links)
    has_pose = transform_object_to_frame is not None
    if has_pose == (pepper is not None) or (pepper is None) != (q is None):
        raise InvalidValueError(
            f"place of {item.name!r} on the robot",
            "both of two ways to give it, neither, or one without its second argument",
            "either transform_object_to_frame, or pepper and q",
        )
    if pepper is None or q is None:
        quantity = f"transform_object_to_frame of {item.name!r}"
        pose = as_rigid(np.asarray(transform_object_to_frame), quantity)
    else:
        pose = np.linalg.inv(_frame_pose(pepper, q, frame)) @ item.transform_object_to_world
        for link in links:
            pepper.frame_id(link)
    center = None if center_of_mass is None else np.asarray(center_of_mass)
    return AttachedObject(item.name, item.geometry, frame, pose, links, item.color, mass, center)


def released(item: AttachedObject, pepper: PepperModel, q: ArrayLike) -> SceneObject:
    """Return an attached object as an obstacle at its pose at q, shape (n,) [rad or m].

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        InvalidValueError: for a q of wrong length, or with NaN or infinity.
    """
    pose = _frame_pose(pepper, q, item.frame) @ item.transform_object_to_frame
    return SceneObject(item.name, item.geometry, pose, item.color)


def _frame_pose(pepper: PepperModel, q: ArrayLike, frame: str) -> NDArray[np.float64]:
    """Return a frame's pose in the world, shape (4, 4), at joint positions q [rad or m], shape (n,)."""
    state = as_joint_vectors(pepper, q, "q")
    if state.ndim != 1:
        raise InvalidValueError("q", f"shape {state.shape}", f"one configuration, shape ({pepper.n},)")
    return frame_pose(pepper, state, frame)
