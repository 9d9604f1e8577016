"""What other tests ask of kernels alone, against Pinocchio: `batch/test_batch_agreement.py` has the rest."""

import numpy as np
import pinocchio as pin
import pytest

import pepper_kin as pk
from pepper_kin import symbolic
from pepper_kin.exceptions import ModelError


def frame_of(pepper):
    return "LArm_effector" if "LArm_effector" in pepper.frame_names else pepper.frame_names[-1]


def close(found, expected, what, tolerance=1e-9):
    expected = np.asarray(expected)
    found = np.asarray(found).reshape(expected.shape)
    size = max(np.abs(expected).max(), 1e-6)
    assert np.abs(found - expected).max() <= tolerance * size, what


def test_all_link_poses(robot, states):
    """Small differences come from constant angles, which are snapped to quarter turns within 1e-11."""
    poses = symbolic.frame_poses(robot, robot.frame_names)
    for name, (q, _, _) in states(robot).items():
        expected = pk.kinematics.frame_poses(robot, q, robot.frame_names)
        close(poses(q), expected, name)


@pytest.mark.parametrize("frame_place", [-1, 0])
def test_outer_forces(robot, states, frame_place):
    """A wrench at a frame takes J^T w off the torques; at a frame fixed to the floor it changes nothing."""
    frame = frame_of(robot) if frame_place else robot.frame_names[0]
    wrench = np.array([3.0, -5.0, 7.0, 0.4, 0.5, -0.6])
    for name, (q, v, a) in states(robot).items():
        share = pk.kinematics.frame_jacobian(robot, q, frame).T @ wrench
        tau = pk.dynamics.inverse_dynamics(robot, q, v, a) - share
        close(symbolic.inverse_dynamics(robot, contact_frame=frame)(q, v, a, wrench), tau, name)
    q, v, a = states(robot)["random again"]
    tau = np.array(symbolic.inverse_dynamics(robot, frame)(q, v, a, wrench)).ravel()
    back = symbolic.forward_dynamics(robot, frame)(q, v, tau, wrench)
    np.testing.assert_allclose(np.array(back).ravel(), a, rtol=1e-6, atol=1e-6)


@pytest.mark.thorough
def test_forward_dynamics_derivatives(small_robot, states):
    robot = small_robot
    model, full = robot.pinocchio_model, robot.full_map
    data = model.createData()
    for name, (q, v, tau) in states(robot).items():
        found = symbolic.forward_dynamics_derivatives(robot)(q, v, tau)
        a = np.array(symbolic.forward_dynamics(robot)(q, v, tau)).ravel()
        by_q, by_v, mass = pin.computeRNEADerivatives(
            model, data, robot.to_full(q), robot.rate_to_full(v), robot.rate_to_full(a)
        )
        mass = full.T @ mass @ full
        torques = (full.T @ by_q @ full, full.T @ by_v @ full, -np.eye(robot.n))
        # Light fingers make M stiff: accelerations are judged by the torques that they explain.
        for by, expected in zip(map(np.array, found), torques, strict=True):
            scale = np.abs(expected).max() + np.abs(mass).max() * np.abs(by).max()
            assert np.abs(mass @ by + expected).max() <= 1e-9 * scale, name


def test_a_joint_that_moves_no_mass_is_named(load_example):
    """Romeo's hands have no mass of their own: torques exist, accelerations do not."""
    romeo = load_example("romeo_description/urdf/romeo.urdf")
    q = np.zeros(romeo.n)
    close(symbolic.inverse_dynamics(romeo)(q, q, q), pk.dynamics.inverse_dynamics(romeo, q, q, q), "zero")
    for build in (symbolic.forward_dynamics, symbolic.inverse_mass_matrix):
        with pytest.raises(ModelError, match="no inverse: no mass is moved by LHand, RHand"):
            build(romeo)
