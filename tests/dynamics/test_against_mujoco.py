import mujoco
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.model.plain_urdf import plain_urdf


@pytest.fixture(scope="module")
def engine():
    """MuJoCo on the same URDF without shapes: an engine that shares no code with Pinocchio."""
    pepper = pk.load_pepper()
    spec = mujoco.MjSpec.from_string(plain_urdf(pepper.document))
    spec.compiler.fusestatic = True
    spec.compiler.discardvisual = False
    model = spec.compile()
    return pepper, model, mujoco.MjData(model)


def test_mass_matrix_and_bias_agree_with_mujoco(engine):
    pepper, model, data = engine
    order = [model.joint(name).dofadr[0] for name in pepper.joint_names]
    rng = np.random.default_rng(0)
    for _ in range(50):
        q = rng.uniform(pepper.lower_limits, pepper.upper_limits)
        v = rng.normal(size=pepper.n) * 2
        data.qpos[order], data.qvel[order] = q, v
        mujoco.mj_forward(model, data)
        times_a = np.zeros(model.nv)
        a = np.zeros(model.nv)
        a[order] = rng.normal(size=pepper.n)
        mujoco.mj_mulM(model, data, times_a, a)
        expected = pk.dynamics.mass_matrix(pepper, q) @ a[order]
        np.testing.assert_allclose(times_a[order], expected, atol=1e-9)
        bias = pk.dynamics.inverse_dynamics(pepper, q, v, np.zeros(pepper.n))
        np.testing.assert_allclose(data.qfrc_bias[order], bias, atol=1e-8)


def test_torques_of_the_exported_robot_agree_without_contacts():
    """As docs/coming_from/mujoco.md says: contacts between links count in mj_inverse, unless switched off."""
    pepper = pk.load_pepper()
    model = mujoco.MjModel.from_xml_string(pepper.export("mjcf"))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (50, pepper.n))
    v, a = rng.normal(size=(2, 50, pepper.n))
    differences = np.empty((2, 50))
    for k, expected in enumerate(pk.dynamics.inverse_dynamics(pepper, q, v, a)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
        for row, flags in enumerate((0, int(mujoco.mjtDisableBit.mjDSBL_CONTACT))):
            model.opt.disableflags = flags
            mujoco.mj_inverse(model, data)
            differences[row, k] = np.abs(data.qfrc_inverse - expected).max()
    assert differences[0].max() > 1.0
    assert differences[1].max() < 1e-9
