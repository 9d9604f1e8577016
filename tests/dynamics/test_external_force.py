import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin import symbolic
from pepper_kin.exceptions import InvalidValueError, UnknownNameError


def states(pepper, count, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.uniform(
        np.clip(pepper.lower_limits, -2, 2), np.clip(pepper.upper_limits, -2, 2), (count, pepper.n)
    )
    return q, *rng.normal(size=(2, count, pepper.n)), rng.normal(size=(count, 6)) * 10


@pytest.mark.parametrize(("base", "hands"), [("fixed", "locked"), ("planar", "mimic")])
def test_power_of_the_force_is_the_power_at_the_joints(base, hands):
    """Virtual work: f . (velocity of the frame) = tau . v, the velocity by finite differences of the pose."""
    pepper = pk.load_pepper(base, hands)
    q, v, _, force = states(pepper, 5)
    torque = pk.dynamics.external_torque(pepper, q, {"LArm_effector": force})
    h = 1e-6
    ahead, behind = (pk.kinematics.frame_pose(pepper, q + s * h * v, "LArm_effector") for s in (1, -1))
    linear = (ahead[:, :3, 3] - behind[:, :3, 3]) / (2 * h)
    spin = (ahead[:, :3, :3] - behind[:, :3, :3]) / (2 * h) @ np.swapaxes(ahead[:, :3, :3], 1, 2)
    angular = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    power = np.sum(force[:, :3] * linear, axis=1) + np.sum(force[:, 3:] * angular, axis=1)
    np.testing.assert_allclose(np.sum(torque * v, axis=1), power, atol=2e-4)


def test_against_pinocchio_with_forces_on_joints():
    pepper = pk.load_pepper()
    model, data = pepper.pinocchio_model, pepper.pinocchio_model.createData()
    q, v, a, force = states(pepper, 4, seed=1)
    frame = model.frames[pepper.frame_id("RArm_effector")]
    for k in range(4):
        pinocchio.framesForwardKinematics(model, data, q[k])
        here = pinocchio.SE3(np.eye(3), data.oMf[pepper.frame_id("RArm_effector")].translation)
        on_joints = [pinocchio.Force.Zero() for _ in range(model.njoints)]
        world = here.act(pinocchio.Force(force[k]))
        on_joints[frame.parentJoint] = data.oMi[frame.parentJoint].actInv(world)
        expected = pinocchio.rnea(model, data, q[k], v[k], a[k], on_joints)
        found = pk.dynamics.inverse_dynamics(pepper, q[k], v[k], a[k], {"RArm_effector": force[k]})
        np.testing.assert_allclose(found, expected, atol=1e-10)


def test_forward_inverts_inverse_with_forces_in_batch_and_symbols():
    pepper = pk.load_pepper()
    q, v, a, force = states(pepper, 40, seed=2)
    forces = {"LArm_effector": force, "Head": -force}
    tau = pk.dynamics.inverse_dynamics(pepper, q, v, a, forces)
    np.testing.assert_allclose(pk.dynamics.forward_dynamics(pepper, q, v, tau, forces), a, atol=1e-8)
    one = symbolic.inverse_dynamics(pepper, contact_frame="LArm_effector")
    expected = np.array(one(q[0], v[0], a[0], force[0])).ravel()
    found = pk.dynamics.inverse_dynamics(pepper, q[0], v[0], a[0], {"LArm_effector": force[0]})
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_one_force_for_all_states():
    pepper = pk.load_pepper()
    q, v, a, force = states(pepper, 30, seed=3)
    same = pk.dynamics.inverse_dynamics(pepper, q, v, a, {"Head": force[0]})
    each = pk.dynamics.inverse_dynamics(pepper, q, v, a, {"Head": np.tile(force[0], (30, 1))})
    np.testing.assert_array_equal(same, each)


def test_bad_forces_are_named():
    for forces, error, message in [
        ({"Tail": np.zeros(6)}, UnknownNameError, "unknown frame 'Tail'"),
        (
            {"Head": np.zeros(3)},
            InvalidValueError,
            r"force at Head: got shape \(3,\), expected shape \(6,\)",
        ),
        ({"Head": [0, 0, np.nan, 0, 0, 0]}, InvalidValueError, "force at Head"),
        ({"Head": np.zeros((7, 6))}, InvalidValueError, r"force at Head: got shape \(7, 6\)"),
    ]:
        pepper = pk.load_pepper()
        q, v, a, _ = states(pepper, 2)
        with pytest.raises(error, match=message):
            pk.dynamics.inverse_dynamics(pepper, q, v, a, forces)


def test_friction_is_read_from_the_description():
    joint = """<joint name="j" type="revolute"><parent link="w"/><child link="l"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="9" velocity="1"/>{}</joint>"""
    text = """<robot name="a"><link name="w"/><link name="l"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>{}</robot>"""
    robot = pk.load_robot(text.format(joint.format('<dynamics damping="0.5" friction="0.2"/>')))
    np.testing.assert_allclose(
        pk.dynamics.joint_friction(robot, [[2.0], [-2.0], [0.0]]), [[1.2], [-1.2], [0.0]]
    )
    assert pk.dynamics.joint_friction(pk.load_pepper(), np.ones(15)).sum() == 0
