"""Cameras and inertial units as naoqi_driver2 publishes them: its `camera_info_definitions`, `imu`."""

import numpy as np
import pinocchio as pin
import pytest

import pepper_kin as pk
from pepper_kin.naoqi.body import Body
from pepper_kin.ros.sensor_messages import CameraMessages, SensorMessages

# fx, fy, cx, cy of P, read from the driver's definitions.
DRIVER = {
    ("front", "VGA"): (551.590, 550.291, 308.271, 229.201),
    ("front", "QVGA"): (272.424, 273.516, 141.132, 107.392),
    ("front", "QQVGA"): (137.542, 136.815, 76.300, 59.391),
    ("bottom", "VGA"): (549.572, 549.687, 304.800, 248.527),
    ("bottom", "QVGA"): (273.491, 275.743, 155.112, 126.057),
    ("bottom", "QQVGA"): (138.706, 138.954, 77.254, 58.700),
    ("depth", "VGA"): (525.0, 525.0, 319.5, 239.5),
    ("depth", "QVGA"): (262.5, 262.5, 159.75, 119.75),
    ("depth", "QQVGA"): (131.25, 131.25, 79.875, 59.875),
}


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "resolution"), DRIVER)
def test_the_projection_matrix_is_the_driver_s(name, resolution):
    info = CameraMessages(Body(real_time=False), name, resolution).info(1.0)
    fx, fy, cx, cy = DRIVER[name, resolution]
    np.testing.assert_allclose(info.p, [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], atol=6e-4)
    np.testing.assert_array_equal(info.r, np.eye(3).ravel())
    assert (list(info.d) == [], info.distortion_model) == (
        (True, "") if name == "depth" else (False, "plumb_bob")
    )


def rectified(info, pixel):
    """Where P puts what K and D show at a pixel, by sensor_msgs/CameraInfo; Newton inverts Brown's lens."""
    k, (k1, k2, p1, p2, k3) = np.reshape(info.k, (3, 3)), info.d

    def lens(point):
        x, y = point
        square = x * x + y * y
        radial = 1 + k1 * square + k2 * square**2 + k3 * square**3
        return np.array([
            x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
        ])  # fmt: skip

    wanted = np.linalg.solve(k, [*pixel, 1.0])[:2]
    point = wanted.copy()
    for _ in range(20):
        slope = np.column_stack([(lens(point + h) - lens(point - h)) / 2e-6 for h in 1e-6 * np.eye(2)])
        point -= np.linalg.solve(slope, lens(point) - wanted)
    return (np.reshape(info.p, (3, 4)) @ [*point, 1.0, 1.0])[:2]


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["front", "bottom"])
@pytest.mark.parametrize("side", [(-0.42, -0.30), (0.42, 0.32)])
def test_rectified_pictures_have_points_where_p_projects_them(name, side):
    frame = {"front": "CameraTop_optical_frame", "bottom": "CameraBottom_optical_frame"}[name]
    body = Body(real_time=False)
    model = pin.buildModelFromXML(body.pepper.urdf)
    data, q = model.createData(), pin.neutral(model)
    for joint in body.index:
        if model.existJointName(joint):
            q[model.joints[model.getJointId(joint)].idx_q] = body.measured(joint)
    pin.framesForwardKinematics(model, data, q)
    offset = np.array([*side, 1.0]) * 0.6
    center = data.oMf[model.getFrameId(frame)].act(offset)
    body.scene = pk.Scene().add("ball", pk.model.Sphere(0.02), center, color=(1.0, 0.0, 0.0, 1.0))
    messages = CameraMessages(body, name, "VGA")
    picture = messages.picture().astype(int)
    rows, columns = np.nonzero((picture[..., 0] > 40) & (picture[..., 1:].max(axis=-1) < 30))
    assert rows.size > 300
    info = messages.info(0.0)
    x, y, z = np.reshape(info.p, (3, 4)) @ [*offset, 1.0]
    raw = np.array([columns.mean(), rows.mean()])
    assert rectified(info, raw) == pytest.approx([x / z, y / z], abs=0.5)
    pinhole = (np.reshape(info.k, (3, 3)) @ offset)[:2] / offset[2]
    assert np.abs(raw - pinhole).max() > 1.2  # a picture without the lens has them elsewhere


def test_inertial_units_have_the_driver_s_frames_and_unknown_covariances():
    body = Body(real_time=False)
    sensors = SensorMessages(body, noise=False)
    sensors.read()
    for part, frame in (("torso", "base_link"), ("base", "base_footprint")):
        made = sensors.inertia(part, 0.0)
        assert made.header.frame_id == frame
        for name in ("orientation", "angular_velocity", "linear_acceleration"):
            assert list(getattr(made, f"{name}_covariance")) == [-1.0] + 8 * [0.0]
