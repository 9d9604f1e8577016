"""Keys of ALMemory that drivers read: "Device/SubDeviceList/..."."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import partial
from operator import getitem

import numpy as np

from pepper_kin.model import rpy_from_rotation
from pepper_kin.naoqi.body import Body
from pepper_kin.naoqi.joint_names import ACTUATED, BODY, WHEELS
from pepper_kin.naoqi.tables import table
from pepper_kin.twin.sensors import Reading, SensorSuite, sensor_specifications

TOP = "Device/SubDeviceList/"

SENSOR_PERIOD = 0.02
"""Time for which a sensor reading is reused [s]."""

FARTHEST = {"laser": 3.0, "sonar": 5.0}
"""Reading of a beam without an echo [m]."""

BEAM_YAWS = np.deg2rad(np.linspace(30.0, -30.0, 15))
"""Yaws of a laser's 15 beams in the frame of the laser, from left to right [rad]."""


class DeviceKeys:
    """Values of the keys of the body's devices, computed on access.

    Args:
        body: The simulated body.

    Attributes:
        pressed: Names of the touch sensors that are pressed from outside.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.pressed: set[str] = set()
        self._suites: dict[str, SensorSuite] = {}
        self._readings: dict[str, tuple[float, dict[str, Reading]]] = {}
        self._makers: dict[str, Callable[[], object]] = {}
        self._fill()

    @property
    def names(self) -> list[str]:
        """All keys."""
        return list(self._makers)

    def __contains__(self, key: object) -> bool:
        return key in self._makers

    def __getitem__(self, key: str) -> object:
        with self.body.time.lock:
            return self._makers[key]()

    def get(self, key: str) -> object:
        """Return the value of a key, or None for an unknown key."""
        maker = self._makers.get(key)
        return None if maker is None else self[key]

    def reading(self, sensor: str) -> Reading:
        """Return the present reading of a twin's sensor; all sensors of its kind are read, no others."""
        now, kind = self.body.time.now, sensor.split("_")[0]
        read_at, readings = self._readings.get(kind, (-math.inf, {}))
        if now >= read_at + SENSOR_PERIOD:
            state, suite = self.body.state, self._suite(kind)
            suite.reset()
            readings = suite.read(
                now, state.position, state.velocity, state.acceleration, state.torque, scene=self.body.scene
            )
            self._readings[kind] = now, readings
        return readings[sensor]

    def _suite(self, kind: str) -> SensorSuite:
        """Return the sensors of a kind, whose names begin with `kind`."""
        if kind not in self._suites:
            names = [name for name in sensor_specifications() if name.split("_")[0] == kind]
            self._suites[kind] = SensorSuite(self.body.pepper, sensors=names, noise=False)
        return self._suites[kind]

    def touched(self, sensor: str) -> bool:
        """Return whether a bumper or a touch sensor is pressed, by the scene or from outside."""
        return sensor in self.pressed or bool(self.reading(sensor).value)

    def _fill(self) -> None:
        """Add all keys, with functions that return their values."""
        body, keys = self.body, self._makers
        for name in BODY:
            at = TOP + name
            keys[f"{at}/Position/Sensor/Value"] = partial(body.measured, name)
            keys[f"{at}/Position/Actuator/Value"] = partial(body.commanded, name)
            keys[f"{at}/Hardness/Actuator/Value"] = partial(getitem, body.stiffness, name)
            keys[f"{at}/Stiffness/Actuator/Value"] = partial(getitem, body.stiffness, name)
            keys[f"{at}/Temperature/Sensor/Value"] = lambda: 38.0
            keys[f"{at}/Temperature/Sensor/Status"] = lambda: 0
        for name in ACTUATED:
            k = body.index[name]
            keys[f"{TOP}{name}/Torque/Sensor/Value"] = partial(self._state, "torque", k)
            keys[f"{TOP}{name}/Velocity/Sensor/Value"] = partial(self._state, "velocity", k)
        for index, name in enumerate(WHEELS):
            keys[f"{TOP}{name}/Speed/Sensor/Value"] = partial(self._wheel_speed, index)
            keys[f"{TOP}{name}/Speed/Actuator/Value"] = keys[f"{TOP}{name}/Speed/Sensor/Value"]
        for key, sensor in table("devices")["touches"].items():
            keys[f"{TOP}{key}/Sensor/Value"] = partial(self._touch, sensor)
            keys[table("devices")["events"][sensor]] = partial(self._touch, sensor)
        for side in ("Front", "Back"):
            keys[f"{TOP}Platform/{side}/Sonar/Sensor/Value"] = partial(self._sonar, side)
        self._add_lasers()
        self._add_inertial()
        for key, value in (table("devices")["values"] | table("modules")["nothing"]).items():
            keys[key] = partial(copy.copy, value)
        keys["robotIsWakeUp"] = lambda: body.awake

    def _add_lasers(self) -> None:
        keys = self._makers
        for side in ("Front", "Left", "Right"):
            for segment in range(15):
                at = f"{TOP}Platform/LaserSensor/{side}/Horizontal/Seg{segment + 1:02d}"
                for axis, letter in enumerate("XY"):
                    keys[f"{at}/{letter}/Sensor/Value"] = partial(self._beam, side, segment, axis)
        for segment in range(3):
            at = f"{TOP}Platform/LaserSensor/Front/Shovel/Seg{segment + 1:02d}"
            # The shovel laser points at the floor 10 cm ahead and detects nothing on a flat floor.
            keys[f"{at}/X/Sensor/Value"] = lambda: FARTHEST["laser"]
            keys[f"{at}/Y/Sensor/Value"] = lambda: 0.0

    def _add_inertial(self) -> None:
        keys = self._makers
        for board, part in (("InertialSensor", "torso"), ("InertialSensorBase", "base")):
            for axis, letter in enumerate("XYZ"):
                for device, sensor in (
                    ("Gyroscope", "gyroscope"),
                    ("Gyr", "gyroscope"),
                    ("Accelerometer", "accelerometer"),
                    ("Acc", "accelerometer"),
                ):
                    keys[f"{TOP}{board}/{device}{letter}/Sensor/Value"] = partial(
                        self._inertial, part, sensor, axis
                    )
                keys[f"{TOP}{board}/Angle{letter}/Sensor/Value"] = partial(self._tilt, part, axis)

    def _state(self, quantity: str, joint: int) -> float:
        return float(getattr(self.body.state, quantity)[joint])

    def _wheel_speed(self, wheel: int) -> float:
        return float(self.body.controller.wheel_speeds[wheel])

    def _touch(self, sensor: str) -> float:
        return float(self.touched(sensor))

    def _inertial(self, part: str, sensor: str, axis: int) -> float:
        return float(self.reading(f"imu_{part}_{sensor}").value[axis])

    def _tilt(self, part: str, axis: int) -> float:
        frame = "ImuTorsoGyrometer_frame" if part == "torso" else "ImuBaseGyrometer_frame"
        return float(rpy_from_rotation(self.body.frame_pose(frame, True)[:3, :3])[axis])

    def _sonar(self, side: str) -> float:
        value = float(self.reading(f"sonar_{side.lower()}").value)
        return value if math.isfinite(value) else FARTHEST["sonar"] if value > 0 else 0.25

    def _beam(self, side: str, segment: int, axis: int) -> float:
        """Return x or y of the echo of a beam in the frame of the laser [m]."""
        reading = np.asarray(self.reading(f"laser_{side.lower()}").value, dtype=float)[::-1]
        distance = float(reading[segment])
        if not math.isfinite(distance):
            distance = FARTHEST["laser"] if distance > 0 else 0.1
        yaw = float(BEAM_YAWS[segment])
        return distance * (math.sin(yaw) if axis else math.cos(yaw))
