"""Depths and normals of overlapping round shapes, where coal's result is not minimal or missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin.arrays import Array

_MEET = 1e-9  # distance of axes that count as intersecting [m]
_HERE = 1e-12  # length that counts as zero [m]

Pose = tuple[Array, Array]
"""Pose in the world: rotation, shape (3, 3), and position [m], shape (3,)."""


@dataclass(frozen=True, eq=False)
class Witness:
    """Replacement of coal's `DistanceResult` of a pair, computed separately.

    Attributes:
        min_distance: Distance [m]; if negative, minus the minimum translation that separates the two.
        normal: Unit vector from the first to the second, shape (3,).
        points: Nearest points, or the deepest, one on each [m], shape (2, 3).
    """

    min_distance: float
    normal: Array
    points: Array

    def getNearestPoint1(self) -> Array:  # noqa: N802 (coal's name)
        """Return the point on the first shape, shape (3,) [m]."""
        return np.asarray(self.points[0])

    def getNearestPoint2(self) -> Array:  # noqa: N802 (coal's name)
        """Return the point on the second shape, shape (3,) [m]."""
        return np.asarray(self.points[1])


def is_round(shape: Any) -> bool:
    """Return whether a shape of coal's is a sphere, a capsule or a cylinder."""
    import coal

    return isinstance(shape, (coal.Sphere, coal.Capsule, coal.Cylinder))


def witness(shapes: tuple[Any, Any], poses: tuple[Pose, Pose], result: Any) -> Any:
    """Return coal's result on a pair of round shapes, or a better one.

    The minimum translation that separates a sphere and a cylinder is known in closed form; coal's search
    finds a longer one if the sphere's center is inside (fcl#575).  If axes of spheres and capsules intersect,
    coal returns no normal, or one along which the depth does not separate them: any normal perpendicular to
    both axes does, by the sum of their radii.

    Args:
        shapes: Coal's shapes.
        poses: Poses of the shapes.
        result: Coal's `DistanceResult`.
    """
    import coal

    first, second = shapes
    if isinstance(first, coal.Cylinder) and isinstance(second, coal.Sphere):
        return _of_cylinder(first, poses[0], second.radius, poses[1][1])
    if isinstance(first, coal.Sphere) and isinstance(second, coal.Cylinder):
        found = _of_cylinder(second, poses[1], first.radius, poses[0][1])
        return Witness(found.min_distance, -found.normal, found.points[::-1])
    if coal.Cylinder in (type(first), type(second)):
        return result
    if result.min_distance > _MEET - first.radius - second.radius:
        return result
    return _of_axes(first, poses[0], second, poses[1])


def _of_cylinder(cylinder: Any, pose: Pose, radius: float, center: Array) -> Witness:
    """Return the witness of a cylinder and a sphere with radius [m] and center, shape (3,) [m]."""
    rotation, position = pose
    local = rotation.T @ (center - position)
    out = float(np.hypot(local[0], local[1]))
    side = np.array([local[0] / out, local[1] / out, 0.0]) if out > _HERE else np.array([1.0, 0.0, 0.0])
    end = np.array([0.0, 0.0, 1.0 if local[2] >= 0.0 else -1.0])
    beside, above = out - cylinder.radius, abs(local[2]) - cylinder.halfLength
    near = local - max(beside, 0.0) * side - max(above, 0.0) * end
    if max(beside, above) <= 0.0:
        normal, apart = (side, beside) if beside > above else (end, above)
        near = local - apart * normal
    else:
        apart = float(np.hypot(max(beside, 0.0), max(above, 0.0)))
        normal = (local - near) / apart
    normal = rotation @ normal
    return Witness(apart - radius, normal, np.array([rotation @ near + position, center - radius * normal]))


def _of_axes(first: Any, pose: Pose, second: Any, other: Pose) -> Witness:
    """Return the witness of two spheres or capsules whose axes intersect."""
    ends = [
        getattr(shape, "halfLength", 0.0) * rotation[:, 2]
        for shape, (rotation, _) in ((first, pose), (second, other))
    ]
    normal = np.cross(ends[0], ends[1])
    if np.linalg.norm(normal) <= _HERE:  # the axes are parallel, or one shape is a sphere
        line = max(ends, key=lambda axis: float(np.linalg.norm(axis)))
        normal = np.cross(line, np.eye(3)[int(np.argmin(np.abs(line)))])
        normal = normal if np.linalg.norm(normal) > _HERE else np.array([0.0, 0.0, 1.0])
    normal = normal / np.linalg.norm(normal)
    # Intersection of the axes: the point of each that is nearest to the other.
    matrix = np.column_stack([ends[0], -ends[1]])
    shares = np.clip(np.linalg.lstsq(matrix, other[1] - pose[1], rcond=None)[0], -1.0, 1.0)
    middle = 0.5 * (pose[1] + shares[0] * ends[0] + other[1] + shares[1] * ends[1])
    points = np.array([middle + first.radius * normal, middle - second.radius * normal])
    return Witness(-(first.radius + second.radius), normal, points)
