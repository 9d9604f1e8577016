"""Constraints and costs on a part of the way, checked by Pinocchio and coal on each leg's curve."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion import Leg, PathCost, PlanStatus, plan_legs

EFFECTOR, UP, TILT = "LArm_effector", np.array([0.0, 0.0, 1.0]), np.radians(4)
POST = pk.Scene().add_box("post", size=(0.05, 0.05, 1.0), position=(0.33, 0.17, 0.85))
LEFT, RIGHT = (0.28, 0.32, 0.85), (0.30, 0.05, 0.85)


def level():
    return pk.ik.AxisAlignment(EFFECTOR, UP, axis=UP, tolerance=TILT)


def hand(point):
    return [pk.ik.HandPosition("left", point)]


def dense(curve, count=40):
    segments = np.repeat(np.arange(len(curve.breaks) - 1), count)
    within = np.tile(np.linspace(0.0, 1.0, count), len(curve.breaks) - 1)
    return curve.at(segments, within * np.diff(curve.breaks)[segments])


def tilts(pepper, q):
    return np.arccos(np.clip(pk.kinematics.frame_pose(pepper, q, EFFECTOR)[..., :3, 2] @ UP, -1, 1))


def test_a_tray_is_level_from_where_it_is_taken_to_where_it_is_put(pepper):
    start = pepper.posture("Stand")
    legs = [Leg(hand(LEFT)), Leg(hand(RIGHT), [level()]), Leg(start)]
    found = plan_legs(pepper, start, legs, POST, joints="left_arm", timeout=20)
    assert found.success, found.report()
    to, carry, back = found.plans
    assert tilts(pepper, dense(to.curve)).max() > TILT
    assert tilts(pepper, dense(back.curve)).max() > TILT
    assert tilts(pepper, dense(carry.curve)).max() <= TILT
    assert found.constraint_errors[0] == found.constraint_errors[2] == ()
    assert found.constraint_errors[1][0] == pytest.approx(tilts(pepper, dense(carry.curve)).max(), rel=0.02)
    for plan, point in ((to, LEFT), (carry, RIGHT)):
        place = pk.kinematics.frame_pose(pepper, plan.goal, EFFECTOR)[:3, 3]
        np.testing.assert_allclose(place, point, atol=1e-3)
    for before, after in zip(found.plans, found.plans[1:], strict=False):
        np.testing.assert_array_equal(before.goal, after.path[0])
    for plan in found.plans:
        assert not pk.collision.in_collision(pepper, dense(plan.curve), POST).any()
    assert len(found.path) == sum(len(plan.path) for plan in found.plans) - 2
    assert "Leg 2 of 3" in found.report()

    trajectory = found.retime(pepper, balance=0.01)
    durations = [pk.retime(pepper, plan, balance=0.01).duration for plan in found.plans]
    assert trajectory.duration == pytest.approx(sum(durations))
    meet = trajectory(durations[0])
    np.testing.assert_allclose(meet.position, to.goal, atol=1e-6)
    np.testing.assert_allclose(meet.velocity, 0, atol=1e-6)
    times = np.linspace(durations[0], durations[0] + durations[1], 300)
    assert tilts(pepper, trajectory(times).position).max() <= TILT + 1e-6


def test_costs_of_a_leg(pepper):
    pose = pk.symbolic.frame_pose(pepper, EFFECTOR)
    low = PathCost(pepper, lambda q: 40 * (1.1 - pose(q)[2, 3]) ** 2)
    found = plan_legs(
        pepper, pepper.posture("Stand"), [Leg(hand(LEFT)), Leg(hand(RIGHT), costs=[low])], POST,
        joints="left_arm", timeout=20,
    )  # fmt: skip
    assert found.success, found.report()
    assert found.plans[0].costs == ()
    assert found.plans[1].costs[0].integral < found.plans[1].costs[0].before


def test_the_leg_that_fails_is_named(pepper):
    far = [Leg(hand(LEFT)), Leg(hand((3.0, 0.0, 1.0)), [level()]), Leg(hand(LEFT))]
    found = plan_legs(pepper, pepper.posture("Stand"), far, POST, joints="left_arm", timeout=20)
    assert found.status is PlanStatus.NO_IK
    assert len(found.plans) == 2
    assert "Leg 2 of 3: " in found.report()
    assert found.path is None
    with pytest.raises(InvalidValueError, match="Leg 2 of 3"):
        found.retime(pepper)


def test_a_fixed_goal_that_the_next_leg_forbids_is_said(pepper):
    start = pepper.posture("Stand")
    tipped = pk.ik.solve(pepper, hand(LEFT), start=start, scene=POST, joints="left_arm").q
    found = plan_legs(pepper, start, [Leg(tipped), Leg(hand(RIGHT), [level()])], POST, joints="left_arm")
    assert found.status is PlanStatus.START_OFF_CONSTRAINT
    assert len(found.plans) == 2


def test_what_is_no_leg_is_refused(pepper):
    for legs in [[], [3], [[pk.ik.HandPosition("left", LEFT)]]]:
        with pytest.raises(InvalidValueError, match="legs"):
            plan_legs(pepper, pepper.posture("Stand"), legs)
