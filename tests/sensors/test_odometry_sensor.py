"""Wheel odometry of a moving base: exact without errors, and wrong in proportion to the way."""

from dataclasses import replace

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.twin.base import OmniBase, arc_moved, world_velocity
from pepper_kin.twin.sensors import SensorSuite, sensor_specifications


@pytest.fixture(scope="module")
def pepper():
    return pk.load_pepper(base="planar")


def drive(pepper, suite, twist, samples):
    """Readings along an arc, sample by sample; the robot's head moves meanwhile."""
    found, pose = [], np.array([0.3, -0.2, 2.0])
    for k in range(samples):
        q, v = pepper.joint_vector({"HeadYaw": 0.5 * np.sin(k)}), np.zeros(pepper.n)
        q[:3], v[:3] = pose, world_velocity(twist, pose[2])
        found.append(suite.read(k / 15, q, v)["wheel_odometry"])
        pose = arc_moved(pose, np.array(twist) / 15)
    return found


def exact(**changes):
    perfect = replace(
        sensor_specifications()["wheel_odometry"], noise=0.0, bias=0.0, resolution=0.0, **changes
    )
    return {"specifications": {"wheel_odometry": perfect}, "sensors": ["wheel_odometry"]}


def test_wheels_without_errors_tell_the_true_pose_over_many_turns(pepper):
    found = drive(pepper, SensorSuite(pepper, **exact()), (0.2, -0.1, 0.9), 200)
    for reading in (found[1], found[-1]):
        np.testing.assert_allclose(reading.value, reading.truth, atol=1e-10)
    assert found[-1].truth[2] == pytest.approx(2.0 + 0.9 * 199 / 15)  # the yaw counts its turns
    np.testing.assert_allclose(found[-1].truth[3:], (0.2, -0.1, 0.9), atol=1e-9)
    ideal = drive(pepper, SensorSuite(pepper, noise=False, sensors=["wheel_odometry"]), (0.2, -0.1, 0.9), 200)
    np.testing.assert_array_equal(ideal[-1].value, ideal[-1].truth)
    np.testing.assert_allclose(ideal[-1].truth, found[-1].truth)


def test_standing_still_adds_no_error(pepper):
    found = drive(pepper, SensorSuite(pepper, sensors=["wheel_odometry"]), (0, 0, 0), 50)
    for reading in found:
        np.testing.assert_allclose(reading.value, reading.truth, atol=1e-12)


@pytest.mark.thorough
def test_errors_have_the_size_of_wheels_and_slip(pepper):
    straight, ends = (0.3, 0.0, 0.0), []
    for seed in range(120):
        suite = SensorSuite(pepper, seed=seed, sensors=["wheel_odometry"])
        ends.append(drive(pepper, suite, straight, 31)[-1])
    way = 0.3 * 2.0
    turns = OmniBase().wheel_speeds((way, 0, 0))
    spread = np.linalg.inv(OmniBase().wheel_map)
    variance = spread @ np.diag(0.005**2 * turns**2 + 0.005**2 * np.abs(turns)) @ spread.T
    turned = [reading.error[2] for reading in ends]
    assert np.std(turned) == pytest.approx(np.sqrt(variance[2, 2]), rel=0.25)
    assert 0 < np.abs([reading.error[3:] for reading in ends]).max() < 0.05


def test_counts_are_rounded_without_losing_any(pepper):
    coarse = {"wheel_odometry": replace(exact()["specifications"]["wheel_odometry"], resolution=0.05)}
    suite = SensorSuite(pepper, sensors=["wheel_odometry"], specifications=coarse)
    found = drive(pepper, suite, (0.02, 0.0, 0.0), 300)  # less than one count of each wheel per sample
    bound = 0.05 * np.abs(np.linalg.inv(OmniBase().wheel_map)).sum(axis=1).max()
    assert 0 < np.abs(found[-1].error[:2]).max() < bound


def test_reset_forgets_the_way(pepper):
    suite = SensorSuite(pepper, seed=4, sensors=["wheel_odometry"])
    first = drive(pepper, suite, (0.3, 0.1, 0.2), 20)
    suite.reset()
    second = drive(pepper, suite, (0.3, 0.1, 0.2), 20)
    np.testing.assert_array_equal(first[-1].value, second[-1].value)
    assert not np.array_equal(first[-1].value, first[-1].truth)
