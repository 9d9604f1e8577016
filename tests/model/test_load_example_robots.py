"""Robots of the package example-robot-data: ours must be what Pinocchio itself reads from the same file."""

import importlib.metadata

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import UnknownNameError

URDFS = {
    "romeo": "romeo_description/urdf/romeo_small.urdf",
    "talos": "talos_data/robots/talos_reduced.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
}


def urdf_path(name):
    package = importlib.metadata.distribution("example-robot-data")
    found = [file for file in package.files or () if str(file).endswith(f"robots/{URDFS[name]}")]
    return package.locate_file(found[0])


@pytest.fixture(scope="module", params=("panda", "romeo", "talos"))
def pair(request):
    path = urdf_path(request.param)
    return pk.load_robot(path), pinocchio.buildModelFromUrdf(str(path)), request.param


def random_state(robot, seed):
    rng = np.random.default_rng(seed)
    lower, upper = np.maximum(robot.lower_limits, -3), np.minimum(robot.upper_limits, 3)
    q = rng.uniform(lower, upper)
    return q, rng.normal(size=robot.n), rng.normal(size=robot.n)


def own_configuration(robot, model, q):
    """q as Pinocchio's own loading wants it: continuous joints as cosine and sine, followers included."""
    full = robot.to_full(q)
    names = list(robot.pinocchio_model.names)[1:]
    configuration = pinocchio.neutral(model)
    for name, value in zip(names, full, strict=True):
        joint = model.joints[model.getJointId(name)]
        entry = [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = entry
    return configuration


def test_joints_and_mass(pair):
    robot, model, name = pair
    followers = [j for j in robot.document.joints if j.mimic is not None and j.type != "fixed"]
    assert robot.n + len(followers) == model.nv
    assert {"romeo": robot.n >= 31, "talos": robot.n == 32, "panda": robot.n == 8}[name]
    assert pk.dynamics.total_mass(robot) == pytest.approx(
        sum(inertia.mass for inertia in model.inertias), rel=1e-12
    )


def test_frames_agree_with_pinocchios_own_loading(pair):
    robot, model, _ = pair
    data = model.createData()
    for seed in range(5):
        q, _, _ = random_state(robot, seed)
        pinocchio.framesForwardKinematics(model, data, own_configuration(robot, model, q))
        for name in robot.frame_names:
            expected = data.oMf[model.getFrameId(name, pinocchio.FrameType.BODY)].homogeneous
            np.testing.assert_allclose(pk.kinematics.frame_pose(robot, q, name), expected, atol=1e-12)


def test_newton_euler_agrees(pair):
    robot, _, _ = pair
    for seed in range(3):
        q, v, a = random_state(robot, seed)
        tau = pk.dynamics.inverse_dynamics(robot, q, v, a)
        np.testing.assert_allclose(pk.dynamics.newton_euler(robot, q, v, a), tau, rtol=1e-9, atol=1e-9)


@pytest.mark.thorough
def test_audit_and_exports_take_any_robot(pair):
    robot, _, _ = pair
    audit = pk.model.audit(robot)
    assert audit.total_mass > 10
    assert audit.reachable == audit.frames
    assert pk.model.compare(robot, robot).equal
    for kind in pk.model.FORMATS:
        options = {} if kind in ("urdf", "srdf") else {"balance_inertias": True}  # Romeo has impossible ones
        assert robot.name in robot.export(kind, **options)


def test_a_robot_without_postures_begins_at_neutral_which_its_error_names():
    """The SRDF of the UR5 has none; stretched out, it touches nothing."""
    urdf = urdf_path("ur5")
    robot = pk.load_robot(urdf, urdf.parents[1] / "srdf" / "ur5.srdf")
    with pytest.raises(UnknownNameError, match=r"joint_vector\({'shoulder_pan_joint': 0.0.*neutral\(\)"):
        robot.posture("default")
    assert not pk.collision.in_collision(robot, robot.neutral())
