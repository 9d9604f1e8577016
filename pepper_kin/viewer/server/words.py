"""Names of bodies and joints for visitors of the page."""

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
"""Maximum number of touching pairs that are named; of more only the number is given."""

_MOTIONS = ("Pitch", "Roll", "Yaw", "")


def body_words(name: str) -> str:
    """Return words for a link or an object, such as "the left forearm" or "the table"."""
    side, part = _SIDES.get(name[:1]), _PARTS.get(name[1:])
    if side is not None and part is not None:
        return f"the {side} {part}"
    if name in _BODIES:
        return f"the {_BODIES[name]}"
    if name.startswith("Wheel"):
        return "the base"
    # Names with numbers ("box 1") and proper names have no article.
    return name if name[-1:].isdigit() or name[:1].isupper() else f"the {name}"


def joint_words(name: str) -> str:
    """Return words for a joint, such as "the left elbow (LElbowRoll)"."""
    for motion in _MOTIONS:
        stem = name.removesuffix(motion)
        if stem in _JOINTS:
            return f"the {_JOINTS[stem]} ({name})"
        if stem[:1] in _SIDES and stem[1:] in _LIMBS:
            return f"the {_SIDES[stem[0]]} {_LIMBS[stem[1:]]} ({name})"
    return name


def pair_words(pepper: PepperModel, pair: Contact | ClosestPair) -> tuple[str, str]:
    """Return words for both bodies of a pair, the one with more joints from the base first."""
    names = sorted(zip(pair.names, pair.links, strict=True), key=lambda item: -_depth(pepper, item[1]))
    return body_words(names[0][0]), body_words(names[1][0])


def length_words(length: float) -> str:
    """Return a length [m] as text in a suitable unit, such as "4 mm", "12 cm" or "1.9 m"."""
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
    """Return the contacts as a sentence; "" for none."""
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
    """Return the number of joints between a link and the world; -1 for an object in the world."""
    if link is None:
        return -1
    model = pepper.inner_model
    joint, count = model.frames[pepper.frame_id(link)].parentJoint, 0
    while joint:
        joint, count = model.parents[joint], count + 1
    return count
