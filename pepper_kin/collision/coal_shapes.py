"""Conversion of geometries to coal's shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.kept_size import MOST_BYTES, kept_within
from pepper_kin.collision.mesh_file import file_state, read_mesh
from pepper_kin.collision.solids import (
    ConvexMesh,
    HalfSpace,
    PointCloud,
    SceneGeometry,
    TriangleMesh,
    has_no_area,
    is_flat_hull,
)
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, Sphere

FLAT = 1e-3
"""Maximum depth of points of a closed mesh in its convex hull at which the mesh counts as that hull [m]."""
MOST_FACES = 4000
"""Maximum number of faces of a mesh that is tested for convexity."""
_PER_TRIANGLE = 400  # bytes per triangle of a tree of triangles
_WIDTH = 1e-7  # width of the triangle that replaces a degenerate one [m]
_SPECK = _WIDTH * np.array([[1.0, 0.0, 0.0], [-0.5, 1.0, 0.0], [-0.5, -1.0, 0.0]])
"""Corners of the triangle that replaces a point [m]: coal's trees hold triangles, and fail for triangles
without size."""


def coal_geometry(geometry: SceneGeometry) -> Any:
    """Return coal's shape for a geometry, without its padding.

    Raises:
        FileFormatError: for a mesh whose file cannot be read.
    """
    import coal

    match geometry:
        case Box():
            return coal.Box(*geometry.size)
        case Sphere():
            return coal.Sphere(geometry.radius)
        case Cylinder():
            return coal.Cylinder(geometry.radius, geometry.length)
        case Capsule():
            return coal.Capsule(geometry.radius, geometry.length)
        case HalfSpace():
            return coal.Halfspace(np.array([0.0, 0.0, 1.0]), geometry.offset)
        case ConvexMesh():
            hull = _tree(geometry.vertices, geometry.faces)
            hull.buildConvexRepresentation(False)
            return hull.convex
        case TriangleMesh():
            return _tree(geometry.vertices, geometry.faces)
        case PointCloud():
            corners = (geometry.points[:, None, :] + _SPECK).reshape(-1, 3)
            return _tree(corners, np.arange(len(corners)).reshape(-1, 3))
        case Mesh():
            return _mesh_of_file(geometry)


def is_empty(geometry: SceneGeometry) -> bool:
    """Return whether a geometry is a point cloud without points."""
    return isinstance(geometry, PointCloud) and not len(geometry.points)


def _tree(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Any:
    """Return coal's tree of triangles for vertices [m], shape (v, 3), and indices into them, shape (f, 3)."""
    import coal

    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(faces), len(vertices))
    tree.addVertices(np.array(vertices))
    tree.addTriangles(np.array(faces))
    tree.endModel()
    return tree


def _surface(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Any:
    """Return the tree of a mesh that may have degenerate triangles, without area.

    Coal's distances to such a triangle are wrong by meters.  It is replaced by its longest side, or its
    point, widened to `_WIDTH`, by which distances may be too small.
    """
    corners = vertices[faces]
    flat = has_no_area(corners)
    wide = len(vertices) + np.arange(3 * np.count_nonzero(flat)).reshape(-1, 3)
    vertices = np.concatenate([vertices, _widened(corners[flat]).reshape(-1, 3)])
    return _tree(vertices, np.concatenate([faces[~flat], wide]))


def _widened(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return triangles with an area for degenerate ones, both of shape (f, 3, 3) [m]."""
    sides = np.roll(corners, -1, axis=1) - corners
    lengths, rows = np.linalg.norm(sides, axis=2), np.arange(len(corners))
    longest = lengths.argmax(axis=1)
    start, along = corners[rows, longest], sides[rows, longest]
    # The axis along which the side is shortest is the least parallel to it.
    across = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    across *= _WIDTH / np.maximum(np.linalg.norm(across, axis=1), np.finfo(float).tiny)[:, None]
    lines = np.stack([start, start + along, start + 0.5 * along + across], axis=1)
    point = lengths[rows, longest] < _WIDTH
    return np.where(point[:, None, None], start[:, None] + _SPECK, lines)


def _as_solid(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> Any | None:
    """Return the convex hull of a mesh that is closed and convex within FLAT; None for any other mesh.

    Vertices without triangles, and triangles with a repeated vertex, are ignored.

    The depth of a point in a hull is a concave function, so that no point of a triangle is deeper than three
    times the depth of its middle.
    A tree of triangles represents a surface only; a convex polytope is a solid, and its distances are
    computed faster.
    """
    from scipy.spatial import ConvexHull, QhullError

    if not 0 < len(triangles) <= MOST_FACES:
        return None
    points, places = np.unique(np.round(vertices[triangles.ravel()], 7), axis=0, return_inverse=True)
    faces = places.reshape(-1, 3)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    sides = np.sort(np.concatenate([faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    if (np.unique(sides, axis=0, return_counts=True)[1] != 2).any():
        return None
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return None
    if is_flat_hull(hull):
        return None
    middles = points[faces].mean(axis=1)
    depth = -(middles @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    if 3.0 * depth.max() > FLAT:
        return None
    order = np.full(len(points), -1)
    order[hull.vertices] = np.arange(hull.vertices.size)
    outward = np.cross(*(points[hull.simplices[:, k]] - points[hull.simplices[:, 0]] for k in (1, 2)))
    turned = np.einsum("ij,ij->i", outward, hull.equations[:, :3]) < 0.0
    simplices = np.where(turned[:, None], hull.simplices[:, [0, 2, 1]], hull.simplices)
    solid = _tree(points[hull.vertices], order[simplices])
    solid.buildConvexRepresentation(False)
    return solid.convex


def _mesh_of_file(mesh: Mesh) -> Any:
    return _read_mesh(mesh, file_state(mesh.path))


@kept_within(MOST_BYTES, lambda shape, *_: _PER_TRIANGLE * getattr(shape, "num_tris", 0))
def _read_mesh(mesh: Mesh, state: tuple[str | int, ...]) -> Any:
    """Return the shape of a mesh file, read once for all checkers, and again if the file has changed."""
    vertices, faces = read_mesh(mesh.path, mesh.scale)
    return _as_solid(vertices, faces) or _surface(vertices, faces)
