"""The base in front of the twin: commands become references, runs are watched for balance."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.twin import Twin
from pepper_kin.twin.base import (
    BalanceMonitor,
    BaseController,
    OmniBase,
    TippingStatus,
    simulate_tipping,
    world_velocity,
)
from pepper_kin.twin.sensors import SensorSuite


def driven(pepper, controller, commands, steps, timestep=0.002):
    """References of the planar robot for commands (time, twist), held until the next."""
    position = np.tile(pepper.posture("Stand"), (steps, 1))
    velocity, due = np.zeros_like(position), dict(commands)
    for k in range(steps):
        if k in due:
            controller.command(due[k])
        twist = controller.step(timestep)
        position[k, :3] = controller.pose
        velocity[k, :3] = world_velocity(twist, controller.pose[2])
    return position, velocity


def test_the_twin_follows_the_base_and_odometry_tells_where_it_is():
    pepper = pk.load_pepper(base="planar")
    controller = BaseController(OmniBase(pepper), command_timeout=1.0)
    position, velocity = driven(pepper, controller, [(0, (0.25, 0.1, 0.4))], 900)
    suite = SensorSuite(pepper, sensors=["wheel_odometry", "imu_base_gyroscope"], seed=5)
    twin = Twin(pepper, 0.002, sensors=suite)
    run = twin.follow(position, velocity)
    assert run.success
    assert np.abs(run.position[1:] - position).max() < 2e-3
    odometry = run.readings["wheel_odometry"]
    rows = np.round(odometry.time / 0.002).astype(int)
    np.testing.assert_allclose(odometry.truth[:, :3], run.position[rows, :3], atol=1e-9)
    way = np.hypot(*run.position[-1, :2])
    assert way > 0.2
    assert 0 < np.abs(odometry.value[-1] - odometry.truth[-1])[:2].max() < 0.05 * way
    turning = run.readings["imu_base_gyroscope"]
    k = int(np.argmin(np.abs(turning.time - 0.7)))
    assert turning.truth[k, 2] == pytest.approx(run.velocity[round(turning.time[k] / 0.002), 2], abs=1e-9)


def test_braking_hard_shifts_the_point_as_the_height_of_the_mass_says():
    """With everything else at rest the zero-moment point lags the center by a h / g."""
    pepper = pk.load_pepper(base="planar")
    monitor, q = BalanceMonitor(pepper), pepper.posture("Stand")
    a = np.zeros(pepper.n)
    a[:2] = 0.5, -0.2
    report = monitor.assess([0.0], q[None], 0 * q[None], a[None])
    center = pk.dynamics.center_of_mass(pepper, q)
    np.testing.assert_allclose(report.point[0], center[:2] - a[:2] * center[2] / 9.81, atol=1e-9)
    assert report.friction[0] == pytest.approx(np.hypot(0.5, 0.2) / 9.81)


def test_a_wild_run_of_the_twin_is_seen_to_tip():
    pepper = pk.load_pepper()
    time = 0.002 * np.arange(1, 301)
    rock = 0.35 * np.sin(12.0 * time)
    position = np.tile(pepper.posture("Stand"), (300, 1))
    velocity = np.zeros_like(position)
    for name in ("HipPitch", "KneePitch"):
        j = pepper.joint_index(name)
        position[:, j] += rock
        velocity[:, j] = 4.2 * np.cos(12.0 * time)
    run = Twin(pepper, 0.002).follow(position, velocity)
    monitor = BalanceMonitor(pepper)
    report = monitor.assess_run(run)
    assert not report.balanced
    tipping = simulate_tipping(monitor, report, run.position)
    assert tipping.status is not TippingStatus.STOOD
    assert tipping.time[int(np.argmax(tipping.edge >= 0))] == report.event.time
    calm = Twin(pepper, 0.002).follow(np.tile(pepper.posture("Stand"), (50, 1)))
    assert monitor.assess_run(calm).balanced
