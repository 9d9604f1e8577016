"""Balls in lanes of single precision, against Pinocchio's double."""

from importlib import metadata
from pathlib import Path

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision.fast import FastChecker
from pepper_kin.collision.fast.ball_cover import ball_cover
from pepper_kin.collision.fast.rounding import Rounding
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.check import place_frozen
from pepper_kin.core.collision.records import BODY, PART

OTHERS = {
    "panda": ("panda_description/urdf/panda.urdf", "panda_description/srdf/panda.srdf"),
    "talos": ("talos_data/robots/talos_reduced.urdf", "talos_data/srdf/talos.srdf"),
}
SCENE = pk.Scene().add_box("table", (0.6, 1.0, 0.04), (0.55, 0.0, 0.70))


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["pepper", "pepper on wheels", "panda", "talos"])
def test_centers_are_off_by_less_than_is_allowed_for(name):
    """The bound of rounding errors holds with room, and is small enough to cost nothing."""
    base = {"pepper": "fixed", "pepper on wheels": "planar"}
    if name in base:
        robot = pk.load_pepper(base=base[name])
    else:
        share = Path(metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share"))
        files = (share / "example-robot-data" / "robots" / file for file in OTHERS[name])
        robot = pk.load_robot(*files, [share])
    fast, rng = FastChecker(robot, SCENE), np.random.default_rng(0)
    structure = fast._prepared.structure
    allowed = Rounding(robot, structure.solids).placed
    assert np.median(allowed) < 5e-4
    model, data = robot.inner_model, robot.inner_model.createData()
    order = [i for i in range(len(structure.solids))]
    memory = fast._prepared.memory()
    bodies = at.section_bits(memory, at.BODIES).reshape(-1, BODY.width)
    parts = at.section_bits(memory, at.PARTS).reshape(-1, PART.width)
    share = 0.0
    for _ in range(40):
        low, high = np.maximum(robot.lower_limits, -16.0), np.minimum(robot.upper_limits, 16.0)
        q = rng.uniform(low, high)
        at.section(memory, at.FROZEN)[:] = q
        place_frozen(memory)
        placed = at.section_single(memory, at.CENTERS).reshape(-1, 3, 8)
        pinocchio.forwardKinematics(model, data, robot.to_full(q))
        for b, body in enumerate(bodies):
            joint = b + 1 if b + 1 < model.njoints else 0
            expected = [
                data.oMi[joint].act(center)
                for i in order
                if structure.solids[i].joint == joint
                for center in ball_cover(structure.solids[i]).centers
            ]
            if not expected:
                continue
            own = parts[body[BODY.columns.first_part] : body[BODY.columns.part_end]]
            spans = own[:, [PART.columns.first_ball, PART.columns.ball_end]]
            found = np.concatenate([placed[first:end] for first, end in spans])
            assert (found == found[:, :, :1]).all()
            gaps = np.linalg.norm(found[:, None, :, 0] - np.array(expected), axis=2)
            share = max(share, gaps.min(axis=1).max() / allowed[b])
    assert share < 1.0


def test_what_hangs_on_a_mimic_joint_moves_with_its_leader():
    """Fingers that follow the hand, at the free hand's place, not where they were when the check was made."""
    pepper = pk.load_pepper(hands="mimic")
    hand, wrist = pepper.joint_index("LHand"), pepper.joint_index("LWristYaw")
    stand = pepper.posture("Stand")
    open_hand, closed = stand.copy(), stand.copy()
    open_hand[hand], closed[hand] = pepper.upper_limits[hand], pepper.lower_limits[hand]
    tip = pk.kinematics.frame_pose(pepper, open_hand, "LFinger13_link")[:3, 3]
    scene = pk.Scene().add_sphere("bead", 0.004, tip)
    fast = FastChecker(pepper, scene)
    expected = ~fast.exact.in_collision(np.array([closed, open_hand]))
    assert expected.tolist() != [True, True] or len(fast._prepared.structure.solids) == 0
    validity = fast.compiled(closed, [wrist, hand])
    for q, free in zip((closed, open_hand), expected, strict=True):
        assert (validity.valid_steps(q[[wrist, hand]], q[[wrist, hand]], 1) == 1) == free
