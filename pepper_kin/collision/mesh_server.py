"""Server process of `mesh_process`: reads the mesh files named on its input, and writes arrays.

It runs as a script and imports nothing of pepper_kin.  A request is a line of JSON: the path, and the maximum
memory [bytes].  An answer is eight bytes with the length of a JSON text, the text, and the arrays that it
announces; or a text with the error.
"""

from __future__ import annotations

import importlib
import io
import json
import sys
from typing import Any
from xml.etree import ElementTree

import numpy as np

Part = tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], "np.ndarray[Any, Any] | None"]
"""Vertices [m], faces, and one color for all faces or one for each, or None."""
NO_COLOR = np.array([204, 204, 204, 255])
"""Color of faces without one if other faces have one."""
_OF_MATERIALS = ("library_images", "library_effects", "library_materials", "bind_material")


def main() -> None:
    """Serve requests until the input ends."""
    for package in ("collada", "trimesh"):  # loaded before memory is limited
        importlib.import_module(package)
    out = sys.stdout.buffer
    out.write(b"!")
    out.flush()
    for line in sys.stdin:
        request = json.loads(line)
        _limit(request["memory"])
        arrays: list[np.ndarray[Any, Any]] = []
        try:
            arrays = _read(request["path"])
            head: dict[str, Any] = {"arrays": [(part.dtype.str, part.shape) for part in arrays]}
        except MemoryError:
            head = {"error": "it takes too much memory"}
        except RecursionError:
            head = {"error": "its parts are nested without end"}
        except Exception as error:  # readers of damaged files raise anything
            head = {"error": " ".join((f"{type(error).__name__}: {error}")[:200].split())}
        text = json.dumps(head).encode()
        out.write(len(text).to_bytes(8, "little") + text)
        for part in arrays:
            out.write(part.tobytes())
        out.flush()


def _limit(memory: int) -> None:
    """Limit the memory of this process [bytes]."""
    try:
        import resource
    except ImportError:  # on Windows only time is limited
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(
        resource.RLIMIT_AS, (memory if hard == resource.RLIM_INFINITY else min(memory, hard), hard)
    )


def _read(path: str) -> list[np.ndarray[Any, Any]]:
    """Return vertices [m], faces, and the faces' colors: no rows if the file has none."""
    parts = _collada(path) if path.lower().endswith(".dae") else _by_trimesh(path)
    vertices, faces, colors = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], []
    count = 0
    for points, triangles, color in parts:
        vertices.append(points)
        faces.append(count + np.asarray(triangles, np.int64))
        colors.append(np.broadcast_to(NO_COLOR if color is None else color, (len(triangles), 4)))
        count += len(points)
    named = any(color is not None for _, _, color in parts)
    return [
        np.ascontiguousarray(np.concatenate(vertices), np.float64),
        np.ascontiguousarray(np.concatenate(faces), np.int64),
        np.ascontiguousarray(np.concatenate(colors) if named else np.empty((0, 4)), np.uint8),
    ]


def _collada(path: str) -> list[Part]:
    """Read COLLADA by pycollada; again without its materials if these are broken."""
    import collada

    with open(path, "rb") as file:
        content = file.read()
    ignored = [collada.common.DaeError]
    document = collada.Collada(io.BytesIO(content), ignore=ignored)
    if document.errors:
        tree = ElementTree.fromstring(content)
        for parent in list(tree.iter()):
            for child in list(parent):
                if child.tag.rpartition("}")[2] in _OF_MATERIALS:
                    parent.remove(child)
        document = collada.Collada(io.BytesIO(ElementTree.tostring(tree)), ignore=ignored)
    if document.scene is None:
        raise ValueError("it names no scene to be shown")
    unit = document.assetInfo.unitmeter
    parts: list[Part] = []
    for geometry in document.scene.objects("geometry"):
        turned = np.linalg.det(geometry.matrix[:3, :3]) < 0.0
        for primitive in geometry.primitives():
            if hasattr(primitive, "triangleset"):
                primitive = primitive.triangleset()
            if not isinstance(primitive, collada.triangleset.BoundTriangleSet) or primitive.vertex is None:
                continue
            diffuse = getattr(getattr(primitive.material, "effect", None), "diffuse", None)
            color = np.clip(np.multiply(diffuse, 255.0), 0.0, 255.0) if isinstance(diffuse, tuple) else None
            faces = primitive.vertex_index[:, ::-1] if turned else primitive.vertex_index
            parts.append((np.multiply(primitive.vertex, 1.0 if unit is None else unit), faces, color))
    return parts


def _by_trimesh(path: str) -> list[Part]:
    """Read another format by trimesh."""
    import trimesh

    scene = trimesh.load_scene(path, process=False)
    parts: list[Part] = []
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh):
            continue
        visual: Any = mesh.visual
        color = None
        if visual.kind == "texture":
            color = np.asarray(visual.material.main_color)
        elif visual.defined:
            color = np.asarray(visual.face_colors)
        turned = np.linalg.det(transform[:3, :3]) < 0.0
        points = trimesh.transform_points(mesh.vertices, transform)
        if mesh.units is not None:
            points = points * trimesh.units.unit_conversion(mesh.units, "meters")
        parts.append((points, mesh.faces[:, ::-1] if turned else mesh.faces, color))
    return parts


if __name__ == "__main__":
    main()
