"""What sensors of many robots would read, without noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.kinematics import frame_acceleration, frame_pose, frame_velocity
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors
from pepper_kin.twin.sensors.camera import Intrinsics, camera_intrinsics
from pepper_kin.twin.sensors.range_sensors import cone, fan
from pepper_kin.twin.sensors.raycast import RayCaster, Rays
from pepper_kin.twin.sensors.specification import SensorSpecification, sensor_specifications

_COARSE = 5


class BatchRanges:
    """Lasers and sonars of N robots in one scene; the robots themselves are not seen.

    Args:
        pepper: The robot.
        scene: What stands around it.
        names: Of the sensors, such as "laser_front" or "sonar_front"; the lasers if omitted.
        floor: Whether there is a floor at z = 0 besides what the scene holds.

    Raises:
        UnknownNameError: for a sensor or a frame that there is not.
    """

    def __init__(
        self, pepper: PepperModel, scene: Scene, names: tuple[str, ...] = (), *, floor: bool = True
    ) -> None:
        known = sensor_specifications()
        ranging = {name: each for name, each in known.items() if each.kind in ("laser", "sonar")}
        self._pepper, self._fans = pepper, []
        for name in names or tuple(name for name in ranging if ranging[name].kind == "laser"):
            if name not in ranging:
                raise UnknownNameError("range sensor", name, ranging)
            pepper.frame_id(ranging[name].frame)
            self._fans.append((ranging[name], _directions(ranging[name])))
        self._caster = _caster(scene, floor)

    def read(self, q: ArrayLike) -> Array:
        """Return the distances along all beams, a sonar's the least of its cone [m].

        -inf stands for too near and inf for too far or nothing, as in readings of a `SensorSuite`.

        Args:
            q: Joint positions [rad or m], shape (N, n).

        Returns:
            Shape (N, beams), the sensors side by side.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        states = np.atleast_2d(as_joint_vectors(self._pepper, q, "q"))
        count, width = len(states), sum(len(directions) for _, directions in self._fans)
        origins, aims, most = (
            np.empty((count, width, 3)),
            np.empty((count, width, 3)),
            np.empty((count, width)),
        )
        parts, end = [], 0
        for specification, directions in self._fans:
            part = slice(end, end + len(directions))
            pose = frame_pose(self._pepper, states, specification.frame)
            origins[:, part] = (pose[:, :3, 3] + specification.height * pose[:, :3, 2])[:, np.newaxis]
            aims[:, part] = directions @ pose[:, :3, :3].transpose(0, 2, 1)
            most[:, part], end = specification.maximum, part.stop
            parts.append((specification, part))
        rays = Rays(origins.reshape(-1, 3), aims.reshape(-1, 3), most.ravel(), (count, width))
        far, found = self._caster.distances_checked(rays).reshape(count, width), []
        for specification, part in parts:
            own = far[:, part]
            own = own.min(axis=1, keepdims=True) if specification.kind == "sonar" else own
            own = np.where(own > specification.maximum, np.inf, own)
            found.append(np.where(own < specification.minimum, -np.inf, own))
        return np.concatenate(found, axis=1)


class BatchDepth:
    """A depth camera of N robots in one scene; the robots themselves are not seen.

    Args:
        pepper: The robot.
        scene: What stands around it.
        intrinsics: Of the camera; a fifth of the columns and rows of `camera_depth` in QVGA if omitted.
        name: "camera_depth", or another camera.
        floor: Whether there is a floor at z = 0 besides what the scene holds.

    Raises:
        UnknownNameError: for a camera or a frame that there is not.
    """

    def __init__(
        self,
        pepper: PepperModel,
        scene: Scene,
        intrinsics: Intrinsics | None = None,
        name: str = "camera_depth",
        *,
        floor: bool = True,
    ) -> None:
        full = camera_intrinsics(name, "QVGA")
        small = Intrinsics(
            full.width // _COARSE, full.height // _COARSE, *(x / _COARSE for x in (full.fx, full.fy)),
            *((x + 0.5) / _COARSE - 0.5 for x in (full.cx, full.cy)),
        )  # fmt: skip
        self._pepper, self._caster = pepper, _caster(scene, floor)
        self._frame = sensor_specifications()[name].frame
        pepper.frame_id(self._frame)
        points = (small if intrinsics is None else intrinsics).rays()
        self.shape = points.shape[:2]
        self._away = np.linalg.norm(points, axis=2).ravel()
        self._directions = points.reshape(-1, 3) / self._away[:, np.newaxis]

    def read(self, q: ArrayLike) -> Array:
        """Return distances along the optical axis [m], inf where nothing is.

        Args:
            q: Joint positions [rad or m], shape (N, n).

        Returns:
            Shape (N, rows, columns).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        states = np.atleast_2d(as_joint_vectors(self._pepper, q, "q"))
        pose = frame_pose(self._pepper, states, self._frame)
        aims = self._directions @ pose[:, :3, :3].transpose(0, 2, 1)
        origins = np.repeat(pose[:, np.newaxis, :3, 3], len(self._directions), axis=1)
        shape = aims.shape[:2]
        rays = Rays(origins.reshape(-1, 3), aims.reshape(-1, 3), np.full(aims[..., 0].size, np.inf), shape)
        far = self._caster.distances_checked(rays).reshape(shape) / self._away
        return np.asarray(far.reshape(-1, *self.shape))


class BatchInertial:
    """Accelerometers and gyroscopes of N robots.

    Args:
        pepper: The robot.
        names: Of the sensors; all that its base and torso have if omitted.

    Raises:
        UnknownNameError: for a sensor or a frame that there is not.
    """

    def __init__(self, pepper: PepperModel, names: tuple[str, ...] = ()) -> None:
        known = sensor_specifications()
        inertial = {n: each for n, each in known.items() if each.kind in ("accelerometer", "gyroscope")}
        for name in names:
            if name not in inertial:
                raise UnknownNameError("inertial sensor", name, inertial)
        self._pepper, self._sensors = pepper, [inertial[name] for name in names or inertial]
        for sensor in self._sensors:
            pepper.frame_id(sensor.frame)

    def read(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return specific forces R^T (a - g) [m/s^2] and angular velocities [rad/s] in the frames' axes.

        Args:
            q: Joint positions [rad or m], shape (N, n).
            v: Joint velocities, shape (N, n).
            a: Joint accelerations, shape (N, n).

        Returns:
            Shape (N, 3 k), the sensors side by side.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        gravity, found = np.array(self._pepper.inner_model.gravity.linear), []
        for sensor in self._sensors:
            turn = frame_pose(self._pepper, q, sensor.frame)[..., :3, :3]
            if sensor.kind == "gyroscope":
                seen = frame_velocity(self._pepper, q, v, sensor.frame)[..., 3:]
            else:
                seen = frame_acceleration(self._pepper, q, v, a, sensor.frame)[..., :3] - gravity
            found.append(np.einsum("...ji,...j->...i", turn, seen))
        return np.concatenate([np.atleast_2d(part) for part in found], axis=1)


def _caster(scene: Scene, floor: bool) -> RayCaster:
    """Return a caster of rays at a scene, and at a floor at z = 0."""
    scene = scene.add_half_space("floor of rays", (0.0, 0.0, 1.0)) if floor else scene
    items = list(scene.objects.values())
    poses = np.array([item.transform_object_to_world for item in items]).reshape(-1, 4, 4)
    return RayCaster([item.geometry for item in items], poses)


def _directions(specification: SensorSpecification) -> Array:
    """Return the beams of a sensor in its frame, shape (k, 3)."""
    half = specification.field_of_view / 2
    return cone(half) if specification.kind == "sonar" else fan(half, specification.beams)
