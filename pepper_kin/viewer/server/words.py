"""Names of bodies and joints as a visitor of the page would say them."""

from __future__ import annotations

from collections.abc import Iterable

from pepper_kin.collision import ClosestPair, Contact
from pepper_kin.model import PepperModel

_BODIES = {
    "Tibia": "base",
    "Pelvis": "leg",
    "Hip": "hip",
    "torso": "torso",
    "Neck": "neck",
    "Head": "head",
}
_SIDES = {"L": "left", "R": "right", "l": "left", "r": "right"}
_PARTS = {
    "Shoulder": "shoulder",
    "Bicep": "upper arm",
    "Elbow": "elbow",
    "ForeArm": "forearm",
    "_wrist": "hand",
    "_gripper": "hand",
    "_hand": "hand",
    "Hand": "hand",
}
_JOINTS = {"Knee": "knee", "Hip": "hip", "Head": "neck"}
_LIMBS = {"Shoulder": "shoulder", "Elbow": "elbow", "Wrist": "wrist", "Hand": "hand"}
MOST_PAIRS = 3
"""Pairs that touch and are named; of more only the number is given."""

_MOTIONS = ("Pitch", "Roll", "Yaw", "")


def body_words(name: str) -> str:
    """Return what to call a link or an object, such as "the left forearm" or "the table"."""
    side, part = _SIDES.get(name[:1]), _PARTS.get(name[1:])
    if side is not None and part is not None:
        return f"the {side} {part}"
    if name in _BODIES:
        return f"the {_BODIES[name]}"
    if name.startswith("Wheel"):
        return "the base"
    # "the box 1" is not English, nor is an article before a proper name.
    return name if name[-1:].isdigit() or name[:1].isupper() else f"the {name}"


def joint_words(name: str) -> str:
    """Return what to call a joint, such as "the left elbow (LElbowRoll)"."""
    for motion in _MOTIONS:
        stem = name.removesuffix(motion)
        if stem in _JOINTS:
            return f"the {_JOINTS[stem]} ({name})"
        if stem[:1] in _SIDES and stem[1:] in _LIMBS:
            return f"the {_SIDES[stem[0]]} {_LIMBS[stem[1:]]} ({name})"
    return name


def pair_words(pepper: PepperModel, pair: Contact | ClosestPair) -> tuple[str, str]:
    """Return what to call the two of a pair, the one that moves farther from the base first."""
    names = sorted(zip(pair.names, pair.links, strict=True), key=lambda item: -_depth(pepper, item[1]))
    return body_words(names[0][0]), body_words(names[1][0])


def length_words(length: float) -> str:
    """Return a length [m] in the unit that suits it, such as "4 mm", "12 cm" or "1.9 m"."""
    if length < 0.0195:
        return f"{1000 * length:.0f} mm"
    return f"{100 * length:.0f} cm" if length < 0.995 else f"{length:.1f} m"


def listed(words: Iterable[str]) -> str:
    """Return words joined by commas and "and"."""
    items = list(words)
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"


def sentence(text: str) -> str:
    """Return a text with its first letter as a capital."""
    return text[:1].upper() + text[1:]


def contact_words(pepper: PepperModel, found: Iterable[Contact]) -> str:
    """Return what touches what as a sentence; empty where nothing does."""
    pairs: dict[str, list[str]] = {}
    for contact in found:
        subject, other = pair_words(pepper, contact)
        pairs.setdefault(other, [])
        if subject not in pairs[other]:
            pairs[other].append(subject)
    clauses = [
        f"{listed(subjects)} {'touch' if len(subjects) > 1 else 'touches'} {other}"
        for other, subjects in pairs.items()
    ]
    more = len(clauses) - MOST_PAIRS
    rest = f"; and {more} more" if more > 0 else ""
    return f"{sentence('; '.join(clauses[:MOST_PAIRS]))}{rest}." if clauses else ""


def _depth(pepper: PepperModel, link: str | None) -> int:
    """Return how many joints lie between a link and the world; -1 for what stands in the world."""
    if link is None:
        return -1
    model = pepper.inner_model
    joint, count = model.frames[pepper.frame_id(link)].parentJoint, 0
    while joint:
        joint, count = model.parents[joint], count + 1
    return count
