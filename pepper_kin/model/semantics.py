"""Joint groups, their states and the postures of the whole body, read from an SRDF text."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

from pepper_kin.exceptions import ModelError
from pepper_kin.model.urdf_document import UrdfDocument, refuse_document_types

MOST_NAMED = 8
"""Unknown names of a kind that a sentence lists."""


@dataclass(frozen=True)
class Semantics:
    """What an SRDF adds to a URDF.

    Attributes:
        groups: Group name -> joint names in tree order (moving joints only).
        states: (group name, state name) -> joint name -> value [rad, m, or opening of a hand].
        disabled_pairs: Pairs of links whose collisions are not checked, each sorted, with the reason.
        unknown: ("joint", "link" or "group", name) that the SRDF names and that there are not.
        text: The SRDF it was read from; empty where there was none.
    """

    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)
    states: dict[tuple[str, str], dict[str, float]] = field(default_factory=dict)
    disabled_pairs: dict[tuple[str, str], str] = field(default_factory=dict)
    unknown: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    text: str = field(default="", repr=False)

    def unknown_names(self) -> str:
        """Say in a sentence which joints, links and groups are named but not there; empty if none are."""
        parts = []
        for kind in ("joint", "link", "group"):
            names = [repr(name) for of, name in self.unknown if of == kind]
            more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
            if names:
                parts.append(f"{kind} {', '.join(names[:MOST_NAMED])}{more}")
        return f"the robot has no {'; no '.join(parts)}, which are left out" if parts else ""

    def postures(self) -> dict[str, dict[str, float]]:
        """Postures of the whole body: name -> joint name -> value.

        They are the states of the group `whole_body`; where it has none (most SRDFs name no such group), the
        states of all groups, those of one name joined.
        """
        whole = any(group == "whole_body" for group, _ in self.states)
        found: dict[str, dict[str, float]] = {}
        for (group, name), values in self.states.items():
            if group == "whole_body" or not whole:
                found[name] = {**found.get(name, {}), **values}
        return found


def parse_srdf(text: str, urdf: UrdfDocument) -> Semantics:
    """Read an SRDF text against its URDF.

    Args:
        text: The XML.
        urdf: The robot.  Joints, links and chains of the SRDF that it lacks (fingers of a locked hand) are
            left out, as are sub-groups that there are not: `Semantics.unknown` names them.

    Returns:
        Groups, states and disabled pairs.  `disable_default_collisions` disables all pairs of a link, and
        `enable_collisions` makes an exception, as in MoveIt.

    Raises:
        ModelError: on malformed XML, another root than <robot>, a group that holds itself, or a state whose
            value is no finite number.
    """
    refuse_document_types(text, "SRDF")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise ModelError(f"SRDF: not well-formed XML: {error}") from error
    if root.tag != "robot":
        raise ModelError(f"SRDF: the root element is <{root.tag}>, expected <robot>")
    return _Reader(root, urdf).semantics(text)


class _Reader:
    """Reads elements; what names something that there is not is left out and noted."""

    def __init__(self, root: ET.Element, urdf: UrdfDocument) -> None:
        self.root, self.urdf = root, urdf
        self.joints = {joint.name for joint in urdf.joints}
        self.joints |= {_name(joint) for joint in root.findall("virtual_joint")}
        self.links = frozenset(urdf.links)
        self.parent_joint = {joint.child: joint for joint in urdf.joints}
        self.groups: dict[str, ET.Element] = {}
        for group in root.findall("group"):
            self.groups.setdefault(_name(group), group)  # MoveIt keeps the first of one name as well
        self.unknown: dict[tuple[str, str], None] = {}
        self.members: dict[str, set[str]] = {}

    def semantics(self, text: str) -> Semantics:
        """Return all that the elements say."""
        moving = [joint.name for joint in self.urdf.joints if joint.type != "fixed"]
        members = {group: self._members(group) for group in self.groups}
        groups = {group: tuple(name for name in moving if name in members[group]) for group in members}
        states = {
            (_name(state, "group"), _name(state)): self._state_values(state)
            for state in self.root.findall("group_state")
        }
        pairs = self._disabled_pairs()
        for joint in self.root.findall("passive_joint"):
            self._known("joint", joint)
        for effector in self.root.findall("end_effector"):
            self._known("link", effector, "parent_link")
            self._known("group", effector, "group")
        return Semantics(groups, states, pairs, tuple(self.unknown), text)

    def _known(self, kind: str, element: ET.Element, attribute: str = "name") -> str | None:
        """Return a name if there is such a thing; else None, and note it where it is not empty."""
        name = _name(element, attribute)
        if name in {"joint": self.joints, "link": self.links, "group": self.groups}[kind]:
            return name
        if name:
            self.unknown[kind, name] = None
        return None

    def _state_values(self, state: ET.Element) -> dict[str, float]:
        """Return the values of a state; but those of a free-flyer: a URDF has none."""
        values: dict[str, float] = {}
        for joint in state.findall("joint"):
            words, name = joint.get("value", "").split(), _name(joint)
            try:
                numbers = [float(word) for word in words]
            except ValueError:
                numbers = []
            if not numbers or not all(map(math.isfinite, numbers)):
                raise ModelError(
                    f"SRDF: state {state.get('name')!r}: joint {name!r} has no number as value, but {words}"
                )
            if len(numbers) == 1:
                self._known("joint", joint)
                values[name] = numbers[0]
        return values

    def _disabled_pairs(self) -> dict[tuple[str, str], str]:
        pairs = {}
        for element in self.root.findall("disable_default_collisions"):
            link = self._known("link", element, "link")
            if link is not None:
                pairs.update({_sorted_pair(link, other): "Default" for other in self.links - {link}})
        for element in self.root.findall("enable_collisions"):
            first, second = self._known("link", element, "link1"), self._known("link", element, "link2")
            if first is not None and second is not None:
                pairs.pop(_sorted_pair(first, second), None)
        for element in self.root.findall("disable_collisions"):
            for attribute in ("link1", "link2"):
                self._known("link", element, attribute)
            pair = _sorted_pair(_name(element, "link1"), _name(element, "link2"))
            pairs[pair] = element.get("reason", "")
        return pairs

    def _members(self, group: str, above: tuple[str, ...] = ()) -> set[str]:
        """Return the joints of a group, whose sub-groups may stand anywhere in the text."""
        if group in self.members:
            return self.members[group]
        if group in above:
            raise ModelError(f"SRDF: group {group!r} holds itself: {' > '.join((*above, group))}")
        element = self.groups[group]
        members = {name for joint in element.findall("joint") if (name := self._known("joint", joint))}
        for sub in element.findall("group"):
            name = self._known("group", sub)
            members |= set() if name is None else self._members(name, (*above, group))
        for chain in element.findall("chain"):
            base, tip = self._known("link", chain, "base_link"), self._known("link", chain, "tip_link")
            if base is not None and tip is not None:
                # What both ends hang on lies beyond the chain, which may go up one branch and down another.
                members |= self._joints_above(base) ^ self._joints_above(tip)
        for link in element.findall("link"):
            joint = self.parent_joint.get(self._known("link", link) or "")
            members |= set() if joint is None else {joint.name}
        self.members[group] = members
        return members

    def _joints_above(self, link: str) -> set[str]:
        joints = set()
        while link in self.parent_joint:
            joint = self.parent_joint[link]
            joints.add(joint.name)
            link = joint.parent
        return joints


def _name(element: ET.Element, attribute: str = "name") -> str:
    """Return an attribute without the spaces around it; empty where it is absent."""
    return element.get(attribute, "").strip()


def _sorted_pair(a: str, b: str) -> tuple[str, str]:
    return (a, b) if a <= b else (b, a)
