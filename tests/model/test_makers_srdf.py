"""SRDFs as the makers of robots write them, against Pinocchio's reader of reference configurations."""

import importlib.metadata
import warnings
from pathlib import Path

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import ModelError, ModelWarning, UnknownNameError

SHARE = Path(importlib.metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share"))
ROBOTS = SHARE / "example-robot-data" / "robots"

FORK = """<robot name="fork"><link name="trunk"/><link name="left"/><link name="right"/><link name="tip"/>
  <joint name="l" type="continuous"><parent link="trunk"/><child link="left"/></joint>
  <joint name="r" type="continuous"><parent link="trunk"/><child link="right"/></joint>
  <joint name="t" type="continuous"><parent link="right"/><child link="tip"/></joint></robot>"""


def test_postures_are_those_that_pinocchio_reads():
    for urdf, srdf, posture in [
        ("talos_data/robots/talos_reduced", "talos_data/srdf/talos", "half_sitting"),
        ("panda_description/urdf/panda", "panda_description/srdf/panda", "default"),
        ("xarm_description/urdf/xarm7", "xarm_description/srdf/xarm7", "home"),
        (
            "anymal_b_simple_description/robots/anymal-kinova",
            "anymal_b_simple_description/srdf/anymal-kinova",
            "standing_with_arm_up",
        ),
        (
            "simple_humanoid_description/urdf/simple_humanoid",
            "simple_humanoid_description/srdf/simple_humanoid",
            "half_sitting",
        ),
        ("kinova_description/robots/kinova", "kinova_description/srdf/kinova", "arm_up"),
        ("icub_description/robots/icub", "icub_description/srdf/icub", "half_sitting"),
    ]:
        robot = pk.load_robot(ROBOTS / f"{urdf}.urdf", ROBOTS / f"{srdf}.srdf")
        model = pinocchio.buildModelFromUrdf(str(ROBOTS / f"{urdf}.urdf"))
        pinocchio.loadReferenceConfigurations(model, str(ROBOTS / f"{srdf}.srdf"), False)
        theirs = model.referenceConfigurations[posture]

        q = robot.posture(posture)

        for name, value in zip(robot.joint_names, q, strict=True):
            joint = model.joints[model.getJointId(name)]
            part = theirs[joint.idx_q : joint.idx_q + joint.nq]
            angle = float(part[0]) if joint.nq == 1 else float(np.arctan2(part[1], part[0]))
            turned = value if joint.nq == 1 else np.angle(np.exp(1j * value))
            limits = robot.lower_limits[robot.joint_index(name)], robot.upper_limits[robot.joint_index(name)]
            assert turned == pytest.approx(np.clip(angle, *limits), abs=1e-9), name
        with pytest.raises(UnknownNameError, match=rf"unknown posture 'sit'; available: .*{posture}"):
            robot.posture("sit")


def groups(text):
    return pk.load_robot(FORK, f'<robot name="fork">{text}</robot>').semantics.groups


def test_a_chain_may_go_up_one_branch_and_down_another():
    chain = '<group name="all"><chain base_link="left" tip_link="tip"/></group>'
    assert groups(chain) == {"all": ("l", "r", "t")}
    assert groups(chain.replace('"left"', '"right"')) == {"all": ("t",)}


def test_groups_may_come_after_those_that_hold_them():
    text = '<group name="all"><group name="a"/></group><group name="a"><joint name="t"/></group>'
    assert groups(text) == {"all": ("t",), "a": ("t",)}
    with pytest.raises(ModelError, match="SRDF: group 'all' contains itself: all > a > all"):
        groups(text.replace('<joint name="t"/>', '<group name="all"/>'))


def test_names_that_the_robot_lacks_are_left_out_with_a_warning():
    """One SRDF serves variants of a robot, as Pepper's serves locked hands; or a name is wrong."""
    text = '<group name="arm"><chain base_link="trunk" tip_link="finger"/><joint name="r"/></group>'
    with pytest.warns(ModelWarning, match="SRDF: the robot has no link 'finger', which are left out"):
        assert groups(text) == {"arm": ("r",)}
    text = """<group name="arm"><group name="hand"/><joint name="r"/><joint name="q"/><link name="tip"/>
      </group>
      <passive_joint name="caster"/><end_effector name="hand" parent_link="palm" group="fingers"/>
      <group_state name="away" group="arm"><joint name="w" value="1"/></group_state>
      <disable_collisions link1="trunk" link2="sole"/><enable_collisions link1="left" link2="nose"/>"""
    with pytest.warns(ModelWarning) as raised:
        assert groups(text) == {"arm": ("r", "t")}
    assert "no joint 'q', 'w', 'caster'; no link 'nose', 'sole', 'palm'; no group 'hand', 'fingers'" in str(
        raised[0].message
    )


def test_what_srdfs_of_makers_hold_is_read_without_a_word():
    """Comments, spaces, a virtual joint in a group, passive joints, a link's spheres, a joint property."""
    text = """<!-- <group name="old"><joint name="gone"/></group> -->
      <virtual_joint name="world_joint" type="planar" parent_frame="odom" child_link="trunk"/>
      <group name=" all "><joint name="world_joint"/><joint name=" l "/><passive_joint name="r"/>
        <chain base_link="trunk" tip_link="tip"/></group>
      <group name="all"><joint name="t"/></group>
      <group_state name="home" group="all"><joint name="world_joint" value="0 0 0"/>
        <joint name="t" value=" .5 "/></group_state>
      <end_effector name="hand" parent_link="tip" group="all" parent_group="all"/>
      <passive_joint name="l"/><passive_joint name="world_joint"/>
      <link_sphere_approximation link="tip"><sphere center="0 0 0" radius="0.1"/></link_sphere_approximation>
      <joint_property joint_name="l" property_name="angular_distance_weight" value="0.2"/>"""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robot = pk.load_robot(FORK, f'<?xml version="1.0"?>\n<robot name="fork">{text}</robot>')
    assert robot.semantics.groups == {"all": ("l", "r", "t")}
    np.testing.assert_array_equal(robot.posture("home"), [0.0, 0.0, 0.5])


def test_collisions_of_a_link_are_disabled_with_all_others_but_exceptions():
    text = """<disable_default_collisions link="tip"/><enable_collisions link1="tip" link2="left"/>
      <disable_collisions link1="right" link2="left" reason="Never"/>"""
    robot = pk.load_robot(FORK, f'<robot name="fork">{text}</robot>')
    assert robot.semantics.disabled_pairs == {
        ("right", "tip"): "Default",
        ("tip", "trunk"): "Default",
        ("left", "right"): "Never",
    }


def test_another_document_is_refused():
    with pytest.raises(ModelError, match="SRDF: the root element is <sdf>, expected <robot>"):
        pk.load_robot(FORK, "<sdf/>")
