"""Each quantity against Pinocchio, on many robots and states."""

import numpy as np
import pinocchio as pin
import pytest

import pepper_kin as pk
from pepper_kin import symbolic
from pepper_kin.exceptions import ModelError

WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Reference:
    """Pinocchio at one state; mimic joints by q_full = E q + e."""

    def __init__(self, pepper, q, v, a):
        self.pepper, self.map = pepper, pepper.full_map
        self.model, self.data = pepper.pinocchio_model, pepper.pinocchio_model.createData()
        self.q, self.v, self.a = pepper.to_full(q), pepper.rate_to_full(v), pepper.rate_to_full(a)
        self.state = (q, v, a)
        pin.forwardKinematics(self.model, self.data, self.q, self.v, self.a)
        pin.updateFramePlacements(self.model, self.data)

    def both(self, matrix):
        return self.map.T @ matrix @ self.map

    def mass(self):
        upper = np.triu(pin.crba(self.model, self.model.createData(), self.q))
        return self.both(upper + np.triu(upper, 1).T)

    def derivatives(self, a):
        pin.computeRNEADerivatives(self.model, self.data, self.q, self.v, a)
        return self.both(self.data.dtau_dq), self.both(self.data.dtau_dv)

    def centroidal(self):
        """Momentum about the center of all links, from Pinocchio's about that of the moving ones."""
        pin.ccrba(self.model, self.data, self.q, self.v)
        offset = np.array(self.data.com[0]) - pk.dynamics.center_of_mass(self.pepper, self.state[0])
        result = np.array(self.data.Ag)
        result[3:] += np.cross(offset, result[:3], axisb=0, axisc=0)
        return result @ self.map

    def floor(self):
        rate = pin.computeCentroidalMomentumTimeVariation(self.model, self.data, self.q, self.v, self.a)
        center = pk.dynamics.center_of_mass(self.pepper, self.state[0])
        weight = pk.dynamics.total_mass(self.pepper) * self.model.gravity.linear
        moment = rate.angular + np.cross(self.data.com[0], rate.linear) - np.cross(center, weight)
        return np.concatenate([rate.linear - weight, moment])


def frame_of(pepper):
    return "LArm_effector" if "LArm_effector" in pepper.frame_names else pepper.frame_names[-1]


def close(found, expected, what, tolerance=1e-9):
    expected = np.asarray(expected)
    found = np.asarray(found).reshape(expected.shape)
    size = max(np.abs(expected).max(), 1e-6)
    assert np.abs(found - expected).max() <= tolerance * size, what


def test_frames(robot, states):
    frame = frame_of(robot)
    for name, (q, v, a) in states(robot).items():
        ref = Reference(robot, q, v, a)
        at = robot.frame_id(frame)
        close(symbolic.frame_pose(robot, frame)(q), ref.data.oMf[at].homogeneous, name)
        velocity = pin.getFrameVelocity(ref.model, ref.data, at, WORLD).vector
        close(symbolic.frame_velocity(robot, frame)(q, v), velocity, name)
        acceleration = pin.getFrameClassicalAcceleration(ref.model, ref.data, at, WORLD).vector
        close(symbolic.frame_acceleration(robot, frame)(q, v, a), acceleration, name)
        jacobian = pk.kinematics.frame_jacobian(robot, q, frame)
        close(symbolic.frame_jacobian(robot, frame)(q), jacobian, name)
        rate = np.array(symbolic.frame_jacobian_rate(robot, frame)(q, v))
        close(jacobian @ a + rate @ v, acceleration, name)


def test_all_link_poses(robot, states):
    """Small differences come from constant angles, which are snapped to quarter turns within 1e-11."""
    poses = symbolic.frame_poses(robot, robot.frame_names)
    for name, (q, _, _) in states(robot).items():
        expected = pk.kinematics.frame_poses(robot, q, robot.frame_names)
        close(poses(q), expected, name)


def test_dynamics(robot, states):
    for name, (q, v, a) in states(robot).items():
        tau = pk.dynamics.inverse_dynamics(robot, q, v, a)
        close(symbolic.inverse_dynamics(robot)(q, v, a), tau, name)
        close(symbolic.gravity_torque(robot)(q), pk.dynamics.gravity_torque(robot, q), name)
        mass = Reference(robot, q, v, a).mass()
        close(symbolic.mass_matrix(robot)(q), mass, name)
        back = np.array(symbolic.forward_dynamics(robot)(q, v, tau)).ravel()
        # Tiny finger inertias make M stiff: accelerations are judged by the torques that they explain.
        scale = np.abs(tau).max() + np.abs(mass).max() * np.abs(a).max() + 1e-6
        assert np.abs(mass @ (back - a)).max() < 1e-9 * scale, name
        inverse = np.array(symbolic.inverse_mass_matrix(robot)(q))
        assert np.abs(mass @ inverse - np.eye(robot.n)).max() < 1e-9 * np.linalg.cond(mass) ** 0.5, name
        np.testing.assert_array_equal(inverse, inverse.T)


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


def test_inverse_dynamics_derivatives(robot, states):
    for name, (q, v, a) in states(robot).items():
        ref = Reference(robot, q, v, a)
        by_q, by_v = ref.derivatives(ref.a)
        found = symbolic.inverse_dynamics_derivatives(robot)(q, v, a)
        close(found[0], by_q, name)
        close(found[1], by_v, name)
        close(found[2], ref.mass(), name)
        coriolis = ref.both(pin.computeCoriolisMatrix(ref.model, ref.data, ref.q, ref.v))
        close(symbolic.coriolis_matrix(robot)(q, v), coriolis, name)


def test_forward_dynamics_derivatives(small_robot, states):
    robot = small_robot
    for name, (q, v, tau) in states(robot).items():
        ref = Reference(robot, q, v, tau)
        found = symbolic.forward_dynamics_derivatives(robot)(q, v, tau)
        a = np.array(symbolic.forward_dynamics(robot)(q, v, tau)).ravel()
        mass = ref.mass()
        torques = (*ref.derivatives(robot.rate_to_full(a)), -np.eye(robot.n))
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


def test_momentum_energy_and_balance(robot, states):
    for name, (q, v, a) in states(robot).items():
        ref = Reference(robot, q, v, a)
        close(symbolic.center_of_mass(robot)(q), pk.dynamics.center_of_mass(robot, q), name)
        jacobian = pin.jacobianCenterOfMass(ref.model, ref.data, ref.q) @ ref.map
        share = ref.data.mass[0] / pk.dynamics.total_mass(robot)
        close(symbolic.center_of_mass_jacobian(robot)(q), jacobian * share, name)
        centroidal = ref.centroidal()
        close(symbolic.centroidal_map(robot)(q), centroidal, name)
        close(symbolic.centroidal_momentum(robot)(q, v), centroidal @ v, name)
        close(symbolic.kinetic_energy(robot)(q, v), pk.dynamics.kinetic_energy(robot, q, v), name)
        close(symbolic.potential_energy(robot)(q), pk.dynamics.potential_energy(robot, q), name)
        floor = ref.floor()
        close(symbolic.base_wrench(robot)(q, v, a), floor, name)
        point = np.array([-floor[4], floor[3]]) / floor[2]
        close(symbolic.zero_moment_point(robot)(q, v, a), point, name, 1e-7)


def test_regressor(small_robot, states):
    robot = small_robot
    for name, (q, v, a) in states(robot).items():
        ref = Reference(robot, q, v, a)
        expected = ref.map.T @ pin.computeJointTorqueRegressor(ref.model, ref.data, ref.q, ref.v, ref.a)
        close(symbolic.regressor(robot)(q, v, a), expected, name)
