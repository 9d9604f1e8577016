"""Mesh names in exported files: by package, by absolute path, or relative to the file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from pepper_kin.model.joint_vectors import check_choice
from pepper_kin.model.shapes import Mesh
from pepper_kin.model.urdf_document import UrdfDocument

MESH_PATHS = ("package", "absolute", "relative")
FOLDER = "meshes"


def mesh_files(document: UrdfDocument) -> dict[str, Path]:
    """Return the files to copy for `mesh_paths="relative"`: path relative to the export -> source file.

    Two files of the same name in different folders get different names.
    """
    result: dict[str, Path] = {}
    for shape in (*document.visuals, *document.collisions):
        if isinstance(shape.geometry, Mesh) and shape.geometry.path not in result.values():
            path = shape.geometry.path
            name, count = f"{FOLDER}/{path.name}", 2
            while name in result:
                name, count = f"{FOLDER}/{path.stem}_{count}{path.suffix}", count + 1
            result[name] = path
    return result


def mesh_namer(document: UrdfDocument, mesh_paths: str, scheme: str = "package") -> Callable[[Path], str]:
    """Return a function from a mesh's file to its name in the export.

    Args:
        document: The robot.
        mesh_paths: "package" (as the URDF names it, under `scheme`), "absolute" or "relative" (see
            `mesh_files`).
        scheme: Scheme of the URI of a name by package; SDF has "model".

    Raises:
        InvalidValueError: for another choice.
    """
    check_choice("mesh_paths", mesh_paths, MESH_PATHS)
    if mesh_paths == "absolute":
        return lambda path: str(path.resolve())
    if mesh_paths == "relative":
        beside = {path: name for name, path in mesh_files(document).items()}
        return lambda path: beside[path]
    names = {path: name for name, path in _named_files(document)}
    return lambda path: names[path].replace("package://", f"{scheme}://", 1)


def _named_files(document: UrdfDocument) -> Iterator[tuple[str, Path]]:
    """Yield (name in the text, file) of each mesh; one file may have several names."""
    for kind, shapes in (("visual", document.visuals), ("collision", document.collisions)):
        # As in `read_shapes`, the first element of the first geometry of each shape counts.
        items = [item for link in document.tree.findall("link") for item in link.findall(kind)]
        geometries = [geometry for item in items if (geometry := item.find("geometry")) is not None]
        elements = [geometry[0] for geometry in geometries if geometry[0].tag == "mesh"]
        paths = [shape.geometry.path for shape in shapes if isinstance(shape.geometry, Mesh)]
        for element, path in zip(elements, paths, strict=True):
            yield element.get("filename", ""), path


def files_by_name(document: UrdfDocument) -> dict[str, Path]:
    """Return the file of each mesh name in the URDF's text."""
    return dict(_named_files(document))
