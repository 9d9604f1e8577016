"""Shapes of the robot and the scene for compiled code: a core grown by a radius."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision.coal_shapes import coal_geometry
from pepper_kin.collision.fast.cloud_block import box_around, cloud_block
from pepper_kin.collision.solids import (
    ConvexMesh,
    HalfSpace,
    PointCloud,
    SceneGeometry,
    TriangleMesh,
    padding,
)
from pepper_kin.core.collision.layout import BOX, CLOUD, CYLINDER, HULL, OTHER
from pepper_kin.core.collision.scene_rows import BALL, BAR, BLOCK, ROUND
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, Sphere

VAST = 25.0
"""Half length of the box that represents a half-space [m]: single precision resolves 4e-6 m there."""


@dataclass(frozen=True, eq=False)
class Solid:
    """All points within `radius` of a core.

    Attributes:
        owner: Name of the link or scene object.
        joint: Index of the joint in `pinocchio_model` that carries it; 0 is the world.
        rotation: (3, 3), the core's axes in the joint's frame.
        position: (3,), the core's center in the joint's frame [m].
        kind: BOX, CYLINDER (along z), HULL (of `vertices`), CLOUD (in a box) or OTHER (supported by coal
            only).
        half: (3,), half lengths of the box around the core [m]; infinite if OTHER has no bounds.
        radius: Distance by which the solid extends beyond its core [m].
        vertices: (k, 3), vertices of a HULL, or of the hull of a moving CLOUD, relative to the core's center
            and axes [m].
        filled: Whether the core is the whole shape, not only its convex hull.
        cloud: Block of a CLOUD.
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
    cloud: Array | None = None

    @property
    def segment(self) -> bool:
        """Whether the core is a segment along z or a point."""
        return self.kind == BOX and self.half[0] == 0.0 and self.half[1] == 0.0

    @cached_property
    def bounding_radius(self) -> float:
        """Radius of the sphere around the core's center that encloses the solid [m]."""
        if self.kind == HULL:
            return float(np.linalg.norm(self.vertices, axis=1).max()) + self.radius
        x, y, z = self.half.tolist()
        return math.hypot(x, z if self.kind == CYLINDER else math.hypot(y, z)) + self.radius

    @cached_property
    def row(self) -> Array:
        """Row of the solid, shape (ROW,), see `core.collision.scene_rows`."""
        corner = math.sqrt(sum([half * half for half in self.half.tolist() if math.isfinite(half)]))
        numbers = [self.kind, self.radius, self.bounding_radius, self.filled, corner, *self.half.tolist()]
        return np.array([*numbers, *self.position.tolist(), *self.rotation.T.ravel().tolist()])


def simple_shape(geometry: SceneGeometry) -> tuple[float, float, float, float] | None:
    """Return the kind and three sizes [m] of a primitive shape; None for meshes, clouds and half-spaces."""
    if type(geometry) is Box:
        return (BLOCK, *geometry.size)
    if type(geometry) is Sphere:
        return BALL, geometry.radius, 0.0, 0.0
    if type(geometry) is Capsule:
        return BAR, geometry.radius, geometry.length, 0.0
    if type(geometry) is Cylinder:
        return ROUND, geometry.radius, geometry.length, 0.0
    return None


def solid_of(owner: str, geometry: SceneGeometry, joint: int, pose: Array, *, stands: bool = False) -> Solid:
    """Return a shape as a core grown by a radius.

    Args:
        owner: Name of the link or scene object.
        geometry: The shape.
        joint: Index of the joint that carries it; 0 is the world.
        pose: (4, 4), transform from the shape's own frame to the joint's.
        stands: Whether it belongs to the world, where clouds are not covered by spheres.

    Raises:
        FileFormatError: for a mesh whose file cannot be read.
    """
    kind, radius, filled = BOX, padding(geometry), True
    rotation, position, vertices, cloud = pose[:3, :3], pose[:3, 3], _NONE, None
    match geometry:
        case Box():
            half = np.array(geometry.size) / 2
        case Sphere():
            half, radius = np.zeros(3), geometry.radius
        case Capsule():
            half, radius = np.array([0.0, 0.0, geometry.length / 2]), geometry.radius
        case Cylinder():
            kind, half = CYLINDER, np.array([geometry.radius, geometry.radius, geometry.length / 2])
        case HalfSpace():
            half = np.full(3, VAST)
            normal = rotation[:, 2]
            rotation, position = _half_space(normal, geometry.offset + float(normal @ position))
        case _:
            points, filled = _points(geometry)
            if not len(points):
                return Solid(owner, joint, rotation, position, OTHER, np.full(3, np.inf), radius, _NONE)
            middle, half = box_around(points)
            position = rotation @ middle + position
            kind = HULL
            if isinstance(geometry, PointCloud):
                kind, cloud, filled = CLOUD, cloud_block(geometry), True
            if kind == HULL or not stands:
                vertices = _corners(points - middle)
    return Solid(
        owner, joint, read_only(rotation), read_only(position), kind, read_only(half), radius,
        read_only(vertices), filled, cloud,
    )  # fmt: skip


_NONE = read_only(np.zeros((0, 3)))


def _half_space(normal: Array, offset: float) -> tuple[Array, Array]:
    """Return axes and center of a box that contains all of n . x <= d within VAST of the world's origin.

    Args:
        normal: n, a unit vector, shape (3,).
        offset: d [m].

    Returns:
        The axes as columns, shape (3, 3), and the center [m], shape (3,).
    """
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(normal, across), normal]), (offset - VAST) * normal


def _points(geometry: ConvexMesh | TriangleMesh | PointCloud | Mesh) -> tuple[Array, bool]:
    """Return the points of a shape, none if they are not known, and whether the shape is their hull."""
    import coal

    if isinstance(geometry, Mesh):
        shape = coal_geometry(geometry)
        if isinstance(shape, coal.ConvexBase):
            return np.array(shape.points()).reshape(-1, 3), True
        known = isinstance(shape, coal.BVHModelBase)
        return np.array(shape.vertices()).reshape(-1, 3) if known else _NONE, False
    points = geometry.points if isinstance(geometry, PointCloud) else geometry.vertices
    return points, isinstance(geometry, ConvexMesh)


def _corners(points: Array) -> Array:
    """Return the points [m], shape (k, 3), that span the convex hull of all, shape (c, 3).

    All points are returned if they lie in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return points
