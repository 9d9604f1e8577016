import pickle
import re

import numpy as np
import pinocchio as pin
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, ModelError, ModelWarning, UnknownNameError

ARM = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
  <joint name="slide" type="prismatic"><parent link="upper"/><child link="lower"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.5" effort="10" velocity="1"/></joint>
</robot>"""
SCALED = '<mesh filename="a.stl" scale="1 1 1 1"/>'
SHAPE = "<collision><geometry>{}</geometry></collision>"


def test_continuous_joint_has_one_coordinate_without_bounds():
    robot = pk.load_robot(ARM)
    assert robot.joint_names == ("turn", "slide")
    assert robot.joint_units == ("rad", "m")
    assert np.isneginf(robot.lower_limits[0])
    pose = pk.kinematics.frame_pose(robot, [np.pi / 2, 0.3], "lower")
    np.testing.assert_allclose(pose[:3, 3], [0, 0.3, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message", "limits"),
    [
        ('lower="0" upper="0.5"', 'lower="0.5" upper="0"', "lower limit 0.5 is above upper limit 0", None),
        ('velocity="1"', 'velocity="-1"', "velocity is -1; it is read as no limit", np.inf),
        ("</robot>", '<x:leg xmlns:x="http://ros.org/xacro" side="l"/></robot>', "<xacro:leg>", None),
        ('<link name="lower">', f'<link name="lower">{SHAPE.format("<plane/>")}', "geometry <plane>", None),
        (
            '<link name="lower">',
            f'<link name="lower">{SHAPE.format(SCALED)}',
            "scale '1 1 1 1' is not 3 numbers",
            None,
        ),
        (
            '<child link="lower"/>',
            '<child link="lower"/><mimic joint="thumb"/>',
            "slide mimics an unknown joint 'thumb'; it moves by itself",
            None,
        ),
    ],
)
def test_what_pinocchio_reads_is_mended_and_said(old, new, message, limits):
    assert old in ARM
    text = "\n" + ARM.replace(old, new, 1)
    with pytest.warns(ModelWarning, match=re.escape(message)):
        robot = pk.load_robot(text)
    sound = text.strip().replace('velocity="-1"', 'velocity="1"')  # which Pinocchio 4 refuses
    model = pin.buildModelFromXML(sound)
    q = np.array([0.7, 0.3])
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array([np.cos(0.7), np.sin(0.7), 0.3]))
    there = data.oMf[model.getFrameId("lower")].homogeneous
    np.testing.assert_allclose(pk.kinematics.frame_pose(robot, q, "lower"), there, atol=1e-12)
    assert (robot.lower_limits[1], robot.upper_limits[1]) == (0.0, 0.5)
    assert robot.velocity_limits[1] == (1.0 if limits is None else limits)


def test_faults_are_named():
    for old, new, message in [
        ('<link name="lower">', '<link name="upper">', "two links are named 'upper'"),
        ('<child link="lower"/>', '<child link="wrist"/>', "unknown link 'wrist'"),
        ('<child link="lower"/>', '<child link="upper"/>', "link 'upper' has two parent joints"),
        ('type="prismatic"', 'type="floating"', "joint slide has type 'floating'"),
        ('velocity="1"', 'velocity="fast"', "velocity='fast' is not a finite number"),
        ("</robot>", "", "not well-formed"),
        ("<robot", "<!DOCTYPE r [<!ENTITY a 'b'>]><robot", "entities are not allowed"),
        (
            '<limit lower="0" upper="0.5" effort="10" velocity="1"/>',
            "",
            "slide is prismatic and has no <limit>",
        ),
        ('<mass value="1"/>', "", "URDF: inertial of link upper has no mass"),
        ('ixy="0" ', "", "URDF: inertial of link upper has no ixy"),
        (
            '<mass value="1"/>',
            '<mass value="heavy"/>',
            "inertial of link upper: value='heavy' is not a finite number",
        ),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>', "axis of joint turn: '0 1' is not 3 finite numbers"),
        ('<axis xyz="0 0 1"/>', '<origin xyz="a"/>', "origin of joint turn: 'a' is not 3 finite numbers"),
    ]:
        assert old in ARM
        with pytest.raises(ModelError) as caught:
            pk.load_robot(ARM.replace(old, new, 1))
        assert message in str(caught.value)


def test_unreadable_file_is_named(tmp_path):
    with pytest.raises(FileFormatError, match=r"missing\.urdf: cannot be read"):
        pk.load_robot(tmp_path / "missing.urdf")


def test_limits_without_effort_or_velocity_are_none():
    robot = pk.load_robot(ARM.replace(' effort="10" velocity="1"', ""))
    np.testing.assert_array_equal(robot.effort_limits, [np.inf, np.inf])
    np.testing.assert_array_equal(robot.velocity_limits, [np.inf, np.inf])
    np.testing.assert_array_equal([robot.lower_limits[1], robot.upper_limits[1]], [0, 0.5])
    force = pk.dynamics.inverse_dynamics(robot, [0.0, 0.2], [2.0, 0.0], [0.0, 0.0])
    assert force[1] == pytest.approx(-1.0 * 2.0**2 * (0.2 + 0.1))  # m omega^2 r, inwards


def test_a_robot_without_links_is_no_loop():
    with pytest.raises(ModelError, match="URDF: the robot has no link"):
        pk.load_robot('<robot name="nothing"/>')


def state(value):
    return f"""<robot name="arm"><group name="all"><joint name="turn"/></group>
      <group_state name="rest" group="all"><joint name="root_joint" value="0. 0. 1.02 0. 0. 0. 1."/>
      <joint name="turn" value="{value}"/></group_state></robot>"""


def test_states_of_a_free_flyer_are_left_out():
    """A URDF has no joint of seven coordinates; SRDFs made for a floating base name one all the same."""
    semantics = pk.load_robot(ARM, state("0.25")).semantics
    assert semantics.states == {("all", "rest"): {"turn": 0.25}}


def test_what_is_wrong_in_a_file_begins_with_its_name(tmp_path):
    urdf, srdf = tmp_path / "arm.urdf", tmp_path / "arm.srdf"
    urdf.write_text("<robot name='arm'")
    with pytest.raises(ModelError, match=r"arm\.urdf: URDF: not well-formed XML"):
        pk.load_robot(urdf)
    urdf.write_text("<robot name='arm'><link name='a'/></robot>")
    with pytest.raises(ModelError, match=r"arm\.urdf: URDF: robot 'arm' has no moving joint"):
        pk.load_robot(str(urdf))
    joint = "<joint name='j' type='continuous'><parent link='a'/><child link='b'/></joint>"
    urdf.write_text(f"<robot name='arm'><link name='a'/><link name='b'/>{joint}</robot>")
    srdf.write_text("<robot")
    with pytest.raises(ModelError, match=r"arm\.srdf: SRDF: not well-formed XML"):
        pk.load_robot(urdf, srdf)
    with pytest.raises(ModelError, match=r"^URDF: not well-formed XML"):
        pk.load_robot("<robot")


def test_acceleration_limits_given_at_loading_belong_to_the_description():
    """All that reads limits then finds them: timing, certificates, exports, copies."""
    robot = pk.load_robot(ARM, acceleration_limits={"turn": 3.0})
    np.testing.assert_array_equal(robot.acceleration_limits, [3.0, np.inf])
    robot = pk.load_robot(robot.urdf, acceleration_limits=2.0)
    np.testing.assert_array_equal(robot.acceleration_limits, [3.0, 2.0])
    np.testing.assert_array_equal(pk.load_robot(robot.export("urdf")).acceleration_limits, [3.0, 2.0])
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(robot)).acceleration_limits, [3.0, 2.0])
    q = [[0.0, 0.0], [1.0, 0.2]]
    assert pk.retime(robot, q).check(robot).acceleration.success
    with pytest.raises(UnknownNameError, match="unknown joint 'bend'; available: turn, slide"):
        pk.load_robot(ARM, acceleration_limits={"bend": 1.0})
