"""Links without mass: joints that move none are named, and inertia counts where it comes alone."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import ModelError

LINK = """<link name="{}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>"""
JOINT = """<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><axis xyz="0 1 0"/>{}
  <limit lower="-2" upper="2" effort="30" velocity="2"/></joint>"""


def robot_of(*parts):
    return pk.load_robot(f'<robot name="r">{"".join(parts)}</robot>')


def empty_tip(mimic):
    """An arm that carries an empty link; where `mimic`, a second one that follows it."""
    parts = ['<link name="base"/><link name="tip"/>', LINK.format("arm")]
    parts += [JOINT.format("lift", "base", "arm", ""), JOINT.format("turn", "arm", "tip", "")]
    if mimic:
        parts += [
            '<link name="other"/>',
            JOINT.format("follow", "arm", "other", '<mimic joint="turn"/>'),
        ]
    return robot_of(*parts)


@pytest.mark.parametrize("mimic", [False, True])
@pytest.mark.parametrize("count", [1, 3])
def test_a_joint_that_moves_no_mass_is_named(mimic, count):
    robot = empty_tip(mimic)
    q = np.full((count, 2), 0.2)[0 if count == 1 else slice(None)]
    for function in (
        lambda: pk.dynamics.forward_dynamics(robot, q, 0 * q, 0 * q + 1),
        lambda: pk.dynamics.inverse_mass_matrix(robot, q),
    ):
        with pytest.raises(ModelError, match="no mass is moved by turn"):
            function()


def test_joints_about_one_axis_with_nothing_between_are_named():
    """Turning one against the other moves nothing, although each alone moves the arm."""
    parts = ['<link name="base"/><link name="between"/>', LINK.format("arm")]
    parts += [JOINT.format("first", "base", "between", ""), JOINT.format("second", "between", "arm", "")]
    robot, q = robot_of(*parts), np.zeros(2)
    with pytest.raises(ModelError, match=r"no mass is moved when these move together: first, second$"):
        pk.dynamics.forward_dynamics(robot, q, q, q + 1)


def test_inertia_without_mass_counts():
    """As Newton's and Euler's laws say, and Pinocchio: a foot of no mass still resists being turned."""
    foot = """<link name="foot"><inertial><mass value="0"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.3" iyz="0" izz="0.2"/></inertial></link>"""
    weld = '<joint name="weld" type="fixed"><parent link="arm"/><child link="foot"/></joint>'
    parts = ['<link name="base"/>', LINK.format("arm"), JOINT.format("lift", "base", "arm", "")]
    robot = robot_of(*parts, foot, weld)
    tau = pk.dynamics.newton_euler(robot, [0.0], [0.0], [1.0])
    by_hand = 0.01 + 1.0 * 0.1**2 + 0.3 - 9.81 * 0.1
    np.testing.assert_allclose(tau, [by_hand], rtol=1e-12)
    np.testing.assert_allclose(
        pk.dynamics.inverse_dynamics(robot, [0.0], [0.0], [1.0]), [by_hand], rtol=1e-12
    )
