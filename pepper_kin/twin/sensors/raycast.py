"""Ray casting: distances from points along directions to the first surface of solids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.collision import ConvexMesh, HalfSpace, PointCloud, TriangleMesh
from pepper_kin.collision.kept_size import MOST_BYTES, bytes_of, kept_within
from pepper_kin.collision.mesh_file import file_state, read_mesh
from pepper_kin.collision.solids import SceneGeometry, padding
from pepper_kin.core.ray_casting import (
    BALLS,
    BOX,
    CAPSULE,
    CYLINDER,
    HALF_SPACE,
    SPHERE,
    TRIANGLES,
    Hits,
    Solids,
    box_tree,
    nearest_hits,
    normals_at,
    place_solids,
    unplaced,
)
from pepper_kin.core.shading import Surfaces, paint
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, Sphere
from pepper_kin.model.joint_vectors import as_batch, as_finite, as_numbers

Indices = NDArray[np.int64]

_PARTS_IN_LEAF = 4
_SOLIDS_IN_LEAF = 2


@dataclass(frozen=True, eq=False)
class RayHits(BriefRepr):
    """What rays met first.

    Attributes:
        distance: Along each ray [m], inf where nothing was met, shape (...).
        solid: Index of the solid met, -1 where none was, shape (...).
        normal: Unit normal of its surface, turned against the ray; 0 where nothing was met, shape (..., 3).
    """

    distance: Array
    solid: Indices
    normal: Array


@dataclass(frozen=True, eq=False)
class _Tree:
    """Triangles or balls of one solid with the tree over them."""

    node_box: Array
    node_link: Indices
    parts: Array


class RayCaster:
    """Solids at fixed poses, to cast rays at.

    A ray meets the first surface in its direction; one that starts inside a solid meets that solid's surface
    from within.  Triangle meshes are surfaces; with a padding they are all points within it.  Opacity is
    not looked at.

    Args:
        geometries: Shapes of the solids, m of them.
        poses: transform_solid_to_world of each, shape (m, 4, 4).

    Raises:
        InvalidValueError: for what is no shape of a scene, or poses of a wrong shape or not finite.
        FileFormatError: for a mesh whose file cannot be read.
    """

    def __init__(self, geometries: Sequence[SceneGeometry], poses: ArrayLike) -> None:
        for geometry in geometries:
            if not isinstance(geometry, SceneGeometry):
                raise InvalidValueError("geometry", type(geometry).__name__, "a shape that a scene can hold")
        self._solids = _laid_out(geometries)
        self._bounds = _bounds(self._solids)
        kinds = self._solids.kind
        # A cloud may be empty: its root's box holds nothing.
        held = np.isfinite(self._bounds).all(axis=1)
        self._bounded = np.flatnonzero(held & (kinds != HALF_SPACE))
        self._kept = _no_hits(0)
        self._placed = unplaced(len(kinds), self._bounded, np.flatnonzero(kinds == HALF_SPACE))
        self.place(poses)

    def __len__(self) -> int:
        return len(self._solids.kind)

    def place(self, poses: ArrayLike) -> None:
        """Move the solids.

        Args:
            poses: transform_solid_to_world of each, shape (m, 4, 4); rigid.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        count = len(self)
        pose = as_finite(poses, "poses", (count, 4, 4)) if count or np.size(poses) else np.empty((0, 4, 4))
        self.place_checked(pose)

    def place_checked(self, poses: Array) -> None:
        """Do what `place` does for finite poses of the right shape, (m, 4, 4)."""
        self._placed.pose[:] = poses
        place_solids(self._bounds, self._bounded, _SOLIDS_IN_LEAF, self._placed)

    def cast(self, origins: ArrayLike, directions: ArrayLike, maximum: ArrayLike = np.inf) -> RayHits:
        """Return what rays meet first.

        Args:
            origins: Where the rays start, in the world [m], shape (..., 3).
            directions: Directions of any length but 0, shape (..., 3); broadcast against the origins.
            maximum: Nothing beyond this distance counts [m], one number or one for each ray,
                shape (...).

        Raises:
            InvalidValueError: for NaN, infinity, shapes that do not broadcast, a direction of length 0, or a
                maximum below 0.
        """
        rays = rays_of(origins, directions, maximum)
        hits = self.cast_checked(rays)
        shape = rays.shape
        normal = hits.normal.reshape(*shape, 3)
        return RayHits(hits.distance.reshape(shape), hits.solid.reshape(shape), normal)

    def distances(self, origins: ArrayLike, directions: ArrayLike, maximum: ArrayLike = np.inf) -> Array:
        """Return only the distances of `cast`, inf where nothing is met, shape (...) [m].

        Args:
            origins: Where the rays start, in the world [m], shape (..., 3).
            directions: Directions of any length but 0, shape (..., 3); broadcast against the origins.
            maximum: Nothing beyond this distance counts [m], one number or one for each ray, shape (...).
        """
        rays = rays_of(origins, directions, maximum)
        return self._hits(rays).distance.reshape(rays.shape)

    def cast_checked(self, rays: Rays) -> RayHits:
        """Return what `cast` does for rays that `rays_of` gave, all in one row."""
        hits, normal = self._hits(rays), np.zeros((len(rays.most), 3))
        normals_at(rays.origins, rays.directions, hits, self._solids, self._placed.pose, normal)
        return RayHits(hits.distance, hits.solid, normal)

    def show_checked(self, rays: Rays, colors: Array, floor: int, surfaces: Surfaces) -> None:
        """Write what rays meet that are as for `cast_checked`; where they meet nothing, nothing is changed.

        Args:
            rays: With greatest distances that may be those of `surfaces`.
            colors: Red, green and blue of the solids, from 0 to 1, shape (m, 3).
            floor: The solid that is the floor, with tiles; -1 for none.
            surfaces: Written.
        """
        hits = self._kept_hits(rays)
        normals_at(rays.origins, rays.directions, hits, self._solids, self._placed.pose, surfaces.normal)
        paint(rays.origins, rays.directions, hits, colors, floor, surfaces)

    def distances_checked(self, rays: Rays) -> Array:
        """Return what `distances` does for rays that `rays_of` gave; the next call writes there."""
        return self._kept_hits(rays).distance

    def _hits(self, rays: Rays) -> Hits:
        hits = _no_hits(len(rays.most))
        nearest_hits(*rays[:3], self._solids, self._placed, hits)
        return hits

    def _kept_hits(self, rays: Rays) -> Hits:
        """Do what `_hits` does, in arrays that the next call uses again: new ones cost more than the rays."""
        if len(rays.most) != len(self._kept.distance):
            self._kept = _no_hits(len(rays.most))
        nearest_hits(*rays[:3], self._solids, self._placed, self._kept)
        return self._kept


class Rays(NamedTuple):
    """Rays in the form that compiled code takes.

    Attributes:
        origins: Shape (n, 3) [m].
        directions: Unit vectors, shape (n, 3).
        most: Greatest distances, shape (n,) [m].
        shape: Of the rays as passed in.
    """

    origins: Array
    directions: Array
    most: Array
    shape: tuple[int, ...]


def rays_of(origins: ArrayLike, directions: ArrayLike, maximum: ArrayLike = np.inf) -> Rays:
    """Return rays as compiled code takes them; see `RayCaster.cast` for errors.

    Args:
        origins: Where the rays start, in the world [m], shape (..., 3).
        directions: Directions of any length but 0, shape (..., 3); broadcast against the origins.
        maximum: Nothing beyond this distance counts [m], one number or one for each ray, shape (...).
    """
    start = as_batch(origins, "origins", (3,))
    aim = as_batch(directions, "directions", (3,))
    most = as_numbers(maximum, "maximum")
    if not (most >= 0).all():
        raise InvalidValueError("maximum", most.min(), "distances of at least 0 [m]")
    # A huge vector's square would overflow; scaled by its greatest component it cannot.
    greatest = np.abs(aim).max(axis=-1, keepdims=True)
    if not (greatest > 0).all():
        raise InvalidValueError("directions", "a direction of length 0", "directions of a length above 0")
    aim = aim / greatest
    aim = aim / np.sqrt(np.einsum("...i,...i->...", aim, aim))[..., None]
    try:
        shape = np.broadcast_shapes(start.shape, aim.shape)[:-1]
        most = np.ascontiguousarray(np.broadcast_to(most, shape)).reshape(-1)
    except ValueError:
        shapes = f"shapes {start.shape}, {aim.shape} and {most.shape}"
        raise InvalidValueError("origins, directions, maximum", shapes, "shapes that broadcast") from None
    o = np.ascontiguousarray(np.broadcast_to(start, (*shape, 3))).reshape(-1, 3)
    d = np.ascontiguousarray(np.broadcast_to(aim, (*shape, 3))).reshape(-1, 3)
    return Rays(o, d, most, shape)


def _no_hits(count: int) -> Hits:
    """Return arrays for the hits of some rays."""
    return Hits(np.empty(count), np.empty(count, np.int64), np.empty(count, np.int64))


def _laid_out(geometries: Sequence[SceneGeometry]) -> Solids:
    kind, size = np.zeros(len(geometries), dtype=np.int64), np.zeros((len(geometries), 3))
    start = np.zeros((len(geometries), 2), dtype=np.int64)
    trees: dict[_Tree, tuple[int, int]] = {}
    boxes, links, parts = [np.empty((0, 6))], [np.empty((0, 2), dtype=np.int64)], [np.empty((0, 9))]
    nodes, count = 0, 0
    for item, geometry in enumerate(geometries):
        kind[item], size[item] = _kind_and_size(geometry)
        if kind[item] not in (TRIANGLES, BALLS):
            continue
        tree = _tree(geometry)
        if tree not in trees:  # a mesh that several links show is kept once
            trees[tree] = (nodes, count)
            boxes.append(tree.node_box)
            links.append(tree.node_link)
            parts.append(tree.parts)
            nodes, count = nodes + len(tree.node_box), count + len(tree.parts)
        start[item] = trees[tree]
    return Solids(kind, size, start, np.concatenate(boxes), np.concatenate(links), np.concatenate(parts))


def _kind_and_size(geometry: SceneGeometry) -> tuple[int, tuple[float, float, float]]:
    match geometry:
        case Sphere():
            return SPHERE, (geometry.radius, 0.0, 0.0)
        case Box():
            x, y, z = geometry.size
            return BOX, (x / 2, y / 2, z / 2)
        case Cylinder():
            return CYLINDER, (geometry.radius, geometry.length / 2, 0.0)
        case Capsule():
            return CAPSULE, (geometry.radius, geometry.length / 2, 0.0)
        case HalfSpace():
            return HALF_SPACE, (geometry.offset, 0.0, 0.0)
        case PointCloud():
            return BALLS, (geometry.radius, 0.0, 0.0)
    return TRIANGLES, (padding(geometry), 0.0, 0.0)


def _bounds(solids: Solids) -> Array:
    """Return the boxes around the solids, each in its own frame, shape (m, 6)."""
    result = np.empty((len(solids.kind), 6))
    for item, (kind, (a, b, c)) in enumerate(zip(solids.kind, solids.size, strict=True)):
        if kind in (TRIANGLES, BALLS):
            result[item] = solids.node_box[solids.start[item, 0]]
            continue
        half = {
            SPHERE: (a, a, a),
            BOX: (a, b, c),
            CYLINDER: (a, a, b),
            CAPSULE: (a, a, a + b),
            HALF_SPACE: (np.inf, np.inf, np.inf),
        }[int(kind)]
        result[item, :3], result[item, 3:] = np.negative(half), half
    return result


def _tree(geometry: SceneGeometry | Mesh) -> _Tree:
    """Return the tree over a mesh's triangles or a cloud's balls; it is kept while a file stays as it is."""
    assert isinstance(geometry, Mesh | ConvexMesh | TriangleMesh | PointCloud)  # others have no parts
    return _kept_tree(geometry, file_state(geometry.path) if isinstance(geometry, Mesh) else ())


@kept_within(MOST_BYTES, bytes_of)
def _kept_tree(
    geometry: Mesh | ConvexMesh | TriangleMesh | PointCloud, state: tuple[str | int, ...]
) -> _Tree:
    if isinstance(geometry, PointCloud):
        parts = np.zeros((len(geometry.points), 9))
        parts[:, :3] = geometry.points
        low, high = geometry.points - geometry.radius, geometry.points + geometry.radius
    else:
        if isinstance(geometry, Mesh):
            vertices, faces = read_mesh(geometry.path, geometry.scale)
        else:
            vertices, faces = geometry.vertices, geometry.faces
        corners = np.asarray(vertices)[faces]
        sides = corners[:, 1:] - corners[:, :1]
        real = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) > 0
        corners, sides = corners[real], sides[real]
        parts = np.hstack([corners[:, 0], sides.reshape(-1, 6)])
        low, high = corners.min(axis=1) - padding(geometry), corners.max(axis=1) + padding(geometry)
    if not len(parts):
        nothing = np.array([[np.inf] * 3 + [-np.inf] * 3])
        return _Tree(nothing, np.array([[0, 1]], dtype=np.int64), np.zeros((1, 9)))
    boxes, links, order = box_tree(np.hstack([low, high]), _PARTS_IN_LEAF)
    return _Tree(boxes, links, np.ascontiguousarray(parts[order]))
