"""Robots of one joint: the angle is known, whatever solves for it."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.ik import FrameOrientation

ARM = """<robot name="arm"><link name="base"/><link name="hand"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="10"/></joint></robot>"""


def turned(angle):
    return pk.model.rotation_from_rpy((0.0, 0.0, angle))


@pytest.mark.parametrize("solver", ["fast", "placo", "proxsuite"])
@pytest.mark.parametrize("angle", [-0.9, 0.4])
def test_the_angle_is_found(solver, angle):
    found = pk.ik.solve(pk.load_robot(ARM), FrameOrientation("hand", turned(angle), 1.0, 1e-6), solver=solver)
    assert found.success
    np.testing.assert_allclose(found.q, [angle], atol=2e-6)


def test_angles_of_a_batch_are_found():
    angles = np.linspace(-0.9, 0.9, 7)
    targets = np.array([turned(angle) for angle in angles])
    found = pk.ik.solve_batch(pk.load_robot(ARM), FrameOrientation("hand", targets, 1.0, 1e-6))
    assert found.success.all()
    np.testing.assert_allclose(found.q[:, 0], angles, atol=2e-6)
