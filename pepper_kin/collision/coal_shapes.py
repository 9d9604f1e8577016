"""Geometries as coal's shapes."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.mesh_file import check_is_file
from pepper_kin.collision.solids import (
    ConvexMesh,
    HalfSpace,
    PointCloud,
    SceneGeometry,
    TriangleMesh,
)
from pepper_kin.exceptions import FileFormatError
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, Sphere

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
    import coal

    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(faces), len(vertices))
    tree.addVertices(np.array(vertices))
    tree.addTriangles(np.array(faces))
    tree.endModel()
    return tree


def _mesh_of_file(mesh: Mesh) -> Any:
    check_is_file(mesh.path)
    state = mesh.path.stat()
    return _read_mesh(mesh, (state.st_mtime_ns, state.st_size))


@lru_cache(maxsize=256)
def _read_mesh(mesh: Mesh, state: tuple[int, int]) -> Any:
    """Read a mesh once for all checkers of a robot, and again where its file has changed."""
    import coal

    try:
        return coal.MeshLoader().load(str(mesh.path), np.array(mesh.scale))
    except (RuntimeError, ValueError) as error:
        raise FileFormatError(mesh.path, f"cannot be read as a mesh: {error}") from error
