"""Pinocchio's order of a URDF's joints and frames, and the couplings of mimic joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.exceptions import ModelError
from pepper_kin.model.urdf_document import Joint, UrdfDocument
from pepper_kin.model.xml_source import MOST

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel


def depth_first(document: UrdfDocument) -> tuple[Joint, ...]:
    """Return all joints, parents before children; children of one link are sorted by name."""
    below: dict[str, list[Joint]] = {}
    for joint in sorted(document.joints, key=lambda joint: joint.name, reverse=True):
        below.setdefault(joint.parent, []).append(joint)
    waiting, order = list(below.get(document.root, ())), []
    while waiting:
        joint = waiting.pop()
        order.append(joint)
        waiting += below.get(joint.child, ())
    return tuple(order)


def frame_ids(document: UrdfDocument, order: tuple[Joint, ...]) -> dict[str, int]:
    """Return Pinocchio's index of each link's frame, by link in document order.

    Frame 0 is the universe, frame 1 the root link; each joint then adds its own frame and its child's.

    Args:
        document: The robot.
        order: All joints in the order of `depth_first`.
    """
    found = {document.root: 1} | {joint.child: 2 * place + 3 for place, joint in enumerate(order)}
    return {link: found[link] for link in document.links}


def mimic_map(
    full_names: tuple[str, ...], names: tuple[str, ...], joints: dict[str, Joint]
) -> tuple[np.ndarray, np.ndarray]:
    """Return E and e of q_full = E q + e; chains of mimic joints are resolved.

    Args:
        full_names: Names of all moving joints.
        names: Names of the moving joints without mimic element.
        joints: Moving joints by name.

    Raises:
        ModelError: for a joint that mimics itself, or whose factors are too large.
    """
    full_map, offset = np.zeros((len(full_names), len(names))), np.zeros(len(full_names))
    known = {name: (column, 1.0, 0.0) for column, name in enumerate(names)}
    for row, name in enumerate(full_names):
        chain = []
        while name not in known:
            chain.append(name)
            name = joints[name].mimic[0]  # type: ignore[index]
            if len(chain) > len(full_names):
                raise ModelError(f"URDF: joint {name} mimics itself")
        for follower in reversed(chain):
            leader, multiplier, addend = joints[follower].mimic  # type: ignore[misc]
            column, gain, shift = known[leader]
            known[follower] = column, multiplier * gain, multiplier * shift + addend
            if not max(map(abs, known[follower][1:])) <= MOST:
                reason = f"its factors multiply to more than {MOST:g}"
                raise ModelError(f"URDF: joint {follower} mimics {leader}: {reason}")
        column, gain, shift = known[full_names[row]]
        full_map[row, column], offset[row] = gain, shift
    return full_map, offset


def coupling_of(pepper: PepperModel, joint: str) -> tuple[str, float, float]:
    """Return the coordinate that a moving joint follows (itself if it is one), the gain and the offset.

    Chains of followers are resolved: position = gain * coordinate + offset.
    """
    row = list(pepper.inner_model.names).index(joint) - 1
    column = int(np.argmax(np.abs(pepper.full_map[row])))
    gain, offset = pepper.full_map[row, column], pepper.full_offset[row]
    return pepper.joint_names[column], float(gain), float(offset)


def leader_of(pepper: PepperModel, joint: str) -> str:
    """Return the coordinate that a moving joint follows; itself if it is one."""
    return coupling_of(pepper, joint)[0]
