"""Sensors of many robots at once: the same as those of each robot's own suite, without noise."""

import numpy as np
import pytest

from pepper_kin.collision import Scene
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.twin.sensors import (
    BatchDepth,
    BatchInertial,
    BatchRanges,
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


def test_sensors_that_there_are_not_are_named(pepper):
    with pytest.raises(UnknownNameError, match="laser_front"):
        BatchRanges(pepper, Scene(), ("laser_font",))
    with pytest.raises(UnknownNameError, match="gyroscope"):
        BatchInertial(pepper, ("laser_front",))
