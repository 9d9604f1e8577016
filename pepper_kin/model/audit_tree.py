"""Audit of the tree: joint limits, leaders of mimic joints, and one root."""

from __future__ import annotations

from dataclasses import dataclass

from pepper_kin.exceptions import shortened
from pepper_kin.model.head_pitch import DOCUMENTED
from pepper_kin.model.tolerant_urdf import Fault, JointFacts, UrdfFacts
from pepper_kin.model.urdf_document import MOVING_TYPES

PHALANGES = (
    *(f"Finger{finger}{phalanx}" for finger in (1, 2, 3, 4) for phalanx in (1, 2, 3)),
    "Thumb1",
    "Thumb2",
)
"""Pepper's finger joints of one hand, without the side's letter."""
_ROUNDING = 1e-4  # tolerance of limits that are written with few decimals [rad]
_OF_PEPPER = {"HeadYaw", "HeadPitch", "KneePitch"}  # joints that identify Pepper: NAO has two knees


@dataclass(frozen=True)
class JointRow:
    """Limits of one moving joint, from its description.

    Attributes:
        name: The joint.
        type: Joint type, one of MOVING_TYPES.
        lower: Lower limit [rad or m], None where absent.
        upper: Upper limit [rad or m], None where absent.
        velocity: Velocity limit [rad/s or m/s], None where absent.
        effort: Effort limit [N m or N], None where absent.
        status: "ok" or "fault".
    """

    name: str
    type: str
    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None
    status: str

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        values = (self.lower, self.upper, self.velocity, self.effort)
        texts = ("-" if value is None else f"{value:.6g}" for value in values)
        return (self.name, self.type, *texts, "" if self.status == "ok" else self.status)


def audit_joints(facts: UrdfFacts, faults: list[Fault]) -> list[JointRow]:
    """Return a row per moving joint; faults are appended to `faults`."""
    rows = []
    wrong = _wrong_leaders(facts)
    for joint in facts.joints.values():
        for end in (joint.parent, joint.child):
            if end and end not in facts.links:
                faults.append(Fault("structure", f"joint {joint.name}", f"it names an unknown link {end!r}"))
        if joint.type not in MOVING_TYPES:
            continue
        own = [*_limit_faults(joint), *_mimic_faults(joint, wrong)]
        faults += own
        limits = joint.limits
        rows.append(
            JointRow(
                joint.name,
                joint.type,
                limits.get("lower"),
                limits.get("upper"),
                limits.get("velocity"),
                limits.get("effort"),
                "fault" if own else "ok",
            )
        )
    return rows


def head_notes(joints: dict[str, JointFacts]) -> list[Fault]:
    """Return a note if Pepper's upper limit of HeadPitch is above the documented one.

    Args:
        joints: Facts of the description's joints, by name.
    """
    upper = joints["HeadPitch"].limits.get("upper") if joints.keys() >= _OF_PEPPER else None
    if upper is None or upper <= DOCUMENTED + _ROUNDING:
        return []
    message = (
        f"its upper limit is {upper:.6g} rad, but no robot was seen beyond {DOCUMENTED:.6g}, which the "
        "vendor's page gives: load_pepper(head_limits='documented')"
    )
    return [Fault("limits", "joint HeadPitch", message)]


def _limit_faults(joint: JointFacts) -> list[Fault]:
    """Return the faults of a joint's limits: missing, in the wrong order, equal, or not above zero."""
    where, limits, found = f"joint {joint.name}", joint.limits, []
    wanted = (
        ("velocity", "effort") if joint.type == "continuous" else ("lower", "upper", "velocity", "effort")
    )
    missing = [key for key in wanted if key not in limits]
    # A continuous joint without <limit> is common and legal.
    if missing and not (joint.type == "continuous" and not limits):
        found.append(Fault("limits", where, f"missing: {', '.join(missing)}"))
    lower, upper = limits.get("lower"), limits.get("upper")
    if joint.type != "continuous" and lower is not None and upper is not None:
        if lower > upper:
            found.append(
                Fault("limits", where, f"its lower limit {lower:g} is above its upper limit {upper:g}")
            )
        elif lower == upper:
            found.append(Fault("limits", where, f"it cannot move: both limits are {lower:g}"))
    for key in ("velocity", "effort"):
        value = limits.get(key)
        if value is not None and value <= 0:
            found.append(Fault("limits", where, f"its {key} limit is {value:g}, expected a value above zero"))
    return found


def _mimic_faults(joint: JointFacts, wrong: dict[str, str]) -> list[Fault]:
    """Return the faults of a joint's mimic element; `wrong` is the result of `_wrong_leaders`."""
    if joint.mimic is None:
        return []
    message = wrong[joint.name] or ("" if joint.mimic[1] != 0 else "its multiplier is zero")
    return [Fault("mimic", f"joint {joint.name}", message)] if message else []


def _wrong_leaders(facts: UrdfFacts) -> dict[str, str]:
    """Return the fault of each joint's chain of leaders, empty for a sound one; each is visited once."""
    found: dict[str, str] = {}
    for name in facts.joints:
        chain: dict[str, None] = {}
        message = None
        while message is None:
            chain[name] = None
            mimic = facts.joints[name].mimic
            leader = "" if mimic is None else mimic[0]
            if mimic is None:
                message = ""
            elif leader not in facts.joints:
                message = f"it follows an unknown joint {shortened(leader)!r}"
            elif leader in chain:
                loop = [*chain][[*chain].index(leader) :]
                message = f"it follows itself: {shortened(' -> '.join([*loop, leader]))}"
            elif facts.joints[leader].type not in MOVING_TYPES:
                message = f"it follows {shortened(leader)!r}, which does not move"
            else:
                message = found.get(leader)
            name = leader
        found.update(dict.fromkeys(chain, message))
    return found


def fingers_found(facts: UrdfFacts, faults: list[Fault]) -> tuple[int, int, int, int] | None:
    """Count Pepper's fixed, following, independent and missing finger joints; None without any finger.

    Missing fingers, and hands of which only some fingers follow, are faults.
    """
    wanted = [f"{side}{phalanx}" for side in "LR" for phalanx in PHALANGES]
    found = [name for name in wanted if name in facts.joints]
    if not found:
        return None
    missing = [name for name in wanted if name not in found]
    if missing:
        faults.append(
            Fault("mimic", "the fingers", f"{len(missing)} of 28 are missing: {', '.join(missing)}")
        )
    fixed = [name for name in found if facts.joints[name].type == "fixed"]
    following = [name for name in found if name not in fixed and facts.joints[name].mimic is not None]
    free = [name for name in found if name not in fixed and name not in following]
    if following and (free or fixed):
        odd = ", ".join(free + fixed)
        faults.append(Fault("mimic", "the fingers", f"they follow their hand, but not these: {odd}"))
    for name in following:
        leader = facts.joints[name].mimic
        if leader is not None and leader[0] in facts.joints and not leader[0].startswith(name[0]):
            faults.append(Fault("mimic", f"joint {name}", f"it follows the other side's {leader[0]}"))
    hands = [f"{side}Hand" for side in "LR" if f"{side}Hand" in facts.joints]
    moving_hands = [name for name in hands if facts.joints[name].type in MOVING_TYPES]
    if moving_hands and not following and free:
        faults.append(
            Fault("mimic", "the fingers", f"{' and '.join(moving_hands)} move but no finger follows them")
        )
    return len(fixed), len(following), len(free), len(missing)


def reachable_links(facts: UrdfFacts, faults: list[Fault]) -> set[str]:
    """Return the links connected to the root; other links are a fault.

    The root is the link without a parent that has the most descendants.
    """
    children: dict[str, list[str]] = {}
    parents: dict[str, list[str]] = {}
    for joint in facts.joints.values():
        if joint.parent in facts.links and joint.child in facts.links:
            children.setdefault(joint.parent, []).append(joint.child)
            parents.setdefault(joint.child, []).append(joint.name)
    for link, names in parents.items():
        if len(names) > 1:
            faults.append(
                Fault("structure", f"link {link}", f"it has {len(names)} parents: {', '.join(names)}")
            )

    def below(root: str, taken: set[str]) -> set[str]:
        found, waiting = {root}, [root]
        while waiting:
            for link in children.get(waiting.pop(), []):
                if link not in found and link not in taken:
                    found.add(link)
                    waiting.append(link)
        return found

    if not facts.links:
        faults.append(Fault("structure", "the robot", "it has no link"))
        return set()
    # A link with several parents counts for the first root only, so each link is visited once.
    taken: set[str] = set()
    best, most = "", 0
    for link in facts.links:
        if link not in parents:
            tree = below(link, taken)
            taken |= tree
            if len(tree) > most:
                best, most = link, len(tree)
    reachable = below(best, set()) if best else set()
    lost = [link for link in facts.links if link not in reachable]
    if lost:
        listed = shortened(", ".join(lost))
        faults.append(Fault("structure", "the robot", f"{len(lost)} links do not hang on the root: {listed}"))
    return reachable
