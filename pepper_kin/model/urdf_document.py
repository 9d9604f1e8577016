"""Reading and checking of a URDF text without any robotics library, so that errors name the element."""

from __future__ import annotations

import math
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from pepper_kin.exceptions import ModelError, ModelWarning, shortened
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model.mended_urdf import mend
from pepper_kin.model.urdf_version import to_version_1_0
from pepper_kin.model.xml_source import (
    XmlText,
    attribute_of,
    number_of,
    parse_xml,
    positive_of,
    with_bound_prefixes,
)

if TYPE_CHECKING:
    from pepper_kin.model.shapes import Shape
    from pepper_kin.model.wheels import Wheels

urdf_shapes = lazy_module("pepper_kin.model.urdf_shapes")

MOST_MOVING = 4000
"""Maximum number of moving joints: matrices grow with the square of their number."""
MOST_LINKS = 10_000
"""Maximum number of links: Pinocchio compares the name of each link with all before it."""
LONGEST_CHAIN = 3000
"""Maximum number of joints between the root and a link: Pinocchio reads a chain recursively, on the stack."""
MOVING_TYPES = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Joint:
    """One joint of a URDF.

    Attributes:
        name: Name of the joint.
        type: revolute, continuous, prismatic or fixed.
        parent: Parent link.
        child: Child link.
        lower: Lower limit [rad or m], -inf where there is none.
        upper: Upper limit [rad or m], inf where there is none.
        velocity: Velocity limit [rad/s or m/s], inf where there is none.
        acceleration: Acceleration limit [rad/s^2 or m/s^2], inf where there is none.
        effort: Effort limit [N m or N], inf where there is none.
        mimic: (leading joint, multiplier, offset) or None.
        damping: Viscous friction [N m s/rad or N s/m], zero where none is given.
        friction: Coulomb friction [N m or N], zero where none is given.
    """

    name: str
    type: str
    parent: str
    child: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    effort: float
    mimic: tuple[str, float, float] | None
    damping: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True)
class UrdfDocument(XmlText):
    """Contents of a URDF text: name, links, joints, shapes.

    Attributes:
        name: Name of the robot.
        text: Text of the URDF.
        links: Link names in document order.
        joints: All joints in document order.
        package_dirs: Folders that hold packages, for `package://` file names.
        wheels: Limits of the wheels of an added base; None without one.
        tree: Root element of the text, see `XmlText`.
    """

    name: str
    text: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    package_dirs: tuple[Path, ...] = field(default=(), repr=False)
    wheels: Wheels | None = field(default=None, repr=False)

    @property
    def visuals(self) -> tuple[Shape, ...]:
        """Visual shapes."""
        return self.shapes[0]

    @property
    def collisions(self) -> tuple[Shape, ...]:
        """Collision shapes; a cylinder and spheres named NAME_shaft, NAME_start, NAME_end are one capsule."""
        return self.shapes[1]

    @cached_property
    def shapes(self) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
        """Visual and collision shapes, read from the text at the first use.

        Raises:
            ModelError: naming the shape that is malformed.
        """
        return urdf_shapes.read_shapes(self.tree, self.package_dirs)

    @property
    def root(self) -> str:
        """Name of the link that is not the child of any joint."""
        children = {joint.child for joint in self.joints}
        return next(link for link in self.links if link not in children)


def parse_urdf(text: str, package_dirs: Sequence[Path] = ()) -> UrdfDocument:
    """Read a URDF text of version 1.0 to 1.2; its shapes are read at their first use.

    Args:
        text: The XML. Document type declarations are refused: entities can hide or multiply content.
        package_dirs: Folders that hold packages, for `package://` file names.

    Returns:
        The document.

    Raises:
        ModelError: naming the element that is malformed, missing, doubled or disconnected, or the version.

    Warns:
        ModelWarning: naming each repair, see `mended_urdf`.
    """
    text = with_bound_prefixes(text.lstrip())
    root = parse_xml(text, "URDF")
    rewritten = to_version_1_0(root)
    mended = mend(root, text)
    for what in mended:
        warnings.warn(f"URDF: {what}", ModelWarning, stacklevel=4)
    if mended or rewritten:
        text = ET.tostring(root, encoding="unicode")
    links = tuple(attribute_of(element, "name", "link") for element in root.findall("link"))
    joints = tuple(_joint(element) for element in root.findall("joint"))
    _check_tree(links, joints)
    document = UrdfDocument(root.get("name", "robot"), text, links, joints, tuple(package_dirs))
    document.keep_tree(root)
    return document


def _joint(element: ET.Element) -> Joint:
    """Return a joint from its element, after a check of its attributes."""
    name = attribute_of(element, "name", "the robot")
    kind = attribute_of(element, "type", f"joint {name}")
    if kind not in (*MOVING_TYPES, "fixed"):
        raise ModelError(
            f"URDF: joint {name} has type {shortened(repr(kind))}; "
            f"supported: {', '.join((*MOVING_TYPES, 'fixed'))}"
        )
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise ModelError(f"URDF: joint {name} has no <parent> or no <child>")
    limit = element.find("limit")
    if limit is None:
        limit = ET.Element("limit")
        if kind in ("revolute", "prismatic"):
            raise ModelError(f"URDF: joint {name} is {kind} and has no <limit>")
    bounded = kind != "continuous"
    lower = number_of(limit, "lower", 0.0, f"joint {name}") if bounded else -math.inf
    upper = number_of(limit, "upper", 0.0, f"joint {name}") if bounded else math.inf
    mimic, dynamics = element.find("mimic"), element.find("dynamics")  # a fixed joint follows nothing
    dynamics = ET.Element("dynamics") if dynamics is None else dynamics
    return Joint(
        name=name,
        type=kind,
        parent=attribute_of(parent, "link", f"joint {name}"),
        child=attribute_of(child, "link", f"joint {name}"),
        lower=lower,
        upper=upper,
        velocity=positive_of(limit, "velocity", math.inf, f"joint {name}"),
        acceleration=positive_of(limit, "acceleration", math.inf, f"joint {name}"),
        effort=positive_of(limit, "effort", math.inf, f"joint {name}"),
        mimic=None
        if mimic is None or kind == "fixed"
        else (
            attribute_of(mimic, "joint", f"joint {name}"),
            number_of(mimic, "multiplier", 1.0, f"mimic of {name}"),
            number_of(mimic, "offset", 0.0, f"mimic of {name}"),
        ),
        damping=positive_of(dynamics, "damping", 0.0, f"joint {name}"),
        friction=positive_of(dynamics, "friction", 0.0, f"joint {name}"),
    )


def _check_tree(links: tuple[str, ...], joints: tuple[Joint, ...]) -> None:
    """Refuse duplicate names, unknown links, loops, several roots, and trees that are too large."""
    if not links:
        raise ModelError("URDF: the robot has no link")
    for names, what in ((links, "link"), ([j.name for j in joints], "joint")):
        unique: set[str] = set()
        for name in names:
            if name in unique:
                raise ModelError(f"URDF: two {what}s are named {name!r}")
            unique.add(name)
    known = set(links)
    parent_of: dict[str, str] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in known:
                raise ModelError(f"URDF: joint {joint.name} names an unknown link {end!r}")
        if joint.child in parent_of:
            raise ModelError(f"URDF: link {joint.child!r} has two parent joints")
        parent_of[joint.child] = joint.parent
    roots = [link for link in links if link not in parent_of]
    if len(roots) != 1:
        listed = shortened(", ".join(roots)) or "(a loop)"
        raise ModelError(f"URDF: expected one root link, found {len(roots)}: {listed}")
    _check_depth(links, parent_of, roots[0])
    if len(links) > MOST_LINKS:
        raise ModelError(f"URDF: {len(links)} links, at most {MOST_LINKS} are read")
    moving = sum(joint.type != "fixed" for joint in joints)
    if moving > MOST_MOVING:
        raise ModelError(f"URDF: {moving} joints move, at most {MOST_MOVING} are read")


def _check_depth(links: tuple[str, ...], parent_of: dict[str, str], root: str) -> None:
    """Refuse loops, and chains that are too long; each link is visited once."""
    depth = {root: 0}
    for link in links:
        chain = []
        while link not in depth:
            chain.append(link)
            link = parent_of[link]
            if len(chain) > len(links):
                raise ModelError(f"URDF: link {link!r} is part of a loop")
        for below in reversed(chain):
            depth[below] = depth[parent_of[below]] + 1
            if depth[below] > LONGEST_CHAIN:
                reason = f"hangs on a chain of more than {LONGEST_CHAIN} joints"
                raise ModelError(f"URDF: link {below!r} {reason}")
