"""Shapes and pairs as the tables that `core.collision.distances` reads."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pepper_kin.collision.fast.joint_table import pose_of
from pepper_kin.core.collision.distances import (
    BOUNDED,
    BOX,
    BOXED,
    BY_BALLS,
    BY_HEIGHT,
    MEASURED,
    PLANE,
    SEGMENT,
)  # fmt: skip


def shape_row(item: Any) -> list[float]:
    """Return the numbers of one of Pinocchio's geometry objects, without padding; see SHAPE."""
    import coal
    import pinocchio

    shape, place, radius = item.geometry, item.placement, 0.0
    if isinstance(shape, coal.Sphere):
        kind, half, radius = SEGMENT, [0.0, 0.0, 0.0], float(shape.radius)
    elif isinstance(shape, coal.Capsule):
        kind, half, radius = SEGMENT, [0.0, 0.0, float(shape.halfLength)], float(shape.radius)
    elif isinstance(shape, coal.Box):
        kind, half = BOX, shape.halfSide.tolist()
    elif isinstance(shape, coal.Halfspace):
        # Its z axis points out of it, and its origin lies on its surface.
        turn = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(shape.n))
        place = place * pinocchio.SE3(turn.matrix(), np.array(shape.n) * shape.d)
        kind, half = PLANE, [0.0, 0.0, 0.0]
    else:
        shape.computeLocalAABB()
        low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
        place = place * pinocchio.SE3(np.eye(3), (low + high) / 2)
        kind, half = BOXED, ((high - low) / 2).tolist()
    return [kind, item.parentJoint, *pose_of(place), *half, radius, math.hypot(*half) + radius]


def pair_row(a: int, b: int, kinds: list[int]) -> tuple[int, int, int, bool]:
    """Return how to look at a pair: its shapes, perhaps in exchange; how; and whether exchanged."""
    swapped = bool(kinds[a] == PLANE or (kinds[a] != SEGMENT and kinds[b] == SEGMENT))
    first, second = (b, a) if swapped else (a, b)
    if kinds[second] == PLANE:
        how = BY_HEIGHT
    elif kinds[first] != SEGMENT:
        how = BY_BALLS
    else:
        how = BOUNDED if kinds[second] == BOXED else MEASURED
    return first, second, how, swapped
