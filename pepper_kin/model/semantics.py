"""Joint groups, their states and the postures of the whole body, read from an SRDF text."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

from pepper_kin.exceptions import ModelError, UnknownNameError
from pepper_kin.model.urdf_document import UrdfDocument, refuse_document_types


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

    def postures(self) -> tuple[str, ...]:
        """Names of the states of the group `whole_body`."""
        return tuple(state for group, state in self.states if group == "whole_body")


def parse_srdf(text: str, urdf: UrdfDocument) -> Semantics:
    """Read an SRDF text against its URDF.

    Args:
        text: The XML.
        urdf: The robot; joints of the SRDF that it lacks (fingers of a locked hand) are left out.

    Returns:
        Groups, states and disabled pairs.

    Raises:
        ModelError: on malformed XML, an unknown sub-group, a chain whose tip does not hang on its base, or a
            state whose value is no finite number.
    """
    refuse_document_types(text, "SRDF")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise ModelError(f"SRDF: not well-formed XML: {error}") from error
    moving = [joint.name for joint in urdf.joints if joint.type != "fixed"]
    groups: dict[str, tuple[str, ...]] = {}
    for element in root.findall("group"):
        members = _members(element, urdf, groups)
        groups[element.get("name", "")] = tuple(name for name in moving if name in members)
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


def _members(element: ET.Element, urdf: UrdfDocument, groups: dict[str, tuple[str, ...]]) -> set[str]:
    parent_joint = {joint.child: joint for joint in urdf.joints}
    members = {str(joint.get("name")) for joint in element.findall("joint")}
    for sub in element.findall("group"):
        name = sub.get("name", "")
        if name not in groups:
            raise ModelError(str(UnknownNameError("group in the SRDF", name, groups)))
        members.update(groups[name])
    for chain in element.findall("chain"):
        base, link = chain.get("base_link", ""), chain.get("tip_link", "")
        while link != base:
            if link not in parent_joint:
                group, tip = element.get("name"), chain.get("tip_link")
                raise ModelError(f"SRDF: chain of group {group!r}: {tip!r} does not hang on {base!r}")
            members.add(parent_joint[link].name)
            link = parent_joint[link].parent
    for link_element in element.findall("link"):
        joint = parent_joint.get(link_element.get("name", ""))
        if joint is not None:
            members.add(joint.name)
    return members
