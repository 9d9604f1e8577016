"""Margins that give way along a path, and what is said of them; distances are measured by coal."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import checker_for
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion import Leg, PlanStatus, plan_legs

PEPPER = pk.load_pepper()
RAISED = {"LShoulderRoll": 0.5, "LElbowRoll": -0.1}
START = PEPPER.joint_vector({"LShoulderPitch": 0.3, **RAISED})
GOAL = PEPPER.joint_vector({"LShoulderPitch": 1.3, **RAISED})
SWEEP = START + np.linspace(0.0, 1.0, 2001)[:, None] * (GOAL - START)


@pytest.fixture(scope="module")
def pinned():
    """Return a scene with a pin that the arm, which can only swing, passes 4 mm away."""
    hand = pk.kinematics.frame_pose(PEPPER, SWEEP[1000], "LArm_effector")[:3, 3]
    away = np.array([0.0, 1.0, 0.0])
    near, far = 0.0, 0.3
    for _ in range(16):
        middle = (near + far) / 2
        scene = pk.Scene().add_sphere("pin", 0.01, hand + middle * away)
        near, far = (near, middle) if scene_distance(scene, SWEEP[::20]) > 0.004 else (middle, far)
    return scene


def scene_distance(scene: pk.Scene, states: np.ndarray) -> float:
    """Return the least distance of the robot to things of a scene, up to 20 mm, by coal [m]."""
    low, high = 0.0, 0.02
    for _ in range(14):
        middle = (low + high) / 2
        near = checker_for(PEPPER, scene, middle).in_collision(states).any()
        low, high = (low, middle) if near else (middle, high)
    return high


def least_distance(plan, scene: pk.Scene) -> float:
    """Return coal's least distance to the scene at 400 states of a plan's curve [m]."""
    curve = plan.curve
    s = np.linspace(curve.breaks[0], curve.breaks[-1], 400)
    segment = np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2)
    return scene_distance(scene, curve.at(segment, s - curve.breaks[segment]))


def swing(scene, *, timeout=1.0, **options):
    """Plan the swing of the arm."""
    return pk.plan(PEPPER, START, GOAL, scene, joints=["LShoulderPitch"], timeout=timeout, **options)


@pytest.mark.thorough
def test_a_margin_that_no_path_keeps_gives_way_and_the_message_names_what_to(pinned):
    plan = swing(pinned)
    assert plan.success, plan.message
    assert "The margin was relaxed from 10 to 2.5 mm where" in plan.message
    assert "pin" in plan.message.split("was relaxed")[1]
    assert "LArm" in plan.message or "l_" in plan.message
    assert 0.001 < plan.margin <= least_distance(plan, pinned)


@pytest.mark.thorough
def test_a_margin_is_proven_by_coal_never_to_be_more_than_what_is_kept(pinned):
    rng, found = np.random.default_rng(5), []
    box = pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715))
    for number in range(12):
        goal = [pk.ik.HandPosition("left", rng.uniform([0.25, 0.1, 0.76], [0.4, 0.35, 0.95]))]
        plan = pk.plan(PEPPER, PEPPER.posture("Stand"), goal, box, seed=number)
        if plan.success:
            found.append(plan.margin)
            assert plan.margin <= min(0.01, least_distance(plan, box))
    assert len(found) > 6
    assert max(found) > 0.002


def test_in_the_open_all_of_the_margin_is_proven_and_nothing_is_said_of_it():
    plan = swing(pk.Scene().add_sphere("far", 0.1, (2.0, 0.0, 1.0)))
    assert plan.margin == 0.01
    assert "margin" not in plan.message


@pytest.mark.thorough
@pytest.mark.parametrize("least", [0.006, 0.01])
def test_a_least_margin_forbids_to_give_way_further(pinned, least):
    plan = swing(pinned, least_margin=least)
    assert plan.status in (PlanStatus.NO_PATH_IN_TIME, PlanStatus.START_SHUT_IN, PlanStatus.GOAL_SHUT_IN)
    assert "Most often in the way there: pin" in plan.message
    assert np.isnan(plan.margin)


def test_a_least_margin_is_kept_by_the_whole_curve(pinned):
    plan = swing(pinned, least_margin=0.003)
    assert plan.success, plan.message
    assert 0.0029 < plan.margin <= least_distance(plan, pinned)


def test_an_end_that_does_not_keep_the_least_margin_is_named_with_what_is_near(pinned):
    middle = SWEEP[1000]
    for start, goal, status in (
        (middle, GOAL, PlanStatus.START_TOO_NEAR), (START, middle, PlanStatus.GOAL_TOO_NEAR),
    ):  # fmt: skip
        assert pk.plan(PEPPER, start, goal, pinned).success
        plan = pk.plan(PEPPER, start, goal, pinned, least_margin=0.006)
        assert plan.status is status
        assert "least_margin, 6.0 mm" in plan.message
        assert "pin" in plan.message
        assert "least_margin" in plan.advice


def test_margins_that_ends_do_not_keep_are_said():
    near = pk.Scene().add_sphere("pin", 0.01, pin_beside(START, 0.003))
    plan = pk.plan(PEPPER, START, GOAL, near)
    assert plan.success
    assert "A margin of 2.5 mm is kept, since start or goal do not keep more." in plan.message


def pin_beside(q: np.ndarray, distance: float) -> np.ndarray:
    """Return the center of a pin that a posture is so far from [m]."""
    hand, low, high = pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:3, 3], 0.0, 0.3
    for _ in range(40):
        y = (low + high) / 2
        scene = pk.Scene().add_sphere("pin", 0.01, hand + np.array([0.0, y, 0.0]))
        far = not checker_for(PEPPER, scene, distance).in_collision(q)
        low, high = (low, y) if far else (y, high)
    return hand + np.array([0.0, high, 0.0])


@pytest.mark.thorough
def test_margins_give_way_with_constraints_and_costs_and_in_legs_too(pinned):
    elbow = pk.ik.JointValue("LElbowYaw", float(START[PEPPER.joint_index("LElbowYaw")]), tolerance=0.5)
    for tasks in ({"constraints": [elbow]}, {"costs": [elbow]}):
        options = {**tasks, "timeout": 4.0}  # a busy machine searches slowly, and then takes less margin
        plan = swing(pinned, **options)
        assert plan.success, plan.message
        assert "was relaxed from 10 to 2.5 mm" in plan.message
        assert swing(pinned, least_margin=0.006, **tasks, timeout=0.5).path is None
    kept = swing(pinned, least_margin=0.003, costs=[elbow], timeout=4.0)
    assert 0.0029 < kept.margin <= least_distance(kept, pinned)
    legs = plan_legs(PEPPER, START, [Leg(GOAL)], pinned, joints=["LShoulderPitch"], timeout=4.0)
    assert "was relaxed from 10 to 2.5 mm" in legs.report()


def test_aorrtc_gives_way_too(pinned):
    plan = swing(pinned, planner="aorrtc", gap=0.05)
    assert plan.success
    assert "was relaxed" in plan.message


@pytest.mark.parametrize("least", [-0.001, 0.02, float("nan"), True])
def test_a_least_margin_lies_between_none_and_the_margin(least):
    with pytest.raises(InvalidValueError, match="least_margin"):
        swing(None, least_margin=least)
