"""A metric in which a distance between configurations bounds how far any point of the body moves."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.coal_shapes import coal_geometry
from pepper_kin.kinematics import frame_jacobian
from pepper_kin.model import Box, Capsule, Cylinder, Geometry, PepperModel, Sphere
from pepper_kin.model.shapes import read_only

_SAMPLES = 48


@lru_cache(maxsize=16)
def joint_reaches(pepper: PepperModel, held: tuple[tuple[str, float], ...] = ()) -> NDArray[np.float64]:
    """Return how far each joint can move a point of the body, per radian or metre.

    r_j = max over sampled configurations and over the links' collision shapes of |dp/dq_j| + the shape's
    extent: a bound on the speed of any point of the shape per unit of joint speed, up to sampling.  A mesh
    counts as the ball around its bounding box.

    Args:
        pepper: The robot.
        held: For each object that hangs on the robot, its frame and the greatest distance of a point of it
            from the frame's origin [m].

    Returns:
        r, shape (n,) [m/rad, or 1 for a prismatic joint], above zero.

    Raises:
        FileFormatError: for a mesh whose file cannot be read.
    """
    rng = np.random.default_rng(0)
    lower = np.clip(pepper.lower_limits, -np.pi, np.pi)
    upper = np.clip(pepper.upper_limits, -np.pi, np.pi)
    q = rng.uniform(lower, upper, (_SAMPLES, pepper.n))
    extents: dict[str, float] = {}
    for shape in pepper.collision_shapes:
        extent = float(np.linalg.norm(shape.transform_shape_to_link[:3, 3])) + _radius(shape.geometry)
        extents[shape.link] = max(extent, extents.get(shape.link, 0.0))
    for frame, extent in held:
        extents[frame] = max(extent, extents.get(frame, 0.0))
    reach = np.full(pepper.n, 1e-3)
    revolute = np.array([unit == "rad" for unit in pepper.joint_units])
    for link, extent in extents.items():
        jacobian = frame_jacobian(pepper, q, link)
        turns = np.linalg.norm(jacobian[:, 3:], axis=1) > 1e-9
        speed = np.linalg.norm(jacobian[:, :3], axis=1) + np.where(turns, extent, 0.0)
        reach = np.maximum(
            reach, np.where(revolute, speed, np.linalg.norm(jacobian[:, :3], axis=1)).max(axis=0)
        )
    return read_only(reach)


def _radius(geometry: Geometry) -> float:
    """Greatest distance of a point of the geometry from its frame's origin, or a little more [m]."""
    if isinstance(geometry, Box):
        return float(np.linalg.norm(geometry.size)) / 2
    if isinstance(geometry, Sphere):
        return geometry.radius
    if isinstance(geometry, Capsule):
        return geometry.radius + geometry.length / 2
    if isinstance(geometry, Cylinder):
        return float(np.hypot(geometry.radius, geometry.length / 2))
    mesh = coal_geometry(geometry)
    mesh.computeLocalAABB()
    return float(np.linalg.norm(mesh.aabb_center)) + float(mesh.aabb_radius)
