"""Center of mass and inertia of solids of uniform density, per kilogram."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.mesh_file import read_mesh
from pepper_kin.collision.solids import ConvexMesh, PointCloud, SceneGeometry, TriangleMesh
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, Sphere


class UniformSolid(NamedTuple):
    """Mass distribution per kilogram, in the geometry's own frame.

    Attributes:
        center: Center of mass [m], shape (3,).
        inertia: Inertia about the center of mass [m^2], shape (3, 3).
    """

    center: Array
    inertia: Array


def uniform_solid(name: str, geometry: SceneGeometry) -> UniformSolid:
    """Return the mass distribution of a geometry that is solid and of uniform density.

    Boxes, spheres, cylinders and capsules have closed forms; convex meshes and closed surfaces are integrated
    over their volume (trimesh).  An open surface counts as its convex hull, a cloud as equal spheres around
    its points (solid; with zero radius, point masses).  Padding is ignored.

    Args:
        name: Name of the object, for errors.
        geometry: Geometry of the object.

    Raises:
        InvalidValueError: for a half-space, an empty cloud, or a mesh that encloses no volume.
        FileFormatError: for a mesh file that cannot be read.
    """
    match geometry:
        case Box():
            x, y, z = np.square(geometry.size) / 12
            return UniformSolid(np.zeros(3), np.diag([y + z, x + z, x + y]))
        case Sphere():
            return UniformSolid(np.zeros(3), 0.4 * geometry.radius**2 * np.eye(3))
        case Cylinder():
            return UniformSolid(np.zeros(3), _cylinder(geometry.radius, geometry.length))
        case Capsule():
            return UniformSolid(np.zeros(3), _capsule(geometry.radius, geometry.length))
        case ConvexMesh():
            return _enclosed(name, geometry.vertices, geometry.faces)
        case TriangleMesh():
            return _of_surface(name, geometry)
        case Mesh():
            return _of_surface(name, TriangleMesh(*read_mesh(geometry.path, geometry.scale)))
        case PointCloud() if len(geometry.points):
            center = geometry.points.mean(axis=0)
            apart = geometry.points - center
            spread = apart.T @ apart / len(apart)
            ball = 0.4 * geometry.radius**2 * np.eye(3)
            return UniformSolid(center, np.trace(spread) * np.eye(3) - spread + ball)
    raise InvalidValueError(f"geometry of {name!r}", type(geometry).__name__, "a solid where it has a mass")


def _cylinder(radius: float, length: float) -> Array:
    """Return the inertia of a cylinder along z about its center, per kilogram [m^2]."""
    across = radius**2 / 4 + length**2 / 12
    return np.diag([across, across, radius**2 / 2])


def _capsule(radius: float, length: float) -> Array:
    """Return the inertia of a capsule along z about its center, per kilogram [m^2].

    It is a cylinder and two hemispheres, whose centers of mass are 3/8 of the radius beyond the ends of the
    segment; their inertia about axes across z through these centers is 2/5 - 9/64 = 83/320 of m r^2.
    """
    share = length / (length + 4.0 / 3.0 * radius)  # volume fraction of the cylinder
    cylinder, lever = _cylinder(radius, length), length / 2 + 3.0 / 8.0 * radius
    across = 83.0 / 320.0 * radius**2 + lever**2
    ends = np.diag([across, across, 0.4 * radius**2])
    return np.asarray(share * cylinder + (1.0 - share) * ends)


def _of_surface(name: str, surface: TriangleMesh) -> UniformSolid:
    """Return the mass distribution of the interior of a surface, or of its hull if it is open."""
    import trimesh

    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=True)
    if _is_closed(np.asarray(mesh.faces)):
        return _enclosed(name, np.asarray(mesh.vertices), np.asarray(mesh.faces))
    try:
        hull = ConvexMesh(surface.vertices)
    except InvalidValueError as error:
        allowed = "a mesh that encloses a volume, or a box, where it has a mass"
        raise InvalidValueError(f"geometry of {name!r}", "a flat mesh", allowed) from error
    return _enclosed(name, hull.vertices, hull.faces)


def _is_closed(faces: NDArray[np.int64]) -> bool:
    """Return whether triangles, shape (f, 3), use each edge equally often in both directions, without border.

    Bodies that share edges, which trimesh does not consider watertight, are closed, too.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    one_way, back = (pairs[np.lexsort(pairs.T)] for pairs in (edges, edges[:, ::-1]))
    return bool(np.array_equal(one_way, back))


def _enclosed(name: str, vertices: Array, faces: NDArray[np.int64]) -> UniformSolid:
    """Return the mass distribution inside a closed surface; vertices (k, 3) [m], faces (f, 3)."""
    import trimesh

    mesh = trimesh.Trimesh(vertices - vertices.mean(axis=0), faces, process=False)
    volume = mesh.volume  # negative if the faces are seen from inside
    if not abs(volume) > 0.0:
        allowed = "a mesh that encloses a volume, or a box, where it has a mass"
        raise InvalidValueError(f"geometry of {name!r}", f"a volume of {volume:g} m^3", allowed)
    center = np.asarray(mesh.center_mass) + vertices.mean(axis=0)
    return UniformSolid(center, np.asarray(mesh.moment_inertia) / volume)
