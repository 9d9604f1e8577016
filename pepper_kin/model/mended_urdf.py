"""Repair, with a warning, of common faults of URDFs that Pinocchio accepts."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from pepper_kin.exceptions import ModelError, shortened
from pepper_kin.model.plain_number import plain_number

XACRO = "xacro"
SOURCE = (
    "macro", "include", "property", "arg", "if", "unless", "insert_block", "element", "attribute",
)  # fmt: skip
"""Elements that only unexpanded xacro sources have."""
GEOMETRIES = ("box", "sphere", "cylinder", "capsule", "mesh")


def mend(root: ET.Element, text: str) -> list[str]:
    """Repair a robot's tree in place and return a sentence for each repair.

    Removed are calls of undefined macros, shapes of types that URDF does not have, meshes with a scale that
    is not three numbers, mimic elements of unknown joints, negative velocity and effort limits (which some
    texts write for no limit), and all but the first of materials with the same name. Limits in the wrong
    order are swapped.

    Raises:
        ModelError: for xacro sources, which would be another robot without their macros.
    """
    calls = _left_over_calls(root) if XACRO in text else ()
    return [*calls, *_materials(root), *_joints(root), *_shapes(root)]


def _left_over_calls(root: ET.Element) -> Iterator[str]:
    """Remove calls of undefined macros; yield a sentence for each."""
    for parent in list(root.iter()):
        for element in list(parent):
            space, _, tag = str(element.tag).rpartition("}")
            if XACRO not in space and not tag.startswith(f"{XACRO}:"):
                continue
            if tag.removeprefix(f"{XACRO}:") in SOURCE:
                raise ModelError(f"URDF: holds <xacro:{tag}>; expand it first: xacro FILE > robot.urdf")
            parent.remove(element)
            yield f"<xacro:{shortened(tag)}> is a call of a macro that nothing defines; it is left out"


def _materials(root: ET.Element) -> Iterator[str]:
    """Remove later materials of the same name; yield a sentence for each."""
    names = set()
    for material in root.findall("material"):
        name = material.get("name")
        if name in names:
            root.remove(material)
            yield f"<material name={shortened(repr(name))}> stands twice; the first is used"
        names.add(name)


def _joints(root: ET.Element) -> Iterator[str]:
    """Repair limits and mimic elements of joints; yield a sentence for each repair."""
    moving = {joint.get("name") for joint in root.findall("joint") if joint.get("type") != "fixed"}
    for joint in root.findall("joint"):
        name, limit, mimic = joint.get("name"), joint.find("limit"), joint.find("mimic")
        if limit is not None and joint.get("type") != "continuous":
            lower, upper = (plain_number(limit.get(key, "0")) for key in ("lower", "upper"))
            if lower > upper:
                limit.set("lower", limit.get("upper", "0"))
                limit.set("upper", f"{lower}")
                yield f"joint {name}: lower limit {lower} is above upper limit {upper}; they changed places"
        for key in ("velocity", "effort"):
            if limit is not None and plain_number(limit.get(key, "0")) < 0.0:
                yield f"joint {name}: {key} is {limit.attrib.pop(key)}; it is read as no limit"
        if mimic is not None and mimic.get("joint") and mimic.get("joint") not in moving:
            joint.remove(mimic)
            yield f"joint {name} mimics an unknown joint {mimic.get('joint')!r}; it moves by itself"


def _shapes(root: ET.Element) -> Iterator[str]:
    """Remove shapes of unknown types or with wrong scales; yield a sentence for each."""
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            solid = next(iter(shape.find("geometry") or ()), None)
            if solid is None:
                continue
            why, scale = "", solid.get("scale")
            if solid.tag not in GEOMETRIES:
                why = f"unknown geometry <{shortened(solid.tag)}>"
            elif solid.tag == "mesh" and scale is not None and len(scale.split()) != 3:
                why = f"scale {shortened(repr(scale))} is not 3 numbers"
            if why:
                link.remove(shape)
                yield f"a {shape.tag} of link {link.get('name')} is left out: {why}"
