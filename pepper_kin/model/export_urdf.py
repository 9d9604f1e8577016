"""The robot as URDF, with mesh names for the exported file."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.model.mesh_names import files_by_name, mesh_namer
from pepper_kin.model.shapes import rotation_rpy
from pepper_kin.model.xml_source import numbers_of
from pepper_kin.model.xml_text import child, document, numbers

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel


def urdf_text(pepper: PepperModel, mesh_paths: str = "package", zero_inertials: bool = False) -> str:
    """Return the robot as a URDF text of version 1.0.

    A capsule, which only version 1.2 has, becomes a cylinder NAME_shaft and two spheres NAME_start and
    NAME_end; `load_robot` joins the three parts of a collision shape again.

    Args:
        pepper: The robot.
        mesh_paths: "package" (names unchanged), "absolute" or "relative".
        zero_inertials: Whether to write a mass of zero into links without <inertial>. Most programs read an
            absent <inertial> as no mass; PyBullet reads it as 1 kg, which adds 64 kg to Pepper's sensors.
    """
    name = mesh_namer(pepper.document, mesh_paths)
    capsules = pepper.document.tree.find("link/*/geometry/capsule") is not None
    if mesh_paths == "package" and not zero_inertials and not capsules:
        return pepper.urdf
    files = files_by_name(pepper.document)
    root = pepper.document.copied_tree()
    _replace_capsules(root)
    for mesh in root.iterfind("link/*/geometry/mesh"):
        path = files.get(mesh.get("filename", ""))
        if path is not None:  # None for a second geometry of a shape, which is not read
            mesh.set("filename", name(path))
    if zero_inertials:
        for link in root.findall("link"):
            if link.find("inertial") is None:
                inertial = child(link, "inertial")
                child(inertial, "mass", value="0")
                child(inertial, "inertia", ixx="0", ixy="0", ixz="0", iyy="0", iyz="0", izz="0")
    return document(root, f"{pepper.name}: exported by pepper_kin.")


def _replace_capsules(root: ET.Element) -> None:
    """Replace capsules by a cylinder and two spheres, in place."""
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for index, shape in enumerate(link.findall(kind)):
                capsule = shape.find("geometry/capsule")
                if capsule is None:
                    continue
                name = shape.get("name") or f"{link.get('name')}_{kind}_{index}"
                origin, place = shape.find("origin"), list(link).index(shape)
                xyz, rpy = (
                    (0.0, 0.0, 0.0)
                    if origin is None
                    else numbers_of(origin.get(key), 3, (0.0, 0.0, 0.0), name)
                    for key in ("xyz", "rpy")
                )
                half = float(capsule.get("length", "0")) / 2
                parts = []
                for ending, height in (("shaft", 0.0), ("start", -half), ("end", half)):
                    part = copy.deepcopy(shape)
                    part.set("name", f"{name}_{ending}")
                    for old in (*part.findall("origin"), *part.findall("geometry")):
                        part.remove(old)
                    at = np.array(xyz) + height * rotation_rpy(*rpy)[:, 2]
                    child(part, "origin", xyz=numbers(at), rpy=numbers(rpy))
                    solid = {"radius": capsule.get("radius", "0")}
                    if ending == "shaft":
                        solid["length"] = capsule.get("length", "0")
                    child(child(part, "geometry"), "cylinder" if ending == "shaft" else "sphere", **solid)
                    parts.append(part)
                link.remove(shape)
                for part in reversed(parts):
                    link.insert(place, part)
