"""Joints that turn without limits: full turns make no difference."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.model.joint_vectors import full_turns

MASS = '<inertial><mass value="1"/><inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial>'
URDF = f"""<robot name="r"><link name="base">{MASS}</link><link name="la">{MASS}</link>
<link name="lb">{MASS}</link>
<joint name="turns" type="continuous"><parent link="base"/><child link="la"/><axis xyz="0 0 1"/>
  <limit effort="5" velocity="2"/></joint>
<joint name="bends" type="revolute"><parent link="la"/><child link="lb"/><axis xyz="0 0 1"/>
  <limit lower="-3.1" upper="3.1" effort="5" velocity="2"/></joint></robot>"""


@pytest.mark.parametrize(("start", "goal"), [(3.0, -3.0), (-3.0, 3.0), (0.5, 12.0), (-9.0, 9.0), (1.0, 2.0)])
def test_plans_go_the_short_way_and_end_at_the_goal_but_for_full_turns(start, goal):
    robot = pk.load_robot(URDF, acceleration_limits=1.0)
    found = pk.plan(robot, np.array([start, 3.0]), np.array([goal, -3.0]))
    assert found.success
    turned = found.path[-1] - found.path[0]
    assert abs(turned[0]) <= np.pi + 1e-9
    assert turned[1] == pytest.approx(-6.0)  # which has limits
    off = found.path[-1, 0] - goal
    assert off == pytest.approx(2 * np.pi * np.round(off / (2 * np.pi)), abs=1e-9)


@pytest.mark.parametrize(
    ("factor", "turns"), [(0.5, 2), (-1.5, 2), (1 / 3, 3), (0.11, 100), (2.0, 1), (0.3712345, 0)]
)
def test_joints_that_follow_stand_as_at_the_goal_too(factor, turns):
    """A follower of half the angle stands on the other side after one turn: the same posture is two away."""
    follower = f"""<link name="lc">{MASS}</link><joint name="follows" type="continuous"><parent link="base"/>
      <child link="lc"/><axis xyz="0 0 1"/><limit effort="5" velocity="9"/>
      <mimic joint="turns" multiplier="{factor!r}"/></joint></robot>"""
    robot = pk.load_robot(URDF.replace("</robot>", follower), acceleration_limits=1.0)
    goal = np.array([-3.0, 0.0])
    found = pk.plan(robot, np.array([3.0, 0.0]), goal)
    assert found.success
    for link in ("la", "lb", "lc"):
        poses = pk.kinematics.frame_pose(robot, np.array([found.path[-1], goal]), link)
        np.testing.assert_allclose(poses[0], poses[1], atol=1e-9)
    assert found.path[-1, 0] == pytest.approx(-3.0 + (2 * np.pi if turns == 1 else 0.0))
    period = 2 * np.pi * turns
    turned = full_turns(robot, np.array([[1.4 * period, 0.0], [1.6 * period, 0.0]]))
    np.testing.assert_allclose(turned, [[period, 0.0], [2 * period, 0.0]])


@pytest.mark.parametrize("turns", [2, 3, 7, -20])
def test_ik_is_the_same_after_full_turns(turns):
    pepper = pk.load_pepper(base="planar")
    arm, yaw = pepper.joint_group("left_arm"), pepper.joint_index("BaseYaw")
    q = pepper.posture("Stand").copy()
    point = pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3] + [0.02, 0.0, 0.03]
    reference = pk.ik.solve(pepper, pk.ik.HandPosition("left", point), q, joints=arm)
    assert reference.success
    q[yaw] += 2 * np.pi * turns
    found = pk.ik.solve(pepper, pk.ik.HandPosition("left", point), q, joints=arm)
    rows = pk.ik.solve_batch(pepper, pk.ik.HandPosition("left", point[None]), q, joints=arm)
    several = pk.ik.solutions(pepper, pk.ik.HandPosition("left", point), q, joints=arm, count=2)
    assert found.success
    assert rows.success.all()
    assert len(several)
    for each in (found.q, rows.q[0], several[0]):
        assert each[yaw] == pytest.approx(q[yaw])
        at = pk.kinematics.frame_pose(pepper, each, "LArm_effector")[:3, 3]
        np.testing.assert_allclose(at, point, atol=1.1e-3)
        assert not pk.collision.in_collision(pepper, each)
