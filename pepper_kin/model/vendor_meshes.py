"""The vendor's own meshes in place of ours, where a user has them.

They may not be redistributed and are no part of this library: a user names the folder that holds them.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from pathlib import Path

from pepper_kin.exceptions import FileFormatError
from pepper_kin.model.urdf_document import UrdfDocument, parse_urdf

SUFFIXES = (".stl", ".obj", ".dae")
"""What is taken, best first: the viewer reads STL."""
RAISED = {"Pelvis": 0.268, "Hip": 0.079, "torso": 0.139}
"""The vendor's frames of three links lie higher than ours, which sit on their joints [m]."""


def with_vendor_meshes(document: UrdfDocument, folder: str | Path, scale: float = 0.1) -> UrdfDocument:
    """Replace the visual shapes of Pepper by meshes found in a folder.

    A link takes the file named after it, as in `Head.stl`, `head.dae` or `LFinger11.stl` for the link
    `LFinger11_link`, anywhere below the folder; links without a file keep our shapes.

    Args:
        document: Pepper, without prefix.
        folder: Where the meshes are.
        scale: Factor from the files' unit to meters; the vendor's files are in decimeters.

    Returns:
        The same with absolute file names.

    Raises:
        FileFormatError: for a folder that is not there, or holds no mesh of any link.
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
    """Return the meshes below a folder by their names in lower case."""
    if not os.path.isdir(folder):  # Path.is_dir raises for names that are too long
        raise FileFormatError(folder, "is not a folder")
    found: dict[str, Path] = {}
    for suffix in reversed(SUFFIXES):
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() == suffix:
                found[path.stem.lower()] = path.resolve()
    return found
