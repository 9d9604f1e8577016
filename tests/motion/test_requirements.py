"""What motions keep in reserve: asked of the independent check, of the twin, and of single postures."""

import pickle

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import MotionRequirements

PEPPER = pk.load_pepper()
FAST = PEPPER.with_requirements("limits")
STAND = PEPPER.posture("Stand")
TABLE = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
POINTS = np.random.default_rng(5).uniform((0.30, -0.30, 0.78), (0.50, 0.35, 1.00), (12, 3))


def reach_tasks(point):
    return [pk.ik.HandPosition("left" if point[1] > 0 else "right", point), pk.ik.LookAt(point)]


@pytest.mark.parametrize("point", POINTS, ids=lambda point: str(point.round(2)))
def test_a_reach_without_options_is_green_and_the_twin_follows(point):
    plan = pk.plan(PEPPER, STAND, reach_tasks(point), TABLE)
    assert plan.success
    motion = pk.retime(PEPPER, plan)
    assert motion.check(PEPPER, TABLE, balance="robot", torque_scale="robot").success
    run = pk.Twin(PEPPER).execute(motion, hold_time=0.5)
    assert np.abs(run.position - run.reference_position).max() < 0.01


def test_all_that_the_limits_allow_is_faster_and_tips_over():
    plan = pk.plan(FAST, STAND, reach_tasks(POINTS[0]), TABLE)
    fast, safe = pk.retime(FAST, plan), pk.retime(PEPPER, plan)
    named = pk.retime(PEPPER, plan, balance=None, torque_scale=1.0)
    assert fast.duration == named.duration < 0.98 * safe.duration
    assert fast.check(PEPPER).failures == ("balance",)
    assert fast.check(PEPPER, balance=None).success


def test_retime_keeps_what_its_plan_was_asked_for():
    goal = PEPPER.joint_vector({"LShoulderPitch": 0.2, "HipPitch": -0.3})
    plan = pk.plan(PEPPER, STAND, goal, balance=0.03, torque_scale=0.8)
    kept = pk.retime(PEPPER, plan).check(PEPPER, balance=0.03, torque_scale=0.8)
    assert kept.success
    assert kept.balance.value == pytest.approx(0.03, abs=2e-3)
    held = pk.plan(PEPPER, STAND, goal, balance=None, torque_scale=1.0)
    assert pk.retime(PEPPER, held).duration == pk.retime(FAST, held.curve).duration


def test_a_goal_that_needs_the_servos_torque_is_refused_with_a_sentence():
    loaded = PEPPER.with_limits(effort={"LShoulderPitch": 1.06 * lift_torque()})
    goal = loaded.joint_vector({"LShoulderPitch": 0.0, "LElbowRoll": -0.01})
    refused = pk.plan(loaded, STAND, goal)
    assert refused.status is pk.motion.PlanStatus.GOAL_TORQUE_LIMIT
    assert "85.5 % of its" in refused.message
    assert "torque_scale" in refused.message
    assert pk.plan(loaded, STAND, goal, torque_scale=1.0).success


def lift_torque():
    """Return what holds the stretched left arm level [N m]."""
    q = PEPPER.joint_vector({"LShoulderPitch": 0.0, "LElbowRoll": -0.01})
    return abs(pk.dynamics.gravity_torque(PEPPER, q)[PEPPER.joint_index("LShoulderPitch")])


@pytest.mark.thorough
def test_inverse_kinematics_prefers_postures_on_which_the_robot_stands():
    points = np.random.default_rng(1).uniform((0.25, -0.3, 0.5), (0.75, 0.5, 1.1), (60, 3))
    task, still = pk.ik.HandPosition("left", points), np.zeros((60, PEPPER.n))
    free = pk.ik.solve_batch(PEPPER, task, balance=None)
    kept = pk.ik.solve_batch(PEPPER, task)
    both = free.success & kept.success
    assert (free.success == kept.success).all()
    inside = [pk.dynamics.tip_over_margin(PEPPER, r.q, still, still)[both] for r in (free, kept)]
    stood = inside[0] >= 0.014
    assert (free.q[both][stood] == kept.q[both][stood]).all()
    assert (inside[1][~stood] >= 0.014).sum() >= 0.2 * (~stood).sum() > 0
    row = int(np.flatnonzero(both)[~stood][0])
    one = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", points[row]))
    assert (one.q == kept.q[row]).all()
    assert one.balance == pytest.approx(inside[1][~stood][0], abs=1e-9)
    tips = np.flatnonzero(both)[inside[1] < 0.0]
    if tips.size:
        assert "it would tip over" in kept.result(int(tips[0])).report()


def test_gestures_keep_the_reserve():
    motion = pk.motion.gesture(PEPPER, "bow", tempo=4.0)
    assert motion.check(PEPPER, balance="robot", torque_scale="robot").success
    more = pk.motion.gesture(PEPPER, "bow", tempo=4.0, balance=0.06, torque_scale=0.7)
    assert more.check(PEPPER, balance=0.06, torque_scale=0.7).success
    assert more.duration > motion.duration


def test_requirements_are_of_the_robot_and_travel_with_it():
    assert PEPPER.requirements == MotionRequirements(0.01, 0.9)
    assert FAST.requirements == MotionRequirements(None, 1.0)
    more = PEPPER.with_requirements(MotionRequirements(0.02, 0.7))
    assert pickle.loads(pickle.dumps(more)).requirements == more.requirements
    assert more.with_limits(velocity=1.0).requirements == more.requirements
    arm = (
        '<robot name="arm"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
    )
    arm += '<child link="b"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    assert pk.load_robot(arm).requirements == FAST.requirements


def test_what_is_no_requirement_is_refused():
    with pytest.raises(UnknownNameError, match="reserve, limits"):
        PEPPER.with_requirements("fast")
    with pytest.raises(InvalidValueError, match="MotionRequirements, or one of 'reserve', 'limits'"):
        PEPPER.with_requirements(0.01)
    with pytest.raises(InvalidValueError, match=r"torque_scale.*\(0, 1\]"):
        MotionRequirements(torque_scale=1.2)
    with pytest.raises(InvalidValueError, match='"robot" for the robot\'s own'):
        pk.retime(PEPPER, [STAND, PEPPER.joint_vector({"HeadYaw": 0.3})], balance="yes")
