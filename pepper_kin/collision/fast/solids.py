"""The robot's and the scene's shapes as compiled code sees them: a core grown by a radius."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pepper_kin.collision.bodies import WORLD
from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.core.collision.layout import BOX, CYLINDER, HULL, OTHER, Array
from pepper_kin.model.shapes import read_only

VAST = 25.0
"""Half length of the box that stands for a half-space [m]: single precision still tells 4e-6 m there."""


@dataclass(frozen=True, eq=False)
class Solid:
    """All points within `radius` of a core.

    Attributes:
        owner: Name of the link or scene object.
        joint: Number of the joint in `pinocchio_model` that carries it; 0 is the world.
        rotation: (3, 3), the core's axes in the joint's frame.
        position: (3,), the core's centre in the joint's frame [m].
        kind: BOX, CYLINDER (along z), HULL (of `vertices`) or OTHER (known to coal only).
        half: (3,), half lengths of the box around the core [m]; infinite where OTHER has no bounds.
        radius: How far the solid reaches beyond its core [m].
        vertices: (k, 3), of a HULL, relative to the core's centre and axes [m].
        filled: Whether the core is the whole shape, not just its convex hull.
    """

    owner: str
    joint: int
    rotation: Array
    position: Array
    kind: int
    half: Array
    radius: float
    vertices: Array
    filled: bool = True

    @property
    def segment(self) -> bool:
        """Whether the core is a segment along z or a point."""
        return self.kind == BOX and self.half[0] == 0.0 and self.half[1] == 0.0

    @property
    def bounding_radius(self) -> float:
        """Radius of the sphere around the core's centre that holds the solid [m]."""
        if self.kind == HULL:
            return float(np.linalg.norm(self.vertices, axis=1).max()) + self.radius
        reach = np.hypot(self.half[0], self.half[2]) if self.kind == CYLINDER else np.linalg.norm(self.half)
        return float(reach) + self.radius


class Part(NamedTuple):
    """A shape as a checker holds it.

    Attributes:
        owner: Name of the link or scene object.
        item: Pinocchio's geometry object.
        in_world: Whether it stands in the scene.
        padding: How far it reaches beyond coal's shape [m].
    """

    owner: str
    item: Any
    in_world: bool
    padding: float


def parts_of(checker: CollisionChecker) -> list[Part]:
    """Return the shapes that a checker compares, in its order; the only look into how it keeps them."""
    return [Part(b.owner, b.geometry_object, b.kind == WORLD, b.padding) for b in checker._bodies]


def solid_of(part: Part) -> Solid:
    """Return a shape as a core grown by a radius."""
    import coal

    shape, pose = part.item.geometry, part.item.placement
    none = np.zeros((0, 3))
    kind, half, radius, vertices, middle, filled = OTHER, np.full(3, np.inf), 0.0, none, np.zeros(3), True
    if isinstance(shape, coal.Box):
        kind, half = BOX, np.array(shape.halfSide)
    elif isinstance(shape, coal.Sphere):
        kind, half, radius = BOX, np.zeros(3), float(shape.radius)
    elif isinstance(shape, coal.Capsule):
        kind, half, radius = BOX, np.array([0.0, 0.0, shape.halfLength]), float(shape.radius)
    elif isinstance(shape, coal.Cylinder):
        kind, half = CYLINDER, np.array([shape.radius, shape.radius, shape.halfLength])
    elif isinstance(shape, coal.Halfspace):
        return _half_space(part)
    else:
        points = _points(shape)
        if points is not None and len(points):
            low, high = points.min(axis=0), points.max(axis=0)
            middle, half, kind = (low + high) / 2, (high - low) / 2, HULL
            vertices, filled = _corners(points - middle), isinstance(shape, coal.ConvexBase)
    rotation = np.array(pose.rotation)
    position = rotation @ middle + np.array(pose.translation)
    return Solid(
        part.owner, int(part.item.parentJoint), read_only(rotation), read_only(position), kind,
        read_only(half), radius + part.padding, read_only(vertices), filled,
    )  # fmt: skip


def _half_space(part: Part) -> Solid:
    """Return a half-space n . x <= d as a box that holds all of it within VAST of the world's origin."""
    pose, shape = part.item.placement, part.item.geometry
    normal = np.array(pose.rotation) @ np.array(shape.n)
    offset = float(shape.d) + float(normal @ np.array(pose.translation))
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    rotation = np.column_stack([across, np.cross(normal, across), normal])
    position = (offset - VAST) * normal
    return Solid(
        part.owner, int(part.item.parentJoint), read_only(rotation), read_only(position), BOX,
        read_only(np.full(3, VAST)), part.padding, read_only(np.zeros((0, 3))),
    )  # fmt: skip


def _points(shape: Any) -> Array | None:
    """Return the vertices of a convex polytope, a mesh or a cloud; None of anything else."""
    import coal

    if isinstance(shape, coal.ConvexBase):
        return np.array(shape.points()).reshape(-1, 3)
    if isinstance(shape, coal.BVHModelBase):
        return np.array(shape.vertices()).reshape(-1, 3)
    return None


def _corners(points: Array) -> Array:
    """Return those of the points that span their convex hull; all of them where they lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return points
