"""What programs call of pybullet beside qiBullet, and such programs."""

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pybullet as bullet
import pytest

import pepper_kin as pk
from pepper_kin.qibullet import PepperVirtual, SimulationError, SimulationManager, UnsimulatedError
from pepper_kin.qibullet import pybullet as p
from pepper_kin.qibullet.programs import run_program

BOX = """<robot name="box"><link name="box"><collision><origin xyz="0 0 0.1"/><geometry>
<box size="0.2 0.4 0.2"/></geometry></collision></link></robot>"""
PROGRAM = """\
import pybullet
from qibullet import SimulationManager, PepperVirtual
from qibullet.robot_posture import PepperPosture
import helper
manager = SimulationManager()
client = manager.launchSimulation(gui=False, auto_step=False)
pepper = manager.spawnPepper(client, spawn_ground_plane=True)
body = pybullet.loadURDF("cube_small.urdf", basePosition=[1, 0, 0.3])
"""


@pytest.fixture
def box(tmp_path):
    path = tmp_path / "box.urdf"
    path.write_text(BOX)
    return str(path)


def test_quaternions_and_constants_are_bullets():
    rng = np.random.default_rng(0)
    for _ in range(200):
        angles = rng.uniform([-3, -1.5, -3], [3, 1.5, 3])
        quaternion = p.getQuaternionFromEuler(angles)
        same = np.sign(np.dot(quaternion, bullet.getQuaternionFromEuler(angles)))
        np.testing.assert_allclose(
            same * np.array(quaternion), bullet.getQuaternionFromEuler(angles), atol=1e-12
        )
        np.testing.assert_allclose(p.getEulerFromQuaternion(quaternion), angles, atol=1e-9)
        scaled = np.multiply(quaternion, 1.7)
        np.testing.assert_allclose(
            p.getMatrixFromQuaternion(scaled), bullet.getMatrixFromQuaternion(scaled), atol=1e-12
        )
        first, second = rng.normal(size=3), rng.normal(size=3)
        for ours, theirs in zip(
            p.multiplyTransforms(first, quaternion, second, quaternion),
            bullet.multiplyTransforms(first, quaternion, second, quaternion), strict=True,
        ):  # fmt: skip
            sign = 1.0 if len(ours) == 3 else np.sign(np.dot(ours, theirs))
            np.testing.assert_allclose(np.multiply(sign, ours), theirs, atol=1e-6)
    assert {name: getattr(bullet, name) for name in p.CONSTANTS} == p.CONSTANTS
    for name in (*p.ACCEPTED, *p.DRAWN):
        assert callable(getattr(bullet, name))  # and no others
        getattr(p, name)()


def test_bodies_are_met_by_lasers_and_stand_on_the_floor(pepper, client, steps, box):
    pepper.subscribeLaser()
    steps(0.3)
    assert min(pepper.getFrontLaserValue()) == pytest.approx(3.0, abs=0.05)  # nothing
    body = p.loadURDF(box, [1.5, 0.0, 0.7], physicsClientId=client)
    place, quaternion = p.getBasePositionAndOrientation(body, client)
    assert place == pytest.approx((1.5, 0.0, 0.0))  # lowered to the floor
    assert quaternion == pytest.approx((0.0, 0.0, 0.0, 1.0))
    steps(0.3)
    near = min(pepper.getFrontLaserValue())
    p.resetBasePositionAndOrientation(body, [1.0, 0.0, 0.0], [0, 0, 0, 1], client)
    steps(0.3)
    assert near - min(pepper.getFrontLaserValue()) == pytest.approx(0.5, abs=1e-6)
    p.removeBody(body, client)
    large = p.loadURDF(box, [1.5, 0.0, 0.0], useFixedBase=1, globalScaling=3.0, physicsClientId=client)
    steps(0.3)
    assert near - min(pepper.getFrontLaserValue()) == pytest.approx(
        0.2, abs=1e-6
    )  # 0.6 m deep in place of 0.2
    p.removeBody(large, client)
    steps(0.3)
    assert min(pepper.getFrontLaserValue()) == pytest.approx(3.0, abs=0.05)
    with pytest.raises(SimulationError, match="no body"):
        p.removeBody(large, client)


@pytest.mark.parametrize(
    ("kind", "sizes", "lowest"),
    [
        ("GEOM_SPHERE", {"radius": 0.2}, 0.2),
        (
            "GEOM_BOX",
            {"halfExtents": [0.1, 0.2, 0.3]},
            0.1 * math.sin(math.pi / 6) + 0.3 * math.cos(math.pi / 6),
        ),
        (
            "GEOM_CYLINDER",
            {"radius": 0.1, "height": 0.4},
            0.2 * math.cos(math.pi / 6) + 0.1 * math.sin(math.pi / 6),
        ),
        ("GEOM_CAPSULE", {"radius": 0.1, "height": 0.4}, 0.2 * math.cos(math.pi / 6) + 0.1),
    ],
)
def test_shapes_that_are_not_fixed_touch_the_floor(client, kind, sizes, lowest):
    shape = p.createCollisionShape(getattr(p, kind), **sizes)
    tilted = p.getQuaternionFromEuler([0.0, math.pi / 6, 0.0])
    body = p.createMultiBody(1.0, shape, -1, [2.0, 1.0, 3.0], tilted, physicsClientId=client)
    assert p.getBasePositionAndOrientation(body, client)[0] == pytest.approx((2.0, 1.0, lowest))
    fixed = p.createMultiBody(0.0, shape, -1, [2.0, -1.0, 3.0], tilted, physicsClientId=client)
    assert p.getBasePositionAndOrientation(fixed, client)[0] == pytest.approx((2.0, -1.0, 3.0))


def test_joints_are_those_that_bullet_reads(pepper, client, tmp_path):
    path = tmp_path / "pepper.urdf"
    text = pk.load_pepper(base="fixed", hands="mimic").urdf
    path.write_text(re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.DOTALL))  # without meshes
    server = bullet.connect(bullet.DIRECT)
    body = bullet.loadURDF(str(path), physicsClientId=server)
    infos = [bullet.getJointInfo(body, k, server) for k in range(bullet.getNumJoints(body, server))]
    model = pepper.getRobotModel()
    ours = {
        info[1]: info
        for info in (p.getJointInfo(model, k, client) for k in range(p.getNumJoints(model, client)))
    }
    names = {info[1]: info for info in infos}
    assert set(pepper.joint_dict) <= {name.decode() for name in ours}
    for name in (name for name in ours if name.decode() in pepper.joint_dict):
        mine, theirs = ours[name], names[name]
        assert (mine[2], mine[12]) == (theirs[2], theirs[12])
        np.testing.assert_allclose(mine[8:12], theirs[8:12], rtol=1e-6)
    bullet.disconnect(server)


def test_joints_go_to_positions_and_links_are_where_they_are(pepper, client, steps):
    model = pepper.getRobotModel()
    number = pepper.joint_dict["HeadYaw"].getIndex()
    p.setJointMotorControl2(model, number, p.POSITION_CONTROL, targetPosition=0.4, physicsClientId=client)
    steps(2.0)
    assert p.getJointState(model, number, client)[0] == pytest.approx(0.4, abs=0.01)
    link = pepper.link_dict["l_wrist"].getIndex()
    assert p.getLinkState(model, link, physicsClientId=client)[0] == tuple(
        pepper.getLinkPosition("l_wrist")[0]
    )
    with pytest.raises(UnsimulatedError):
        p.setJointMotorControl2(model, number, p.VELOCITY_CONTROL, targetVelocity=1.0, physicsClientId=client)
    with pytest.raises(SimulationError, match="joint: got 999"):
        p.getJointInfo(model, 999, client)
    with pytest.raises(UnsimulatedError, match=r"pybullet\.rayTest "):
        p.rayTest([0, 0, 0], [1, 0, 0])
    with pytest.raises(AttributeError):
        p.NO_SUCH_CONSTANT  # noqa: B018


@pytest.mark.thorough
def test_inverse_kinematics_brings_the_link_there(pepper, client, steps):
    model, link = pepper.getRobotModel(), pepper.link_dict["r_gripper"].getIndex()
    target = [0.3, -0.2, 0.9]
    found = p.calculateInverseKinematics(model, link, target, physicsClientId=client)
    names = [name for name in pepper.joint_dict if name in pepper.body.index]
    assert len(found) == len(names)
    pepper.setAngles(names, list(found), 1.0)
    steps(4.0)
    assert pepper.getLinkPosition("r_gripper")[0] == pytest.approx(target, abs=0.02)


def test_contacts_name_the_body_and_the_link(pepper, client):
    model, link = pepper.getRobotModel(), pepper.link_dict["Head"].getIndex()
    place = pepper.getLinkPosition("Head")[0]
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.05)
    body = p.createMultiBody(0.0, shape, -1, place, physicsClientId=client)
    found = p.getContactPoints(body, model, physicsClientId=client)
    assert (body, model, -1, link) in [contact[1:5] for contact in found]
    assert all(contact[8] <= 0.0 for contact in found)
    assert p.getContactPoints(model, body, linkIndexA=link, physicsClientId=client)[0][1:5] == (
        model,
        body,
        link,
        -1,
    )


def test_the_page_lists_what_there_is():
    page = (Path(__file__).parents[2] / "docs" / "qibullet.md").read_text(encoding="utf-8")
    own = [name for name, value in vars(p).items() if getattr(value, "__module__", "") == p.__name__]
    functions = [name for name in own if not name.startswith("_") and name != "Place"]
    lists = {"Simulated or computed": functions, "Accepted without effect": p.ACCEPTED}
    for title, names in {**lists, "Answered with a number, without effect": p.DRAWN}.items():
        listed = page.split(f"{title}: ")[1].split(".\n")[0]
        assert re.findall(r"`(\w+)`", listed) == sorted(names)


def test_sliders_stay_where_they_began():
    slider = p.addUserDebugParameter("x", -1.0, 1.0, 0.3)
    assert p.readUserDebugParameter(slider) == 0.3
    with pytest.raises(SimulationError):
        p.readUserDebugParameter(-5)


@pytest.mark.thorough
def test_cameras_without_handles_are_the_last_ones(pepper):
    with pytest.raises(SimulationError):
        pepper.getCameraFrame()
    pepper.subscribeCamera(PepperVirtual.ID_CAMERA_TOP)
    assert pepper.getCameraFrame().shape == (240, 320, 3)
    assert pepper.unsubscribeCamera(PepperVirtual.ID_CAMERA_TOP)
    with pytest.raises(SimulationError):
        pepper.getCameraFrame()


@pytest.mark.thorough
def test_programs_run_as_they_are(tmp_path, capsys):
    (tmp_path / "helper.py").write_text("print 'old helper'\n")
    program = tmp_path / "program.py"
    program.write_text(PROGRAM + "print(round(pybullet.getBasePositionAndOrientation(body)[0][2], 6))\n")
    before, own = sys.modules["pybullet"], SimulationManager().launchSimulation(gui=False)
    result = run_program(program)
    assert (result.ended, result.error) == ("completed", None)
    assert capsys.readouterr().out.splitlines() == ["old helper", "0.025"]
    assert sys.modules["pybullet"] is before
    assert "qibullet" not in sys.modules
    assert pk.qibullet.simulation.all_running() == (own,)  # that of the program has ended
    SimulationManager().stopSimulation(own)
    program.write_text(PROGRAM + "while True:\n    manager.stepSimulation(client)\n")
    result = run_program(program, longest=1.0)
    assert (result.ended, result.success) == ("time is up", True)
    program.write_text(PROGRAM + "manager.spawnNao(client)\n")
    result = run_program(program)
    assert (result.ended, result.code) == ("failed", 1)
    assert isinstance(result.error, UnsimulatedError)


@pytest.mark.thorough
def test_the_command_runs_a_program(tmp_path):
    (tmp_path / "helper.py").write_text("")
    program = tmp_path / "program.py"
    program.write_text(PROGRAM + "import sys\nprint(sys.argv[1:], body)\n")
    main = "import sys; from pepper_kin.cli import main; sys.argv[0] = 'pepper-kin'; main()"
    process = subprocess.run(
        [sys.executable, "-c", main, "qibullet", "run", str(program), "a", "--b"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    assert process.stdout.splitlines()[-1] == "['a', '--b'] 2"
