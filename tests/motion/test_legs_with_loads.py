"""Legs that pick up and put down: mass and shape of the object count on the legs on which it is carried.

The references are Pinocchio, with the object as part of a link, and coal.
"""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion import Leg, PlanStatus, plan_legs

PEPPER = pk.load_pepper().with_requirements("limits")
STAND = PEPPER.posture("Stand")
HAND = [name for name in PEPPER.link_names if name.startswith(("l_", "LFinger", "LThumb"))]
RADIUS, LENGTH, CUP = 0.02, 0.10, np.array([0.38, 0.25, 0.80])
WORLD = (
    pk.Scene()
    .add_box("table", (0.3, 0.8, 0.03), (0.55, 0.05, 0.68))
    .add_cylinder("cup", RADIUS, LENGTH, CUP)
    .allow("cup", *HAND)
)
JOINTS = ["left_arm", "HipPitch"]
TAKE, PUT = [pk.ik.HandPosition("left", CUP)], [pk.ik.HandPosition("left", (0.30, 0.30, 1.15))]


def legs_of(mass, **options):
    """Return legs to the cup, with it to another place, and back without it."""

    def grasped(scene, q):
        return scene.attach("cup", "l_gripper", pepper=PEPPER, q=q, mass=mass, **options)

    return [Leg(TAKE), Leg(PUT, scene=grasped), Leg(STAND, scene=lambda s, q: s.release(PEPPER, "cup", q))]


def frames_at(q):
    """Return the pose of the gripper by Pinocchio."""
    model, data = PEPPER.inner_model, PEPPER.inner_model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    return data.oMf[PEPPER.frame_id("l_gripper")]


def loaded_model(mass, q):
    """Return Pinocchio's model with the cup, taken at q, as part of the hand."""
    model = PEPPER.inner_model.copy()
    frame = model.frames[PEPPER.frame_id("l_gripper")]
    placed = frames_at(q).actInv(pinocchio.SE3(np.eye(3), CUP))
    inertia = pinocchio.Inertia.FromCylinder(mass, RADIUS, LENGTH)
    model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement * placed)
    return model


def torques(model, trajectory):
    time = np.concatenate([np.linspace(0.0, trajectory.duration, 1501), trajectory.breaks])
    data, state = model.createData(), trajectory(time)
    return np.array([pinocchio.rnea(model, data, *row) for row in zip(*state, strict=True)])


@pytest.fixture(scope="module")
def found():
    return plan_legs(PEPPER, STAND, legs_of(0.5), WORLD, joints=JOINTS, timeout=20, balance=0.01)


def test_an_object_is_carried_on_the_leg_on_which_it_is_held(found):
    assert found.success, found.report()
    assert [[load.mass for load in plan.loads] for plan in found.plans] == [[], [0.5], []]
    assert [list(scene.attached) for scene in found.scenes] == [[], ["cup"], []]
    taken, put = found.plans[0].goal, found.plans[1].goal
    moved = frames_at(put) * frames_at(taken).inverse()
    place = found.scenes[2].objects["cup"].transform_object_to_world
    np.testing.assert_allclose(place[:3, 3], moved.act(CUP), atol=1e-9)
    for plan, scene in zip(found.plans, found.scenes, strict=True):
        segments = np.arange(len(plan.curve.breaks) - 1)
        q = np.concatenate([plan.curve.at(segments, x * np.diff(plan.curve.breaks)) for x in (0, 0.3, 0.7)])
        assert not pk.collision.in_collision(PEPPER, q, scene).any()


def test_each_leg_is_timed_and_certified_with_what_it_carries(found):
    motions = found.retime_legs(PEPPER, balance=0.01)
    carried = motions[1]
    loaded = torques(loaded_model(0.5, found.plans[0].goal), carried)
    assert (np.abs(loaded) <= PEPPER.effort_limits * (1 + 1e-6)).all()
    alone = pk.retime(PEPPER, found.plans[1], balance=0.01, scene=pk.Scene())  # without the cup
    assert carried.duration > alone.duration
    certificates = found.check(PEPPER, motions)
    assert all(one.success for one in certificates)
    np.testing.assert_allclose(np.abs(certificates[1].torque.value), np.abs(loaded).max(axis=0), atol=0.02)
    for one, motion in ((certificates[0], motions[0]), (certificates[2], motions[2])):
        greatest = np.abs(torques(PEPPER.inner_model, motion)).max(axis=0)
        np.testing.assert_allclose(np.abs(one.torque.value), greatest, atol=5e-3)
    # Only the leg on which it is held fails its certificate when it is timed without it.
    light = [motions[0], alone, motions[2]]
    assert [one.success for one in found.check(PEPPER, light)] == [True, False, True]


def test_the_joined_motion_keeps_the_torques_of_all_legs(found):
    motions = found.retime_legs(PEPPER)
    whole = found.retime(PEPPER)
    assert whole.duration == pytest.approx(sum(one.duration for one in motions))
    begin = motions[0].duration
    part = whole.between(begin, begin + motions[1].duration)
    assert part.is_close(motions[1], 1e-6)


def test_an_object_too_heavy_is_said_with_its_leg():
    found = plan_legs(PEPPER, STAND, legs_of(8.0), WORLD, joints=JOINTS, timeout=5)
    assert found.status is PlanStatus.START_TORQUE_LIMIT
    assert "Leg 2 of 3: " in found.report()
    assert "with 8 kg of 'cup' at l_gripper" in found.plans[1].message
    assert len(found.plans) == len(found.scenes) == 2
    with pytest.raises(InvalidValueError, match=r"Leg 2 of 3.*8 kg"):
        found.retime_legs(PEPPER)


@pytest.mark.parametrize("seed", range(3))
def test_the_hand_reaches_for_a_heavy_object_so_that_it_can_be_held(seed):
    legs = legs_of(1.0, center_of_mass=(0.0, 0.0, -0.03))
    found = plan_legs(PEPPER, STAND, legs, WORLD, joints=JOINTS, seed=seed, timeout=20)
    assert found.success, found.report()
    model = PEPPER.inner_model.copy()
    frame = model.frames[PEPPER.frame_id("l_gripper")]
    q, still = found.plans[0].goal, np.zeros(PEPPER.n)
    center = frames_at(q).actInv(CUP + np.array([0.0, 0.0, -0.03]))
    mass = pinocchio.Inertia(1.0, np.array(center), np.zeros((3, 3)))
    model.appendBodyToJoint(frame.parentJoint, mass, frame.placement)
    assert (np.abs(pinocchio.rnea(model, model.createData(), q, still, still)) < PEPPER.effort_limits).all()


def test_a_world_may_change_where_a_leg_begins():
    shut = WORLD.add_box("lid", (0.5, 1.0, 0.02), (0.45, 0.1, 0.95))
    raised = PEPPER.joint_vector({"LShoulderPitch": -0.3, "LShoulderRoll": 0.2, "LElbowRoll": -0.4})
    options = {"joints": ["left_arm"], "timeout": 2.0}
    assert not plan_legs(PEPPER, STAND, [Leg(TAKE), Leg(raised, scene=shut)], WORLD, **options).success
    found = plan_legs(PEPPER, STAND, [Leg(raised), Leg(STAND, scene=shut), Leg(raised, scene=WORLD)], WORLD)
    assert found.scenes[0] is WORLD
    assert found.scenes[1] is shut


def test_what_is_no_world_is_refused():
    for wrong in [3, "cup", [WORLD], lambda scene, q: None, lambda scene, q: "cup"]:
        with pytest.raises(InvalidValueError, match=r"scene of leg 2: got .*Scene"):
            plan_legs(PEPPER, STAND, [Leg(TAKE), Leg(STAND, scene=wrong)], WORLD, joints=JOINTS, timeout=5)


def test_trajectories_that_are_not_those_of_the_legs_are_refused(found):
    motions = found.retime_legs(PEPPER)
    for wrong in (motions[:2], motions[0], [*motions[:2], found.plans[2]], None):
        with pytest.raises(InvalidValueError, match=r"trajectories: got .*retime_legs"):
            found.check(PEPPER, wrong)


def test_a_leg_in_which_nothing_moves_has_no_trajectory():
    found = plan_legs(PEPPER, STAND, [Leg(STAND), Leg(TAKE)], WORLD, joints=JOINTS, timeout=5)
    motions = found.retime_legs(PEPPER)
    assert motions[0] is None
    assert found.check(PEPPER, motions)[0] is None
    assert found.check(PEPPER, motions)[1].success
