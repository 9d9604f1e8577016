"""Checks of whether MuJoCo can load a mesh file."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model.shapes import Mesh

READABLE_MESHES = (".stl", ".obj", ".msh")
_MOST_TRIANGLES = 200_000  # maximum number of triangles of an STL file
_FLAT = 1e-6
"""Ratio of a mesh's thickness to its size below which the mesh counts as flat."""


def why_unreadable(mesh: Mesh, touches: bool) -> str:
    """Return the reason why MuJoCo would refuse a mesh; empty for a readable mesh.

    MuJoCo reads binary STL and OBJ. A mesh needs four different vertices, a nonzero area after scaling and,
    as a collision shape, a convex hull: vertices that are not in one plane.

    Args:
        mesh: The mesh.
        touches: Whether the mesh is a collision shape.
    """
    path, suffix = mesh.path, mesh.path.suffix.lower()
    if suffix not in READABLE_MESHES:
        return f"MuJoCo reads {', '.join(READABLE_MESHES)}"
    if not path.is_file():
        return "there is no such file"
    if suffix == ".msh":
        return ""
    try:
        content = path.read_bytes()
    except OSError as error:
        return f"it cannot be read: {error.strerror or error}"
    points = _stl_points(content) if suffix == ".stl" else _obj_points(content)
    if isinstance(points, str):
        return points
    points = np.unique(points, axis=0)
    if len(points) < 4:
        return f"it has {len(points)} different vertices, MuJoCo needs 4"
    if touches and _dimensions(points) < 3:
        return "its vertices are in one plane, so that it has no convex hull"
    if _dimensions(points * np.array(mesh.scale)) < 2:
        return f"it has no area with the scale {mesh.scale}"
    return ""


def _dimensions(points: NDArray[np.float64]) -> int:
    """Return the dimension of the affine hull of points, shape (k, 3)."""
    widths = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return int((widths > _FLAT * max(float(widths[0]), 1e-300)).sum())


def _stl_points(content: bytes) -> NDArray[np.float64] | str:
    """Return the vertices of a binary STL file, shape (k, 3), or the reason why it cannot be read."""
    count = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else 0
    if len(content) != 84 + 50 * count or not count:
        return "it is not binary STL, which MuJoCo needs"
    if count > _MOST_TRIANGLES:
        return f"it has {count} triangles, MuJoCo reads at most {_MOST_TRIANGLES}"
    rows = np.frombuffer(content, np.uint8, offset=84).reshape(count, 50)[:, 12:48]
    return np.ascontiguousarray(rows).view("<f4").reshape(-1, 3).astype(float)


def _obj_points(content: bytes) -> NDArray[np.float64] | str:
    """Return the vertices of an OBJ file, shape (k, 3), or the reason why it cannot be read."""
    rows = [line.split()[1:4] for line in content.splitlines() if line.startswith((b"v ", b"v\t"))]
    try:
        return np.array(rows, dtype=float).reshape(-1, 3)
    except ValueError:
        return "it has a vertex that is not three numbers"
