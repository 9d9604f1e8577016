"""The look at all ends of a motion at once, against coal's verdicts and Pinocchio's torques, one by one."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision import checker_for, loads_of
from pepper_kin.model.requirements import HOLDING_SHARE
from pepper_kin.motion.checks import LEAST_MARGIN, Checks
from pepper_kin.motion.static_limits import StaticLimits

PEPPER = pk.load_pepper().with_requirements("limits")
STANDING = PEPPER.joint_vector({"RShoulderPitch": 1.0, "RShoulderRoll": -0.5, "RElbowRoll": 0.2})
LEFT = np.array([PEPPER.joint_index(name) for name in PEPPER.joint_names if name.startswith("L")])
SCENE = (
    pk.Scene()
    .add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))
    .add_sphere("lamp", 0.1, (0.25, 0.45, 1.0))
)
CARRIED = 0.9
MARGINS = (0.002, 0.008, 0.02)


def ends_of(seed: int, goals: int) -> np.ndarray:
    """Return a start and goals that differ in the joints of the left arm."""
    q = np.tile(STANDING, (1 + goals, 1))
    low, high = PEPPER.lower_limits[LEFT], PEPPER.upper_limits[LEFT]
    q[:, LEFT] = np.random.default_rng(seed).uniform(low, high, (1 + goals, LEFT.size))
    return q


def keeps(q: np.ndarray, margin: float, self_margin: float) -> np.ndarray:
    """Whether coal finds nothing nearer than the margins."""
    return ~checker_for(PEPPER, SCENE, margin, self_margin).in_collision(q)


def held(q: np.ndarray, carried: float) -> bool:
    """Whether the joints can hold all of some postures, by Pinocchio and the principle of virtual work."""
    model = PEPPER.pinocchio_model
    data = model.createData()
    for row in q:
        torque = pinocchio.computeGeneralizedGravity(model, data, row).copy()
        up = pk.kinematics.frame_jacobian(PEPPER, row, "l_gripper")[2]
        torque += carried * 9.81 * up
        if (np.abs(torque) > HOLDING_SHARE * PEPPER.effort_limits).any():
            return False
    return True


def expected(ends: np.ndarray, margin: float, carried: float) -> tuple[float, float] | None:
    """Return the margins that the ends allow, each halved until the start and a goal keep it."""
    if not held(ends, carried) or not keeps(ends, 0.0, 0.0).all():
        return None
    if margin > LEAST_MARGIN and keeps(ends, margin, margin).all():
        return margin, margin

    def two_keep(scene: float, own: float) -> bool:
        kept = keeps(ends, scene, own)
        return bool(kept[0] and kept[1:].any())

    own = scene = margin
    while own > LEAST_MARGIN and not two_keep(0.0, own):
        own /= 2.0
    own = 0.0 if own <= LEAST_MARGIN else own if own == margin else own / 2.0
    while scene > LEAST_MARGIN and not two_keep(scene, own):
        scene /= 2.0
    return 0.0 if scene <= LEAST_MARGIN else scene, own


@pytest.mark.parametrize("carried", [0.0, CARRIED])
def test_ends_are_sound_where_coal_and_torques_say_so(carried: float) -> None:
    payload = loads_of(PEPPER, None, {"l_gripper": carried} if carried else None)
    checks = Checks(PEPPER, SCENE, StaticLimits(PEPPER, carrying=payload))
    visited = {"refused": 0, "whole": 0, "less": 0, "not held": 0}
    for seed in range(150):
        ends = ends_of(seed, 1 + seed % 3)
        margin = MARGINS[seed // 3 % 3]
        found = checks.sound_ends(ends[0], ends[1:], LEFT, margin)
        answer = expected(ends, margin, carried)
        assert found == answer, seed
        kind = "refused" if answer is None else "whole" if answer == (margin, margin) else "less"
        visited[kind] += 1
        visited["not held"] += answer is None and bool(keeps(ends, 0.0, 0.0).all())
    assert min(visited["refused"], visited["whole"], visited["less"]) > 2, visited
    assert (visited["not held"] > 2) == bool(carried), visited


@pytest.mark.parametrize("place", [0, 1, 63, 64, 65, 90])
def test_one_end_at_fault_among_many_is_found(place: int) -> None:
    """More ends than go through the check together; the one that touches may be any of them."""
    checks, many, margin = Checks(PEPPER, SCENE), ends_of(1, 600), MARGINS[0]
    sound = many[keeps(many, margin, margin)][:91]
    touching = many[~keeps(many, 0.0, 0.0)][0]
    assert len(sound) == 91
    assert checks.sound_ends(sound[0], sound[1:], LEFT, margin) == (margin, margin)
    sound[place] = touching
    assert checks.sound_ends(sound[0], sound[1:], LEFT, margin) is None
