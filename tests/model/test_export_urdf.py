"""URDF in PyBullet (an independent reader) and SRDF against the robot it is for."""

import pathlib
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.semantics import parse_srdf

VARIANTS = [(base, hands) for base in ("fixed", "planar") for hands in ("locked", "mimic", "independent")]


@pytest.mark.parametrize(("base", "hands"), VARIANTS)
def test_pybullet_reads_the_same_robot(base, hands, tmp_path):
    bullet = pytest.importorskip("pybullet")  # no wheels for Python 3.12 and later
    pepper = pk.load_pepper(base=base, hands=hands)
    path = tmp_path / "pepper.urdf"
    path.write_text(pepper.export("urdf", mesh_paths="absolute", zero_inertials=True), encoding="utf-8")
    client = bullet.connect(bullet.DIRECT)
    try:
        body = bullet.loadURDF(
            str(path), useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
        )
        infos = [
            bullet.getJointInfo(body, i, physicsClientId=client)
            for i in range(bullet.getNumJoints(body, physicsClientId=client))
        ]
        joints = {info[1].decode(): info[0] for info in infos}
        links = {info[12].decode(): info[0] for info in infos}
        assert set(links) == set(pepper.link_names) - {pepper.document.root}
        names = list(pepper.pinocchio_model.names)[1:]
        moving = [info[1].decode() for info in infos if info[2] != bullet.JOINT_FIXED]
        assert set(moving) == set(names)
        rng = np.random.default_rng(0)
        q = rng.uniform(np.maximum(pepper.lower_limits, -3), np.minimum(pepper.upper_limits, 3))
        full = pepper.to_full(q)
        for name, value in zip(names, full, strict=True):
            bullet.resetJointState(body, joints[name], value, physicsClientId=client)
        for name, index in links.items():
            state = bullet.getLinkState(body, index, computeForwardKinematics=1, physicsClientId=client)
            pose = pk.kinematics.frame_pose(pepper, q, name)
            rotation = np.array(bullet.getMatrixFromQuaternion(state[5])).reshape(3, 3)
            np.testing.assert_allclose(state[4], pose[:3, 3], atol=1e-6, err_msg=name)
            np.testing.assert_allclose(rotation, pose[:3, :3], atol=1e-6, err_msg=name)
        values = [full[names.index(name)] for name in moving]
        matrix = np.array(bullet.calculateMassMatrix(body, values, physicsClientId=client))
        order = [moving.index(name) for name in names]
        matrix = pepper.full_map.T @ matrix[np.ix_(order, order)] @ pepper.full_map
        np.testing.assert_allclose(matrix, pk.dynamics.mass_matrix(pepper, q), atol=1e-6)
    finally:
        bullet.disconnect(client)


@pytest.mark.parametrize("mesh_paths", ["package", "absolute", "relative"])
def test_exported_urdf_loads_again(mesh_paths, tmp_path):
    pepper = pk.load_pepper(hands="mimic")
    text = pepper.export("urdf", mesh_paths=mesh_paths)
    again = pk.load_robot(text)
    comparison = pk.model.compare(pepper, text)
    assert comparison.equal, comparison.report()
    q = pepper.posture("Stand")
    np.testing.assert_allclose(
        pk.dynamics.mass_matrix(again, q), pk.dynamics.mass_matrix(pepper, q), atol=1e-12
    )
    names = [mesh.get("filename") for mesh in ET.fromstring(text).iterfind("link/visual/geometry/mesh")]
    if mesh_paths == "package":
        assert all(name.startswith("package://pepper_kin/urdf/meshes/") for name in names)
    elif mesh_paths == "absolute":
        assert all(pathlib.Path(name).is_absolute() and pathlib.Path(name).is_file() for name in names)
    else:
        assert set(names) == set(pk.model.mesh_files(pepper.document))


def test_package_names_stay_as_they_are():
    pepper = pk.load_pepper()
    assert pepper.export("urdf") == pepper.urdf


def test_zero_inertials_are_for_urdf_only():
    with pytest.raises(InvalidValueError, match="zero_inertials: got True, expected False: only URDF"):
        pk.load_pepper().export("mjcf", zero_inertials=True)


@pytest.mark.parametrize(("base", "hands"), VARIANTS)
def test_srdf_names_only_what_there_is(base, hands):
    pepper = pk.load_pepper(base=base, hands=hands)
    root = ET.fromstring(pepper.export("srdf"))
    joints = {joint.name for joint in pepper.document.joints if joint.type != "fixed"}
    assert {j.get("name") for j in root.iterfind("group/joint")} <= joints
    assert {j.get("name") for j in root.iterfind("group_state/joint")} <= set(pepper.joint_names)
    assert {j.get("name") for j in root.iterfind("passive_joint")} == joints - set(pepper.joint_names)
    groups = {group.get("name") for group in root.findall("group")}
    assert {g.get("name") for g in root.iterfind("group/group")} <= groups
    assert {e.get("group") for e in root.findall("end_effector")} <= groups
    for pair in root.findall("disable_collisions"):
        assert {pair.get("link1"), pair.get("link2")} <= set(pepper.link_names)
        assert pair.get("reason") in ("Adjacent", "Always", "Default", "Never", "User")
    assert (len(root.findall("virtual_joint")) == 1) == (base == "fixed")
    again = parse_srdf(ET.tostring(root, encoding="unicode"), pepper.document)
    assert again.disabled_pairs.keys() == pepper.semantics.disabled_pairs.keys()
    ours = {name: joints for name, joints in pepper.semantics.groups.items() if joints}
    assert {name: joints for name, joints in again.groups.items() if joints} == ours


def test_the_papers_eight_groups_and_their_states():
    semantics = pk.load_pepper(hands="mimic").semantics
    arm = ["ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw"]
    left, right = ([f"{side}{name}" for name in arm] for side in "LR")
    assert list(semantics.groups["left_arm"]) == left
    assert list(semantics.groups["right_arm"]) == right
    assert list(semantics.groups["both_arms"]) == left + right
    assert set(semantics.groups["torso"]) == {"HipRoll", "HipPitch", "KneePitch"}
    assert set(semantics.groups["head"]) == {"HeadYaw", "HeadPitch"}
    assert len(semantics.groups["LHand"]) == len(semantics.groups["RHand"]) == 15
    assert len(semantics.groups["both_hands"]) == 30
    states = set(semantics.states)
    assert {("left_arm", "down"), ("right_arm", "down"), ("both_arms", "down")} <= states
    assert {(g, s) for g in ("LHand", "RHand", "both_hands") for s in ("open", "closed")} <= states
    wanted = {"Stand", "StandInit", "StandZero", "Crouch", "Rest", "Ready"}
    assert wanted <= set(semantics.postures())


def test_independent_fingers_take_the_hands_opening():
    mimic, free = pk.load_pepper(hands="mimic"), pk.load_pepper(hands="independent")
    for name in mimic.posture_names:
        for frame in ("LFinger13_link", "RThumb2_link"):
            np.testing.assert_allclose(
                pk.kinematics.frame_pose(free, free.posture(name), frame),
                pk.kinematics.frame_pose(mimic, mimic.posture(name), frame),
                atol=1e-8,
            )


def test_rest_hangs_its_head():
    pepper = pk.load_pepper()
    i = pepper.joint_index("HeadPitch")
    assert pepper.posture("Rest")[i] == pepper.upper_limits[i]
    assert not pk.collision.in_collision(pepper, pepper.posture("Rest"))
