"""Beyond reach, proven: what a search that ran out of time may still say."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.ik import IKStatus
from pepper_kin.ik.problem import make_problem
from pepper_kin.ik.reach_bound import least_shortfall, why_beyond_reach

PEPPER = pk.load_pepper()
FAR = (2.4, 0.0, 0.8)


def problem_of(pepper, task, movable=None):
    free = np.ones(pepper.n, dtype=bool) if movable is None else movable
    return make_problem(pepper, [task], pepper.neutral(), free, keep_idle=True)


@pytest.mark.parametrize("hands", ["locked", "mimic"])
@pytest.mark.parametrize("moving", [None, "left_arm"])
def test_no_posture_comes_nearer_than_the_bound(hands, moving):
    """Thousands of postures, without limits, by `pepper_kin.kinematics`."""
    pepper = pk.load_pepper(hands=hands)
    task = pk.ik.HandPosition("left", FAR)
    movable = np.isin(pepper.joint_names, pepper.joint_group(moving)) if moving else np.ones(pepper.n, bool)
    bound = least_shortfall(problem_of(pepper, task, movable), task)
    q = np.tile(pepper.neutral(), (5000, 1))
    q[:, movable] = np.random.default_rng(0).uniform(-np.pi, np.pi, (5000, int(movable.sum())))
    palm = pk.kinematics.frame_pose(pepper, q, task.frame)[:, :3, 3]
    nearest = np.linalg.norm(palm - task.target, axis=1).min()
    assert 1.0 < bound < nearest


def test_the_bound_of_two_links_is_exact():
    urdf = """<robot name="two"><link name="base"/><link name="one"/><link name="two"/><link name="tip"/>
    <joint name="a" type="continuous"><parent link="base"/><child link="one"/><origin xyz="0 0 0.5"/>
      <axis xyz="0 0 1"/></joint>
    <joint name="b" type="continuous"><parent link="one"/><child link="two"/><origin xyz="0.4 0 0"/>
      <axis xyz="0 0 1"/></joint>
    <joint name="c" type="fixed"><parent link="two"/><child link="tip"/><origin xyz="0.3 0 0"/></joint>
    </robot>"""
    arm = pk.load_robot(urdf)
    task = pk.ik.FramePosition("tip", (1.0, 0.0, 0.5))
    assert least_shortfall(problem_of(arm, task), task) == pytest.approx(0.3, abs=1e-12)
    within = pk.ik.FramePosition("tip", (0.0, 0.69, 0.5))
    assert least_shortfall(problem_of(arm, within), within) == 0.0


def test_a_base_that_drives_is_out_of_nothing():
    pepper = pk.load_pepper(base="planar")
    assert why_beyond_reach(problem_of(pepper, pk.ik.HandPosition("left", (9.0, 0.0, 0.8)))) == ""


@pytest.mark.parametrize("solver", ["fast", "placo"])
def test_out_of_time_says_beyond_reach_and_how_near_it_got(solver):
    tasks = [pk.ik.HandPosition("left", FAR), pk.ik.LookAt(FAR)]
    result = pk.ik.solve(PEPPER, tasks, solver=solver, timeout=1e-9, collisions=False)
    assert result.status is IKStatus.TIMED_OUT
    report = result.report()
    assert report.startswith("not reached: time ran out, but it is beyond reach; this is the closest")
    palm = pk.kinematics.frame_pose(PEPPER, result.q, "LArm_effector")[:3, 3]
    assert f"left hand stops {np.linalg.norm(palm - FAR):.2f} m short of (2.400, 0.000, 0.800)" in report
    assert "no posture brings left hand nearer than 1." in report
    assert "give more time" not in report


def test_out_of_time_near_the_body_blames_the_time_alone():
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", (0.5, 0.2, 0.9)), timeout=1e-9, collisions=False)
    assert result.hint == ""
    assert "give more time" in result.report()


def test_a_plan_out_of_time_says_it_too():
    task = pk.ik.HandPosition("left", FAR)
    plan = pk.plan(PEPPER, PEPPER.posture("Stand"), [task], timeout=1e-6)
    assert plan.status.value == "no_ik"
    assert "beyond reach" in plan.report()
    assert "m short of (2.400, 0.000, 0.800)" in plan.report()
