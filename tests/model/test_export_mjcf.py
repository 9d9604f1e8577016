"""MJCF in MuJoCo: the same frames and masses, limits, couplings, sensors, and a robot that stands still."""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError

VARIANTS = [(base, hands) for base in ("fixed", "planar") for hands in ("locked", "mimic", "independent")]


class Engine:
    """A robot and its MJCF in MuJoCo."""

    def __init__(self, pepper, **options):
        self.pepper = pepper
        self.text = pepper.export("mjcf", **options)
        self.model = mujoco.MjModel.from_xml_string(self.text)
        self.data = mujoco.MjData(self.model)
        names = list(pepper.pinocchio_model.names)[1:]
        self.order = [self.model.joint(name).qposadr[0] for name in names]

    def set(self, q):
        self.data.qpos[self.order] = self.pepper.to_full(q)
        mujoco.mj_forward(self.model, self.data)

    def frame_pose(self, name):
        kind = mujoco.mjtObj.mjOBJ_BODY
        if mujoco.mj_name2id(self.model, kind, name) >= 0:
            item = self.data.body(name)
        else:
            item = self.data.site(name)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = item.xmat.reshape(3, 3), item.xpos
        return pose

    def mass_matrix(self):
        """E' M E with M of MuJoCo's own coordinates."""
        full = np.zeros((self.model.nv, self.model.nv))
        for i, unit in enumerate(np.eye(self.model.nv)):
            column = np.zeros(self.model.nv)
            mujoco.mj_mulM(self.model, self.data, column, unit)
            full[:, i] = column
        full = full[np.ix_(self.order, self.order)]
        return self.pepper.full_map.T @ full @ self.pepper.full_map


@pytest.fixture(scope="module", params=VARIANTS, ids="-".join)
def engine(request):
    base, hands = request.param
    return Engine(pk.load_pepper(base=base, hands=hands))


def random_q(pepper, rng):
    return rng.uniform(np.maximum(pepper.lower_limits, -3), np.minimum(pepper.upper_limits, 3))


def test_frames_and_mass_matrix_are_ours(engine):
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = random_q(engine.pepper, rng)
        engine.set(q)
        for name in engine.pepper.frame_names:
            expected = pk.kinematics.frame_pose(engine.pepper, q, name)
            np.testing.assert_allclose(engine.frame_pose(name), expected, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(engine.mass_matrix(), pk.dynamics.mass_matrix(engine.pepper, q), atol=1e-6)
    total = float(engine.model.body_subtreemass[0])
    assert total == pytest.approx(pk.dynamics.total_mass(engine.pepper), abs=1e-6)


def test_limits_of_joints_and_actuators(engine):
    pepper, model = engine.pepper, engine.model
    assert model.nu == 2 * pepper.n
    for i, name in enumerate(pepper.joint_names):
        joint = model.joint(name)
        if np.isfinite(pepper.upper_limits[i]):
            assert tuple(joint.range) == (pepper.lower_limits[i], pepper.upper_limits[i])
            assert joint.limited[0]
        else:
            assert not joint.limited[0]
        effort = pepper.effort_limits[i]
        assert tuple(model.jnt_actfrcrange[joint.id]) == (-effort, effort)
        for place, kind in ((i, "position"), (pepper.n + i, "velocity")):
            actuator = model.actuator(f"{name}_{kind}")
            assert (actuator.id, actuator.trnid[0]) == (place, joint.id)


def test_stands_still_for_ten_seconds(engine):
    model, data, pepper = engine.model, engine.data, engine.pepper
    mujoco.mj_resetDataKeyframe(model, data, model.key("Stand").id)
    start = data.qpos.copy()
    np.testing.assert_allclose(start[engine.order], pepper.to_full(pepper.posture("Stand")), atol=1e-12)
    farthest = 0.0
    while data.time < 10.0:
        mujoco.mj_step(model, data)
        farthest = max(farthest, float(np.abs(data.qpos - start).max()))
    assert farthest < 1e-4, "it does not sag"
    assert np.abs(data.qvel).max() < 1e-3
    assert data.ncon == 0
    assert all(warning.number == 0 for warning in data.warning)


def test_without_actuators_it_falls(engine):
    """The stillness is the actuators' work, gravity compensation included."""
    model, data = engine.model, engine.data
    mujoco.mj_resetDataKeyframe(model, data, model.key("Stand").id)
    start = data.qpos.copy()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    for _ in range(1000):
        mujoco.mj_step(model, data)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    assert np.abs(data.qpos - start).max() > 0.1


def test_fingers_follow_their_hand():
    engine = Engine(pk.load_pepper(hands="mimic"))
    model, data = engine.model, engine.data
    assert model.neq == 28
    mujoco.mj_resetDataKeyframe(model, data, model.key("Stand").id)
    data.ctrl[model.actuator("LHand_position").id] = 0.1
    for _ in range(1000):
        mujoco.mj_step(model, data)
    opening = data.joint("LHand").qpos[0]
    assert opening == pytest.approx(0.1, abs=1e-4)
    for finger in ("LFinger11", "LFinger23", "LThumb2"):
        assert data.joint(finger).qpos[0] == pytest.approx(0.872665 * opening, abs=1e-3)
    assert data.joint("RHand").qpos[0] == pytest.approx(0.5888, abs=1e-3)


def test_sensors_measure():
    engine = Engine(pk.load_pepper())
    q = engine.pepper.posture("Stand")
    engine.set(q)
    i = engine.pepper.joint_index("LElbowRoll")
    assert engine.data.sensor("LElbowRoll_position").data[0] == pytest.approx(q[i])
    engine.data.qvel[:] = 0
    engine.data.qvel[engine.order[engine.pepper.joint_index("HipRoll")]] = 0.5
    mujoco.mj_forward(engine.model, engine.data)
    turn = pk.kinematics.frame_pose(engine.pepper, q, "ImuTorsoGyrometer_frame")[:3, :3]
    jacobian = pk.kinematics.frame_jacobian(engine.pepper, q, "ImuTorsoGyrometer_frame")
    expected = turn.T @ (jacobian[3:, engine.pepper.joint_index("HipRoll")] * 0.5)
    np.testing.assert_allclose(engine.data.sensor("ImuTorsoGyrometer").data, expected, atol=1e-9)
    assert engine.data.sensor("ImuTorsoAccelerometer").data.shape == (3,)


def test_the_accelerometer_of_a_base_on_the_floor_feels_gravity():
    """A base that drives: MuJoCo 3 reads nothing on bodies that cannot move."""
    engine = Engine(pk.load_pepper(base="planar"))
    engine.set(engine.pepper.posture("Stand"))
    mujoco.mj_forward(engine.model, engine.data)
    assert engine.data.sensor("ImuBaseAccelerometer").data[2] == pytest.approx(9.81, abs=1e-9)


def test_the_base_goes_where_it_is_sent():
    engine = Engine(pk.load_pepper(base="planar"))
    model, data = engine.model, engine.data
    mujoco.mj_resetDataKeyframe(model, data, model.key("Stand").id)
    data.ctrl[model.actuator("BaseX_velocity").id] = 0.2
    while data.time < 3.0:
        data.ctrl[model.actuator("BaseX_position").id] = 0.2 * data.time
        mujoco.mj_step(model, data)
    assert data.joint("BaseX").qvel[0] == pytest.approx(0.2, abs=1e-3)
    assert data.joint("BaseX").qpos[0] == pytest.approx(0.6, abs=1e-3)


def greatest_distance(pepper, motion, timestep=0.001):
    """Play a motion in MuJoCo and on the twin [rad or m], the documented way."""
    engine, run = Engine(pepper), pk.Twin(pepper, timestep).execute(motion)
    model, data = engine.model, engine.data
    model.opt.timestep = timestep
    places = [model.joint(name).qposadr[0] for name in pepper.joint_names]
    engine.set(motion.start)
    worst = 0.0
    for k in range(1, len(run.time)):
        state = motion(min(data.time, motion.duration))
        data.ctrl[:] = np.concatenate([state.position, state.velocity])
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.abs(data.qpos[places] - run.position[k]).max()))
    return worst


@pytest.mark.thorough
@pytest.mark.parametrize(("base", "hands"), [("planar", "mimic"), ("fixed", "independent")])
def test_a_gesture_is_the_twins(base, hands):
    """Angles within 1 mrad of those of the twin, fingers included, which neither lags nor sags behind."""
    pepper = pk.load_pepper(base=base, hands=hands)
    assert greatest_distance(pepper, pk.motion.gesture(pepper, "wave")) < 1e-3


def test_a_motor_without_the_torque_lets_the_arm_sink_as_on_the_twin():
    """The sum of servo and gravity's torque is limited; MuJoCo's step damps a saturated servo by h Kd."""
    pepper = pk.load_pepper().with_limits(effort={"RShoulderPitch": 0.5})
    raised = pepper.joint_vector({"RShoulderPitch": 0.2})
    motion = pk.Trajectory.from_positions(pepper, [0.0, 0.3], [raised, raised])
    sunk = np.abs(pk.Twin(pepper).execute(motion).position[-1] - raised).max()
    assert sunk > 0.2
    assert greatest_distance(pepper, motion, 1e-4) < 0.03 * sunk


def test_disabled_pairs_are_excluded_and_others_touch():
    engine = Engine(pk.load_pepper())
    model, data, pepper = engine.model, engine.data, engine.pepper
    arm = {"RShoulderPitch": 0.89, "RShoulderRoll": -0.46, "RElbowYaw": 0.76, "RElbowRoll": 1.32}
    q = pepper.joint_vector({**arm, "RWristYaw": 0.28})
    ours = {tuple(sorted(pair)) for pair in pk.collision.checker_for(pepper).contacts(q)}
    assert ours == {("r_wrist", "torso")}, "the right hand is in the chest"
    engine.set(q)
    theirs = {
        tuple(sorted(model.body(model.geom_bodyid[g]).name for g in contact.geom)) for contact in data.contact
    }
    assert ours == theirs
    visuals = [g for g in range(model.ngeom) if model.geom_group[g] == 2]
    assert len(visuals) > 60
    assert all(model.geom_contype[g] == 0 and model.geom_conaffinity[g] == 0 for g in visuals)
    assert {model.geom_type[g] for g in visuals} == {int(mujoco.mjtGeom.mjGEOM_MESH)}
    capsule = model.geom("LBicep_collision_0")
    assert capsule.type[0] == int(mujoco.mjtGeom.mjGEOM_CAPSULE)
    assert all(model.geom(f"Wheel{w}_link_collision_0").contype[0] == 0 for w in ("FL", "FR", "B"))


def test_relative_meshes_load_beside_the_file(tmp_path):
    pepper = pk.load_pepper()
    files = pk.model.mesh_files(pepper.document)
    (tmp_path / "meshes").mkdir()
    for name, path in files.items():
        (tmp_path / name).write_bytes(path.read_bytes())
    target = tmp_path / "pepper.xml"
    target.write_text(pepper.export("mjcf", mesh_paths="relative"), encoding="utf-8")
    assert mujoco.MjModel.from_xml_path(str(target)).nmesh == len(files)
    names = [mesh.get("file") for mesh in ET.parse(target).getroot().iterfind("asset/mesh")]
    assert all(name.startswith("meshes/") for name in names)


def test_packages_are_refused():
    with pytest.raises(
        InvalidValueError, match="mesh_paths: got 'package', expected 'absolute' or 'relative'"
    ):
        pk.load_pepper().export("mjcf", mesh_paths="package")
    with pytest.raises(
        InvalidValueError, match="format: got 'step', expected one of 'urdf', 'srdf', 'sdf', 'mjcf'"
    ):
        pk.load_pepper().export("step")
