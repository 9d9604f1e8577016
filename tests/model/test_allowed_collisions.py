"""The pairs of links that are not checked: where they come from and how the published ones differ."""

import itertools
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk

DATA = Path(__file__).parents[1] / "data"
WHEELS = ("WheelB_link", "WheelFL_link", "WheelFR_link")


def our_pairs():
    return pk.load_pepper().semantics.disabled_pairs


def published():
    """(disabled pairs, checked pairs) of the published SRDF."""
    checked = set()
    for line in (DATA / "published_checked_pairs.txt").read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            link, partners = line.split(": ")
            checked |= {tuple(sorted((link, partner))) for partner in partners.split()}
    links = {shape.link for shape in pk.load_pepper(hands="mimic").collision_shapes}
    return set(itertools.combinations(sorted(links), 2)) - checked, checked


def hand_of(link):
    if link.endswith("_wrist"):
        return link[0].upper()
    return link[0] if "Finger" in link or "Thumb" in link else ""


def test_counts_by_reason():
    assert Counter(our_pairs().values()) == {
        "Adjacent": 46, "Always": 2, "DependentRange": 4, "Grasp": 32, "Never": 456,
    }  # fmt: skip


def test_the_published_list_has_939_pairs():
    disabled, checked = published()
    assert len(disabled) == 939
    assert len(checked) == 142


def test_differences_from_the_published_list():
    disabled, _ = published()
    ours = our_pairs()
    # Ours alone: four pairs decided by tabulated ranges instead.
    assert {ours[pair] for pair in ours.keys() - disabled} == {"DependentRange"}
    # Theirs alone, checked by us.
    kinds = Counter()
    for pair in disabled - ours.keys():
        hands = [hand_of(link) for link in pair]
        kinds["body" if not any(hands) else "hand and body" if not all(hands) else
              "one hand" if hands[0] == hands[1] else "two hands"] += 1  # fmt: skip
    assert sum(kinds.values()) == 939 - (len(ours) - 4)
    assert kinds == {"two hands": 222, "hand and body": 172, "body": 5, "one hand": 4}


def test_adjacent_pairs_are_the_neighbors():
    """One joint apart, frames and links without shapes not counted."""
    pepper = pk.load_pepper(hands="mimic")
    with_shape = {shape.link for shape in pepper.collision_shapes}
    parent = {joint.child: joint.parent for joint in pepper.document.joints}
    expected = set()
    for link in with_shape:
        above = parent.get(link)
        while above is not None and above not in with_shape:
            above = parent.get(above)
        if above is not None:
            expected.add(tuple(sorted((link, above))))
    assert {pair for pair, reason in our_pairs().items() if reason == "Adjacent"} == expected


def mirrored(link):
    if link in ("WheelFL_link", "WheelFR_link"):
        return "WheelFR_link" if "FL" in link else "WheelFL_link"
    swap = {"L": "R", "R": "L", "l": "r", "r": "l"}
    sided = hand_of(link) or link[1:] in ("Shoulder", "Bicep", "Elbow", "ForeArm")
    return swap[link[0]] + link[1:] if sided else link


def test_left_and_right_are_treated_alike():
    ours = our_pairs()
    for (a, b), reason in ours.items():
        assert ours.get(tuple(sorted((mirrored(a), mirrored(b))))) == reason, (a, b)


@pytest.mark.parametrize("hands", ["locked", "mimic", "independent"])
def test_pairs_said_never_to_touch_do_not(hands):
    """A fresh sample with coal's own distances, and postures at the ends of the ranges."""
    pepper = pk.load_pepper(hands=hands)
    import coal
    import pinocchio

    from pepper_kin.collision.checker import coal_geometry

    never = {pair for pair, reason in pepper.semantics.disabled_pairs.items() if reason == "Never"}
    shapes = [(s.link, s.transform_shape_to_link, coal_geometry(s.geometry)) for s in pepper.collision_shapes]
    rng = np.random.default_rng(7)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, size=(40, pepper.n))
    ends = rng.random((20, pepper.n)) < 0.5
    q[:20] = np.where(ends, pepper.lower_limits, pepper.upper_limits)
    for state in q:
        placed = [
            (link, pinocchio.SE3(pk.kinematics.frame_pose(pepper, state, link) @ pose), shape)
            for link, pose, shape in shapes
        ]
        for (a, pa, sa), (b, pb, sb) in itertools.combinations(placed, 2):
            if (min(a, b), max(a, b)) not in never:
                continue
            ta, tb = (coal.Transform3s(p.rotation, p.translation) for p in (pa, pb))
            distance = coal.distance(sa, ta, sb, tb, coal.DistanceRequest(), coal.DistanceResult())
            assert distance > 0, (a, b, dict(zip(pepper.joint_names, state, strict=True)))


def test_a_hand_may_close_on_itself_but_not_on_the_other():
    pepper = pk.load_pepper(hands="mimic")
    for opening in np.linspace(0.02, 0.98, 25):
        q = pepper.joint_vector({"LHand": opening, "RHand": opening})
        assert not pk.collision.in_collision(pepper, q), opening
    ours = our_pairs()
    assert ("LFinger13_link", "RFinger13_link") not in ours
    assert ("l_wrist", "r_wrist") not in ours
    # Two neighbors curled farther than the coupling ever curls them.
    free = pk.load_pepper(hands="independent")
    curled = free.joint_vector(
        {f"LFinger{finger}{phalanx}": 0.0 for finger in (2, 3) for phalanx in (1, 2, 3)}
    )
    assert pk.collision.checker_for(free).contacts(curled) == (("LFinger22_link", "LFinger32_link"),)


@pytest.mark.thorough
def test_hands_that_meet_are_seen():
    """Both hands in front of the chest: the published list would not see their fingers cross."""
    pepper = pk.load_pepper(hands="mimic")
    rng = np.random.default_rng(3)
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    checker = pk.collision.checker_for(pepper)
    disabled, _ = published()
    found = set()
    for name, (low, high) in {
        "LShoulderPitch": (0.2, 1.2), "RShoulderPitch": (0.2, 1.2), "LElbowRoll": (-1.56, -0.8),
        "RElbowRoll": (0.8, 1.56), "LElbowYaw": (-1.0, 0.5), "RElbowYaw": (-0.5, 1.0),
        "LShoulderRoll": (0.009, 0.3), "RShoulderRoll": (-0.3, -0.009),
    }.items():  # fmt: skip
        index = pepper.joint_index(name)
        lower[index], upper[index] = low, high
    for state in rng.uniform(lower, upper, size=(800, pepper.n)):
        found |= {tuple(sorted(pair)) for pair in checker.contacts(state)}
    across = {pair for pair in found if {hand_of(link) for link in pair} == {"L", "R"}}
    assert across & disabled, "contacts of the two hands that the published list leaves out"
