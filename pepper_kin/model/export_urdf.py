"""The robot as URDF, with its meshes named for another place."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.model.mesh_names import files_by_name, mesh_namer
from pepper_kin.model.xml_text import child, document

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel


def urdf_text(pepper: PepperModel, mesh_paths: str = "package", zero_inertials: bool = False) -> str:
    """Return the robot as a URDF text.

    Args:
        pepper: The robot.
        mesh_paths: "package" (names as they are), "absolute" or "relative".
        zero_inertials: Whether to write a mass of zero into links that have none.  Most programs read an
            absent <inertial> as no mass; PyBullet reads it as 1 kg, which adds 64 kg to Pepper's sensors.
    """
    name = mesh_namer(pepper.document, mesh_paths)
    if mesh_paths == "package" and not zero_inertials:
        return pepper.urdf
    files = files_by_name(pepper.document)
    root = pepper.document.copied_tree()
    for mesh in root.iterfind("link/*/geometry/mesh"):
        mesh.set("filename", name(files[mesh.get("filename", "")]))
    if zero_inertials:
        for link in root.findall("link"):
            if link.find("inertial") is None:
                inertial = child(link, "inertial")
                child(inertial, "mass", value="0")
                child(inertial, "inertia", ixx="0", ixy="0", ixz="0", iyy="0", iyz="0", izz="0")
    return document(root, f"{pepper.name}: exported by pepper_kin.")
