"""Joint groups, their states and the postures of the whole body, read from an SRDF text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field

from pepper_kin.exceptions import ModelError, shortened
from pepper_kin.model.plain_number import plain_number
from pepper_kin.model.urdf_document import Joint, UrdfDocument
from pepper_kin.model.xml_source import MOST, XmlText, parse_xml

MOST_NAMED = 8
"""Maximum number of unknown names of a kind listed in a sentence."""
ROUNDED = 1e-5
"""Maximum change of a state's value that rounding explains [rad or m]."""
MOST_NAMES = 2_000_000
"""Maximum number of members of all groups, and of pairs of links, that an SRDF may define."""


@dataclass(frozen=True)
class Semantics(XmlText):
    """Contents of an SRDF: groups, states and disabled pairs.

    Attributes:
        groups: Group name -> joint names in tree order (moving joints only).
        states: (group name, state name) -> joint name -> value [rad, m, or opening of a hand].
        disabled_pairs: Pairs of links whose collisions are not checked, each sorted, with the reason.
        unknown: ("joint", "link" or "group", name) of each name in the SRDF that the robot does not have.
        changed: Sentences about values of states that no posture of the robot has.
        text: Text of the SRDF; empty without an SRDF, and then there is no `tree`.
    """

    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)
    states: dict[tuple[str, str], dict[str, float]] = field(default_factory=dict)
    disabled_pairs: dict[tuple[str, str], str] = field(default_factory=dict)
    unknown: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    changed: tuple[str, ...] = field(default=(), repr=False)
    text: str = field(default="", repr=False)

    def unknown_names(self) -> str:
        """Return a sentence that lists the unknown joints, links and groups; empty if there are none."""
        parts = []
        for kind in ("joint", "link", "group"):
            names = [shortened(repr(name)) for of, name in self.unknown if of == kind]
            more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
            if names:
                parts.append(f"{kind} {', '.join(names[:MOST_NAMED])}{more}")
        return f"the robot has no {'; no '.join(parts)}, which are left out" if parts else ""

    def postures(self) -> dict[str, dict[str, float]]:
        """Return the postures of the whole body: name -> joint name -> value [rad or m].

        They are the states of the group `whole_body`. If it has none (most SRDFs name no such group), they
        are the states of all groups, joined by name.
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
        urdf: The robot.  Joints, links and chains of the SRDF that the robot lacks (fingers of a locked hand)
            are left out, as are undefined sub-groups: `Semantics.unknown` names them.

    Returns:
        Groups, states and disabled pairs.  `disable_default_collisions` disables all pairs of a link, and
        `enable_collisions` makes an exception, as in MoveIt.

    Raises:
        ModelError: for malformed XML, a root other than <robot>, a group that contains itself, or a state
            whose value is not a finite number.
    """
    return _SrdfReader(parse_xml(text, "SRDF"), urdf).semantics(text)


class _SrdfReader:
    """Reader of an SRDF's elements, which leaves out and notes unknown names."""

    def __init__(self, root: ET.Element, urdf: UrdfDocument) -> None:
        self.root, self.urdf = root, urdf
        self.joints = {joint.name for joint in urdf.joints}
        self.joints |= {_name(joint) for joint in root.findall("virtual_joint")}
        self.links = frozenset(urdf.links)
        self.parent_joint = {joint.child: joint for joint in urdf.joints}
        self.groups: dict[str, ET.Element] = {}
        for group in root.findall("group"):
            self.groups.setdefault(_name(group), group)  # the first of a name counts, as in MoveIt
        self.unknown: dict[tuple[str, str], None] = {}
        self.changed: list[str] = []
        self.members: dict[str, set[str]] = {}
        self.counted = 0

    def semantics(self, text: str) -> Semantics:
        """Return the groups, states and disabled pairs of the SRDF."""
        moving = [joint.name for joint in self.urdf.joints if joint.type != "fixed"]
        members = {group: self._members(group) for group in self.groups}
        place = {name: k for k, name in enumerate(moving)}
        groups = {
            group: tuple(sorted(members[group] & place.keys(), key=place.__getitem__)) for group in members
        }
        states: dict[tuple[str, str], dict[str, float]] = {}
        for state in self.root.findall("group_state"):
            key = _name(state, "group"), _name(state)
            if key in states:
                self.changed.append(f"{_place(state)} stands twice; the last counts")
            states[key] = self._state_values(state)
        pairs = self._disabled_pairs()
        for joint in self.root.findall("passive_joint"):
            self._known("joint", joint)
        for effector in self.root.findall("end_effector"):
            self._known("link", effector, "parent_link")
            self._known("group", effector, "group")
        self.changed += changed_states(states, self.urdf)
        return Semantics(groups, states, pairs, tuple(self.unknown), tuple(self.changed), text)

    def _count(self, names: int) -> None:
        """Count names, and refuse a short text that defines too many of them."""
        self.counted += names
        if self.counted > MOST_NAMES:
            raise ModelError(f"SRDF: its groups and pairs list more than {MOST_NAMES} names")

    def _known(self, kind: str, element: ET.Element, attribute: str = "name") -> str | None:
        """Return the name in an attribute if such a part exists; else None, and note the unknown name."""
        name = _name(element, attribute)
        if name in {"joint": self.joints, "link": self.links, "group": self.groups}[kind]:
            return name
        if name:
            self.unknown[kind, name] = None
        return None

    def _state_values(self, state: ET.Element) -> dict[str, float]:
        """Return the values of a state, without floating joints, which have several values."""
        values: dict[str, float] = {}
        single = {joint.name for joint in self.urdf.joints}
        for joint in state.findall("joint"):
            words, name = joint.get("value", "").split(), _name(joint)
            numbers = [plain_number(word) for word in words]
            if not numbers or not all(abs(number) <= MOST for number in numbers):
                where = f"state {shortened(state.get('name'))!r}: joint {shortened(name)!r}"
                raise ModelError(f"SRDF: {where} has no number as value, but {shortened(words)}")
            if len(numbers) == 1:
                self._known("joint", joint)
                if name in values:
                    self.changed.append(f"{_place(state)}: joint {name} stands twice; the last counts")
                values[name] = numbers[0]
            elif name in single:
                reason = f"has {len(numbers)} values, expected 1, and is left out"
                self.changed.append(f"{_place(state)}: joint {name} {reason}")
        return values

    def _disabled_pairs(self) -> dict[tuple[str, str], str]:
        """Return the pairs of links that are not checked, with the reason."""
        pairs: dict[tuple[str, str], str] = {}
        for element in self.root.findall("disable_default_collisions"):
            link = self._known("link", element, "link")
            if link is not None:
                self._count(len(self.links))
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

    def _members(self, group: str) -> set[str]:
        """Return the joints of a group; its sub-groups may come before or after it in the SRDF."""
        above: dict[str, None] = {}  # groups whose sub-groups are being read, outermost first
        waiting = [group]
        while waiting:
            name = waiting[-1]
            open_subs = [sub for sub in self._sub_groups(name) if sub not in self.members]
            if name in self.members or not open_subs:
                if name not in self.members:
                    self.members[name] = self._own_members(name)
                waiting.pop()
                above.pop(name, None)
                continue
            above[name] = None
            for sub in open_subs:
                if sub in above:
                    raise ModelError(f"SRDF: group {sub!r} contains itself: {' > '.join((*above, sub))}")
            waiting += open_subs
        return self.members[group]

    def _sub_groups(self, group: str) -> list[str]:
        """Return the known sub-groups of a group."""
        names = (self._known("group", sub) for sub in self.groups[group].findall("group"))
        return [name for name in names if name is not None]

    def _own_members(self, group: str) -> set[str]:
        """Return the joints of a group whose sub-groups are known."""
        element = self.groups[group]
        members = {name for joint in element.findall("joint") if (name := self._known("joint", joint))}
        for sub in self._sub_groups(group):
            members |= self.members[sub]
        for chain in element.findall("chain"):
            base, tip = self._known("link", chain, "base_link"), self._known("link", chain, "tip_link")
            if base is not None and tip is not None:
                # Joints above both ends are not in the chain, which may go up one branch and down another.
                members |= self._joints_above(base) ^ self._joints_above(tip)
        for link in element.findall("link"):
            joint = self.parent_joint.get(self._known("link", link) or "")
            members |= set() if joint is None else {joint.name}
        self._count(len(members))
        return members

    def _joints_above(self, link: str) -> set[str]:
        """Return the joints between a link and the root."""
        joints = set()
        while link in self.parent_joint:
            joint = self.parent_joint[link]
            joints.add(joint.name)
            link = joint.parent
        self._count(len(joints))
        return joints


def changed_states(states: Mapping[tuple[str, str], Mapping[str, float]], urdf: UrdfDocument) -> list[str]:
    """Return a sentence for each value of a state that no posture of the robot has.

    Args:
        states: (group name, state name) -> joint name -> value [rad or m].
        urdf: The robot.
    """
    sentences = []
    joints = {joint.name: joint for joint in urdf.joints}
    for (group, state), values in states.items():
        for name, value in values.items():
            joint, where = joints.get(name), f"state {shortened(state)!r} of group {shortened(group)!r}"
            if joint is None:
                continue
            nearest = min(max(value, joint.lower), joint.upper)
            if joint.type == "fixed" and value:
                sentences.append(f"{where}: joint {name} is fixed, its value {value:g} is left out")
            elif joint.mimic is not None:
                leader, follows = joint.mimic[0], _followed(name, values, joints)
                if abs(follows - value) > ROUNDED:
                    reason = f"follows {leader} and goes to {follows:.6g}"
                    sentences.append(f"{where}: joint {name} has the value {value:.6g}, but {reason}")
            elif joint.type != "fixed" and abs(nearest - value) > ROUNDED:
                limits = f"its limits {joint.lower:.6g} and {joint.upper:.6g}"
                reason = f"has the value {value:.6g}, beyond {limits}; it becomes {nearest:.6g}"
                sentences.append(f"{where}: joint {name} {reason}")
    return sentences


def _followed(name: str, values: Mapping[str, float], joints: Mapping[str, Joint]) -> float:
    """Return the position of a following joint, through chains of mimic joints [rad or m]."""
    gain, shift = 1.0, 0.0
    for _ in joints:  # the length of a chain is at most the number of joints
        mimic = joints[name].mimic if name in joints else None
        if mimic is None:
            break
        name, gain, shift = mimic[0], gain * mimic[1], shift + gain * mimic[2]
    return gain * values.get(name, 0.0) + shift


def _place(state: ET.Element) -> str:
    """Return a state's name and group for a message."""
    return f"state {shortened(_name(state))!r} of group {shortened(_name(state, 'group'))!r}"


def _name(element: ET.Element, attribute: str = "name") -> str:
    """Return an attribute without the spaces around it; empty where it is absent."""
    return element.get(attribute, "").strip()


def _sorted_pair(a: str, b: str) -> tuple[str, str]:
    return (a, b) if a <= b else (b, a)
