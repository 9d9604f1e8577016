"""Sensors of many robots at once: the same as those of each robot's own suite, without noise."""

import numpy as np
import pytest

from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import rotation_from_rpy
from pepper_kin.twin.batch_world import BatchBodies
from pepper_kin.twin.sensors import (
    BatchDepth,
    BatchInertial,
    BatchRanges,
    BatchSwitches,
    Camera,
    SensorSuite,
    camera_intrinsics,
)

RANGES = ("laser_right", "laser_front", "laser_left", "sonar_front", "sonar_back")
INERTIAL = (
    "imu_torso_accelerometer", "imu_torso_gyroscope", "imu_base_accelerometer", "imu_base_gyroscope"
)  # fmt: skip


def test_rows_read_what_suites_read(pepper):
    scene = Scene().add_box("shelf", (0.3, 2.0, 1.5), (1.2, 0.2, 0.75))
    scene = scene.add_sphere("ball", 0.2, (-0.9, 0.1, 0.2)).add_box("near", (0.1, 0.1, 1.0), (0.0, 0.3, 0.5))
    rng = np.random.default_rng(4)
    low, high = pepper.lower_limits, pepper.upper_limits
    q = np.clip(pepper.neutral() + rng.uniform(-0.1, 0.1, (5, pepper.n)), low, high)
    v, a = 0.1 * rng.normal(size=(2, 5, pepper.n))
    ranges, inertial = (
        BatchRanges(pepper, scene, RANGES).read(q),
        BatchInertial(pepper, INERTIAL).read(q, v, a),
    )
    for row in range(5):
        suite = SensorSuite(pepper, noise=False, sensors=(*RANGES, *INERTIAL))
        read = suite.read(0.0, q[row], v[row], a[row], scene=scene)
        wanted = np.concatenate([np.atleast_1d(read[name].value) for name in RANGES])
        assert np.isfinite(wanted).sum() > 15
        np.testing.assert_allclose(ranges[row], wanted, atol=1e-9)
        wanted = np.concatenate([read[name].truth for name in INERTIAL])
        np.testing.assert_allclose(inertial[row], wanted, atol=1e-9)


def test_depth_is_that_of_a_camera(pepper):
    scene = (
        Scene().add_box("shelf", (0.3, 2.0, 1.5), (1.2, 0.2, 0.75)).add_sphere("ball", 0.2, (0.9, -0.5, 1.4))
    )
    q = np.tile(pepper.neutral(), (3, 1))
    q[:, pepper.joint_index("HeadYaw")] = [-0.4, 0.0, 0.5]
    intrinsics = camera_intrinsics("camera_depth", "QQVGA")
    found = BatchDepth(pepper, scene, intrinsics).read(q)
    assert found.shape == (3, 120, 160)
    for row in range(3):
        camera = Camera(pepper, "camera_depth", "QQVGA", lens=False)
        wanted = camera.depth(q[row], scene)
        near = np.isfinite(wanted)
        assert near.mean() > 0.5
        own = np.abs(found[row][near] - wanted[near]) > 1e-4  # the robot's own body, which batches do not see
        assert own.mean() < 0.02
    small = BatchDepth(pepper, scene).read(q)
    assert small.shape == (3, 48, 64)
    np.testing.assert_allclose(
        np.median(small[np.isfinite(small)]), np.median(found[np.isfinite(found)]), rtol=0.1
    )


SWITCHES = (
    "bumper_front_left", "bumper_front_right", "bumper_back", "left_hand_touch", "head_touch_middle"
)  # fmt: skip


def test_pads_are_pressed_as_those_of_suites(pepper):
    """By what stands, and by a body that is elsewhere for each robot."""
    rng, count = np.random.default_rng(5), 60
    frames = ("BumperFL_frame", "BumperFR_frame", "BumperB_frame", "LHandTouchBack_frame")
    middles = np.array([frame_pose(pepper, pepper.neutral(), frame)[:3, 3] for frame in frames])
    q = np.tile(pepper.neutral(), (count, 1))
    q[:, pepper.joint_index("LElbowYaw")] += rng.uniform(-0.3, 0.3, count)
    scene = Scene().add_box("wall", (0.1, 0.1, 1.0), middles[0] + (0.05, 0.04, 0.0))
    scene = scene.add_box("thing", (0.05, 0.08, 0.1), (0.0, 0.0, 0.0))
    position = middles[rng.integers(4, size=count)] + rng.uniform(-0.08, 0.08, (count, 3))
    rotation = np.array([rotation_from_rpy(rpy) for rpy in rng.uniform(-3.0, 3.0, (count, 3))])
    bodies = {"thing": BatchBodies(position, rotation, np.zeros((count, 6)))}
    found = BatchSwitches(pepper, scene, SWITCHES, ("thing",)).read(q, bodies)
    for row in range(count):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation[row], position[row]
        read = SensorSuite(pepper, noise=False, sensors=SWITCHES).read(
            0.0, q[row], scene=scene.moved({"thing": pose})
        )
        assert found[row].tolist() == [bool(read[name].value) for name in SWITCHES]
    assert (found.sum(axis=0)[:4] > 2).all()
    assert found[:, 1:].mean() < 0.5
    still = BatchSwitches(pepper, Scene(scene.objects)).read(q)
    assert still.shape == (count, 8)
    assert still[:, 0].all()
    with pytest.raises(InvalidValueError, match="60 places"):
        BatchSwitches(pepper, scene, SWITCHES, ("thing",)).read(q[:5], bodies)
    with pytest.raises(UnknownNameError, match="thing"):
        BatchSwitches(pepper, scene, SWITCHES, ("thing",)).read(q)
    with pytest.raises(UnknownNameError, match="wall"):
        BatchSwitches(pepper, scene, SWITCHES, ("think",))


def test_sensors_that_there_are_not_are_named(pepper):
    with pytest.raises(UnknownNameError, match="bumper_back"):
        BatchSwitches(pepper, Scene(), ("bumper",))
    with pytest.raises(UnknownNameError, match="laser_front"):
        BatchRanges(pepper, Scene(), ("laser_font",))
    with pytest.raises(UnknownNameError, match="gyroscope"):
        BatchInertial(pepper, ("laser_front",))
