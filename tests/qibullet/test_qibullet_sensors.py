"""Sensors of the adapter against walls and motions whose readings follow by geometry."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.qibullet import (
    Camera,
    CameraDepth,
    CameraResolution,
    CameraRgb,
    Imu,
    PepperVirtual,
    SimulationError,
)

BOX = pk.collision.SceneObject(
    "wall", pk.model.Box((0.1, 8.0, 3.0)), pk.pose((2.05, 0.0, 1.5)), color=(1.0, 0.0, 0.0, 1.0)
)
WALL = pk.Scene({"wall": BOX})
TOP = PepperVirtual.ID_CAMERA_TOP


@pytest.mark.parametrize("resolution", [Camera.K_QQVGA, Camera.K_QQ720p, CameraResolution(64, 48)])
@pytest.mark.parametrize("camera", [0, 1, 2])
def test_pictures_have_the_shape_asked_for(pepper, camera, resolution):
    handle = pepper.subscribeCamera(camera, resolution=resolution, fps=10)
    frame = pepper.getCameraFrame(handle)
    depth = camera == PepperVirtual.ID_CAMERA_DEPTH
    assert frame.shape == (resolution.height, resolution.width, *(() if depth else (3,)))
    assert frame.dtype == (np.uint16 if depth else np.uint8)
    assert pepper.getCameraResolution(handle) == resolution
    assert pepper.getCameraFps(handle) == 10.0
    assert pepper.getCameraLink(handle) is pepper.getLink(
        ("CameraTop", "CameraBottom", "CameraDepth")[camera] + "_optical_frame"
    )
    assert isinstance(pepper.getCamera(handle), CameraDepth if depth else CameraRgb)


def test_colors_are_blue_green_red(manager, client, pepper):
    manager.setScene(client, WALL)
    frame = pepper.getCameraFrame(pepper.subscribeCamera(TOP, resolution=Camera.K_QQVGA))
    blue, green, red = frame[60, 80]
    assert red > 100
    assert max(blue, green) < 30


def test_the_depth_of_a_wall_is_its_distance_in_millimeters(manager, client, pepper):
    manager.setScene(client, WALL)
    handle = pepper.subscribeCamera(PepperVirtual.ID_CAMERA_DEPTH, resolution=Camera.K_QQVGA)
    frame = pepper.getCameraFrame(handle)
    place, (x, y, z, w) = pepper.getLinkPosition("CameraDepth_optical_frame")
    axis_x = 2.0 * (x * z + w * y)  # how far along x the optical axis points
    down_x = 2.0 * (x * y - w * z)
    lens = pepper.getCamera(handle)._getCameraIntrinsics()
    row = 70  # a point of the plane z = 1 in this row is axis + (row - cy) / fy * down
    along = axis_x + (row - lens[5]) / lens[4] * down_x
    assert frame[row, 80] == pytest.approx(1000.0 * (2.0 - place[0]) / along, abs=3)
    manager.setScene(client, None)
    pepper.unsubscribeCamera(handle)
    handle = pepper.subscribeCamera(PepperVirtual.ID_CAMERA_DEPTH, resolution=Camera.K_QQVGA)
    assert pepper.getCameraFrame(handle)[0, 80] == 8000


def test_the_field_of_view_spans_the_picture(pepper):
    handle = pepper.subscribeCamera(TOP, resolution=Camera.K_720p)
    fx, _, _, _, fy, *_ = pepper.getCamera(handle)._getCameraIntrinsics()
    assert 2.0 * np.degrees(np.arctan(640.0 / fx)) == pytest.approx(56.3)
    assert 2.0 * np.degrees(np.arctan(360.0 / fy)) == pytest.approx(43.7)


def test_a_picture_stands_for_its_period(pepper, steps):
    handle = pepper.subscribeCamera(TOP, resolution=CameraResolution(32, 24), fps=2)
    first = pepper.getCameraFrame(handle)
    pepper.setAngles("HeadPitch", 0.4, 1.0)
    steps(0.3)
    np.testing.assert_array_equal(pepper.getCameraFrame(handle), first)
    steps(0.3)
    assert (pepper.getCameraFrame(handle) != first).any()


def test_handles_end_with_their_subscription(pepper):
    assert pepper.subscribeCamera(-3) is None
    handle = pepper.subscribeCamera(TOP, resolution=CameraResolution(32, 24))
    camera = pepper.getCamera(handle)
    assert camera.isActive()
    assert pepper.unsubscribeCamera(handle)
    assert not pepper.unsubscribeCamera(handle)
    assert not camera.isActive()
    assert camera.getFrame() is None
    with pytest.raises(SimulationError, match="no camera is subscribed to"):
        pepper.getCameraFrame(handle)
    for wrong in ({"resolution": "VGA"}, {"fps": 0}, {"fps": None}):
        with pytest.raises(
            SimulationError, match=next(iter(wrong)) if "resolution" in wrong else "frequency"
        ):
            pepper.subscribeCamera(TOP, **wrong)


def test_beams_of_the_front_laser_end_at_a_wall(manager, client, pepper):
    manager.setScene(client, WALL)
    pepper.subscribeLaser()
    front = pepper.getFrontLaserValue()
    frame, _ = pepper.getLinkPosition("SurroundingFrontLaser_frame")
    ahead = (2.0 - frame[0]) / np.cos(np.deg2rad(np.linspace(30, -30, 15)))
    np.testing.assert_allclose(front, np.minimum(ahead, 3.0), atol=5e-3)
    assert len(pepper.getRightLaserValue()) == len(pepper.getLeftLaserValue()) == 15


def test_beams_are_clockwise_and_sides_are_sides(manager, client, pepper, steps):
    manager.setScene(client, pk.Scene().add_box("left", size=(0.3, 0.3, 1.0), position=(1.0, 0.45, 0.5)))
    pepper.subscribeLaser()
    front = pepper.getFrontLaserValue()
    assert front[0] < 2.0
    assert front[-1] == 3.0
    manager.setScene(client, pk.Scene().add_box("left", size=(6.0, 0.3, 1.0), position=(0.0, 1.0, 0.5)))
    assert pepper.getLeftLaserValue() == [3.0] * 15  # the next scan is due 0.16 s later
    steps(0.2)
    assert max(pepper.getLeftLaserValue()) < 3.0
    assert min(pepper.getRightLaserValue()) == 3.0
    ends = pepper.shown_points()
    assert ends.shape == (0, 3)
    pepper.showLaser(True)
    np.testing.assert_allclose(pepper.shown_points()[:, 1], 0.85, atol=5e-3)
    pepper.unsubscribeLaser()
    assert not pepper.laser_manager.isAlive()


@pytest.mark.thorough
def test_the_inertial_unit_reads_turning_and_the_change_of_velocity(pepper, manager, client):
    pepper.subscribeImu(frequency=50)
    assert pepper.getImuGyroscopeValues() == [0.0, 0.0, 0.0]
    pepper.move(0.3, 0.0, 0.5)
    gained, before = np.zeros(3), pepper.body.time.now
    for _ in range(960):
        manager.stepSimulation(client)
        if pepper.body.time.now > before + 0.019:
            before = pepper.body.time.now
            gained += 0.02 * np.array(pepper.getImuAccelerometerValues())
    gyroscope, acceleration = pepper.getImuValues()
    state, base = (
        pepper.body.state,
        [pepper.body.pepper.joint_index(n) for n in ("BaseX", "BaseY", "BaseYaw")],
    )
    assert gyroscope == pytest.approx([0.0, 0.0, 0.5], abs=5e-3)
    np.testing.assert_allclose(gained[:2], state.velocity[base[:2]], atol=0.02)
    assert np.linalg.norm(acceleration) == pytest.approx(0.3 * 0.5, rel=0.1)  # v omega, of a circle
    pepper.unsubscribeImu()
    pepper.stopMove()


def test_wrong_frequencies_are_refused():
    for frequency in (None, 0, -3, float("nan"), "fast"):
        with pytest.raises(SimulationError, match="frequency"):
            Imu(-1, None, frequency)
    assert Imu(-1, None, 10).getFrequency() == 10.0
