"""Motion bounds of joints for all points of a robot, proven from the tree of its joints and their ranges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision.coal_shapes import coal_geometry
from pepper_kin.core.motion_bounds import MotionTree, body_motion_bounds
from pepper_kin.model import Box, Capsule, Cylinder, Geometry, PepperModel, Sphere, kept_for_robot
from pepper_kin.model.moving_tree import moving_tree
from pepper_kin.model.tree_order import depth_first

SLACK = 1e-6
"""Distance by which joints may leave their ranges [rad or m]."""

LEAST = 1e-3
"""Minimum bound of a joint, which is a weight of a metric and so must be positive [m/rad or 1]."""

_SIGNS = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, -1).T


class Hull(NamedTuple):
    """A body within the convex hull of equal spheres.

    Attributes:
        joint: Index of the joint of the Pinocchio model that carries it, 0 for the base.
        centers: Centers of the spheres in that joint's frame [m], shape (k, 3).
        radius: Radius of all spheres [m].
    """

    joint: int
    centers: Array
    radius: float


def motion_bounds(
    pepper: PepperModel,
    lower: Array | None = None,
    upper: Array | None = None,
    held: tuple[tuple[str, float], ...] = (),
) -> Array:
    """Return how far each joint can move a point of the body, per radian or meter.

    No point of the robot's collision shapes moves by more than sum_j r_j |dq_j| while all joints stay within
    the given ranges; see `pepper_kin.core.motion_bounds`.

    Args:
        pepper: The robot.
        lower: Lower ends of the joints' ranges, shape (n,) [rad or m]; the joint limits if omitted.
        upper: Upper ends of the joints' ranges, shape (n,) [rad or m]; the joint limits if omitted.
        held: Frame of each attached object, and maximum distance of its points from the frame's origin [m].

    Returns:
        r, shape (n,) [m/rad, or 1 for a prismatic joint], positive; infinite if a prismatic joint that is
        carried has no limits.

    Raises:
        FileFormatError: for a mesh whose file cannot be read.
    """
    if lower is None and upper is None:
        return _within_limits(pepper, held)
    low = pepper.lower_limits if lower is None else np.asarray(lower, dtype=float)
    high = pepper.upper_limits if upper is None else np.asarray(upper, dtype=float)
    return _bounds(pepper, motion_tree(pepper, held), low, high)


def bounds_anywhere(pepper: PepperModel) -> Array:
    """Return `motion_bounds` for unlimited revolute joints and prismatic joints within their limits."""
    slides = np.array([unit == "m" for unit in pepper.joint_units])
    lower, upper = (
        np.where(slides, pepper.lower_limits, -np.inf),
        np.where(slides, pepper.upper_limits, np.inf),
    )
    return motion_bounds(pepper, lower, upper)


def motion_bounds_of(pepper: PepperModel, hulls: Sequence[Hull]) -> Array:
    """Return how far each joint of the Pinocchio model moves each given body, shape (m, nv) [m/rad or 1].

    Revolute joints are unlimited, prismatic joints within their limits.  Infinite for a body without bounds.
    """
    bounded = [
        hull if np.isfinite(hull.centers).all() else Hull(hull.joint, np.zeros((1, 3)), np.inf)
        for hull in hulls
    ]
    tree = tree_of(pepper, bounded)
    moving = [joint for joint in depth_first(pepper.document) if joint.type != "fixed"]
    lower = np.where(tree.slides, [joint.lower for joint in moving], -np.inf)
    upper = np.where(tree.slides, [joint.upper for joint in moving], np.inf)
    motion_bounds = np.empty((len(hulls), tree.parents.size))
    body_motion_bounds(tree, lower, upper, motion_bounds)
    return motion_bounds


@kept_for_robot(most=32)
def motion_tree(pepper: PepperModel, held: tuple[tuple[str, float], ...] = ()) -> MotionTree:
    """Return the joints of a robot with its collision shapes and attached objects as bodies, cached."""
    tree, hulls = moving_tree(pepper), []
    for shape in pepper.collision_shapes:
        pose = tree.frame_poses[shape.link] @ shape.transform_shape_to_link
        points, radius = _hull(shape.geometry)
        joint = tree.frame_joints[shape.link]
        hulls.append(Hull(joint, points @ pose[:3, :3].T + pose[:3, 3], radius))
    for name, extent in held:
        hulls.append(Hull(tree.frame_joints[name], tree.frame_poses[name][None, :3, 3], extent))
    return tree_of(pepper, hulls)


def tree_of(pepper: PepperModel, hulls: Sequence[Hull]) -> MotionTree:
    """Return the joints of a robot with given bodies."""
    tree = moving_tree(pepper)
    counts = [len(hull.centers) for hull in hulls]
    return MotionTree(
        parents=np.array(tree.parents[1:], dtype=np.int64) - 1,
        rotations=tree.rotations[1:],
        offsets=tree.positions[1:],
        axes=tree.axes[1:],
        slides=tree.slides[1:],
        carriers=np.array([hull.joint - 1 for hull in hulls], dtype=np.int64),
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        centers=np.concatenate([np.empty((0, 3)), *(hull.centers for hull in hulls)]),
        radii=np.repeat([float(hull.radius) for hull in hulls], counts),
    )


@kept_for_robot(most=32)
def _within_limits(pepper: PepperModel, held: tuple[tuple[str, float], ...]) -> Array:
    return read_only(_bounds(pepper, motion_tree(pepper, held), pepper.lower_limits, pepper.upper_limits))


def _bounds(pepper: PepperModel, tree: MotionTree, lower: Array, upper: Array) -> Array:
    """Return how far a unit of each joint moves any body, shape (n,) [m/rad, or 1], within bounds of q.

    Args:
        pepper: The robot.
        tree: Joints and bodies.
        lower: Minimum joint positions [rad or m], shape (n,).
        upper: Maximum joint positions [rad or m], shape (n,).
    """
    gains, taken = np.asarray(pepper.full_map), np.asarray(pepper.full_map) != 0.0
    low, high = lower - SLACK, upper + SLACK
    if pepper.is_coupled:  # q_full = gains q + offset
        ends = np.where(taken, gains, 1.0) * np.stack((low, high))[:, None]
        low, high = (
            pepper.full_offset + np.where(taken, end, 0.0).sum(axis=1)
            for end in (ends.min(axis=0), ends.max(axis=0))
        )
    motion_bounds = np.empty((tree.carriers.size, tree.parents.size))
    body_motion_bounds(tree, np.ascontiguousarray(low), np.ascontiguousarray(high), motion_bounds)
    greatest = np.where(taken, motion_bounds.max(axis=0, initial=0.0)[:, None], 0.0)
    return np.maximum((np.abs(gains) * greatest).sum(axis=0), LEAST)


def _hull(geometry: Geometry) -> tuple[Array, float]:
    """Return spheres whose hull encloses a geometry: centers in its frame, shape (k, 3), and radius [m]."""
    if isinstance(geometry, Sphere):
        return np.zeros((1, 3)), geometry.radius
    if isinstance(geometry, Capsule):
        return np.array([[0.0, 0.0, -geometry.length / 2], [0.0, 0.0, geometry.length / 2]]), geometry.radius
    if isinstance(geometry, Box):
        return _SIGNS * np.array(geometry.size) / 2, 0.0
    if isinstance(geometry, Cylinder):
        return _SIGNS * [geometry.radius, geometry.radius, geometry.length / 2], 0.0
    mesh = coal_geometry(geometry)
    mesh.computeLocalAABB()
    low, high = np.array(mesh.aabb_local.min_), np.array(mesh.aabb_local.max_)
    return (low + high) / 2 + _SIGNS * (high - low) / 2, 0.0
