"""Descriptions as others write them: versions of URDF, URIs, states of an SRDF; and their exports."""

import warnings
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pinocchio
import pytest
from odd_robots import write_meshes

import pepper_kin as pk
from pepper_kin.dynamics import joint_friction
from pepper_kin.exceptions import ModelError, ModelWarning
from pepper_kin.model import audit
from pepper_kin.twin import actuator_parameters

MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
LIMIT = '<limit lower="-2" upper="2" effort="9" velocity="3"/>'


def urdf(inside="", origin="", version="", limit=LIMIT, more=""):
    return f"""<robot name="r"{version}><link name="b"/><link name="a">{MASS}{inside}</link>
    <joint name="j" type="revolute">{origin}<parent link="b"/><child link="a"/><axis xyz="0 0 1"/>
    {limit}</joint>{more}</robot>"""


@pytest.mark.parametrize("version", ["1", "1.0", "1.1", "1.2"])
def test_versions_of_urdf_are_read(version):
    robot = pk.load_robot(urdf(origin='<origin xyz="1 2 3" rpy="0 0 1"/>', version=f' version="{version}"'))
    assert pk.kinematics.frame_pose(robot, [0.0], "a")[:3, 3].tolist() == [1.0, 2.0, 3.0]
    assert pinocchio.buildModelFromXML(robot.export("urdf")).nq == 1


@pytest.mark.parametrize("seed", range(5))
def test_quat_xyzw_is_a_rotation_in_every_origin(seed):
    """Against Pinocchio's quaternions; also of no unit length, as urdfdom normalizes them, and half turns."""
    q = np.random.default_rng(seed).normal(size=4)
    q = np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]) if seed == 0 else q  # a pitch of a quarter turn
    turn = 'quat_xyzw="{!r} {!r} {!r} {!r}"'.format(*q.tolist())
    expected = pinocchio.Quaternion(*(q / np.linalg.norm(q))[[3, 0, 1, 2]]).toRotationMatrix()
    box = f'<collision><origin {turn}/><geometry><box size="1 1 1"/></geometry></collision>'
    text = urdf(box, f'<origin xyz="1 2 3" {turn}/>', ' version="1.1"')
    robot = pk.load_robot(text.replace("<inertial>", f"<inertial><origin {turn}/>"))
    pose = pk.kinematics.frame_pose(robot, [0.0], "a")
    np.testing.assert_allclose(pose[:3, :3], expected, atol=1e-12)
    np.testing.assert_allclose(
        robot.collision_shapes[0].transform_shape_to_link[:3, :3], expected, atol=1e-12
    )
    assert "quat_xyzw" not in robot.urdf
    assert not [fault for fault in audit(text).faults if fault.kind in ("xml", "number")]


@pytest.mark.parametrize(
    ("version", "origin", "reason"),
    [
        (' version="2.0"', "", r"version '2\.0'; versions 1\.0, 1, 1\.1, 1\.2 are read"),
        (' version="x"', "", "version 'x'"),
        ("", '<origin quat_xyzw="0 0 0 1"/>', r"needs <robot version=\"1\.1\">"),
        (' version="1.1"', '<origin quat_xyzw="0 0 0 1" rpy="0 0 0"/>', "stands beside rpy"),
        (' version="1.1"', '<origin quat_xyzw="0 0 0 0"/>', "has the length 0"),
        (' version="1.1"', '<origin quat_xyzw="0 0 1"/>', "is not 4 finite numbers"),
    ],
)
def test_other_versions_and_rotations_are_refused_by_name(version, origin, reason):
    with pytest.raises(ModelError, match=reason):
        pk.load_robot(urdf(origin=origin, version=version))


@pytest.mark.parametrize(
    "name", ["my part.stl", "100%25.STL", "file:{}", "file://localhost{}", "package://meshes/my%20part.stl"]
)
def test_uris_of_files_are_decoded(name, tmp_path):
    """RFC 3986 and 8089; a file whose name has a percent sign is found by its URI and by its plain name."""
    folder = tmp_path / "meshes"
    folder.mkdir()
    write_meshes(folder)
    part = (folder / "my part.stl").as_uri().removeprefix("file://")
    written = (folder / name).as_uri() if "/" not in name and "{" not in name else name.format(part)
    for spelled in (written, str(folder / name) if "/" not in name and "{" not in name else written):
        mesh = f'<collision><geometry><mesh filename="{spelled}"/></geometry></collision>'
        robot = pk.load_robot(urdf(mesh), package_dirs=[tmp_path])
        ball = pk.Scene().add_sphere("s", 0.01, (0, 0, -1))
        assert pk.collision.clearance(robot, [0.0], ball) == pytest.approx(0.99, abs=1e-6)


@pytest.mark.parametrize(
    ("values", "posture", "reason"),
    [
        ([("j", "9")], 2.0, "value 9, beyond its limits -2 and 2; it becomes 2"),
        ([("j", "1.5 0.2")], 0.0, "joint j has 2 values, expected 1"),
        ([("j", "1"), ("j", "0.5")], 0.5, "joint j stands twice"),
        ([("j", "1"), ("k", "0.9")], 1.0, "value 0.9, but follows j and goes to 0.6"),
        ([("j", "1"), ("weld", "1")], 1.0, "joint weld is fixed, its value 1 is left out"),
        ([("j", "1"), ("k", "0.6"), ("weld", "0")], 1.0, None),
        ([("j", "2.000001")], 2.0, None),
    ],
)
def test_values_of_states_that_do_not_fit_are_named(values, posture, reason):
    more = f"""<link name="c">{MASS}</link><link name="d"/><joint name="k" type="revolute"><parent link="a"/>
    <child link="c"/>{LIMIT}<mimic joint="j" multiplier="0.5" offset="0.1"/></joint>
    <joint name="weld" type="fixed"><parent link="c"/><child link="d"/></joint>"""
    states = "".join(f'<joint name="{name}" value="{value}"/>' for name, value in values)
    srdf = f"""<robot name="r"><group name="arm"><joint name="j"/></group>
    <group_state name="s" group="arm">{states}</group_state></robot>"""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = pk.load_robot(urdf(more=more), srdf)
    told = [str(w.message) for w in caught if "SRDF: state 's' of group 'arm'" in str(w.message)]
    assert robot.posture("s")[0] == posture
    assert (reason is None and not told) or (reason is not None and reason in told[0])


def test_narrower_limits_name_the_postures_that_they_change():
    srdf = """<robot name="r"><group name="arm"><joint name="j"/></group>
    <group_state name="s" group="arm"><joint name="j" value="1"/></group_state></robot>"""
    robot = pk.load_robot(urdf(), srdf)
    with pytest.warns(ModelWarning, match="joint j has the value 1, beyond its limits -2 and 0.5"):
        assert robot.with_limits(upper=0.5).posture("s")[0] == 0.5


def test_a_robot_without_shapes_has_no_contacts():
    robot = pk.load_robot(urdf())
    for geometry in ("collision", "visual"):
        assert pk.collision.contacts(robot, [0.0], within=1.0, geometry_type=geometry) == ()


@pytest.mark.parametrize("at", [0.0, 0.3])
def test_a_joint_of_no_range_is_held_in_mujoco(at):
    """MuJoCo takes a range "0 0" for none: push and command move the joint by what a limit yields."""
    robot = pk.load_robot(urdf(limit=f'<limit lower="{at}" upper="{at}" effort="5" velocity="2"/>'))
    model = mujoco.MjModel.from_xml_string(robot.export("mjcf"))
    assert model.joint("j").limited[0]
    assert model.actuator("j_position").ctrllimited[0]
    for push, command in ((1.0, 0.0), (0.0, 1.0)):
        data = mujoco.MjData(model)
        data.qpos[0], data.qfrc_applied[0], data.ctrl[0] = at, push, command
        mujoco.mj_step(model, data, 500)
        assert data.qpos[0] == pytest.approx(at, abs=2e-3)


def test_a_joint_without_effort_has_no_force_in_mujoco():
    """A force range "0 0" would be none, too."""
    robot = pk.load_robot(urdf(limit='<limit lower="-1" upper="1" effort="0" velocity="2"/>'))
    model = mujoco.MjModel.from_xml_string(robot.export("mjcf"))
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    mujoco.mj_step(model, data, 500)
    assert abs(data.qpos[0]) < 1e-6


def test_friction_is_in_the_exports_and_in_the_motors():
    """As MuJoCo reads it from this URDF itself; a follower rubs on its leader by the square of its gain."""
    follower = f"""<link name="c">{MASS}</link><joint name="k" type="revolute"><parent link="a"/>
    <child link="c"/>{LIMIT}<mimic joint="j" multiplier="-2"/>
    <dynamics damping="0.1" friction="0.05"/></joint>"""
    text = urdf(limit=LIMIT + '<dynamics damping="0.7" friction="0.3"/>', more=follower)
    robot, theirs = pk.load_robot(text), mujoco.MjModel.from_xml_string(text)
    ours = mujoco.MjModel.from_xml_string(robot.export("mjcf"))
    assert ours.dof_damping.tolist() == theirs.dof_damping.tolist() == [0.7, 0.1]
    assert ours.dof_frictionloss.tolist() == theirs.dof_frictionloss.tolist() == [0.3, 0.05]
    sdf = ET.fromstring(robot.export("sdf"))
    assert [float(e.text) for e in sdf.iter("damping")] == [0.7, 0.1]
    assert [float(e.text) for e in sdf.iter("friction")] == [0.3, 0.05]
    # Power lost at v: d v^2 + c |v| of each joint, with v of the follower -2 v.
    v = 0.5
    power = (0.7 * v**2 + 0.3 * v) + (0.1 * (2 * v) ** 2 + 0.05 * 2 * v)
    assert joint_friction(robot, [v])[0] * v == pytest.approx(power)
    motor = actuator_parameters(robot, "motor")
    lost = motor.viscous_friction[0] * v**2 + motor.coulomb_friction[0] * v
    assert lost == pytest.approx(power)


def test_capsules_are_written_in_version_1_0():
    """A cylinder and two balls, which `load_robot` joins again; Pinocchio's reader knows no capsule."""
    capsule = '<geometry><capsule radius="0.1" length="0.4"/></geometry>'
    origin = '<origin xyz="0.1 0 0" rpy="0.5 0 0"/>'
    robot = pk.load_robot(urdf(f"<collision>{origin}{capsule}</collision>", version=' version="1.2"'))
    text = robot.export("urdf")
    assert "<capsule" not in text
    [again], [before] = pk.load_robot(text).collision_shapes, robot.collision_shapes
    assert (again.geometry.radius, again.geometry.length) == pytest.approx((0.1, 0.4))
    scene = pk.Scene().add_sphere("s", 0.05, (0.3, 0.4, 0.7))
    near = [pk.collision.clearance(each, [0.3], scene) for each in (robot, pk.load_robot(text))]
    assert near[0] == pytest.approx(near[1], abs=1e-9)
    assert before.name == again.name


def test_one_file_under_two_names_is_exported(tmp_path):
    write_meshes(tmp_path)
    names = ((tmp_path / "solid.obj").as_uri(), str(tmp_path / "solid.obj"))
    shapes = "".join(f'<visual><geometry><mesh filename="{n}"/></geometry></visual>' for n in names)
    robot = pk.load_robot(urdf(shapes))
    for paths in ("absolute", "relative", "package"):
        assert robot.export("urdf", mesh_paths=paths).count("solid.obj") == 2
