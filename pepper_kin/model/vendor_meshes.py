"""The vendor's meshes instead of this library's shapes.

The meshes may not be redistributed and are not part
of this library: a user names their folder.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from pathlib import Path

from pepper_kin.exceptions import FileFormatError
from pepper_kin.model.urdf_document import UrdfDocument, parse_urdf

SUFFIXES = (".stl", ".obj", ".dae")
"""File extensions of meshes in order of preference: the viewer reads STL."""
RAISED = {"Pelvis": 0.268, "Hip": 0.079, "torso": 0.139}
"""Height of the vendor's frames of three links above this library's, which are at their joints [m]."""


def with_vendor_meshes(document: UrdfDocument, folder: str | Path, scale: float = 0.1) -> UrdfDocument:
    """Replace the visual shapes of Pepper by meshes found in a folder.

    A link takes the file named after it, as in `Head.stl`, `head.dae` or `LFinger11.stl` for the link
    `LFinger11_link`, anywhere below the folder; links without a file keep their shapes.

    Args:
        document: Pepper, without prefix.
        folder: Folder of the meshes.
        scale: Factor from the files' unit to meters; the vendor's files are in decimeters.

    Returns:
        A document with absolute file names of the meshes.

    Raises:
        FileFormatError: for a folder that does not exist, or has no mesh of any link.
    """
    found = _meshes_below(Path(folder))
    root = document.copied_tree()
    replaced = 0
    for link in root.findall("link"):
        name = str(link.get("name"))
        path = found.get(name.lower()) or found.get(name.removesuffix("_link").lower())
        if path is None:
            continue
        replaced += 1
        for visual in link.findall("visual"):
            link.remove(visual)
        visual = ET.SubElement(link, "visual", {"name": f"{name}_vendor"})
        ET.SubElement(visual, "origin", {"xyz": f"0 0 {RAISED.get(name, 0.0)}", "rpy": "0 0 0"})
        geometry = ET.SubElement(visual, "geometry")
        ET.SubElement(geometry, "mesh", {"filename": str(path), "scale": f"{scale} {scale} {scale}"})
    if not replaced:
        names = "Head.stl, torso.dae, l_wrist.stl"
        raise FileFormatError(folder, f"holds no mesh named after a link, such as {names}")
    return parse_urdf(ET.tostring(root, encoding="unicode"))


def _meshes_below(folder: Path) -> dict[str, Path]:
    """Return the mesh files below a folder by their stems in lower case."""
    if not os.path.isdir(folder):  # Path.is_dir raises for names that are too long
        raise FileFormatError(folder, "is not a folder")
    found: dict[str, Path] = {}
    for suffix in reversed(SUFFIXES):
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() == suffix:
                found[path.stem.lower()] = path.resolve()
    return found
