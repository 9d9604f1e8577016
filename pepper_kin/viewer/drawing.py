"""Lowering of drawables to meshcat commands.

Every object is lowered by meshcat's own classes, so that a recorded page and a live page draw the same.
meshcat is imported inside the functions: it brings IPython and ZeroMQ with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.solids import ConvexMesh, HalfSpace, PointCloud, TriangleMesh
from pepper_kin.model.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from pepper_kin.viewer.drawable import Color, Drawable
from pepper_kin.viewer.surface import (
    CREASE_ANGLE,
    Surface,
    balls_surface,
    capsule_surface,
    read_surface,
    split_at_creases,
)

if TYPE_CHECKING:
    import meshcat.geometry
    from meshcat.commands import SetObject, SetTransform

LINK_ROOT = "links"
WORLD_ROOT = "world"

PLATE = (4.0, 4.0, 0.01)
"""Lengths of the plate that is drawn for a half-space [m]; its upper face lies in the plane."""
LEAST_BALL = 0.002
"""Points of a cloud are drawn at least this large [m]."""

# three.js draws cylinders along y, the robot's description along z.
_Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def link_path(link: str | None) -> tuple[str, ...]:
    """Return the scene path of a link's group, or of the world's for None."""
    # A slash would start a new level of the tree.
    return (WORLD_ROOT,) if link is None else (LINK_ROOT, link.replace("/", "_"))


def draw_commands(
    drawables: Iterable[Drawable], root: tuple[str, ...] = ()
) -> Iterator[SetObject | SetTransform]:
    """Turn drawables into meshcat commands: one sets the object, one its pose.

    Identifiers count up instead of being random, so the same input gives the same commands.

    Args:
        drawables: What to draw.
        root: Scene path of the group that they all go into.

    Yields:
        Commands; their `lower()` is what meshcat's page takes.

    Raises:
        FileFormatError: A mesh file cannot be read.
    """
    from meshcat.commands import SetObject, SetTransform
    from meshcat.geometry import Mesh as MeshcatMesh
    from meshcat.path import Path as ScenePath

    surfaces: dict[Path, Surface] = {}
    for index, drawable in enumerate(drawables):
        path = ScenePath((*root, *link_path(drawable.link), f"{index} {drawable.name}".replace("/", "_")))
        solid, intrinsic = _geometry(drawable, surfaces)
        body = MeshcatMesh(solid, _material(drawable.color))
        for element, kind in ((solid, "geometry"), (body.material, "material"), (body, "object")):
            element.uuid = f"{kind}-{index}"
        yield SetObject(body, path=path)
        yield SetTransform(drawable.transform_shape_to_link @ intrinsic, path)


def _geometry(
    drawable: Drawable, surfaces: dict[Path, Surface]
) -> tuple[meshcat.geometry.Geometry, NDArray[np.float64]]:
    """Return meshcat's geometry and the transform (rotation or scale) from it to the drawable's shape."""
    from meshcat import geometry as mg

    shape = drawable.geometry
    match shape:
        case Box():
            return mg.Box([float(length) for length in shape.size]), np.eye(4)
        case Sphere():
            return mg.Sphere(float(shape.radius)), np.eye(4)
        case Cylinder():
            return mg.Cylinder(float(shape.length), float(shape.radius)), _Y_TO_Z
        case Capsule():
            surface = capsule_surface(shape.radius, shape.length)
            return mg.TriangularMeshGeometry(surface.vertices, surface.faces), np.eye(4)
        case Mesh():
            path = Path(shape.path)
            if path not in surfaces:
                surfaces[path] = read_surface(path)
            surface = surfaces[path]
            scale = np.diag([*np.broadcast_to(np.asarray(shape.scale, dtype=float), 3), 1.0])
            return mg.TriangularMeshGeometry(surface.vertices, surface.faces), scale
        case HalfSpace():
            plate = np.eye(4)
            plate[2, 3] = shape.offset - PLATE[2] / 2
            return mg.Box(list(PLATE)), plate
        case Surface():
            return mg.TriangularMeshGeometry(shape.vertices, shape.faces), np.eye(4)
        case ConvexMesh() | TriangleMesh():
            surface = split_at_creases(shape.vertices, shape.faces, CREASE_ANGLE)
            return mg.TriangularMeshGeometry(surface.vertices, surface.faces), np.eye(4)
        case PointCloud():
            surface = balls_surface(shape.points, max(shape.radius, LEAST_BALL))
            return mg.TriangularMeshGeometry(surface.vertices, surface.faces), np.eye(4)
    raise AssertionError("Drawable accepts no other geometry")


def _material(color: Color) -> meshcat.geometry.Material:
    """Return a smooth plastic of the given colour."""
    from meshcat.geometry import MeshPhongMaterial

    red, green, blue = (round(255 * channel) for channel in color[:3])
    return MeshPhongMaterial(
        color=red << 16 | green << 8 | blue,
        opacity=color[3],
        specular=0x2A2A2A,
        shininess=45,
        reflectivity=0.2,
    )
