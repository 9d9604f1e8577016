"""Any robot on a base: the same joints as those of Pepper's planar base, and what wheels allow."""

import pickle

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, ModelError
from pepper_kin.model import Wheels

WHEELS = Wheels(speed=0.6, acceleration=0.8, track=0.4, turning_radius=0.35)


def test_a_planar_base_moves_as_peppers_own_does():
    ours = pk.load_robot(pk.load_pepper().urdf, base="planar")
    own = pk.load_pepper(base="planar")
    assert ours.joint_names == own.joint_names
    assert ours.joint_units == own.joint_units
    np.testing.assert_array_equal(ours.lower_limits, own.lower_limits)
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(own.lower_limits, -3), np.minimum(own.upper_limits, 3), (20, own.n))
    v = rng.normal(size=(20, own.n))
    for frame in ("LArm_effector", "Head"):
        np.testing.assert_allclose(
            pk.kinematics.frame_pose(ours, q, frame), pk.kinematics.frame_pose(own, q, frame), atol=1e-12
        )
    np.testing.assert_allclose(
        pk.dynamics.inverse_dynamics(ours, q, v, 0 * v),
        pk.dynamics.inverse_dynamics(own, q, v, 0 * v),
        atol=1e-9,
    )
    assert np.isinf(ours.acceleration_limits[:3]).all()


def test_wheels_limit_the_joints_of_a_planar_base():
    robot = pk.load_robot(pk.load_pepper().urdf, base="planar", wheels=WHEELS)
    np.testing.assert_allclose(robot.velocity_limits[:3], [0.6, 0.6, 3.0])
    np.testing.assert_allclose(robot.acceleration_limits[:3], [0.8, 0.8, 4.0])
    assert robot.wheels == WHEELS
    again = pk.load_robot(robot.urdf)
    np.testing.assert_allclose(again.velocity_limits[:3], robot.velocity_limits[:3])


def test_a_differential_base_has_wheels_that_roll():
    robot = pk.load_robot(pk.load_pepper().urdf, base="differential", wheels=WHEELS)
    assert robot.wheels.differential
    assert not WHEELS.differential
    q, v = robot.neutral(), np.zeros(robot.n)
    q[2], v[:3] = 0.7, (0.3 * np.cos(0.7), 0.3 * np.sin(0.7), 0.5)
    for frame, speed in (("BaseWheelLeft", 0.3 - 0.5 * 0.2), ("BaseWheelRight", 0.3 + 0.5 * 0.2)):
        velocity = pk.kinematics.frame_velocity(robot, q, v, frame)[:3]
        assert np.linalg.norm(velocity) == pytest.approx(speed)
    copy = pickle.loads(pickle.dumps(robot))
    assert copy.wheels == robot.wheels
    np.testing.assert_array_equal(copy.velocity_limits, robot.velocity_limits)


def test_the_acceleration_of_a_differential_base_is_shared():
    """Whatever straight and turning accelerations its joints allow, no wheel exceeds its own."""
    robot = pk.load_robot(pk.load_pepper().urdf, base="differential", wheels=WHEELS)
    straight, _, twist = robot.acceleration_limits[:3]
    assert np.sqrt(2) * straight + WHEELS.track / 2 * twist <= WHEELS.acceleration * (1 + 1e-12)


def test_misuse_is_named():
    urdf = pk.load_pepper().urdf
    with pytest.raises(InvalidValueError, match="base: got 'omni', expected one of 'fixed', 'planar', 'd"):
        pk.load_robot(urdf, base="omni")
    with pytest.raises(InvalidValueError, match="wheels: got None, expected Wheels"):
        pk.load_robot(urdf, base="differential")
    with pytest.raises(InvalidValueError, match="expected None for a fixed base"):
        pk.load_robot(urdf, wheels=WHEELS)
    with pytest.raises(InvalidValueError, match="wheels: track: got 0"):
        Wheels(speed=1.0, acceleration=1.0, track=0.0)
    with pytest.raises(ModelError, match="has BaseX, BaseY, BaseYaw already"):
        pk.load_robot(pk.load_pepper(base="planar").urdf, base="planar")
