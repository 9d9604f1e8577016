"""Conversion of drawables to meshcat commands.

The commands equal those of meshcat's own classes (a test compares them).  meshcat is not imported: it
imports IPython, ZeroMQ and a web server, which takes longer than all drawing code.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.solids import ConvexMesh, HalfSpace, PointCloud, TriangleMesh
from pepper_kin.model.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from pepper_kin.viewer.drawable import Color, Drawable
from pepper_kin.viewer.surface import (
    CREASE_ANGLE,
    DrawnSurface,
    balls_surface,
    capsule_surface,
    read_surface,
    split_at_creases,
)

LINK_ROOT = "links"
WORLD_ROOT = "world"

PLATE = (4.0, 4.0, 0.01)
"""Size of the plate that is drawn for a half-space [m]; its upper face lies in the plane."""
LEAST_BALL = 0.002
"""Minimum drawn radius of a cloud's points [m]."""

FLOATS, INDICES = 0x17, 0x16
"""meshcat's codes of packed arrays of float32 and uint32."""

# three.js draws cylinders along y, the robot's description along z.
_Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def meshcat_bundle() -> str:
    """Return the JavaScript of meshcat's page."""
    spec = find_spec("meshcat")  # does not import it
    assert spec is not None
    assert spec.origin is not None
    bundle = Path(spec.origin).with_name("viewer") / "dist" / "main.min.js"
    return bundle.read_text(encoding="utf-8")


def link_path(link: str | None) -> tuple[str, ...]:
    """Return the scene path of a link's group, or of the world's for None."""
    # A slash would start a new level of the tree.
    return (WORLD_ROOT,) if link is None else (LINK_ROOT, link.replace("/", "_"))


def draw_commands(drawables: Iterable[Drawable], root: tuple[str, ...] = ()) -> Iterator[dict[str, Any]]:
    """Convert each drawable to two meshcat commands: one sets the object, one its pose.

    Identifiers are counted, not random, so that the same input gives the same commands.

    Args:
        drawables: Drawables to convert.
        root: Scene path of their group.

    Yields:
        Commands for meshcat's page.

    Raises:
        FileFormatError: A mesh file cannot be read.
    """
    surfaces: dict[Path, DrawnSurface] = {}
    for index, drawable in enumerate(drawables):
        parts = (*root, *link_path(drawable.link), f"{index} {drawable.name}".replace("/", "_"))
        path = "/" + "/".join(parts)
        solid, intrinsic = _geometry(drawable, surfaces)
        over = {"depthTest": False, "depthWrite": False} if drawable.through else {}
        body = {
            "uuid": f"object-{index}",
            "type": "Mesh",
            "geometry": f"geometry-{index}",
            "material": f"material-{index}",
            "matrix": np.eye(4).ravel().tolist(),
        }
        content = {
            "metadata": {"version": 4.5, "type": "Object"},
            "geometries": [{"uuid": f"geometry-{index}", **solid}],
            "materials": [{"uuid": f"material-{index}", **_material(drawable.color), **over}],
            "object": body,
        }
        yield {"type": "set_object", "object": content, "path": path}
        pose = drawable.transform_shape_to_link @ intrinsic
        yield {"type": "set_transform", "path": path, "matrix": pose.T.ravel().tolist()}


def _geometry(
    drawable: Drawable, surfaces: dict[Path, DrawnSurface]
) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Return a geometry of three.js, and its transform (rotation or scale) to the drawable's shape."""
    shape = drawable.geometry
    match shape:
        case Box():
            return _box(shape.size), np.eye(4)
        case Sphere():
            return _sphere(float(shape.radius)), np.eye(4)
        case Cylinder():
            return _cylinder(float(shape.length), float(shape.radius)), _Y_TO_Z
        case Capsule():
            surface = capsule_surface(shape.radius, shape.length)
            return _triangles(surface.vertices, surface.faces), np.eye(4)
        case Mesh():
            path = Path(shape.path)
            if path not in surfaces:
                surfaces[path] = read_surface(path)
            surface = surfaces[path]
            scale = np.diag([*np.broadcast_to(np.asarray(shape.scale, dtype=float), 3), 1.0])
            return _triangles(surface.vertices, surface.faces), scale
        case HalfSpace():
            plate = np.eye(4)
            plate[2, 3] = shape.offset - PLATE[2] / 2
            return _box(PLATE), plate
        case DrawnSurface():
            return _triangles(shape.vertices, shape.faces), np.eye(4)
        case ConvexMesh() | TriangleMesh():
            surface = split_at_creases(shape.vertices, shape.faces, CREASE_ANGLE)
            return _triangles(surface.vertices, surface.faces), np.eye(4)
        case PointCloud():
            surface = balls_surface(shape.points, max(shape.radius, LEAST_BALL))
            return _triangles(surface.vertices, surface.faces), np.eye(4)
    raise AssertionError("Drawable accepts no other geometry")


def _box(lengths: Sequence[float] | NDArray[np.float64]) -> dict[str, Any]:
    """Return a box of three.js with the given edge lengths [m], shape (3,)."""
    width, height, depth = (float(length) for length in lengths)
    return {"type": "BoxGeometry", "width": width, "height": height, "depth": depth}


def _sphere(radius: float) -> dict[str, Any]:
    return {"type": "SphereGeometry", "radius": radius, "widthSegments": 20, "heightSegments": 20}


def _cylinder(length: float, radius: float) -> dict[str, Any]:
    radii = {"radiusTop": radius, "radiusBottom": radius}
    return {"type": "CylinderGeometry", **radii, "height": length, "radialSegments": 50}


def _triangles(vertices: NDArray[Any], faces: NDArray[Any]) -> dict[str, Any]:
    """Return triangles of three.js: vertices [m before scaling], shape (V, 3), and indices, shape (F, 3)."""
    data = {
        "attributes": {"position": _packed(np.asarray(vertices, "<f4"), "Float32Array", FLOATS)},
        "index": _packed(np.asarray(faces, "<u4"), "Uint32Array", INDICES),
    }
    return {"type": "BufferGeometry", "data": data}


def _packed(rows: NDArray[Any], kind: str, extension: int) -> dict[str, Any]:
    """Pack rows of three, shape (k, 3), as an array for meshcat's page."""
    from umsgpack import Ext

    return {"itemSize": 3, "type": kind, "array": Ext(extension, rows.tobytes()), "normalized": False}


def _material(color: Color) -> dict[str, Any]:
    """Return a smooth plastic material of a color."""
    red, green, blue = (round(255 * channel) for channel in color[:3])
    return {
        "type": "MeshPhongMaterial",
        "color": red << 16 | green << 8 | blue,
        "reflectivity": 0.2,
        "side": 2,
        "transparent": bool(color[3] != 1),
        "opacity": color[3],
        "linewidth": 1.0,
        "wireframe": False,
        "wireframeLinewidth": 1.0,
        "vertexColors": 0,
        "specular": 0x2A2A2A,
        "shininess": 45,
    }
