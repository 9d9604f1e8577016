"""Geometries of a scene that links do not have: half-spaces, meshes as arrays and point clouds."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.core.collision.clouds import extent, thin
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import Geometry
from pepper_kin.model.joint_vectors import as_batch, as_finite, as_real, shown

FLAT = 1e-9
"""Minimum extent of a body, and height of a triangle, that is not flat [m]."""
FARTHEST = 1e6
"""Maximum coordinate and length in a scene [m]: larger numbers leave too few digits for distances."""


@dataclass(frozen=True)
class HalfSpace:
    """All points with z <= offset in its own frame: a floor, a wall, the far side of a plane.

    Attributes:
        offset: Height of the plane [m].
    """

    offset: float = 0.0

    def __post_init__(self) -> None:
        offset = within_world("offset of a half-space", as_finite(self.offset, "offset of a half-space", ()))
        object.__setattr__(self, "offset", float(offset))


@dataclass(frozen=True, eq=False)
class ConvexMesh(FrozenArrays):
    """Convex hull of points, solid inside.

    Attributes:
        vertices: (k, 3) corners of the hull [m], read-only; points inside it are dropped.
        faces: (f, 3) indices of their vertices, counter-clockwise seen from outside, read-only.
        padding: Distance by which the solid extends beyond the hull [m].
    """

    vertices: NDArray[np.float64]
    padding: float = 0.0
    faces: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        from scipy.spatial import ConvexHull, QhullError

        points = as_finite(self.vertices, "vertices of a convex mesh", (None, 3))
        within_world("vertices of a convex mesh", points)
        hull = None
        with suppress(QhullError, ValueError):
            hull = ConvexHull(points)
        if hull is None or is_flat_hull(hull):
            flat = len(points) < 4 or not _spans_volume(points)
            if flat or hull is None:
                found = f"{len(points)} points {'in a plane' if flat else 'without a hull'}"
                allowed = "points of which four or more span a volume"
                raise InvalidValueError("vertices of a convex mesh", found, allowed)
        # Corners keep their given order, so that the hull of a hull is the same hull.
        corners = np.sort(hull.vertices)
        faces = np.searchsorted(corners, hull.simplices)
        vertices = points[corners]
        a, b, c = np.moveaxis(vertices[faces], 1, 0)
        # Two sides of a face and Qhull's outward normal are right-handed if the face is.
        turns = np.linalg.det(np.stack([b - a, c - a, hull.equations[:, :3]], axis=1))
        faces = np.where(turns[:, None] < 0.0, faces[:, ::-1], faces)
        object.__setattr__(self, "vertices", read_only(vertices))
        object.__setattr__(self, "faces", read_only(faces, np.int64))
        object.__setattr__(self, "padding", _thickness("padding of a convex mesh", self.padding))


@dataclass(frozen=True, eq=False)
class TriangleMesh(FrozenArrays):
    """Surface of triangles, closed or not.  The surface is solid, not its interior.

    Attributes:
        vertices: (k, 3) [m], read-only.
        faces: (f, 3) indices of each triangle's vertices, read-only; triangles without area are dropped.
        padding: Distance by which the solid extends beyond the surface [m].
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    padding: float = 0.0

    def __post_init__(self) -> None:
        vertices = as_finite(self.vertices, "vertices of a mesh", (None, 3))
        within_world("vertices of a mesh", vertices)
        faces = _indices(self.faces, len(vertices))
        real = ~has_no_area(vertices[faces])
        if not real.any():
            raise InvalidValueError(
                "faces of a mesh",
                f"{len(faces)} triangles, none of which has an area",
                "at least one triangle with an area",
            )
        object.__setattr__(self, "vertices", read_only(vertices))
        object.__setattr__(self, "faces", read_only(faces[real], np.int64))
        object.__setattr__(self, "padding", _thickness("padding of a mesh", self.padding))


@dataclass(frozen=True, eq=False)
class PointCloud(FrozenArrays):
    """Spheres of one radius around points, for example from a depth camera; there may be none.

    Attributes:
        points: (k, 3) [m], read-only.
        radius: Radius of each sphere [m].
    """

    points: NDArray[np.float64]
    radius: float

    def __post_init__(self) -> None:
        points = as_batch(self.points, "points of a cloud", ())
        if points.size == 0:
            points = np.empty((0, 3))
        points = np.ascontiguousarray(as_finite(points, "points of a cloud", (None, 3)))
        within_world("points of a cloud", points)
        object.__setattr__(self, "points", read_only(points))
        object.__setattr__(self, "radius", _thickness("point radius", self.radius))

    @classmethod
    def thinned(cls, points: ArrayLike, radius: float, voxel: float) -> PointCloud:
        """Return a cloud with at most one point per cube of a grid, which covers all spheres of a given one.

        The points of a cube are replaced by the middle of their bounding box, and the radius grows by the
        maximum distance of a point from its middle, at most sqrt(3) / 2 of the cube's edge.

        Args:
            points: (k, 3) [m].
            radius: Radius of the sphere around each point [m].
            voxel: Edge of the grid's cubes [m].

        Raises:
            InvalidValueError: for NaN, a wrong shape, a negative radius, a voxel of 0 or less, or points so
                far apart that their cubes cannot be counted.
        """
        full = cls(cast("NDArray[np.float64]", points), radius)
        edge = float(as_finite(voxel, "voxel", ()))
        if edge <= 0:
            raise InvalidValueError("voxel", voxel, "a finite length above 0 [m]")
        if not len(full.points):
            return full
        box, count = np.empty(6), len(full.points)
        extent(full.points, box)
        longest = float((box[3:] - box[:3]).max())
        if longest / edge > 2.0**40:
            raise InvalidValueError("voxel", voxel, f"a length that divides {longest:.3g} m into fewer cubes")
        table, boxes = np.full(1 << (2 * count).bit_length(), -1), np.empty((count, 6))
        cubes, off = thin(full.points, box, edge, table, boxes)
        return cls(boxes[:cubes, :3], full.radius + off)


def has_no_area(corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether triangles are no higher than `FLAT`, shape (f,); corners [m], shape (f, 3, 3)."""
    sides = np.roll(corners, -1, axis=1) - corners
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    longest: NDArray[np.float64] = np.linalg.norm(sides, axis=2).max(axis=1, initial=0.0)
    return np.asarray(~(area > FLAT * longest))


def is_flat_hull(hull: Any) -> bool:
    """Return whether SciPy's hull is flat: its volume is at most the minimum extent times half its area."""
    return not 2.0 * hull.volume > 10.0 * FLAT * hull.area


SceneGeometry: TypeAlias = Geometry | HalfSpace | ConvexMesh | TriangleMesh | PointCloud


def within_world(quantity: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return finite coordinates or lengths [m], of any shape, after a check that they are within `FARTHEST`.

    Raises:
        InvalidValueError: naming the quantity and its maximum absolute value.
    """
    if values.size and np.abs(values).max() > FARTHEST:
        worst = values.ravel()[np.abs(values).argmax()]
        raise InvalidValueError(quantity, f"{worst:g} m", f"at most {FARTHEST:g} m: is it in another unit?")
    return values


def padding(geometry: SceneGeometry) -> float:
    """Return the distance by which a geometry extends beyond its points, its hull or its surface [m]."""
    match geometry:
        case ConvexMesh() | TriangleMesh():
            return geometry.padding
        case PointCloud():
            return geometry.radius
    return 0.0


def not_negative(quantity: str, value: float) -> float:
    """Return a finite length of 0 or more.

    Raises:
        InvalidValueError: naming the quantity.
    """
    number = as_real(value)
    if not (math.isfinite(number) and number >= 0):
        raise InvalidValueError(quantity, value, "a finite distance of 0 or more [m]")
    return number


def _thickness(quantity: str, value: float) -> float:
    return float(within_world(quantity, np.array(not_negative(quantity, value))))


def _spans_volume(points: NDArray[np.float64]) -> bool:
    """Return whether points [m], shape (k, 3), span a volume.

    They do if the minimum extent, along the last principal axis, is not negligible.
    """
    centered = points - points.mean(axis=0)
    squares = np.linalg.eigvalsh(centered.T @ centered)  # fast, but accurate to half of the digits only
    if squares[0] > 1e-6 * squares[2] and squares[0] > 10.0 * FLAT**2 * len(points):
        return True
    axes = np.linalg.svd(centered, full_matrices=False)[2]
    return bool(np.ptp(centered @ axes.T, axis=0).min() > FLAT)


def _indices(faces: ArrayLike, count: int) -> NDArray[np.int64]:
    """Return faces, shape (f, 3), as integers, after a check that they are indices below `count`."""
    allowed = "whole numbers of shape (f, 3), f > 0"
    try:
        array = np.asarray(faces)
    except ValueError:  # rows of unequal lengths
        raise InvalidValueError(
            "faces of a mesh", shown(faces), "whole numbers of shape (f, 3), f > 0"
        ) from None
    whole = array.dtype.kind in "iu" or (
        array.dtype.kind == "f" and bool((np.isfinite(array) & (array == np.floor(array))).all())
    )
    try:
        as_finite(faces, "faces of a mesh", (None, 3))  # NumPy would accept True as 1
    except InvalidValueError:
        whole = False
    if array.ndim != 2 or array.shape[1] != 3 or not len(array) or not whole:
        raise InvalidValueError("faces of a mesh", f"{array.dtype} of shape {array.shape}", allowed)
    outside = (array < 0) | (array >= count)
    if outside.any():
        row = int(np.argwhere(outside)[0][0])
        raise InvalidValueError(
            "faces of a mesh",
            f"vertex {int(array[outside][0])} in face {row}",
            f"indices from 0 to {count - 1}, one for each of {count} vertices",
        )
    return array.astype(np.int64)
