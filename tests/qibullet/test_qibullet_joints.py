"""Joints and links of the adapter: commands arrive, speeds are kept, places are those of Bullet."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.naoqi.joint_names import ACTUATED
from pepper_kin.qibullet import PepperVirtual, SimulationError


def test_240_steps_are_a_second(pepper, steps):
    steps(1.0)
    assert pepper.body.time.now == pytest.approx(1.0, abs=0.021)


def test_commands_arrive(pepper, steps):
    rng = np.random.default_rng(3)
    names = [name for name in ACTUATED if name not in ("LHand", "RHand", "KneePitch", "HipPitch", "HipRoll")]
    for _ in range(3):
        goal = [
            float(rng.uniform(0.7 * j.getLowerLimit(), 0.7 * j.getUpperLimit()))
            for j in map(pepper.getJoint, names)
        ]
        pepper.setAngles(names, goal, 0.6)
        steps(4.0)
        np.testing.assert_allclose(pepper.getAnglesPosition(names), goal, atol=2e-3)


def test_a_share_of_the_speed_and_a_joint_that_was_made_slower(pepper, manager, client):
    pepper.setAngles(["HeadYaw", "RElbowYaw"], [1.5, 1.5], [0.2, 0.5])
    joint = pepper.getJoint("LElbowYaw")
    joint.setMaxVelocity(0.5 * joint.getMaxVelocity())
    pepper.setAngles("LElbowYaw", -1.5, 0.5)
    fastest = {"HeadYaw": 0.2, "RElbowYaw": 0.5, "LElbowYaw": 0.25}
    most = dict.fromkeys(fastest, 0.0)
    for _ in range(400):
        manager.stepSimulation(client)
        for name in most:
            most[name] = max(most[name], abs(pepper.body.command_rate(name)))
    limits = pepper.body.velocity_limits
    for name, share in fastest.items():
        assert most[name] == pytest.approx(share * limits[name], rel=1e-3)


def test_velocities_are_how_fast_angles_change(pepper, steps):
    pepper.setAngles(["HeadYaw", "RHand"], [1.5, 0.9], 0.2)
    steps(0.5)
    before, begun = pepper.getAnglesPosition("HeadYaw"), pepper.body.time.now
    measured = [pepper.getAnglesVelocity("HeadYaw")]
    for _ in range(10):
        steps(0.02)
        measured.append(pepper.getAnglesVelocity("HeadYaw"))
    change = (pepper.getAnglesPosition("HeadYaw") - before) / (pepper.body.time.now - begun)
    assert change == pytest.approx(np.mean(measured), rel=0.03)
    fastest = 0.2 * pepper.body.velocity_limits["HeadYaw"]
    assert 0.9 * fastest < change < fastest  # in the middle of a cubic
    finger, hand = pepper.getAnglesVelocity(["RFinger11", "RHand"])
    assert finger == pytest.approx(0.872665 * hand)


def test_a_share_of_zero_moves_nothing(pepper, steps):
    pepper.setAngles("HeadYaw", 1.0, 0.0)
    steps(0.5)
    assert pepper.getAnglesPosition("HeadYaw") == pytest.approx(0.0, abs=0.02)


def test_angles_are_cut_to_the_limits(pepper, steps):
    pepper.setAngles("HeadPitch", 900, 1.0)
    steps(2.0)
    q = pepper.body.configuration(False)
    pitch = q[pepper.body.index["HeadPitch"]]
    assert pitch == pytest.approx(pepper.getJoint("HeadPitch").getUpperLimit())


def test_fingers_follow_their_hand(pepper, steps):
    pepper.setAngles("RHand", 0.8, 1.0)
    steps(2.0)
    assert pepper.getAnglesPosition("RHand") == pytest.approx(0.8, abs=5e-3)
    finger, hand = pepper.getAnglesPosition(["RFinger11", "RHand"])
    assert finger == pytest.approx(0.872665 * hand)
    fingers = [name for name in pepper.joint_dict if name.startswith(("LFinger", "LThumb"))]
    assert len(fingers) == 14
    pepper.setAngles(fingers, [0.5 * 0.872665] * 14, 1.0)
    steps(2.0)
    assert pepper.getAnglesPosition("LHand") == pytest.approx(0.5, abs=5e-3)


def test_postures_are_those_of_the_model(pepper, steps):
    assert pepper.goToPosture("crouch", 1.0)
    steps(4.0)
    q = pk.load_pepper().posture("Crouch")
    names = pk.load_pepper().joint_names
    np.testing.assert_allclose(pepper.getAnglesPosition(list(names)), q, atol=5e-3)
    assert not pepper.goToPosture("Sit", 1.0)
    assert PepperVirtual.P_STAND.getPostureJointNames() == list(ACTUATED)


@pytest.mark.thorough
def test_a_joint_without_effort_falls_and_only_under_gravity(manager, client, pepper, steps):
    pepper.setAngles("LShoulderPitch", -0.5, 1.0)
    steps(2.0)
    manager.setGravity(client, [0.0, 0.0, 0.0])
    joint = pepper.getJoint("LShoulderPitch")
    effort = joint.getMaxEffort()
    joint.setMaxEffort(0.0)
    pepper.setAngles("LShoulderPitch", -0.5, 1.0)
    held = pepper.getAnglesPosition("LShoulderPitch")
    steps(1.0)
    assert pepper.getAnglesPosition("LShoulderPitch") == pytest.approx(held, abs=0.02)
    manager.setGravity(client, [0.0, 0.0, -9.81])
    steps(2.0)
    assert pepper.getAnglesPosition("LShoulderPitch") > held + 0.3
    joint.setMaxEffort(effort)
    pepper.setAngles("LShoulderPitch", 0.0, 1.0)
    steps(3.0)
    assert pepper.getAnglesPosition("LShoulderPitch") == pytest.approx(0.0, abs=5e-3)


def test_gravity_of_one_robot_is_not_that_of_the_library(manager, client, pepper):
    manager.setGravity(client, [0.0, 0.0, -1.62])
    assert pk.load_pepper(base="planar", hands="mimic").inner_model.gravity.linear[2] == -9.81
    assert manager.spawnPepper(client).body.pepper.inner_model.gravity.linear[2] == -1.62


def test_links_are_where_bullet_has_them(tmp_path, manager, client):
    """Bullet loads the description that this library writes, and places the links by itself."""
    bullet = pytest.importorskip("pybullet")  # no wheels for Python 3.12 and later
    pepper = manager.spawnPepper(client, [0.7, -0.4, 0.0], [0.0, 0.0, np.sin(0.3), np.cos(0.3)])
    model = pk.load_pepper(hands="mimic")
    path = tmp_path / "pepper.urdf"
    path.write_text(model.export("urdf", mesh_paths="absolute"))
    server = bullet.connect(bullet.DIRECT)
    try:
        body = bullet.loadURDF(str(path), [0.7, -0.4, 0.0], [0.0, 0.0, np.sin(0.3), np.cos(0.3)],
                               physicsClientId=server)  # fmt: skip
        rng, checked = np.random.default_rng(0), 0
        pepper.setAngles(list(ACTUATED), [
            float(rng.uniform(0.4 * joint.getLowerLimit(), 0.4 * joint.getUpperLimit()))
            for joint in map(pepper.getJoint, ACTUATED)], 1.0)  # fmt: skip
        for _ in range(480):
            manager.stepSimulation(client)
        x, y, yaw = pepper.getPosition()  # arms that brake have turned the base a little
        bullet.resetBasePositionAndOrientation(
            body,
            [x, y, 0.0],
            [0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)],
            physicsClientId=server,
        )
        numbers = range(bullet.getNumJoints(body, physicsClientId=server))
        infos = [bullet.getJointInfo(body, k, physicsClientId=server) for k in numbers]
        for info in infos:
            if info[1].decode() in pepper.joint_dict:
                angle = pepper.getAnglesPosition(info[1].decode())
                bullet.resetJointState(body, info[0], angle, physicsClientId=server)
        for info in infos:
            name = info[12].decode()
            if name in pepper.link_dict and "hand" not in name:  # massless: driven by nothing in Bullet
                state = bullet.getLinkState(body, info[0], computeForwardKinematics=1, physicsClientId=server)
                place, quaternion = pepper.getLinkPosition(name)
                np.testing.assert_allclose(place, state[4], atol=1e-6, err_msg=name)
                assert abs(np.dot(quaternion, state[5])) == pytest.approx(1.0, abs=1e-6), name
                checked += 1
        assert checked > 60
    finally:
        bullet.disconnect(server)


def test_links_hang_on_the_links_of_the_description(pepper):
    names = {link.getIndex(): name for name, link in pepper.link_dict.items()}
    parents = {name: names[link.getParentIndex()] for name, link in pepper.link_dict.items()}
    assert parents["l_wrist"] == "LForeArm"
    assert parents["torso"] == "Hip"
    assert parents["CameraTop_optical_frame"] == "CameraTop_frame"
    assert pepper.getLink("Tibia") == pepper.link_dict["Tibia"] != pepper.link_dict["Head"]


def test_wrong_commands_are_refused_by_name_and_move_nothing(pepper, steps):
    for arguments, words in [
        (("HeadYaw", "wrong", 0.5), "joint value of HeadYaw: got 'wrong'"),
        (("HeadYaw", float("nan"), 0.5), "joint value of HeadYaw: got nan"),
        ((["HeadYaw", "HeadPitch"], 2, 0.5), "expected a number for each of"),
        ((["HeadYaw", "HeadPitch"], [0.0], 0.5), "got 1 of them for 2 joint_names"),
        ((["HeadYaw", "HeadPitch"], [0.0, 0.1], [0.5]), "percentage_speed: got 1 of them for 2"),
        (("HeadYaw", 1.0, 900), "percentage_speed: got 900"),
        (("HeadYaw", 1.0, -0.1), "percentage_speed: got -0.1"),
        (("HeadYaw", 1.0, "fast"), "percentage_speed: got 'fast'"),
    ]:
        with pytest.raises(SimulationError, match="got") as raised:
            pepper.setAngles(*arguments)
        assert words in str(raised.value)
        steps(0.2)
        assert pepper.body.time.now > 0.1
        assert not list(pepper.body.tasks)


def test_unknown_names_are_key_errors_with_a_hint(pepper):
    for call in (
        lambda: pepper.setAngles("HeadJaw", 0.0, 0.5),
        lambda: pepper.getAnglesPosition(["HeadYaw", "HeadJaw"]),
        lambda: pepper.getJoint("HeadJaw"),
    ):
        with pytest.raises(KeyError, match="did you mean 'HeadYaw'"):
            call()
    with pytest.raises(KeyError, match="'l_wrist'"):
        pepper.getLinkPosition("l_wirst")


def test_self_collisions_are_those_of_the_links_asked_for(pepper, steps):
    assert not pepper.isSelfColliding(["r_wrist", "l_wrist", "Head"])
    pepper.setAngles("RElbowRoll", 1.6, 1.0)
    steps(3.0)
    assert pepper.isSelfColliding("r_wrist")
    assert pepper.isSelfColliding(["Head", "torso"])
    assert not pepper.isSelfColliding(["Head", "l_wrist"])
    with pytest.raises(SimulationError, match="unknown link 'wrist'"):
        pepper.isSelfColliding(["Head", "wrist"])
