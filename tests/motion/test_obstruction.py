"""What is said to be in the way where no path is found, by every way to plan."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.motion import Leg, PlanStatus, plan_legs
from pepper_kin.motion.static_limits import static_limits

PEPPER = pk.load_pepper()
ARM = {"LShoulderRoll": 0.5, "LElbowRoll": -0.1}
DOWN = PEPPER.joint_vector({"LShoulderPitch": 1.3, **ARM})
UP = PEPPER.joint_vector({"LShoulderPitch": 0.0, **ARM})
FAILED = (PlanStatus.NO_PATH_IN_TIME, PlanStatus.START_SHUT_IN, PlanStatus.GOAL_SHUT_IN)


@pytest.fixture(scope="module")
def shelf():
    """Return a board between the arm's two postures that it cannot pass, whatever it does in front of it."""
    hand = pk.kinematics.frame_pose(PEPPER, (UP + DOWN) / 2, "LArm_effector")[:3, 3]
    return pk.Scene().add_box("shelf", (0.3, 2.0, 0.02), hand + np.array([0.02, 0.0, 0.0]))


def anything() -> pk.ik.Task:
    """Return a task that hardly constrains anything."""
    return pk.ik.JointValue("LWristYaw", 0.0, tolerance=3.0)


@pytest.mark.parametrize(
    "options",
    [{}, {"constraints": [anything()]}, {"costs": [anything()]}, {"planner": "aorrtc"}],
    ids=["plan", "constraints", "costs", "aorrtc"],
)
def test_an_object_in_the_way_is_named_with_link_and_sizes_of_the_trees(shelf, options):
    joints = ["LShoulderPitch", "LWristYaw"]

    plan = pk.plan(PEPPER, UP, DOWN, shelf, joints=joints, timeout=0.6, **options)
    assert plan.status in FAILED
    assert "the tree of the start grew to" in plan.message
    assert "Most often in the way there: shelf, mostly of l_" in plan.message
    assert "configurations were checked" in plan.message


def test_the_joints_that_may_move_are_named_where_these_are_not_all(shelf):
    """Without `joints` those in which start and goal differ."""
    found = pk.plan(PEPPER, UP, DOWN, shelf, timeout=0.3)
    assert found.status in FAILED
    assert " Only LShoulderPitch may move; `joints=` frees others." in found.message
    free = pk.plan(PEPPER, UP, DOWN, shelf, joints=PEPPER.joint_names, timeout=0.02)
    assert "may move" not in free.message


def test_a_constraint_that_lets_no_motion_through_is_named():
    index = PEPPER.joint_index("LShoulderPitch")
    apart = pk.ik.Expression(
        PEPPER, lambda q: (q[index] - 0.65) ** 2, lower=0.09, tolerance=1e-3, label="away from the middle"
    )
    plan = pk.plan(PEPPER, UP, DOWN, joints=["LShoulderPitch"], constraints=[apart], timeout=0.5)
    assert plan.status in FAILED
    assert "Most often in the way there: away from the middle" in plan.message


def test_a_joint_whose_torque_does_not_suffice_is_named_where_it_stops_a_search():
    straight = {"LShoulderRoll": 0.1, "LElbowRoll": -0.01, "LElbowYaw": 0.0, "LWristYaw": 0.0}
    ends = [PEPPER.joint_vector({"LShoulderPitch": pitch, **straight}) for pitch in (-1.4, 1.4)]
    level = PEPPER.joint_vector({"LShoulderPitch": 0.0, **straight})
    statics = static_limits(PEPPER, None, {"left": 1.0})
    assert statics.hold(np.array(ends)).all()
    joint = statics.weakest(level)
    assert joint is not None
    plan = pk.plan(PEPPER, *ends, joints=["LShoulderPitch"], payload={"left": 1.0}, timeout=0.5)
    assert plan.status in FAILED
    assert f"Most often in the way there: torque of {PEPPER.joint_names[joint]}" in plan.message
    assert pk.plan(PEPPER, *ends, joints=["LShoulderPitch"]).success


def test_balance_is_named_where_a_posture_would_tip_over():
    statics = static_limits(PEPPER, 0.05, None)
    leaning = PEPPER.joint_vector({"HipPitch": -0.6, "LShoulderPitch": 0.8, "RShoulderPitch": 0.8})
    assert statics.weakest(leaning) is None
    assert statics.short_of(leaning) == "balance"


@pytest.mark.thorough
def test_legs_and_batches_say_what_is_in_the_way_of_the_leg_that_failed(shelf):
    joints = ["LShoulderPitch", "LWristYaw"]

    raised = PEPPER.joint_vector({"LShoulderPitch": -0.2, **ARM})
    found = plan_legs(PEPPER, UP, [Leg(raised), Leg(DOWN)], shelf, joints=joints, timeout=2.0)
    assert found.report().splitlines()[1].startswith("Leg 2 of 2: No path")
    assert "Most often in the way there: shelf" in found.report()
    batch = pk.plan_batch([pk.PlanProblem(PEPPER, UP, DOWN, shelf, joints=joints, timeout=0.6)])
    assert "Most often in the way there: shelf" in batch.report()


def test_a_way_along_a_line_names_what_it_runs_into():
    start = PEPPER.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -0.9})
    hand = pk.kinematics.frame_pose(PEPPER, start, "LArm_effector")[:3, 3]
    scene = pk.Scene().add_box("board", (0.5, 1.0, 0.02), hand + np.array([0.1, 0.0, 0.12]))
    line = pk.motion.Line((0.0, 0.0, 0.15), relative=True)
    found = pk.motion.cartesian_path(PEPPER, start, "left", [line], scene, joints="left_arm")
    assert not found.success
    assert "board" in found.message
