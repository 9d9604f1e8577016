"""Goals as sets of tasks: the one that is reached is met, by Pinocchio; what is said where none is."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import kinematics
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.hands import hand_frame
from pepper_kin.motion import PlanStatus

CAN = np.array([0.40, 0.18, 0.95])


def grasps(count=18):
    """Places around a can, and that the hand points to it."""
    angles = np.linspace(-np.pi, np.pi, count, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    places = [pk.ik.HandPosition("left", CAN - 0.12 * direction) for direction in directions]
    pointing = [pk.ik.AxisAlignment("l_gripper", direction, tolerance=0.1) for direction in directions]
    return directions, [list(both) for both in zip(places, pointing, strict=True)]


@pytest.fixture(scope="module")
def scene():
    table = pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.5, 0.0, 0.715))
    return table.add_cylinder("can", 0.03, 0.44, CAN)


@pytest.mark.thorough
@pytest.mark.parametrize("options", [{}, {"least_margin": 0.001}, {"balance": 0.0}], ids=str)
def test_one_of_many_grasps_is_reached(pepper, scene, options):
    directions, tasks = grasps()
    for seed in range(5):
        plan = pk.plan(pepper, pepper.posture("Stand"), tasks, scene, seed=seed, **options)
        assert plan.success, plan.message
        assert f"goal {plan.alternative} of 18" in plan.message
        pose = kinematics.frame_pose(pepper, plan.goal, hand_frame("left"))
        direction = directions[plan.alternative]
        assert np.linalg.norm(pose[:3, 3] - (CAN - 0.12 * direction)) < 2e-3
        axis = kinematics.frame_pose(pepper, plan.goal, "l_gripper")[:3, 0]
        assert np.arccos(axis @ direction) < 0.1 + 1e-6
        assert plan.ik.success
        assert np.allclose(plan.path[-1], plan.goal)
        assert set(pk.retime(pepper, plan).check(pepper, scene).failures) <= {"balance"}  # not asked of it


def test_those_out_of_reach_are_passed_over_and_none_is_said_to_be_none(pepper):
    far = [[pk.ik.HandPosition("left", (3.0, y, 1.0))] for y in (0.0, 0.5, 1.0)]
    near = [pk.ik.HandPosition("left", (0.35, 0.2, 0.9))]
    start = pepper.posture("Stand")
    for place in range(4):
        tasks = [*far[:place], near, *far[place:]]
        plan = pk.plan(pepper, start, tasks)
        assert plan.success
        assert plan.alternative == place
    plan = pk.plan(pepper, start, far, timeout=1.0)
    assert plan.status is PlanStatus.NO_IK
    assert plan.message.startswith("None of 3 goals")
    wall = pk.Scene().add_box("wall", (0.02, 2.0, 2.0), (0.28, 0.0, 1.0))
    behind = [[pk.ik.HandPosition("left", (0.40, y, 0.9))] for y in (0.1, 0.2)]
    plan = pk.plan(pepper, start, behind, wall, timeout=0.5)
    assert not plan.success
    assert plan.message.startswith("None of 2 goals")


def test_goals_that_differ_go_with_what_else_is_asked(pepper):
    start = pepper.posture("Stand")
    tasks = [[pk.ik.HandPosition("right", (0.35, y, 0.9))] for y in (-0.1, -0.2, -0.3)]
    velocity = pepper.joint_vector({"HeadYaw": 0.3}, rest=0.0 * start)
    upright = [pk.ik.JointValue("HipRoll", 0.0)]
    costs = [pk.ik.JointValue("HeadYaw", 0.1)]
    for options in (
        {"constraints": upright},
        {"costs": costs},
        {"start_velocity": velocity},
        {"smooth": True},
    ):
        plan = pk.plan(pepper, start, tasks, **options)
        assert plan.success, plan.message
        place = kinematics.frame_pose(pepper, plan.goal, hand_frame("right"))[:3, 3]
        assert np.linalg.norm(place - (0.35, (-0.1, -0.2, -0.3)[plan.alternative], 0.9)) < 2e-3
    met = kinematics.frame_pose(pepper, start, hand_frame("right"))[:3, 3]
    plan = pk.plan(pepper, start, [tasks[0], [pk.ik.HandPosition("right", met)]])
    assert plan.success
    assert plan.alternative == 1
    single = pk.plan(pepper, start, tasks[0][0])
    assert single.success
    assert single.alternative is None
    assert np.allclose(single.path, pk.plan(pepper, start, tasks[0]).path)
    with pytest.raises(InvalidValueError):
        pk.plan(pepper, start, [tasks[0], start])
