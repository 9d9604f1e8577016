"""Joint groups, their states and the postures of the whole body, read from an SRDF text."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

from pepper_kin.exceptions import ModelError, UnknownNameError
from pepper_kin.model.urdf_document import Joint, UrdfDocument, refuse_document_types


@dataclass(frozen=True)
class Semantics:
    """What an SRDF adds to a URDF.

    Attributes:
        groups: Group name -> joint names in tree order (moving joints only).
        states: (group name, state name) -> joint name -> value [rad, m, or opening of a hand].
        disabled_pairs: Pairs of links whose collisions are not checked, each sorted, with the reason.
        text: The SRDF it was read from; empty where there was none.
    """

    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)
    states: dict[tuple[str, str], dict[str, float]] = field(default_factory=dict)
    disabled_pairs: dict[tuple[str, str], str] = field(default_factory=dict)
    text: str = field(default="", repr=False)

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
        urdf: The robot; joints, links and chains of the SRDF that it lacks (fingers of a locked hand) are
            left out.

    Returns:
        Groups, states and disabled pairs.

    Raises:
        ModelError: on malformed XML, an unknown sub-group or one that holds itself, or a state whose value is
            no finite number.
    """
    refuse_document_types(text, "SRDF")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise ModelError(f"SRDF: not well-formed XML: {error}") from error
    moving = [joint.name for joint in urdf.joints if joint.type != "fixed"]
    elements = {element.get("name", ""): element for element in root.findall("group")}
    groups: dict[str, tuple[str, ...]] = {}
    for group in elements:
        members = _members(group, elements, urdf)
        groups[group] = tuple(name for name in moving if name in members)
    states = {
        (state.get("group", ""), state.get("name", "")): _state_values(state)
        for state in root.findall("group_state")
    }
    pairs = {
        _sorted_pair(p.get("link1", ""), p.get("link2", "")): p.get("reason", "")
        for p in root.findall("disable_collisions")
    }
    return Semantics(groups, states, pairs, text)


def _state_values(state: ET.Element) -> dict[str, float]:
    """Return the values of a state; but those of a free-flyer: a URDF has none."""
    values: dict[str, float] = {}
    for joint in state.findall("joint"):
        words = joint.get("value", "").split()
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            numbers = []
        if not numbers or not all(map(math.isfinite, numbers)):
            where, name = state.get("name"), joint.get("name")
            raise ModelError(f"SRDF: state {where!r}: joint {name!r} has no number as value, but {words}")
        if len(numbers) == 1:
            values[joint.get("name", "")] = numbers[0]
    return values


def _sorted_pair(a: str, b: str) -> tuple[str, str]:
    return (a, b) if a <= b else (b, a)


def _members(
    group: str, elements: dict[str, ET.Element], urdf: UrdfDocument, above: tuple[str, ...] = ()
) -> set[str]:
    """Return the joints of a group, whose sub-groups may stand anywhere in the text."""
    if group not in elements:
        raise ModelError(str(UnknownNameError("group in the SRDF", group, elements)))
    if group in above:
        raise ModelError(f"SRDF: group {group!r} holds itself: {' > '.join((*above, group))}")
    element = elements[group]
    parent_joint = {joint.child: joint for joint in urdf.joints}
    members = {str(joint.get("name")) for joint in element.findall("joint")}
    for sub in element.findall("group"):
        members |= _members(sub.get("name", ""), elements, urdf, (*above, group))
    for chain in element.findall("chain"):
        ends = chain.get("base_link", ""), chain.get("tip_link", "")
        if all(link in urdf.links for link in ends):
            # What both ends hang on lies beyond the chain, which may go up one branch and down another.
            up, down = (_joints_above(link, parent_joint) for link in ends)
            members |= up ^ down
    for link_element in element.findall("link"):
        joint = parent_joint.get(link_element.get("name", ""))
        if joint is not None:
            members.add(joint.name)
    return members


def _joints_above(link: str, parent_joint: dict[str, Joint]) -> set[str]:
    joints = set()
    while link in parent_joint:
        joint = parent_joint[link]
        joints.add(joint.name)
        link = joint.parent
    return joints
