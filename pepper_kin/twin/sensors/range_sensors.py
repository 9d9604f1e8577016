"""Sonars and lasers: distances to the surroundings of the base."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_numbers
from pepper_kin.twin.sensors.reading import SensedState
from pepper_kin.twin.sensors.robot_rays import RobotRays
from pepper_kin.twin.sensors.sensor import LinearSensor
from pepper_kin.twin.sensors.specification import SensorSpecification, sensor_specifications

_RINGS = 8
_BLANK = 8
_ANGLES = 61


class Beams:
    """Rays of several sensors that are cast together; the sensors must have the same rate.

    Args:
        rays: Ray caster of the robot and its surroundings.
    """

    def __init__(self, rays: RobotRays) -> None:
        self._rays = rays
        self._fans: list[tuple[str, Array, float, slice]] = []
        self._origins, self._directions = np.empty((0, 3)), np.empty((0, 3))
        self._state: SensedState | None = None

    def add(self, frame: str, directions: Array, height: float) -> slice:
        """Add rays; return the slice of their distances.

        Args:
            frame: Name of the frame that they start from.
            directions: Unit vectors in the frame's axes, shape (k, 3).
            height: Height of the origin on the frame's z axis [m].
        """
        count = len(self._origins)
        part = slice(count, count + len(directions))
        self._fans.append((frame, directions, height, part))
        self._origins, self._directions = np.empty((part.stop, 3)), np.empty((part.stop, 3))
        return part

    def distances(self, state: SensedState) -> Array:
        """Return the distances along all rays [m], inf without a surface."""
        if state is not self._state:
            for frame, directions, height, part in self._fans:
                pose = state.pose(frame)
                self._origins[part] = pose[:3, 3] + height * pose[:3, 2]
                self._directions[part] = directions @ pose[:3, :3].T
            self._found = self._rays.distances_checked(state.q, state.scene, self._origins, self._directions)
            self._state = state
        return self._found


class _RangeSensor(LinearSensor):
    """Rays from a frame; -inf stands for too near, inf for too far or nothing."""

    uses_scene = True

    def __init__(
        self, pepper: PepperModel, specification: SensorSpecification, seed: int, beams: Beams
    ) -> None:
        super().__init__(pepper, specification, seed)
        self._beams = beams
        self.in_range = (specification.minimum, specification.maximum)


class Sonar(_RangeSensor):
    """Distance to the nearest surface within a cone about the frame's x axis.

    The cone is filled with 217 rays, on rings of equal steps in angle.  Every surface echoes: none is too
    smooth, absorbing or slanted to return an echo.
    """

    def __init__(
        self, pepper: PepperModel, specification: SensorSpecification, seed: int, beams: Beams
    ) -> None:
        super().__init__(pepper, specification, seed, beams)
        self._part = beams.add(specification.frame, cone(specification.field_of_view / 2), 0.0)

    def truth(self, state: SensedState) -> Array:
        """Return the distance [m], inf if nothing is there, shape ()."""
        return np.asarray(self._beams.distances(state)[self._part].min())


class Laser(_RangeSensor):
    """Distances along beams in a plane, from right to left, fanned evenly about the frame's x axis."""

    def __init__(
        self, pepper: PepperModel, specification: SensorSpecification, seed: int, beams: Beams
    ) -> None:
        super().__init__(pepper, specification, seed, beams)
        half = specification.field_of_view / 2
        self.angles = np.linspace(-half, half, specification.beams)
        self.shape = self.angles.shape
        self._part = beams.add(specification.frame, fan(half, specification.beams), specification.height)

    def truth(self, state: SensedState) -> Array:
        """Return the distances [m], inf without a surface, shape (beams,)."""
        return self._beams.distances(state)[self._part]


def fan(half_angle: float, beams: int) -> Array:
    """Return unit vectors about x in its plane with y, from right to left, shape (beams, 3).

    Args:
        half_angle: Angle from the axis to the first and the last vector [rad].
        beams: Number of vectors.
    """
    angles = np.linspace(-half_angle, half_angle, beams)
    return np.column_stack([np.cos(angles), np.sin(angles), np.zeros(beams)])


def cone(half_angle: float, rings: int = _RINGS) -> Array:
    """Return unit vectors that fill a cone about x: one on the axis, 6 k on the k-th ring, shape (m, 3).

    Args:
        half_angle: Angle from the axis to the last ring [rad].
        rings: Number of rings.
    """
    directions = [np.array([[1.0, 0.0, 0.0]])]
    for ring in range(1, rings + 1):
        off, around = half_angle * ring / rings, 2 * np.pi * np.arange(6 * ring) / (6 * ring)
        x = np.full(len(around), np.cos(off))
        directions.append(np.column_stack([x, np.sin(off) * np.cos(around), np.sin(off) * np.sin(around)]))
    return np.concatenate(directions)


def published_scan(pepper: PepperModel, right: ArrayLike, front: ArrayLike, left: ArrayLike) -> Array:
    """Return three laser scans as one, in the form of the robot's ROS driver.

    15 beams of the right one, 8 blanks, 15 of the front one, 8 blanks, 15 of the left one.

    Each value is the distance of the measured point from `base_footprint`, projected to the floor; blank
    beams are -1, and infinities stay.  The driver labels them with angles from -2.0944 rad on, 0.068669 rad
    apart, which are not the directions of the points.

    Args:
        pepper: The robot.
        right: Readings of the right laser [m], shape (15,).
        front: Readings of the front laser [m], shape (15,).
        left: Readings of the left laser [m], shape (15,).

    Returns:
        Ranges [m], shape (61,).

    Raises:
        InvalidValueError: for another number of beams, or NaN.
    """
    parts = []
    base = frame_pose(pepper, pepper.neutral(), "base_footprint")
    for name, measured in (("laser_right", right), ("laser_front", front), ("laser_left", left)):
        specification = sensor_specifications()[name]
        ranges = as_numbers(measured, name, (specification.beams,))
        half = specification.field_of_view / 2
        angles = np.linspace(-half, half, specification.beams)
        pose = np.linalg.inv(base) @ frame_pose(pepper, pepper.neutral(), specification.frame)
        finite = np.where(np.isfinite(ranges), ranges, 0.0)
        place = finite[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]) @ pose[:2, :2].T
        far = np.linalg.norm(place + pose[:2, 3], axis=1)
        parts += [np.where(np.isfinite(ranges), far, ranges), np.full(_BLANK, -1.0)]
    return np.concatenate(parts[:-1])
