"""Joints by names of joints and groups mixed, everywhere that `joints=` is taken."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError

PEPPER = pk.load_pepper()
MIXED = ["right_arm", "HeadYaw"]
MOVING = (3, *range(10, 15))
"""Places of MIXED in the joint vector, counted by hand: torso 3, head 2, left arm 5, right arm 5."""
STILL = [j for j in range(15) if j not in MOVING]
POINT = (0.45, -0.25, 0.85)


def chain(base, tip):
    """Return the moving joints from one link to another, as the URDF's XML has them."""
    above = {j.find("child").get("link"): j for j in ET.fromstring(PEPPER.urdf).findall("joint")}
    names = []
    while tip != base:
        names.append(above[tip].get("name"))
        tip = above[tip].find("parent").get("link")
    return {name for name in names if name in PEPPER.joint_names}


def test_names_come_in_the_order_given_each_once():
    assert PEPPER.resolve_joints("HeadPitch") == ("HeadPitch",)
    assert set(PEPPER.resolve_joints("right_arm")) == chain("torso", "r_wrist")
    assert PEPPER.resolve_joints(["RWristYaw", "head", "right_arm"]) == (
        "RWristYaw", "HeadYaw", "HeadPitch", "RShoulderPitch", "RShoulderRoll", "RElbowYaw", "RElbowRoll",
    )  # fmt: skip
    assert PEPPER.resolve_joints(None) == PEPPER.joint_names
    assert PEPPER.resolve_joints(name for name in MIXED) == PEPPER.resolve_joints(MIXED)


def test_a_joint_comes_before_a_group_of_its_name():
    with_fingers = pk.load_pepper(hands="mimic")
    assert "LHand" in with_fingers.group_names
    assert with_fingers.resolve_joints(["LHand"]) == ("LHand",)


def test_what_is_no_joint_is_refused_by_name():
    with pytest.raises(
        UnknownNameError, match=r"unknown joint or group 'right_leg'; available: KneePitch.*head"
    ):
        PEPPER.resolve_joints(["head", "right_leg"])
    with pytest.raises(UnknownNameError, match="3"):
        PEPPER.resolve_joints(["head", 3])
    with pytest.raises(UnknownNameError, match=r"\['head'\]"):
        PEPPER.resolve_joints([["head"]])
    for nothing in ([], "LHand", 5):
        with pytest.raises(InvalidValueError, match=r"joints: .*at least one moving joint"):
            PEPPER.resolve_joints(nothing)
    assert PEPPER.resolve_joints("LHand", allow_none=True) == ()


@pytest.mark.parametrize("solver", ["fast", "placo", "proxsuite"])
def test_ik_moves_only_them(solver):
    tasks = [pk.ik.HandPosition("right", POINT, tolerance=0.2), pk.ik.LookAt(POINT, tolerance=1.0)]
    result = pk.ik.solve(PEPPER, tasks, joints=MIXED, solver=solver)
    assert result.success, result.report()
    np.testing.assert_array_equal(result.q[STILL], PEPPER.neutral()[STILL])
    assert result.q[3] != PEPPER.neutral()[3]


def test_batches_and_several_solutions_move_only_them():
    tasks = [pk.ik.HandPosition("right", np.tile(POINT, (3, 1)), tolerance=0.2)]
    found = pk.ik.solve_batch(PEPPER, tasks, joints=MIXED)
    np.testing.assert_array_equal(found.q[:, STILL], np.tile(PEPPER.neutral()[STILL], (3, 1)))
    several = pk.ik.solutions(PEPPER, [tasks[0].at(0)], joints=MIXED, count=3)
    np.testing.assert_array_equal(several[:, STILL], np.tile(PEPPER.neutral()[STILL], (len(several), 1)))
    assert len(several) > 1


def test_plans_move_only_them():
    start, tasks = PEPPER.neutral(), [pk.ik.HandPosition("right", POINT, tolerance=0.2)]
    turned = PEPPER.joint_vector({"HeadYaw": 0.4, "RShoulderPitch": 0.7})
    upright = pk.ik.AxisAlignment("torso", (0, 0, 1), axis=(0, 0, 1), tolerance=0.5)
    plans = [
        pk.plan(PEPPER, start, tasks, joints=MIXED),
        pk.plan(PEPPER, start, turned, joints=MIXED),
        pk.motion.plan_constrained(PEPPER, start, turned, constraints=[upright], joints=MIXED),
        *pk.motion.plan_legs(PEPPER, start, [pk.motion.Leg(turned, joints=MIXED)]).plans,
        *pk.plan_batch([pk.PlanProblem(PEPPER, start, turned, joints=MIXED)], processes=1).plans,
    ]
    for plan in plans:
        assert plan.success, plan.report()
        np.testing.assert_array_equal(plan.path[:, STILL], np.tile(start[STILL], (len(plan.path), 1)))
    with pytest.raises(InvalidValueError, match="other values of HeadPitch"):
        pk.plan(PEPPER, start, PEPPER.joint_vector({"HeadPitch": 0.2}), joints=MIXED)


def test_a_place_for_the_base_moves_only_them():
    result = pk.base_placement.place_base(
        PEPPER, [pk.ik.HandPosition("right", (1.2, 0.3, 0.9))], joints=MIXED
    )
    assert result.success, result.report()
    q = result.placements[0].q[0][-15:]
    np.testing.assert_array_equal(q[STILL], PEPPER.neutral()[STILL])


def test_manipulability_and_reach_use_their_columns():
    q = PEPPER.posture("Crouch")
    columns = pk.kinematics.frame_jacobian(PEPPER, q, "RArm_effector")[:3][:, list(MOVING)]
    expected = np.sqrt(np.linalg.det(columns @ columns.T))
    found = pk.kinematics.manipulability(PEPPER, q, "RArm_effector", joints=MIXED)
    assert found == pytest.approx(expected, rel=1e-9)
    from pepper_kin.kinematics.reach_map import reach_map

    voxels = reach_map(PEPPER, "RArm_effector", joints=MIXED, samples=100)
    assert voxels.joints == tuple(PEPPER.joint_names[j] for j in MOVING)


def test_a_controller_locks_them():
    servo = pk.servo.Servo(PEPPER, PEPPER.neutral(), locked=["head", "torso", "LWristYaw"])
    servo.set_target([pk.ik.LookAt((0.5, 0.8, 1.4)), pk.ik.HandPosition("left", (0.4, 0.2, 0.9))])
    for _ in range(20):
        state = servo.step()
    np.testing.assert_array_equal(state.q[[0, 1, 2, 3, 4, 9]], PEPPER.neutral()[[0, 1, 2, 3, 4, 9]])
