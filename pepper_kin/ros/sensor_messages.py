"""Messages of sensors: laser, sonar, inertia, bumpers, touch and cameras, in naoqi_driver2's layout."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.naoqi.body import Body
from pepper_kin.ros.message_parts import QUATERNION, header, vector
from pepper_kin.ros_messages import message_type
from pepper_kin.twin.sensors import Camera, Reading, SensorSuite, published_scan

LASER_ANGLE, LASER_STEP = 2.0944, 0.068669
"""Half of the angular range, and angular step, of the published scan [rad]."""

LASER_RANGE = (0.1, 3.0)
"""Minimum and maximum distance of the published scan [m]."""

BUMPERS = {"bumper_front_right": 0, "bumper_front_left": 1, "bumper_back": 2}
HEAD_TOUCHES = {"head_touch_front": 1, "head_touch_middle": 2, "head_touch_rear": 3}
HAND_TOUCHES = {"right_hand_touch": 0, "left_hand_touch": 3}
"""Sensor of the twin -> its number in messages of naoqi_bridge_msgs."""

CAMERAS = {
    "front": ("camera_top", "CameraTop_optical_frame"),
    "bottom": ("camera_bottom", "CameraBottom_optical_frame"),
    "depth": ("camera_depth", "CameraDepth_optical_frame"),
}
"""Name in topics -> camera of the twin and its frame."""

RECTIFIED = {
    ("camera_top", "VGA"): (551.589721679688, 550.291320800781, 308.271132841983, 229.20143668168),
    ("camera_top", "QVGA"): (272.423675537109, 273.515747070312, 141.131930791285, 107.391746054313),
    ("camera_top", "QQVGA"): (137.541534423828, 136.815216064453, 76.3004646597892, 59.3909799751191),
    ("camera_bottom", "VGA"): (549.571655273438, 549.687316894531, 304.799679526441, 248.526959297022),
    ("camera_bottom", "QVGA"): (273.491455078125, 275.743133544922, 155.112454709117, 126.057357467223),
    ("camera_bottom", "QQVGA"): (138.705535888672, 138.954086303711, 77.2544255212306, 58.7000861760043),
}
"""Camera and resolution -> fx, fy, cx, cy of the driver's P, for rectified images [pixels]."""

IMU_FRAMES = {"torso": "base_link", "base": "base_footprint"}
"""Part of the body -> frame of its inertial unit in the driver, whose `base_link` is the torso."""


class SensorMessages:
    """Messages of the sensors of a simulated body.

    Args:
        body: The simulated body.
        noise: Whether readings have the sensors' noise.
    """

    def __init__(self, body: Body, *, noise: bool = True) -> None:
        self.body = body
        self._suite = SensorSuite(body.pepper, noise=noise)
        self._readings: dict[str, Reading] = {}
        self._pressed: dict[str, bool] = {}

    def read(self) -> None:
        """Read the sensors that are due; called once a cycle, with the body's lock held."""
        body, state = self.body, self.body.state
        self._readings.update(
            self._suite.read(
                body.time.now,
                state.position,
                state.velocity,
                state.acceleration,
                state.torque,
                scene=body.scene,
            )
        )

    @property
    def odometry(self) -> Array:
        """Pose of the base from wheel odometry: x, y [m], yaw [rad], shape (3,)."""
        return np.asarray(self._readings["wheel_odometry"].value, dtype=float)[:3]

    def scan(self, time: float) -> Any:
        """Return sensor_msgs/msg/LaserScan at a time [s]: 15 right, 8 blank, 15 front, 8 blank, 15 left."""
        parts = [self._readings[f"laser_{side}"].value for side in ("right", "front", "left")]
        ranges = published_scan(self.body.pepper, *parts)
        return message_type("sensor_msgs/msg/LaserScan")(
            header=header(time, "base_footprint"),
            angle_min=-LASER_ANGLE,
            angle_max=LASER_ANGLE,
            angle_increment=LASER_STEP,
            range_min=LASER_RANGE[0],
            range_max=LASER_RANGE[1],
            ranges=ranges.tolist(),
        )

    def sonar(self, side: str, time: float) -> Any:
        """Return sensor_msgs/msg/Range of the "front" or "back" sonar at a time [s]."""
        reading = self._readings[f"sonar_{side}"]
        specification = self._suite.sensors[f"sonar_{side}"].specification
        kind = message_type("sensor_msgs/msg/Range")
        return kind(
            header=header(time, reading.frame),
            radiation_type=0,
            field_of_view=specification.field_of_view,
            min_range=specification.minimum,
            max_range=specification.maximum,
            range=float(reading.value),
        )

    def inertia(self, part: str, time: float) -> Any:
        """Return sensor_msgs/msg/Imu of the "torso" or the "base" at a time [s]."""
        turn = self._readings[f"imu_{part}_orientation"]
        x, y, z, w = np.asarray(turn.value, dtype=float).tolist()
        made = message_type("sensor_msgs/msg/Imu")(header=header(time, IMU_FRAMES[part]))
        for unknown in ("orientation", "angular_velocity", "linear_acceleration"):
            getattr(made, f"{unknown}_covariance")[0] = -1.0
        made.orientation = QUATERNION(x=x, y=y, z=z, w=w)
        made.angular_velocity = vector(self._readings[f"imu_{part}_gyroscope"].value)
        made.linear_acceleration = vector(self._readings[f"imu_{part}_accelerometer"].value)
        return made

    def touches(self) -> list[tuple[str, Any]]:
        """Return topic and message of each bumper and touch sensor that was pressed or released."""
        changed = []
        for topic, kind, field, sensors in (
            ("bumper", "Bumper", "bumper", BUMPERS),
            ("head_touch", "HeadTouch", "button", HEAD_TOUCHES),
            ("hand_touch", "HandTouch", "hand", HAND_TOUCHES),
        ):
            for sensor, number in sensors.items():
                pressed = bool(self._readings[sensor].value)
                if pressed != self._pressed.get(sensor, False):
                    self._pressed[sensor] = pressed
                    made = message_type(f"naoqi_bridge_msgs/msg/{kind}")(
                        **{field: number, "state": int(pressed)}
                    )
                    changed.append((topic, made))
        return changed


class CameraMessages:
    """Messages of one camera.

    Args:
        body: The simulated body.
        name: Name in topics: "front", "bottom" or "depth".
        resolution: Resolution of the images: "VGA", "QVGA" or "QQVGA".
    """

    def __init__(self, body: Body, name: str, resolution: str = "QVGA") -> None:
        camera, self.frame = CAMERAS[name]
        self.body, self.is_depth = body, name == "depth"
        self._camera = Camera(body.pepper, camera, resolution, lens=True)
        lens = self._camera.intrinsics
        self._rectified = RECTIFIED.get((camera, resolution), (lens.fx, lens.fy, lens.cx, lens.cy))

    def picture(self) -> NDArray[Any]:
        """Return the present image: colors, or depths [mm]; takes the body's lock for a moment."""
        body = self.body
        with body.time.lock:
            q = body.configuration(True)
        if not self.is_depth:
            return np.asarray(self._camera.color(q, body.scene))
        depth = self._camera.depth(q, body.scene)
        finite = np.where(np.isfinite(depth), depth, 0.0)
        return np.clip(np.round(1000.0 * finite), 0, 65535).astype("<u2")

    def image(self, picture: NDArray[Any], time: float) -> Any:
        """Return sensor_msgs/msg/Image: rgb8, or 16UC1 in millimeters.

        Args:
            picture: Image of this camera, shape (height, width, 3) or (height, width).
            time: Time of the stamp [s].
        """
        height, width = picture.shape[:2]
        return message_type("sensor_msgs/msg/Image")(
            header=header(time, self.frame),
            height=height,
            width=width,
            encoding="16UC1" if self.is_depth else "rgb8",
            is_bigendian=0,
            step=picture.strides[0],
            data=picture.tobytes(),
        )

    def info(self, time: float) -> Any:
        """Return sensor_msgs/msg/CameraInfo at a time [s]; as in the driver, depths have no distortion."""
        lens, (fx, fy, cx, cy) = self._camera.intrinsics, self._rectified
        return message_type("sensor_msgs/msg/CameraInfo")(
            header=header(time, self.frame),
            height=lens.height,
            width=lens.width,
            distortion_model="" if self.is_depth else "plumb_bob",
            d=[] if self.is_depth else [lens.k1, lens.k2, lens.p1, lens.p2, lens.k3],
            k=[lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0],
            r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        )
