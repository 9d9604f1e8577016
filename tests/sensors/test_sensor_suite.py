"""Readings of each sensor, against closed forms and finite differences; the suite's clock and its seeds."""

import zlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.twin.sensors import (
    CAMERAS,
    RobotRays,
    SensorSpecification,
    SensorSuite,
    published_scan,
    sensor_specifications,
)
from pepper_kin.twin.sensors.range_sensors import cone


@pytest.fixture(scope="module")
def planar():
    return pk.load_pepper(base="planar")


def test_the_data_name_frames_rates_and_sources(pepper):
    sensors = sensor_specifications()
    rates = {name: specification.rate for name, specification in sensors.items()}
    assert len(sensors) >= 25
    assert rates["joint_encoders"] == 50
    assert rates["wheel_odometry"] == 15
    for name in ("imu_torso_gyroscope", "sonar_back", "laser_left", *CAMERAS):
        assert rates[name] == 10
    for specification in sensors.values():
        assert not specification.frame or specification.frame in pepper.frame_names
        assert "assumed" in specification.source or "naoqi_driver" in specification.source


def test_rest_is_gravity_upward_and_no_turning(pepper):
    suite = SensorSuite(pepper, noise=False)
    read = suite.read(0.0, pepper.posture("Stand"))
    assert np.linalg.norm(read["imu_torso_accelerometer"].value) == pytest.approx(9.81)
    np.testing.assert_allclose(read["imu_base_accelerometer"].value, [0, 0, 9.81], atol=1e-12)
    np.testing.assert_array_equal(read["imu_torso_gyroscope"].value, 0)
    rotation = pk.kinematics.frame_pose(pepper, pepper.posture("Stand"), "torso")[:3, :3]
    np.testing.assert_allclose(read["imu_torso_accelerometer"].value, rotation.T @ [0, 0, 9.81], atol=1e-12)


def swing(pepper, t):
    """A smooth motion with its derivatives: positions, velocities, accelerations."""
    middle = pepper.posture("Stand")
    size = np.zeros(pepper.n)
    for name, value in {"HipRoll": 0.2, "HipPitch": 0.3, "KneePitch": 0.15, "HeadYaw": 0.5}.items():
        size[pepper.joint_index(name)] = value
    if "BaseYaw" in pepper.joint_names:
        for name, value in {"BaseX": 0.5, "BaseY": 0.2, "BaseYaw": 0.9}.items():
            size[pepper.joint_index(name)] = value
    w = 3.0 + np.arange(pepper.n) % 3
    return middle + size * np.sin(w * t), size * w * np.cos(w * t), -size * w**2 * np.sin(w * t)


@pytest.mark.parametrize("base", ["fixed", "planar"])
@pytest.mark.parametrize("part", ["torso", "base"])
def test_imu_in_a_swing_is_the_finite_difference_of_poses(base, part):
    pepper = pk.load_pepper(base=base)
    frame = f"Imu{part.title()}Accelerometer_frame"
    t, h = 0.7, 1e-4

    def pose(time):
        return pk.kinematics.frame_pose(pepper, swing(pepper, time)[0], frame)

    read = SensorSuite(pepper, noise=False).read(0.0, *swing(pepper, t))
    before, now, after = pose(t - h), pose(t), pose(t + h)
    acceleration = (after[:3, 3] - 2 * now[:3, 3] + before[:3, 3]) / h**2
    force = now[:3, :3].T @ (acceleration + np.array([0, 0, 9.81]))
    np.testing.assert_allclose(read[f"imu_{part}_accelerometer"].value, force, atol=2e-5)
    spin = now[:3, :3].T @ (after[:3, :3] - before[:3, :3]) / (2 * h)
    rate = [spin[2, 1], spin[0, 2], spin[1, 0]]
    np.testing.assert_allclose(read[f"imu_{part}_gyroscope"].value, rate, atol=1e-6)
    x, y, z, w = read[f"imu_{part}_orientation"].value
    turned = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    np.testing.assert_allclose(turned, now[:3, :3], atol=1e-12)


def test_accelerometer_and_gyroscope_end_at_their_range(pepper):
    v = np.zeros(pepper.n)
    v[pepper.joint_index("HipRoll")] = 50.0
    read = SensorSuite(pepper).read(0.0, pepper.posture("Stand"), v)
    assert np.abs(read["imu_torso_gyroscope"].truth).max() > 40
    assert np.abs(read["imu_torso_gyroscope"].value).max() == pytest.approx(np.deg2rad(500), rel=1e-6)
    assert np.abs(read["imu_torso_accelerometer"].value).max() == pytest.approx(2 * 9.80665)


def test_sonar_and_lasers_measure_a_wall(pepper):
    q, suite = pepper.posture("Stand"), SensorSuite(pepper, noise=False)
    scene = pk.Scene().add_box("wall", (0.2, 8, 4), (1.6, 0, 0))  # its face at x = 1.5
    read = suite.read(0.0, q, scene=scene)
    front = pk.kinematics.frame_pose(pepper, q, "SonarFront_frame")
    # The cone's lowest ray is the nearest to level.
    level = np.cos(0.322858 - 0.5236 / 2)
    assert read["sonar_front"].value == pytest.approx((1.5 - front[0, 3]) / level, rel=1e-6)
    assert read["sonar_back"].value == np.inf
    angles = np.deg2rad(np.linspace(-30, 30, 15))
    np.testing.assert_allclose(read["laser_front"].value, (1.5 - 0.0562) / np.cos(angles), rtol=1e-9)
    left = (1.5 + 0.018) / np.maximum(np.cos(1.75728 + angles), 1e-9)
    expected = np.where(left < 3.0, left, np.inf)
    np.testing.assert_allclose(read["laser_left"].value, expected, rtol=1e-6)
    np.testing.assert_allclose(read["laser_right"].value, expected[::-1], rtol=1e-6)


def test_ranges_say_too_near_and_too_far(pepper):
    q, suite = pepper.posture("Stand"), SensorSuite(pepper)
    near = suite.read(0.0, q, scene=pk.Scene().add_box("wall", (0.2, 8, 4), (0.34, 0, 0)))
    assert near["sonar_front"].value == -np.inf
    assert 0.1 < near["sonar_front"].truth < 0.25
    far = suite.read(1.0, q, scene=pk.Scene().add_box("wall", (0.2, 8, 4), (4.1, 0, 0)))
    assert far["sonar_front"].value == np.inf
    assert (far["laser_front"].value == np.inf).all()
    assert np.isfinite(far["laser_front"].truth).all()


def test_the_cone_is_a_cone():
    directions = cone(0.2618)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    angles = np.arccos(directions[:, 0])
    assert angles.max() == pytest.approx(0.2618)
    assert len(directions) == 217
    # No direction of the cone is further than two steps from a ray.
    rng = np.random.default_rng(0)
    off, around = 0.2618 * np.sqrt(rng.random(500)), rng.uniform(0, 2 * np.pi, 500)
    asked = np.column_stack([np.cos(off), np.sin(off) * np.cos(around), np.sin(off) * np.sin(around)])
    assert np.arccos(np.clip(asked @ directions.T, -1, 1)).min(axis=1).max() < 0.2618 / 8


@pytest.mark.parametrize("posture", ["Stand", "StandInit", "StandZero"])
def test_no_base_sensor_sees_the_robot_in_its_postures(pepper, posture):
    read = SensorSuite(pepper, noise=False).read(0.0, pepper.posture(posture))
    for name in ("sonar_front", "sonar_back"):
        assert read[name].value == np.inf
    for name in ("laser_front", "laser_left", "laser_right"):
        assert (read[name].truth == np.inf).all()


def test_published_scan_measures_from_the_base(pepper):
    wall = pk.Scene().add_box("wall", (0.2, 8, 4), (1.6, 0, 0))
    read = SensorSuite(pepper, noise=False).read(0.0, pepper.posture("Stand"), scene=wall)
    scan = published_scan(pepper, *(read[f"laser_{side}"].value for side in ("right", "front", "left")))
    assert scan.shape == (61,)
    assert (scan[15:23] == -1).all()
    assert (scan[38:46] == -1).all()
    y = (1.5 - 0.0562) * np.tan(np.deg2rad(np.linspace(-30, 30, 15)))
    np.testing.assert_allclose(scan[23:38], np.hypot(1.5, y))
    with pytest.raises(InvalidValueError, match="laser_front"):
        published_scan(pepper, np.ones(15), np.ones(14), np.ones(15))


def test_a_ball_presses_the_bumper_that_it_touches(pepper):
    names = ("bumper_front_left", "bumper_front_right", "bumper_back")
    suite = SensorSuite(pepper, sensors=names)
    q = pepper.posture("Stand")

    def pressed(scene, time):
        return [bool(reading.value) for reading in suite.read(time, q, scene=scene).values()]

    scene = pk.Scene()
    assert pressed(scene, 0.0) == [False] * 3
    assert pressed(scene.add_sphere("ball", 0.05, (0.18, 0.255, 0.07)), 1.0) == [True, False, False]
    assert pressed(scene.add_sphere("ball", 0.05, (0.35, 0.26, 0.07)), 2.0) == [False] * 3
    assert pressed(scene.add_box("wall", (0.1, 1, 1), (-0.30, 0, 0.5)), 3.0) == [False, False, True]


@pytest.mark.parametrize(
    "name",
    ["head_touch_front", "head_touch_middle", "head_touch_rear", "left_hand_touch", "right_hand_touch"],
)
def test_a_ball_that_rests_on_the_body_touches_the_pad_under_it(pepper, name):
    """The ball lies on the body's collision shapes, over the pad, as a world with contacts would hold it."""
    q = pepper.joint_vector({"HeadYaw": 0.3, "LElbowYaw": -0.6, "RElbowYaw": 0.6})
    frame = sensor_specifications()[name].frame
    pose = pk.kinematics.frame_pose(pepper, q, frame)
    outward = pose[:3, 0 if "hand" in name else 2]  # the pads' axes as the URDF turns them
    radius = 0.03

    def ball(away):
        return pk.Scene().add_sphere("ball", radius, pose[:3, 3] + (radius + away) * outward)

    def in_the_body(scene):
        touching = pk.collision.contacts(pepper, q, scene)
        return any("ball" in contact.names and contact.distance < -1e-4 for contact in touching)

    away = 0.0
    while in_the_body(ball(away)):
        away += 0.0005
    assert away < 0.02
    touched = SensorSuite(pepper).read(0.0, q, scene=ball(away))
    assert touched[name].value
    above = SensorSuite(pepper).read(0.0, q, scene=ball(away + 0.02))
    assert not any(reading.value for other, reading in above.items() if "touch" in other)


def test_contacts_press_what_they_lie_on(pepper):
    suite = SensorSuite(pepper, sensors=["head_touch_front", "head_touch_rear", "left_hand_touch"])
    q = pepper.joint_vector({"HeadYaw": 0.7})
    point = pk.kinematics.frame_pose(pepper, q, "HeadTouchFront_frame")[:3, 3]
    finger = SimpleNamespace(links=("Head", None), points=np.array([point, point]))
    read = suite.read(0.0, q, contacts=[finger])
    assert [bool(reading.value) for reading in read.values()] == [True, False, False]
    other = SimpleNamespace(links=("LBicep", None), points=np.array([point, point]))
    unknown = SimpleNamespace(links=("Head", "torso"), points=None)
    read = suite.read(1.0, q, contacts=[other, unknown])
    assert not any(reading.value for reading in read.values())


def test_wrong_samples_of_a_switch_have_their_share(pepper):
    worse = replace(sensor_specifications()["bumper_back"], error_rate=0.2)
    suite = SensorSuite(pepper, sensors=["bumper_back"], specifications={"bumper_back": worse})
    q = pepper.posture("Stand")
    wrong = [bool(suite.read(k / 50, q)["bumper_back"].value) for k in range(1000)]
    assert 140 < sum(wrong) < 260


def test_encoders_have_a_resolution_a_bias_and_noise(planar):
    suite = SensorSuite(planar, sensors=["joint_encoders", "joint_torques"], seed=3)
    q, torque = planar.posture("Stand"), np.linspace(-1, 1, planar.n)
    values = [suite.read(k / 50, q, torque=torque) for k in range(400)]
    encoder = np.array([read["joint_encoders"].value for read in values])
    assert encoder.shape == (400, planar.n - 3)  # no encoder tells where the base is
    step = sensor_specifications()["joint_encoders"].resolution
    assert step == pytest.approx(2 * np.pi / 4096)
    np.testing.assert_allclose(encoder / step, np.round(encoder / step), atol=1e-9)
    assert np.abs(encoder - q[3:]).max() < 0.006
    load = np.array([read["joint_torques"].value for read in values]) - torque[3:]
    assert load.std(axis=0).mean() == pytest.approx(0.05, rel=0.05)
    assert 0.005 < np.abs(load.mean(axis=0)).mean() < 0.05  # the bias remains


def test_errors_are_those_of_numpys_generator(pepper):
    """Drawn anew from Philox, keyed by seed and name, with the sample in its counter."""
    names, seed = ("joint_encoders", "imu_base_gyroscope", "sonar_front", "laser_left"), 12
    suite, q = SensorSuite(pepper, sensors=names, seed=seed), pepper.posture("Stand")
    wall = pk.Scene().add_box("wall", (0.2, 8, 8), (1.6, 0, 0))
    for k in range(4):
        for name, reading in suite.read(k / 10, q, scene=wall).items():
            about = sensor_specifications()[name]
            words = np.random.SeedSequence([seed, zlib.crc32(name.encode())])
            key, sample = words.generate_state(2, np.uint64), round(k / 10 * about.rate)
            last, now = (
                np.random.Generator(np.random.Philox(key=key, counter=counter)).standard_normal(
                    reading.truth.shape
                )
                for counter in ([0, 0, 0, 1], [0, 0, sample, 0])
            )
            value = reading.truth + about.bias * last + about.noise * now
            if about.resolution:
                value = np.round(value / about.resolution) * about.resolution
            if about.kind in ("sonar", "laser"):
                value = np.where(value > about.maximum, np.inf, value)
            np.testing.assert_array_equal(reading.value, value)


def test_switches_of_other_rates_are_read_by_themselves(pepper):
    slow = replace(sensor_specifications()["bumper_back"], rate=10.0)
    names = ("bumper_front_left", "bumper_back")
    suite = SensorSuite(pepper, sensors=names, specifications={"bumper_back": slow})
    wall = pk.Scene().add_box("wall", (0.1, 1, 1), (-0.30, 0, 0.5))
    found = [suite.read(k / 50, pepper.posture("Stand"), scene=wall) for k in range(6)]
    assert [tuple(read) for read in found] == [names, *[names[:1]] * 4, names]
    assert [bool(found[k]["bumper_back"].value) for k in (0, 5)] == [True, True]


def test_each_sensor_keeps_its_own_rate(pepper):
    suite = SensorSuite(pepper, sensors=["joint_encoders", "imu_base_gyroscope", "wheel_odometry"])
    q, times = pepper.posture("Stand"), {name: [] for name in suite.names}
    for step in range(2001):
        for name, reading in suite.read(step * 0.001, q).items():
            times[name].append(reading.time)
    assert {name: len(found) for name, found in times.items()} == {
        "joint_encoders": 101,
        "imu_base_gyroscope": 21,
        "wheel_odometry": 31,
    }
    np.testing.assert_allclose(times["joint_encoders"], np.arange(101) / 50, atol=1e-12)
    assert np.abs(np.array(times["wheel_odometry"]) - np.arange(31) / 15).max() < 0.001


def test_readings_depend_on_the_seed_and_not_on_the_company(pepper):
    q = pepper.posture("Stand")
    scene = pk.Scene().add_box("wall", (0.2, 8, 4), (1.6, 0, 0))
    suites = [
        SensorSuite(pepper, seed=7),
        SensorSuite(pepper, seed=7, sensors=["laser_front", "imu_torso_orientation"]),
        SensorSuite(pepper, seed=8),
    ]
    suites[0].read(0.0, q, scene=scene)  # an extra sample before
    all_of, few, other = (suite.read(0.5, q, scene=scene) for suite in suites)
    for name in few:
        np.testing.assert_array_equal(all_of[name].value, few[name].value)
        assert not np.array_equal(all_of[name].value, other[name].value)
    suites[0].reset()
    again = suites[0].read(0.5, q, scene=scene)
    for name, reading in again.items():
        np.testing.assert_array_equal(reading.value, all_of[name].value)
    later = suites[1].read(0.6, q, scene=scene)["laser_front"]
    assert not np.array_equal(later.value, few["laser_front"].value)


def test_noise_has_its_deviation(pepper):
    suite = SensorSuite(pepper, sensors=["imu_base_accelerometer", "imu_base_orientation"])
    q = pepper.posture("Stand")
    read = [suite.read(k / 10, q) for k in range(600)]
    error = np.array([r["imu_base_accelerometer"].error for r in read])
    assert error.std(axis=0) == pytest.approx([0.05] * 3, rel=0.12)
    quaternions = np.array([r["imu_base_orientation"].value for r in read])
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0)
    assert (2 * quaternions[:, :3]).std(axis=0) == pytest.approx([0.002] * 3, rel=0.12)


def test_cameras_read_only_if_named(pepper):
    assert not set(CAMERAS) & set(SensorSuite(pepper).names)
    suite = SensorSuite(pepper, sensors=["camera_depth", "camera_top"], seed=1)
    q = pepper.joint_vector({"HeadPitch": 0.3})
    wall = pk.Scene().add_box("wall", (0.2, 3, 1.4), (2.1, 0, 0.7))
    read = suite.read(0.0, q, scene=wall)
    depth, color = read["camera_depth"], read["camera_top"]
    assert depth.value.shape == (240, 320)
    assert color.value.dtype == np.uint8
    assert color.value.shape == (240, 320, 3)
    in_range = (depth.truth > 1.2) & (depth.truth < 1.6)
    deviation = (0.0012 + 0.0019 * (depth.truth[in_range] - 0.4) ** 2).mean()
    assert depth.error[in_range].std() == pytest.approx(deviation, rel=0.1)
    assert (color.value.astype(float) - color.truth).std() == pytest.approx(2.0, rel=0.1)
    assert (depth.value[depth.truth < 0.39] == -np.inf).all()


def test_own_body_is_hidden_only_where_the_sensor_sits(pepper):
    q = pepper.posture("Stand")
    down = np.array([[0.0, 0.0, -1.0]])
    all_of = RobotRays(pepper, "collision", floor=False).distances(q, None, [0, 0, 2.0], down)
    headless = RobotRays(pepper, "collision", blind_to="CameraTop_frame", floor=False)
    assert headless.distances(q, None, [0, 0, 2.0], down) > all_of > 0.7


def test_a_suite_takes_a_sensor_that_pepper_does_not_have(pepper):
    hand = SensorSpecification("hand", "accelerometer", "l_gripper", 100.0, "m/s^2", "assumed")
    suite = SensorSuite(pepper, noise=False, specifications={"hand": hand})
    q = pepper.posture("Stand")
    upright = pk.kinematics.frame_pose(pepper, q, "l_gripper")[:3, :3].T @ [0, 0, 9.81]
    np.testing.assert_allclose(suite.read(0.0, q)["hand"].value, upright, atol=1e-12)
    assert set(suite.names) == {"hand", *SensorSuite(pepper).names}


def test_misuse_is_named(pepper):
    with pytest.raises(UnknownNameError, match=r"gps.*joint_encoders"):
        SensorSuite(pepper, sensors=["gps"])
    with pytest.raises(InvalidValueError, match="seed"):
        SensorSuite(pepper, seed=-1)
    with pytest.raises(InvalidValueError, match=r"name of a specification.*sonar_back.*sonar_bakc"):
        SensorSuite(pepper, specifications={"sonar_bakc": sensor_specifications()["sonar_back"]})
    with pytest.raises(InvalidValueError, match="rate of sonar_back"):
        replace(sensor_specifications()["sonar_back"], rate=0.0)
    with pytest.raises(InvalidValueError, match="noise of sonar_back"):
        replace(sensor_specifications()["sonar_back"], noise=np.nan)
    suite, q = SensorSuite(pepper, sensors=["joint_encoders"]), pepper.posture("Stand")
    suite.read(1.0, q)
    with pytest.raises(InvalidValueError, match="at least 1 s"):
        suite.read(0.5, q)
    with pytest.raises(InvalidValueError, match="time"):
        suite.read(np.nan, q)
    with pytest.raises(InvalidValueError, match="HeadYaw"):
        suite.read(
            2.0, pepper.posture("Stand") * np.where(np.array(pepper.joint_names) == "HeadYaw", np.nan, 1)
        )
    with pytest.raises(InvalidValueError, match="torque"):
        suite.read(2.0, q, torque=np.zeros((2, pepper.n)))
    with pytest.raises(ValueError, match="read-only"):
        suite.read(2.0, q)["joint_encoders"].value[0] = 1.0


def state(pepper, time, **changes):
    rest = np.zeros(pepper.n)
    base = {"position": pepper.posture("Stand"), "velocity": rest, "acceleration": rest, "torque": rest}
    return SimpleNamespace(time=time, **{**base, **changes})


def test_states_observed_are_recorded_and_begin_anew_with_the_clock(pepper):
    wall = pk.Scene().add_box("wall", (0.2, 8, 4), (1.6, 0, 0))
    suite = SensorSuite(pepper, sensors=["joint_encoders", "laser_front"], scene=wall, seed=2)
    for step in range(501):
        suite.observe(state(pepper, step * 0.001))
    series = suite.recorded()
    assert len(series["joint_encoders"]) == 26
    assert len(series["laser_front"]) == 6
    np.testing.assert_allclose(series["laser_front"].time, np.arange(6) / 10)
    assert series["laser_front"].value.shape == (6, 15)
    assert np.isfinite(series["laser_front"].value).all()
    alone = SensorSuite(pepper, sensors=["laser_front"], seed=2)
    for k in range(6):
        read = alone.read(k / 10, pepper.posture("Stand"), scene=wall)["laser_front"]
        np.testing.assert_array_equal(series["laser_front"].value[k], read.value)
    late = suite.recorded(0.3)
    np.testing.assert_allclose(late["laser_front"].time, [0, 0.1, 0.2], atol=1e-12)
    suite.observe(state(pepper, 0.0))
    assert len(suite.recorded()["joint_encoders"]) == 1
    assert suite.recorded(1.0) == {}


def test_a_moving_world_is_looked_at_where_it_is(pepper):
    bumper = pk.kinematics.frame_pose(pepper, pepper.posture("Stand"), "BumperB_frame")[:3, 3]

    class StubWorld:
        place = 2.0
        force = np.zeros(3)

        def snapshot(self):
            return pk.Scene().add_box("wall", (0.2, 8, 4), (self.place + 0.1, 0, 0))

        @property
        def contacts(self):
            return [SimpleNamespace(names=("Tibia", "ball"), point=bumper, force=self.force)]

    world = StubWorld()
    suite = SensorSuite(pepper, sensors=["laser_front", "bumper_back"], world=world, noise=False)
    suite.observe(state(pepper, 0.0))
    world.place, world.force = 1.5, np.array([1.0, 0, 0])
    suite.observe(state(pepper, 0.1))
    series = suite.recorded()
    np.testing.assert_allclose(series["laser_front"].value[:, 7], [2.0 - 0.0562, 1.5 - 0.0562])
    assert series["bumper_back"].value.tolist() == [False, True]
    with pytest.raises(InvalidValueError, match="both"):
        SensorSuite(pepper, scene=pk.Scene(), world=world)
