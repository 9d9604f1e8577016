"""Geometries as coal's shapes."""

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
)
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, Sphere

FLAT = 1e-3
"""A closed mesh no point of which lies deeper than this in its convex hull is taken as that hull [m]."""
MOST_FACES = 4000
"""Meshes of more faces are not looked at for whether they are convex."""
_PER_TRIANGLE = 400  # bytes of a tree of triangles
_SPECK = 1e-7 * np.array([[1.0, 0.0, 0.0], [-0.5, 1.0, 0.0], [-0.5, -1.0, 0.0]])
"""Corners of the triangle that stands for a point: coal's trees hold triangles, and of no size they fail."""


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
    """Whether there is nothing to collide with: a cloud without points."""
    return isinstance(geometry, PointCloud) and not len(geometry.points)


def _tree(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Any:
    """Return coal's tree of triangles, of vertices [m], shape (v, 3), and indices into them, shape (f, 3)."""
    import coal

    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(faces), len(vertices))
    tree.addVertices(np.array(vertices))
    tree.addTriangles(np.array(faces))
    tree.endModel()
    return tree


def _as_solid(tree: Any) -> Any | None:
    """Return the convex hull of a mesh that is closed and convex within FLAT; None of any other mesh.

    How deep a point lies in a hull is a concave function, so that no point of a triangle lies deeper than
    three times the depth of its middle.
    A tree of triangles knows its surface only; as a convex polytope it is a solid, and its distances are
    found faster.
    """
    from scipy.spatial import ConvexHull, QhullError

    if not hasattr(tree, "tri_indices") or tree.num_tris > MOST_FACES:
        return None
    corners = np.array([[face[0], face[1], face[2]] for face in map(tree.tri_indices, range(tree.num_tris))])
    points, places = np.unique(np.round(np.array(tree.vertices()), 7), axis=0, return_inverse=True)
    faces = places.ravel()[corners]
    sides = np.sort(np.concatenate([faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    if (np.unique(sides, axis=0, return_counts=True)[1] != 2).any():
        return None
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
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
    """Read a mesh once for all checkers of a robot, and again where its file has changed."""
    tree = _tree(*read_mesh(mesh.path, mesh.scale))
    return _as_solid(tree) or tree
