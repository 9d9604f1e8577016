"""The robot's groups, states and allowed collisions as SRDF, the format of MoveIt."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

from pepper_kin.model.xml_text import child, document, number

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

MOVEIT_REASONS = ("Adjacent", "Always", "Default", "Never", "User")


def srdf_text(pepper: PepperModel) -> str:
    """Return an SRDF text that names only joints and links of this robot.

    The text that the robot was loaded with is kept, chains of groups included, without elements for locked
    fingers or a base that does not move; states name only joints that have a coordinate, and only following
    joints are passive. A pair of links whose reason is not one of MoveIt's gets "User".
    """
    root = pepper.semantics.copied_tree() if pepper.semantics.text else _from_fields(pepper)
    root.set("name", pepper.name)
    links = set(pepper.link_names)
    moving = {joint.name for joint in pepper.document.joints if joint.type != "fixed"}
    for group in root.findall("group"):
        for joint in group.findall("joint"):
            if joint.get("name") not in moving:
                group.remove(joint)
    for state in root.findall("group_state"):
        for joint in state.findall("joint"):
            if joint.get("name") not in pepper.joint_names:
                state.remove(joint)
    _drop_empty(root)
    for joint in root.findall("passive_joint"):
        if joint.get("name") not in moving or joint.get("name") in pepper.joint_names:
            root.remove(joint)
    for joint in root.findall("virtual_joint"):
        if joint.get("child_link") != pepper.document.root:
            root.remove(joint)
    for pair in root.findall("disable_collisions"):
        if pair.get("link1") not in links or pair.get("link2") not in links:
            root.remove(pair)
        elif pair.get("reason") not in MOVEIT_REASONS:
            pair.set("reason", "User")
    return document(root, f"{pepper.name}: exported by pepper_kin.")


def _drop_empty(root: ET.Element) -> None:
    """Remove groups without members and all references to them, until no empty group is left."""
    while True:
        empty = {group.get("name") for group in root.findall("group") if len(group) == 0}
        if not empty:
            break
        for group in root.findall("group"):
            if group.get("name") in empty:
                root.remove(group)
                continue
            for member in group.findall("group"):
                if member.get("name") in empty:
                    group.remove(member)
    kept = {group.get("name") for group in root.findall("group")}
    for state in root.findall("group_state"):
        if state.get("group") not in kept or len(state) == 0:
            root.remove(state)
    for effector in root.findall("end_effector"):
        if effector.get("group") not in kept:
            root.remove(effector)


def _from_fields(pepper: PepperModel) -> ET.Element:
    """Return the tree of an SRDF with the groups, states and disabled pairs of a robot without SRDF text."""
    root = ET.Element("robot")
    for name, joints in pepper.semantics.groups.items():
        group = child(root, "group", name=name)
        for joint in joints:
            child(group, "joint", name=joint)
    for (group_name, name), values in pepper.semantics.states.items():
        state = child(root, "group_state", group=group_name, name=name)
        for joint, value in values.items():
            child(state, "joint", name=joint, value=number(value))
    for (first, second), reason in pepper.semantics.disabled_pairs.items():
        child(root, "disable_collisions", link1=first, link2=second, reason=reason)
    return root
