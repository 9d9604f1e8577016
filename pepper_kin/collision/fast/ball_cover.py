"""Spheres that cover a solid, and spheres inside it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision.fast.solids import Solid
from pepper_kin.collision.kept_size import MOST_BYTES, bytes_of, kept_within
from pepper_kin.core.collision.bounding_balls import ball_around_balls, ball_within_planes
from pepper_kin.core.collision.layout import BOX, CLOUD, CYLINDER, HULL

WASTE = 0.008
"""Maximum excess of a covering sphere's radius over the capsule's radius [m]."""
CELL = 0.11
"""Maximum length of the cells into which boxes and cylinders are divided, with a sphere for each [m]."""
PROTRUSION = 0.012
"""Protrusion of a part's sphere out of the hull above which the part is halved [m],"""
MOST = 7
"""up to this number of parts: with six, adjacent links of a UR5 are always in doubt, with ten, searches take
longer."""
MOST_INNER = 5
"""Maximum number of inner spheres that are not concentric with outer ones."""
LEAST_INNER = 0.01
"""Minimum radius of these additional inner spheres [m]."""
_ROUNDING = 1e-9


class BallCover(NamedTuple):
    """Covering and inner spheres of one solid.

    Attributes:
        centers: (k, 3), in the frame of the joint that carries the solid [m].
        outer: (k,), radii of spheres that together cover the solid; some exist for the inner ones only [m].
        inner: (k,), radii of concentric spheres inside the solid; negative where there is none [m].
    """

    centers: Array
    outer: Array
    inner: Array


@kept_within(MOST_BYTES / 4, bytes_of)  # the cover of each solid of a robot is requested some twenty times
def ball_cover(solid: Solid, waste: float = WASTE, cell: float = CELL) -> BallCover:
    """Cover a solid by spheres.

    A capsule of radius r gets k spheres with centers on its axis, from one end to the other.  At spacing s
    they cover it if their radius is sqrt(r^2 + (s / 2)^2), while concentric spheres of radius r are inside.
    A box or a cylinder is divided into cells, each with its bounding sphere; the largest sphere about the
    cell's center that stays in the solid is the inner one.  The convex hull of points is halved repeatedly,
    see `_hull_cover`.

    Args:
        solid: A solid with bounds.
        waste: Maximum difference of outer and inner radius of a capsule [m].
        cell: Maximum length of a cell [m].
    """
    if solid.kind in (HULL, CLOUD):
        local, outers, inners = _hull_cover(solid.vertices.tobytes())
        outers, inners = outers + solid.radius, inners + solid.radius
    elif solid.segment:
        length = 2.0 * float(solid.half[2])
        count, outer = 1, solid.radius + length / 2
        while outer - solid.radius > waste:
            count += 1
            outer = math.hypot(solid.radius, length / (count - 1) / 2)
        along = np.zeros(1) if count == 1 else np.linspace(-length / 2, length / 2, count)
        local = along[:, None] * np.array([0.0, 0.0, 1.0])
        outers, inners = np.full(count, outer), np.full(count, solid.radius)
    else:
        counts = np.maximum(1, np.ceil(2 * solid.half / cell)).astype(int)
        steps = [h / n * np.arange(1 - n, n, 2) for h, n in zip(solid.half, counts, strict=True)]
        local = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        outers = np.full(len(local), float(np.linalg.norm(solid.half / counts)) + solid.radius)
        depth = solid.half - np.abs(local)
        if solid.kind == CYLINDER:
            depth[:, 0] = depth[:, 1] = solid.half[0] - np.hypot(local[:, 0], local[:, 1])
        inners = depth.min(axis=1) + solid.radius
        inners = inners if solid.kind in (BOX, CYLINDER) else np.full(len(local), -1.0)
    if not solid.filled or solid.kind == CLOUD:
        inners = np.full(len(local), -1.0)
    centers = local @ solid.rotation.T + solid.position
    return BallCover(read_only(centers), read_only(outers), read_only(inners))


def ball_around(points: Array, radii: Array) -> tuple[Array, float]:
    """Return center, shape (3,), and radius of a small sphere that encloses spheres [m].

    Args:
        points: Centers of the spheres [m], shape (k, 3).
        radii: Radii of the spheres [m], shape (k,).
    """
    center = np.empty(3)
    return center, ball_around_balls(np.ascontiguousarray(points), radii, center)


@kept_within(MOST_BYTES / 4, bytes_of)
def _hull_cover(vertices: bytes) -> tuple[Array, Array, Array]:
    """Return centers, outer and inner radii of spheres for the convex hull of points.

    The hull's bounding box is halved across its longest side, starting with the part whose sphere protrudes
    farthest out of the hull.  The sphere around a part encloses the corners of the intersection of box and
    hull: the hull's corners in the box, the hull's edges at the box's faces, and the ends of the box's edges
        within
    the hull.
    """
    from scipy.spatial import ConvexHull, QhullError

    points = np.frombuffer(vertices).reshape(-1, 3)
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):  # all points are in a plane
        center, radius = ball_around(points, np.zeros(len(points)))
        return center[None], np.array([radius]), np.array([-1.0])
    planes = np.ascontiguousarray(np.unique(np.round(hull.equations, 12), axis=0))
    sides = np.concatenate([hull.simplices[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    edges = points[np.unique(np.sort(sides, axis=1), axis=0)]
    corners = points[hull.vertices]
    parts = [_part(corners, edges, planes, corners.min(axis=0), corners.max(axis=0))]
    while len(parts) < MOST:
        widest = max(range(len(parts)), key=lambda k: parts[k][1] - parts[k][2])
        _, outer, inner, low, high = parts[widest]
        if outer - inner <= PROTRUSION:
            break
        axis = int(np.argmax(high - low))
        middle = (low[axis] + high[axis]) / 2
        below, above = high.copy(), low.copy()
        below[axis] = above[axis] = middle
        halves = (low, below), (above, high)
        parts[widest : widest + 1] = [_part(corners, edges, planes, *half) for half in halves]
    centers, outers, inners = (np.array([part[k] for part in parts]) for k in range(3))
    deeper = [_deepest(planes, *part[3:]) for part in parts]
    found: list[tuple[Array, float]] = []
    for center, radius in sorted(deeper, key=lambda ball: -ball[1])[:MOST_INNER]:
        if all(np.linalg.norm(center - other) > 0.5 * radius for other, _ in found) and radius > LEAST_INNER:
            found.append((center, radius))
    radii = np.array([radius for _, radius in found])
    centers = np.concatenate([centers, np.array([center for center, _ in found]).reshape(-1, 3)])
    return centers, np.concatenate([outers, radii]), np.concatenate([inners, radii])


def _deepest(planes: Array, low: Array, high: Array) -> tuple[Array, float]:
    """Return center, shape (3,), and radius [m] of a large sphere inside a hull whose center is in a box.

    Args:
        planes: Outward unit normals of the hull's faces and offsets [m], n . x + d <= 0 inside, shape (f, 4).
        low: Minimum corner of the box [m], shape (3,).
        high: Maximum corner of the box [m], shape (3,).
    """
    center = np.empty(3)
    return center, ball_within_planes(planes, low, high, center) - _ROUNDING


_FACES = [(axis, side) for axis in range(3) for side in (0, 1)]
_ENDS = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T


def _part(
    corners: Array, edges: Array, planes: Array, low: Array, high: Array
) -> tuple[Array, float, float, Array, Array]:
    """Return the bounding sphere of a box and a hull's intersection, its inner radius, and its bounds [m].

    Args:
        corners: Corners of the hull [m], shape (c, 3).
        edges: Both ends of the hull's edges [m], shape (e, 2, 3).
        planes: Outward unit normals of its faces and offsets [m], n . x + d <= 0 inside, shape (f, 4).
        low: Minimum corner of the box [m], shape (3,).
        high: Maximum corner of the box [m], shape (3,).
    """
    low, high = low - _ROUNDING, high + _ROUNDING
    found = [corners]
    start, way = edges[:, 0], edges[:, 1] - edges[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis, side in _FACES:
            share = ((low, high)[side][axis] - start[:, axis]) / way[:, axis]
            crossing = (share >= 0) & (share <= 1)
            found.append(start[crossing] + share[crossing, None] * way[crossing])
        box = low + _ENDS * (high - low)
        for axis in range(3):
            first = box[_ENDS[:, axis] == 0]
            step = np.eye(3)[axis] * (high - low)
            rate, slack = planes[:, :3] @ step, -(first @ planes[:, :3].T + planes[:, 3])
            bound = slack / rate
            enter = np.where(rate < 0, bound, 0.0).max(axis=1, initial=0.0)
            leave = np.where(rate > 0, bound, 1.0).min(axis=1, initial=1.0)
            outside = ((rate == 0) & (slack < -_ROUNDING)).any(axis=1)
            kept = (enter <= leave + _ROUNDING) & ~outside
            found += [first[kept] + share[kept, None] * step for share in (enter, leave)]
    points = np.concatenate(found)
    points = points[((points >= low - _ROUNDING) & (points <= high + _ROUNDING)).all(axis=1)]
    center, outer = ball_around(points, np.zeros(len(points)))
    inner = -float((planes[:, :3] @ center + planes[:, 3]).max()) - 2 * _ROUNDING
    return center, outer + 4 * _ROUNDING, inner, points.min(axis=0), points.max(axis=0)
