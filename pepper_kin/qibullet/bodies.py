"""Bodies around the robots of a simulation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import ConvexMesh, TriangleMesh
from pepper_kin.model import Box, Capsule, Cylinder, Sphere


@dataclass
class Standing:
    """A body, as an obstacle of the robots.

    Attributes:
        base: Pose of the root link in the world, shape (4, 4).
        parts: Shapes, and their poses in the root link, shape (4, 4).
    """

    base: Array
    parts: Sequence[tuple[Any, Array]]


def scaled(shape: Any, place: Array, scale: float) -> tuple[Any, Array]:
    """Return a shape and its pose in a body, both scaled by a factor."""
    place = place.copy()
    place[:3, 3] *= scale
    if isinstance(shape, Box):
        x, y, z = shape.size
        return Box((scale * x, scale * y, scale * z)), place
    if isinstance(shape, Sphere):
        return Sphere(scale * shape.radius), place
    if isinstance(shape, Cylinder | Capsule):
        return type(shape)(scale * shape.radius, scale * shape.length), place
    if isinstance(shape, ConvexMesh):
        return ConvexMesh(scale * shape.vertices), place
    return TriangleMesh(scale * shape.vertices, shape.faces), place


def lowest(shape: Any, place: Array) -> float:
    """Return the height of the lowest point of a shape at a pose [m]."""
    up, height = place[2, :3], float(place[2, 3])
    if isinstance(shape, Box):
        return height - float(np.abs(up) @ shape.size) / 2.0
    if isinstance(shape, Sphere):
        return height - shape.radius
    if isinstance(shape, Cylinder | Capsule):
        round_ = math.sqrt(max(0.0, 1.0 - up[2] ** 2)) if isinstance(shape, Cylinder) else 1.0
        return height - float(abs(up[2])) * shape.length / 2.0 - shape.radius * round_
    return height + float((shape.vertices @ up).min())
