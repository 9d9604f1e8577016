"""A suite on the twin: every run holds the readings of its own time."""

from types import SimpleNamespace

import numpy as np

import pepper_kin as pk
from pepper_kin.twin import Twin
from pepper_kin.twin.sensors import SensorSuite
from pepper_kin.twin.world import World

NAMES = ("joint_encoders", "joint_torques", "imu_torso_gyroscope", "imu_torso_accelerometer", "sonar_front")


def test_readings_of_a_run_are_of_its_states(pepper):
    wall = pk.Scene().add_box("wall", (0.2, 8, 4), (1.6, 0, 0))
    suite = SensorSuite(pepper, sensors=NAMES, scene=wall, noise=False)
    twin = Twin(pepper, sensors=suite)
    goal = pepper.joint_vector({"HipRoll": 0.15, "HeadYaw": 0.4})
    trajectory = pk.retime(pepper, [pepper.posture("Stand"), goal], solver="toppra")
    run = twin.execute(trajectory, hold_time=0.2)
    assert set(run.readings) == set(NAMES)
    for name in ("joint_encoders", "joint_torques"):
        series = run.readings[name]
        rows = np.round(series.time / twin.timestep).astype(int)
        np.testing.assert_allclose(series.time, np.arange(len(series)) / 50, atol=1e-9)
        assert len(series) == int(run.duration * 50 + 1e-6) + 1
        expected = run.position if name == "joint_encoders" else run.torque
        np.testing.assert_array_equal(series.value, expected[rows])
    gyro = run.readings["imu_torso_gyroscope"]
    for time, value in zip(gyro.time, gyro.value, strict=True):
        k = round(time / twin.timestep)
        pose = pk.kinematics.frame_pose(pepper, run.position[k], gyro.frame)[:3, :3]
        rate = pk.kinematics.frame_velocity(pepper, run.position[k], run.velocity[k], gyro.frame)[3:]
        np.testing.assert_allclose(value, pose.T @ rate, atol=1e-12)
    assert np.isfinite(run.readings["sonar_front"].value).all()
    assert np.abs(gyro.value).max() > 0.05


def test_runs_one_after_another_hold_their_own_readings(pepper):
    suite = SensorSuite(pepper, sensors=["joint_encoders"], seed=3)
    twin = Twin(pepper, sensors=suite)
    target = np.tile(pepper.posture("Stand"), (100, 1))
    first, second = twin.follow(target), twin.follow(target)
    np.testing.assert_allclose(first.readings["joint_encoders"].time, np.arange(6) * 0.02, atol=1e-9)
    np.testing.assert_allclose(second.readings["joint_encoders"].time, np.arange(6) * 0.02, atol=1e-9)
    np.testing.assert_array_equal(
        first.readings["joint_encoders"].value[-1], second.readings["joint_encoders"].value[0]
    )
    twin.reset()
    again = twin.follow(target)
    np.testing.assert_array_equal(
        again.readings["joint_encoders"].value, first.readings["joint_encoders"].value
    )


def test_a_twin_without_sensors_has_no_readings(pepper):
    assert Twin(pepper).follow(np.tile(pepper.posture("Stand"), (3, 1))).readings == {}


def test_readings_are_of_their_time_whenever_they_are_asked_for(pepper):
    """A world moves on and the caller's arrays change: what is read later is what was there."""
    found = []
    for often in (True, False):
        world = World(pepper, pk.Scene().add_box("wall", (0.2, 8, 4), (1.6, 0, 0)))
        world.add_ball("ball", 0.05, 0.2, (0.9, 0.0, 0.6), velocity=(1.0, 0, 0, 0, 0, 0))
        suite = SensorSuite(pepper, world=world, seed=4)
        rest, q = np.zeros(pepper.n), pepper.posture("Stand").copy()
        for k in range(60):
            q[:2] += 1e-3
            moment = {"position": q, "velocity": rest, "acceleration": rest, "torque": rest}
            suite.observe(SimpleNamespace(time=0.01 * k, **moment))
            world.advance_alone(0.01)
            if often:
                suite.recorded()
        found.append(suite.recorded())
    once, later = found
    assert once.keys() == later.keys() == set(suite.names)
    for name, series in once.items():
        for part in ("time", "value", "truth"):
            np.testing.assert_array_equal(getattr(series, part), getattr(later[name], part))
    assert len(np.unique(once["sonar_front"].truth)) > 3
