"""Sensors of the robot: readings with noise, together with the true values.

    SensorSuite                               all of Pepper's sensors; give it to `Twin(sensors=...)`
    SensorSpecification, sensor_specifications, Reading, ReadingSeries
    Camera, CAMERAS, Intrinsics, camera_intrinsics    depth and color pictures
    RobotRays, Sight, RayCaster, RayHits      distances along rays
    BatchRanges, BatchInertial, BatchDepth, BatchSwitches   sensors of many robots at once
    published_scan                            the three laser scans as one, as ROS publishes them

Each reading holds the sensor's value and the true value.
"""

from pepper_kin.call_errors import name_options
from pepper_kin.twin.sensors.batch import BatchDepth, BatchInertial, BatchRanges, BatchSwitches
from pepper_kin.twin.sensors.camera import Camera, Intrinsics, camera_intrinsics
from pepper_kin.twin.sensors.range_sensors import published_scan
from pepper_kin.twin.sensors.raycast import RayCaster, RayHits
from pepper_kin.twin.sensors.reading import Reading
from pepper_kin.twin.sensors.recording import ReadingSeries
from pepper_kin.twin.sensors.robot_rays import RobotRays, Sight
from pepper_kin.twin.sensors.specification import SensorSpecification, sensor_specifications
from pepper_kin.twin.sensors.suite import CAMERAS, SensorSuite

__all__ = [
    "CAMERAS",
    "BatchDepth",
    "BatchInertial",
    "BatchRanges",
    "BatchSwitches",
    "Camera",
    "Intrinsics",
    "RayCaster",
    "RayHits",
    "Reading",
    "ReadingSeries",
    "RobotRays",
    "SensorSpecification",
    "SensorSuite",
    "Sight",
    "camera_intrinsics",
    "published_scan",
    "sensor_specifications",
]

name_options(__name__)
